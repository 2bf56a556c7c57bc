//! The graphics device, with or without a window.

use std::sync::{Arc, Mutex, PoisonError};

use crate::{Error, Result};

const NO_ADAPTER: &str = "none was found. Install a Vulkan driver (on Debian without a graphics card: apt-get install \
     mesa-vulkan-drivers libvulkan1), or choose another backend with the environment variable WGPU_BACKEND";

/// A device, its queue, and what went wrong with them.
#[derive(Clone)]
pub struct Context {
    adapter: wgpu::Adapter,
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    /// Errors that no call returns: validation, memory, a lost device. Only the first is kept.
    fault: Arc<Mutex<Option<String>>>,
}

impl Context {
    /// A device without a window, on the best adapter; WGPU_BACKEND and WGPU_ADAPTER_NAME choose another.
    ///
    /// # Errors
    /// [`Error::Adapter`] if there is none, saying what to install.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn headless() -> Result<Self> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        pollster::block_on(Self::new(&instance, None))
    }

    /// A device that can present to `surface`, if one is given.
    ///
    /// # Errors
    /// [`Error::Adapter`] if there is none, or it lacks what WebGPU guarantees.
    pub async fn new(instance: &wgpu::Instance, surface: Option<&wgpu::Surface<'_>>) -> Result<Self> {
        #[cfg(not(target_arch = "wasm32"))]
        let adapter = wgpu::util::initialize_adapter_from_env_or_default(instance, surface).await;
        #[cfg(target_arch = "wasm32")]
        let adapter = instance
            .request_adapter(&wgpu::RequestAdapterOptions {
                power_preference: wgpu::PowerPreference::HighPerformance,
                compatible_surface: surface,
                ..Default::default()
            })
            .await;
        let adapter = adapter.map_err(|error| Error::Adapter(format!("{NO_ADAPTER} ({error})")))?;
        let (device, queue) = adapter
            .request_device(&wgpu::DeviceDescriptor {
                label: Some("eigentile"),
                required_features: adapter.features()
                    & (wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::SHADER_F16),
                required_limits: limits(&adapter.limits()),
                ..Default::default()
            })
            .await
            .map_err(|error| Error::Adapter(format!("{}: {error}", adapter.get_info().name)))?;
        let fault = Arc::new(Mutex::new(None));
        let keep = |fault: &Mutex<Option<String>>, message: String| {
            fault
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .get_or_insert(message);
        };
        let errors = fault.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            keep(&errors, error.to_string())
        }));
        let losses = fault.clone();
        device.set_device_lost_callback(move |reason, message| {
            // Dropping the device is no loss.
            if reason != wgpu::DeviceLostReason::Destroyed {
                keep(&losses, format!("the device was lost: {message}"));
            }
        });
        Ok(Self {
            adapter,
            device,
            queue,
            fault,
        })
    }

    /// Prepares a surface of so many pixels for pictures that are encoded in sRGB already, and for new ones at the pace of the
    /// screen.
    ///
    /// # Errors
    /// [`Error::Adapter`] if this device cannot draw into it, [`Error::Budget`] for no pixels or more than it has.
    pub fn configure(
        &self,
        surface: &wgpu::Surface<'_>,
        size: (u32, u32),
    ) -> Result<wgpu::SurfaceConfiguration> {
        let most = self.device.limits().max_texture_dimension_2d;
        if !(1..=most).contains(&size.0) || !(1..=most).contains(&size.1) {
            return Err(Error::Budget(format!(
                "a surface of {}x{} pixels: sides from 1 to {most} can be drawn on this adapter",
                size.0, size.1
            )));
        }
        let mut configuration = surface
            .get_default_config(&self.adapter, size.0, size.1)
            .ok_or_else(|| Error::Adapter(format!("{} cannot draw into this surface", self.adapter())))?;
        let formats = surface.get_capabilities(&self.adapter).formats;
        let plain = [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm];
        if let Some(format) = formats.iter().find(|format| plain.contains(format)) {
            configuration.format = *format;
        }
        configuration.view_formats.clear();
        surface.configure(&self.device, &configuration);
        self.check()?;
        Ok(configuration)
    }

    /// Name of the adapter and its driver.
    pub fn adapter(&self) -> String {
        let info = self.device.adapter_info();
        format!(
            "{} ({} {}, {})",
            info.name, info.driver, info.driver_info, info.backend
        )
    }

    /// The device, for what a program draws beside the engine's pictures.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// The device's queue.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Whether the adapter is a program that runs on the processor.
    pub fn is_software(&self) -> bool {
        self.device.adapter_info().device_type == wgpu::DeviceType::Cpu
    }

    /// Whether shaders can reckon with half floats.
    pub fn has_half_arithmetic(&self) -> bool {
        self.device.features().contains(wgpu::Features::SHADER_F16)
    }

    /// Whether passes can be timed.
    pub(crate) fn has_timestamps(&self) -> bool {
        self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY)
    }

    /// Fails if anything has gone wrong on the device since the start.
    pub(crate) fn check(&self) -> Result<()> {
        match &*self.fault.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(message) => Err(Error::Adapter(format!("{}: {message}", self.adapter()))),
            None => Ok(()),
        }
    }

    /// Waits for all submitted work. Returns at once in browsers, where nothing may wait.
    pub(crate) fn wait(&self) -> Result<()> {
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|error| Error::Adapter(error.to_string()))?;
        self.check()
    }
}

/// WebGPU's default limits, with textures and buffers as large as the adapter has them.
fn limits(adapter: &wgpu::Limits) -> wgpu::Limits {
    wgpu::Limits {
        max_texture_dimension_2d: adapter.max_texture_dimension_2d,
        max_texture_array_layers: adapter.max_texture_array_layers,
        max_buffer_size: adapter.max_buffer_size,
        max_storage_buffer_binding_size: adapter.max_storage_buffer_binding_size,
        ..wgpu::Limits::default()
    }
}
