//! A scene or an archive in a canvas, as JavaScript sees it. What can be done with it is in `input` and `settings`.

mod input;
mod settings;

use std::time::Duration;

use engine::{
    frame::{Budgets, Options},
    gpu::{Area, Context},
    stream::{RangeSource, RetriedSource, RetryOptions},
};
use viewer::{Connection, Subject, Viewer};
use wasm_bindgen::prelude::*;
use web_sys::HtmlCanvasElement;

use self::settings::caches;
use crate::{database::Database, fetch::FetchTransport, fetch::Fetcher, kept::KeptSource};

#[wasm_bindgen]
extern "C" {
    #[wasm_bindgen(js_namespace = performance)]
    fn now() -> f64;
    #[wasm_bindgen(js_namespace = console)]
    fn error(text: &str);
}

/// Says in the console why the module stopped, if it ever does.
#[wasm_bindgen(start)]
fn start() {
    std::panic::set_hook(Box::new(|info| error(&info.to_string())));
}

/// Where the records come from, and what may be used.
#[wasm_bindgen]
pub struct Setting {
    canvas: HtmlCanvasElement,
    fetcher: Fetcher,
    database: Database,
    tiles: String,
    /// Bytes of both caches on the GPU.
    cache_bytes: f64,
    /// What [`HtmlCanvasElement`]s are made of here: `bgra8unorm`, or `rgba8unorm`.
    bgra: bool,
}

#[wasm_bindgen]
impl Setting {
    /// A canvas of the size of the picture, `Fetcher` and `Store` of the package, the address of the folder of archives,
    /// bytes of both caches together, and what `navigator.gpu.getPreferredCanvasFormat()` says.
    #[wasm_bindgen(constructor)]
    pub fn new(
        canvas: HtmlCanvasElement,
        fetcher: Fetcher,
        database: Database,
        tiles: String,
        cache_bytes: f64,
        format: &str,
    ) -> Self {
        Self {
            canvas,
            fetcher,
            database,
            tiles,
            cache_bytes,
            bgra: format == "bgra8unorm",
        }
    }
}

/// A scene or an archive in a canvas.
#[wasm_bindgen]
pub struct Session {
    viewer: Viewer,
    surface: wgpu::Surface<'static>,
    format: wgpu::TextureFormat,
    /// When the last frame was, in milliseconds.
    last: Option<f64>,
}

#[wasm_bindgen]
impl Session {
    /// Opens an archive of the folder, by its name without extension.
    ///
    /// # Errors
    /// If there is no adapter, or no memory.
    pub async fn archive(setting: Setting, name: String) -> Result<Self, JsError> {
        Self::open(setting, Subject::Archive(name)).await
    }

    /// Opens a glTF scene, with its [`externals`] in their order.
    ///
    /// # Errors
    /// If the scene does not hold together, or there is no adapter.
    pub async fn scene(
        setting: Setting,
        name: String,
        bytes: Vec<u8>,
        buffers: Vec<js_sys::Uint8Array>,
    ) -> Result<Self, JsError> {
        let buffers = buffers.iter().map(js_sys::Uint8Array::to_vec).collect();
        let loaded = scenes::gltf::parse(&name, &bytes, buffers)?;
        Self::open(setting, Subject::Scene(loaded.scene)).await
    }

