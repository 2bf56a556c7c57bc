//! Curves as SVG that reads without scripts and in print, drawn by `plotters`.
//!
//! - [`chart()`] (`draw`): panels under one title and one legend.
//! - [`Scale`] (`axis`): ranges, and ticks that read well.
//! - `labels`: where the names of points stand.

mod axis;
mod draw;
mod labels;

pub(crate) use axis::Scale;
pub(crate) use draw::chart;
pub(crate) use plotters::style::RGBColor;

// Colours that differ in lightness too.
pub(crate) const BLUE: RGBColor = RGBColor(0x09, 0x69, 0xda);
pub(crate) const OCHRE: RGBColor = RGBColor(0xbf, 0x87, 0x00);
pub(crate) const VIOLET: RGBColor = RGBColor(0x82, 0x50, 0xdf);
pub(crate) const GREEN: RGBColor = RGBColor(0x1a, 0x7f, 0x37);
pub(crate) const RED: RGBColor = RGBColor(0xcf, 0x22, 0x2e);
pub(crate) const GREY: RGBColor = RGBColor(0x8c, 0x95, 0x9f);
/// Of text.
pub(crate) const INK: RGBColor = RGBColor(0x24, 0x29, 0x2f);
const GRID: RGBColor = RGBColor(0xd0, 0xd7, 0xde);

/// Points, by rising x where a line joins them.
#[derive(Clone)]
pub(crate) struct Series {
    /// In the legend, where series of one name stand once; empty: not there.
    pub(crate) name: String,
    pub(crate) colour: RGBColor,
    pub(crate) points: Vec<(f64, f64)>,
    /// What stands beside points, of as many as there are names.
    pub(crate) labels: Vec<String>,
    /// Width of the line that joins them, pixels; none if 0.
    pub(crate) width: f64,
    pub(crate) dashed: bool,
    /// Of the circles around them, pixels; none if 0.
    pub(crate) radius: f64,
    /// Whether circles are empty.
    pub(crate) hollow: bool,
}

impl Series {
    /// A line.
    pub(crate) fn new(name: impl Into<String>, colour: RGBColor, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.into(),
            colour,
            points,
            labels: Vec::new(),
            width: 1.8,
            dashed: false,
            radius: 0.0,
            hollow: false,
        }
    }
}

/// A pair of axes with what is drawn on it.
pub(crate) struct Panel {
    /// Above it; may be empty.
    pub(crate) title: String,
    /// What is to the right; may be empty.
    pub(crate) x_name: String,
    pub(crate) x: Scale,
    pub(crate) y: Scale,
    pub(crate) series: Vec<Series>,
    /// A point in a ring.
    pub(crate) mark: Option<(f64, f64)>,
}
