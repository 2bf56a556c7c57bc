//! A scene or an archive in a canvas, as JavaScript sees it.

use std::time::Duration;

use engine::{
    Overlay,
    frame::{Budgets, Options},
    gpu::{Area, Context},
    stream::{RangeSource, RetriedSource, RetryOptions},
};
use glam::Vec2;
use viewer::{
    Command, Connection, Input, Link, Subject, Viewer,
    input::{Button, Modifiers, Phase},
    keys,
};
use wasm_bindgen::prelude::*;
use web_sys::HtmlCanvasElement;

use crate::{database::Database, fetch::FetchTransport, fetch::Fetcher, kept::KeptSource};

/// Least bytes of both caches together.
const LEAST_CACHE_BYTES: f64 = (1u64 << 20) as f64;

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

/// URIs of the buffers that lie beside a glTF file, to be loaded before [`Session::scene`].
///
/// # Errors
/// If it is no glTF, or names files outside of its folder.
#[wasm_bindgen]
pub fn externals(name: &str, bytes: &[u8]) -> Result<Vec<String>, JsError> {
    Ok(scenes::gltf::externals(name, bytes)?)
}

/// Keys and gestures, and what they do, in turns.
#[wasm_bindgen]
pub fn help() -> Vec<String> {
    let pairs = keys::HELP.iter();
    pairs
        .flat_map(|(key, does)| [(*key).into(), (*does).into()])
        .collect()
}

/// Names of what can lie over the picture, and what they say in words, in turns.
#[wasm_bindgen]
pub fn overlays() -> Vec<String> {
    let pairs = Overlay::ALL.iter();
    pairs
        .flat_map(|overlay| [overlay.name().into(), overlay.title().into()])
        .collect()
}