    async fn open(setting: Setting, subject: Subject) -> Result<Self, JsError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::BROWSER_WEBGPU,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let size = (setting.canvas.width().max(1), setting.canvas.height().max(1));
        let surface = instance.create_surface(wgpu::SurfaceTarget::Canvas(setting.canvas))?;
        let context = Context::new(&instance, Some(&surface)).await?;
        let retry = RetryOptions {
            seed: (now() * 1e3) as u64,
            ..RetryOptions::default()
        };
        let clock = || Duration::from_secs_f64(now() / 1e3);
        let host = RangeSource::new(FetchTransport::new(setting.fetcher), &setting.tiles);
        let checked = RetriedSource::with_clock(host, retry, Box::new(clock));
        let source = KeptSource::new(checked, setting.database);
        let options = Options {
            size,
            budgets: caches(Budgets::default(), setting.cache_bytes),
            wait: false,
            ..Options::default()
        };
        let viewer = Viewer::new(context, subject, Box::new(source), options)?;
        let session = Self {
            viewer,
            surface,
            format: match setting.bgra {
                true => wgpu::TextureFormat::Bgra8Unorm,
                false => wgpu::TextureFormat::Rgba8Unorm,
            },
            last: None,
        };
        session.configure(size);
        Ok(session)
    }

    fn configure(&self, (width, height): (u32, u32)) {
        let configuration = wgpu::SurfaceConfiguration {
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            format: self.format,
            color_space: wgpu::SurfaceColorSpace::Auto,
            width,
            height,
            present_mode: wgpu::PresentMode::AutoVsync,
            desired_maximum_frame_latency: 2,
            alpha_mode: wgpu::CompositeAlphaMode::Opaque,
            view_formats: Vec::new(),
        };
        self.surface
            .configure(self.viewer.engine().context().device(), &configuration);
    }

    /// One frame, at this time in milliseconds. Returns whether the picture is another one.
    ///
    /// # Errors
    /// If the device fails.
    pub fn frame(&mut self, milliseconds: f64) -> Result<bool, JsError> {
        let seconds = self.last.map_or(0.0, |last| (milliseconds - last) / 1e3);
        self.last = Some(milliseconds);
        // Not further than this: the page may have slept for hours.
        let drawn = self.viewer.frame(seconds.clamp(0.0, 0.25) as f32)?.frame.drawn;
        if drawn {
            self.present()?;
        }
        Ok(drawn)
    }

    /// Shows the last picture again. What the canvas holds can be read until the script returns to the browser.
    ///
    /// # Errors
    /// If the device fails.
    pub fn present(&mut self) -> Result<(), JsError> {
        use wgpu::CurrentSurfaceTexture::{Suboptimal, Success};
        let (Success(texture) | Suboptimal(texture)) = self.surface.get_current_texture() else {
            return Ok(()); // the next frame has one
        };
        let view = texture.texture.create_view(&Default::default());
        let context = self.viewer.engine().context().clone();
        let mut encoder = context.device().create_command_encoder(&Default::default());
        let size = (texture.texture.width(), texture.texture.height());
        let area = Area {
            width: size.0,
            height: size.1,
            ..Area::default()
        };
        self.viewer
            .present(&mut encoder, &view, self.format, size, area, 1.0)?;
        context.queue().submit([encoder.finish()]);
        context.queue().present(texture);
        Ok(())
    }

    /// Changes the size of picture and canvas, in pixels.
    ///
    /// # Errors
    /// For more than the adapter has; then all stays as it is.
    pub fn resize(&mut self, width: u32, height: u32) -> Result<(), JsError> {
        let size = (width.max(1), height.max(1));
        if size != self.viewer.size() {
            self.viewer.resize(size)?;
            self.configure(size);
        }
        Ok(())
    }

    /// 0 while everything answers, 1 while something that failed is asked for again, 2 when the host cannot be reached.
    #[wasm_bindgen(getter)]
    pub fn connection(&self) -> u32 {
        match self.viewer.report().connection {
            Connection::Fine => 0,
            Connection::Waiting => 1,
            Connection::Lost(_) => 2,
        }
    }

    /// Whether the first picture of a material is there.
    #[wasm_bindgen(getter)]
    pub fn shown(&self) -> bool {
        self.viewer.report().shown
    }

    /// Whether nothing more is to come.
    #[wasm_bindgen(getter)]
    pub fn settled(&self) -> bool {
        self.viewer.report().frame.settled
    }

    /// Name of the adapter.
    #[wasm_bindgen(getter)]
    pub fn adapter(&self) -> String {
        self.viewer.engine().adapter()
    }

    /// Figures of the last frame and since the start, as JSON: `Report` in the package's `index.d.ts`.
    ///
    /// # Errors
    /// None that can happen.
    pub fn report(&self) -> Result<String, JsError> {
        Ok(serde_json::to_string(self.viewer.report())?)
    }
}
