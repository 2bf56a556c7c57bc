//! Pictures of what the engine knows of each pixel's pages.

use std::path::Path;

use anyhow::Result;
use engine::{Overlay, frame::Engine};
use scenes::Camera;
use serde::Serialize;

use super::picture;

/// A picture and how to read it.
#[derive(Serialize)]
pub(super) struct Overlaid {
    file: String,
    title: &'static str,
    /// Colours in sRGB as #rrggbb, and what they mean.
    legend: Vec<(String, String)>,
}

/// An overlay by its name, for clap.
pub(super) fn parse(name: &str) -> Result<Overlay, String> {
    Overlay::from_name(name)
        .filter(|overlay| *overlay != Overlay::None)
        .ok_or_else(|| {
            let names: Vec<_> = Overlay::ALL[1..].iter().map(|overlay| overlay.name()).collect();
            format!("there are {}", names.join(", "))
        })
}

/// Draws the settled view under each overlay, into overlay_NAME.png of a folder.
pub(super) fn write(
    engine: &mut Engine,
    camera: &Camera,
    overlays: &[Overlay],
    folder: &Path,
) -> Result<Vec<Overlaid>> {
    let mut written = Vec::new();
    for overlay in overlays {
        engine.set_overlay(*overlay)?;
        engine.frame(camera)?;
        let file = format!("overlay_{}.png", overlay.name());
        picture::write_png(&folder.join(&file), engine.size(), &engine.tonemapped()?)?;
        let colour = |[r, g, b]: [u8; 3]| format!("#{r:02x}{g:02x}{b:02x}");
        let legend = overlay.legend().into_iter();
        written.push(Overlaid {
            file,
            title: overlay.title(),
            legend: legend.map(|(label, rgb)| (colour(rgb), label)).collect(),
        });
    }
    engine.set_overlay(Overlay::None)?;
    Ok(written)
}

impl Overlaid {
    /// For people.
    pub(super) fn text(&self) -> String {
        let entry = |(colour, label): &(String, String)| format!("  {colour}  {label}\n");
        let legend: String = self.legend.iter().map(entry).collect();
        format!("{}: {}\n{legend}", self.file, self.title)
    }
}