/// Labels and colours (`#rrggbb`) of an overlay's legend, in turns; none for an unknown name.
#[wasm_bindgen]
pub fn legend(overlay: &str) -> Vec<String> {
    let legend = Overlay::from_name(overlay)
        .map(Overlay::legend)
        .unwrap_or_default();
    let pairs = legend.into_iter();
    pairs
        .flat_map(|(label, [r, g, b])| [label, format!("#{r:02x}{g:02x}{b:02x}")])
        .collect()
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

    /// A button goes down: 0 the primary, 1 the middle, 2 the secondary one, as in the DOM.
    ///
    /// # Errors
    /// If the device fails.
    pub fn down(&mut self, button: u16, x: f32, y: f32, shift: bool, control: bool) -> Result<(), JsError> {
        let button = match button {
            0 => Button::Primary,
            1 => Button::Middle,
            _ => Button::Secondary,
        };
        let modifiers = Modifiers { shift, control };
        let at = Vec2::new(x, y);
        self.input(Input::Down {
            button,
            at,
            modifiers,
        })
        .map(drop)
    }

    /// The pointer moves.
    ///
    /// # Errors
    /// If the device fails.
    pub fn moved(&mut self, x: f32, y: f32) -> Result<(), JsError> {
        self.input(Input::Move { at: Vec2::new(x, y) }).map(drop)
    }

    /// Buttons are released.
    ///
    /// # Errors
    /// None that can happen.
    pub fn up(&mut self) -> Result<(), JsError> {
        self.input(Input::Up).map(drop)
    }

    /// The wheel turns by so many pixels; positive away from the user.
    ///
    /// # Errors
    /// None that can happen.
    pub fn wheel(&mut self, pixels: f32) -> Result<(), JsError> {
        self.input(Input::Wheel { pixels }).map(drop)
    }

    /// A finger starts (0), moves (1) or ends (2).
    ///
    /// # Errors
    /// If the device fails.
    pub fn touch(&mut self, id: u32, phase: u32, x: f32, y: f32) -> Result<(), JsError> {
        let phase = match phase {
            0 => Phase::Start,
            1 => Phase::Move,
            _ => Phase::End,
        };
        self.input(Input::Touch {
            id: id.into(),
            phase,
            at: Vec2::new(x, y),
        })
        .map(drop)
    }

    /// A key, by its DOM `code`, goes down or up. Returns a command that is the page's.
    ///
    /// # Errors
    /// If the device fails.
    pub fn key(
        &mut self,
        code: &str,
        down: bool,
        repeat: bool,
        shift: bool,
    ) -> Result<Option<String>, JsError> {
        self.input(Input::Key {
            code,
            down,
            repeat,
            shift,
        })
    }

    /// Nothing is pressed any more.
    ///
    /// # Errors
    /// None that can happen.
    pub fn blur(&mut self) -> Result<(), JsError> {
        self.input(Input::Blur).map(drop)
    }

    fn input(&mut self, input: Input<'_>) -> Result<Option<String>, JsError> {
        Ok(self.viewer.input(input)?.map(|command| name(command).to_owned()))
    }

    /// Does what a key would do; see `COMMANDS` in the package's `index.d.ts`. Returns whether there is such a command.
    ///
    /// # Errors
    /// If the device fails.
    pub fn command(&mut self, command: &str) -> Result<bool, JsError> {
        let Some((command, _)) = COMMANDS.iter().find(|(_, known)| *known == command) else {
            return Ok(false);
        };
        self.viewer.command(*command)?;
        Ok(true)
    }

    /// Camera, light, exposure and shape as a string.
    pub fn link(&self) -> String {
        self.viewer.link().to_string()
    }

    /// Restores what a link says.
    ///
    /// # Errors
    /// If it is none.
    pub fn follow(&mut self, link: &str) -> Result<(), JsError> {
        Ok(self.viewer.follow(&Link::parse(link)?)?)
    }

    /// Stops by which the picture is brightened.
    #[wasm_bindgen(getter)]
    pub fn exposure(&self) -> f32 {
        self.viewer.exposure_stops()
    }

    /// Brightens or darkens the picture.
    #[wasm_bindgen(setter)]
    pub fn set_exposure(&mut self, stops: f32) {
        self.viewer.set_exposure_stops(stops);
    }

    /// What a lone archive is shown on.
    #[wasm_bindgen(getter)]
    pub fn shape(&self) -> Option<String> {
        self.viewer.shape().map(|shape| shape.name().to_owned())
    }

    /// Shows a lone archive on another shape: `plane`, `sphere`, `cylinder`, `cloth`.
    ///
    /// # Errors
    /// For another name, or if the device fails.
    pub fn set_shape(&mut self, name: &str) -> Result<(), JsError> {
        let shape = scenes::lone::Shape::named(name)
            .ok_or_else(|| JsError::new(&format!("no shape {name:?}: plane, sphere, cylinder or cloth")))?;
        Ok(self.viewer.set_shape(shape)?)
    }

    /// What lies over the picture.
    #[wasm_bindgen(getter)]
    pub fn overlay(&self) -> String {
        self.viewer.engine().overlay().name().to_owned()
    }

    /// Lays what is known of pages over the picture, by a name of [`overlays`].
    ///
    /// # Errors
    /// For another name, or if the device fails.
    pub fn set_overlay(&mut self, name: &str) -> Result<(), JsError> {
        let overlay =
            Overlay::from_name(name).ok_or_else(|| JsError::new(&format!("no overlay {name:?}")))?;
        Ok(self.viewer.engine_mut().set_overlay(overlay)?)
    }

    /// Bytes of both caches on the GPU.
    #[wasm_bindgen(getter)]
    pub fn cache_bytes(&self) -> f64 {
        let budgets = self.viewer.budgets();
        (budgets.page_cache_bytes + budgets.column_cache_bytes) as f64
    }

    /// Changes the bytes of both caches, at once.
    ///
    /// # Errors
    /// For fewer than one page or column takes; then all stays as it is.
    pub fn set_cache_bytes(&mut self, bytes: f64) -> Result<(), JsError> {
        Ok(self.viewer.set_budgets(caches(self.viewer.budgets(), bytes))?)
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

/// Budgets with so many bytes for both caches: columns are large and few, pages small and many.
fn caches(budgets: Budgets, bytes: f64) -> Budgets {
    let bytes = bytes.max(LEAST_CACHE_BYTES) as u64;
    Budgets {
        page_cache_bytes: bytes - bytes / 3,
        column_cache_bytes: bytes / 3,
        ..budgets
    }
}

const COMMANDS: [(Command, &str); 20] = [
    (Command::ToggleMode, "toggle-mode"),
    (Command::Reset, "reset"),
    (Command::NextShape, "next-shape"),
    (Command::NextOverlay, "next-overlay"),
    (Command::PreviousOverlay, "previous-overlay"),
    (Command::Brighter, "brighter"),
    (Command::Darker, "darker"),
    (Command::NextLight, "next-light"),
    (Command::AddLight, "add-light"),
    (Command::RemoveLight, "remove-light"),
    (Command::Record, "record"),
    (Command::Replay, "replay"),
    (Command::Turntable, "turntable"),
    (Command::Retry, "retry"),
    (Command::Split, "split"),
    (Command::Panel, "panel"),
    (Command::Help, "help"),
    (Command::Screenshot, "screenshot"),
    (Command::Radiance, "radiance"),
    (Command::Escape, "escape"),
];

fn name(command: Command) -> &'static str {
    let known = COMMANDS.iter().find(|(known, _)| *known == command);
    known.map_or("", |(_, name)| name)
}
