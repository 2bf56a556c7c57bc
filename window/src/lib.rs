//! The viewer in a window: winit brings events, egui draws the panel, and [`viewer::Viewer`] does everything else.
//!
//! - `app`: the event loop, and when there is something to draw.
//! - `surface`: what is drawn into.
//! - `events`: from winit's events to the viewer's, and what the program tells on standard output.
//! - `panel`, `charts`, `maps`, `notices`: what lies beside and over the picture.
//! - `shots`: pictures to files.
//!
//! Nothing waits while the picture moves, but for screenshots, which wait for the GPU.

mod app;
mod charts;
mod events;
mod maps;
mod notices;
mod panel;
mod shots;
mod surface;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, anyhow};
use engine::{frame::Options, metrics::Picture, stream::TileSource};
use scenes::CameraPath;
use viewer::{Link, Subject};
use winit::event_loop::EventLoop;

/// Opens the source of the archives: for the picture, and again for the one beside it.
pub type Open = Box<dyn Fn() -> engine::Result<Box<dyn TileSource>>>;

/// Writes a picture of this width and height in sRGB with alpha, `[y][x][rgba]`, to a file.
pub type SavePng = fn(&Path, (u32, u32), &[u8]) -> Result<()>;

/// How pictures get into files.
#[derive(Clone, Copy)]
pub struct Save {
    /// What a screen shows.
    pub png: SavePng,
    /// Linear radiance.
    pub exr: fn(&Path, &Picture) -> Result<()>,
}

/// What is shown, and how.
pub struct Show {
    /// Title of the window: the name of what is shown.
    pub title: String,
    /// A scene, or a lone archive.
    pub subject: Subject,
    /// Where the archives come from.
    pub open: Open,
    /// Budgets and choices; the size is that of the window in pixels to begin with.
    pub options: Options,
    /// What to begin with.
    pub link: Link,
    /// A camera path to replay.
    pub path: Option<CameraPath>,
    /// Folder for pictures and recorded paths.
    pub folder: PathBuf,
    /// How pictures get there.
    pub save: Save,
    /// Whether the panel is open.
    pub panel: bool,
    /// Tells on standard output what happens, a JSON object a line.
    pub events: bool,
}

/// Shows a window until it is closed.
///
/// # Errors
/// If there is no display or no graphics adapter, what is to be shown cannot be, or the device fails.
pub fn run(show: Show) -> Result<()> {
    // What winit says names its own source.
    let event_loop = EventLoop::new().map_err(|_| {
        anyhow!(
            "there is no display to open a window on: neither WAYLAND_DISPLAY nor DISPLAY names one that answers; \
             `eigentile render` draws without a window (on a server: xvfb-run)"
        )
    })?;
    let mut app = app::App::new(show);
    event_loop.run_app(&mut app).context("the window has failed")?;
    app.finish()
}
