//! The one way in which measurements are shown: text with tables, plots and pictures, as a page that needs nothing else; and
//! rows for other programs.
//!
//! - [`Report`] collects parts in the order in which they are read; [`Report::html`] (`html`) writes them. Text is Markdown, the same that
//!   the terminal shows, so that a table has one source.
//! - `chart`: curves as SVG, through the crate `plotters`. [`Origin`] (`origin`): by what and on what something was measured.
//! - [`csv`](fn@csv) flattens whatever serializes into lines.

pub(crate) mod chart;
mod csv;
mod html;
mod origin;

pub use csv::csv;
pub use origin::{Machine, Origin};

/// JSON has no infinity: what was one is null there.
pub(crate) fn infinite_if_null<'de, D: serde::Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    use serde::Deserialize;
    Ok(Option::deserialize(from)?.unwrap_or(f64::INFINITY))
}

/// A picture inside of a report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// What it shows; text for those who do not see it.
    pub label: String,
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// sRGB, `[y][x][rgb]`.
    pub rgb: Vec<u8>,
}

enum Part {
    Heading(String),
    Markdown(String),
    Plots(Vec<String>),
    Figures(Vec<(Vec<Image>, String)>),
}

/// A report in the making.
pub struct Report {
    title: String,
    parts: Vec<Part>,
}

impl Report {
    /// An empty one.
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            parts: Vec::new(),
        }
    }

    /// Begins a section.
    #[must_use]
    pub fn heading(mut self, text: impl Into<String>) -> Self {
        self.parts.push(Part::Heading(text.into()));
        self
    }

    /// Paragraphs, tables and fenced blocks in Markdown, as the terminal shows them.
    #[must_use]
    pub fn text(mut self, markdown: impl Into<String>) -> Self {
        self.parts.push(Part::Markdown(markdown.into()));
        self
    }

    /// SVGs side by side.
    #[must_use]
    pub fn plots(mut self, svgs: Vec<String>) -> Self {
        self.parts.push(Part::Plots(svgs));
        self
    }

    /// Pictures side by side: each one or several, one below the other, and what is to be said of them.
    #[must_use]
    pub fn figures(mut self, figures: Vec<(Vec<Image>, String)>) -> Self {
        self.parts.push(Part::Figures(figures));
        self
    }

    /// Its text and tables, and at the end by what and on what it was measured.
    pub fn markdown(&self, origin: &Origin) -> String {
        let (mut text, mut title) = (String::new(), None);
        for part in &self.parts {
            match part {
                // Of sections without a word nothing would be left.
                Part::Heading(heading) => title = Some(heading),
                Part::Markdown(part) => {
                    if let Some(heading) = title.take() {
                        text += &format!("### {heading}\n\n");
                    }
                    text += &format!("{}\n\n", part.trim_end());
                }
                Part::Plots(_) | Part::Figures(_) => {}
            }
        }
        text + &format!("{origin}\n")
    }

    /// The page: plots as SVG, pictures inside, no scripts; at its end by what and on what it was measured.
    pub fn html(&self, origin: &Origin) -> String {
        html::page(self, origin)
    }
}
