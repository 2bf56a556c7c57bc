//! Overlays: what the engine knows of each pixel's pages, as colours over the picture.
//!
//! The names, the scales and their legends; [`crate::gpu`] draws them. Colours are "viridis" (Smith, van der Walt: A Better
//! Default Colormap for Matplotlib, 2015), which rises evenly in lightness and can be told apart with any colour vision; marks
//! beside the scale are from the palette of Okabe and Ito: Color Universal Design, 2008.

/// Steps of the scale.
const STEPS: usize = 8;

/// "viridis" in steps of 1/8, sRGB, from dark violet over green to yellow (matplotlib 3.11, `colormaps["viridis"]`).
pub(crate) const SCALE: [[u8; 3]; STEPS + 1] = [
    [68, 1, 84],
    [71, 45, 123],
    [59, 82, 139],
    [44, 114, 142],
    [33, 145, 140],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// Nothing resident (vermillion), all shaded, left out (blue), background; in the order of `overlay.wgsl`.
pub(crate) const MARKS: [[u8; 3]; 4] = [ABSENT, [230, 230, 230], [0, 114, 178], [0, 0, 0]];
const ABSENT: [u8; 3] = [213, 94, 0];

/// What is drawn over the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Overlay {
    /// The picture alone.
    #[default]
    None,
    /// Mip of the page that the first shaded component group shows. Where that is coarser than the pixel wants, stripes have
    /// the colour of the mip that it wants.
    Mip,
    /// Component groups that are shaded, on a logarithmic scale.
    Components,
    /// Borders of the pages that the first shaded group shows, in the colours of their mips; the picture between them.
    Borders,
    /// Frames since the newest of the shaded pages came, on a logarithmic scale.
    Age,
    /// Root mean square reflectance that the pixel's tile lacks, as the weights of what is not resident say, against full
    /// residency; on a logarithmic scale.
    PredictedError,
    /// Shares of the component groups that are shaded, left out because together they matter less than
    /// [`crate::frame::Options::component_error`], and not resident; mixed colours for mixed shares.
    Skipped,
}

impl Overlay {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::None,
        Self::Mip,
        Self::Components,
        Self::Borders,
        Self::Age,
        Self::PredictedError,
        Self::Skipped,
    ];

    /// A short name in lower case, for options and links.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Mip => "mip",
            Self::Components => "components",
            Self::Borders => "borders",
            Self::Age => "age",
            Self::PredictedError => "error",
            Self::Skipped => "skipped",
        }
    }

    /// The overlay of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|overlay| overlay.name() == name)
    }

    /// What its colours mean, in one line; empty for none.
    pub fn title(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Mip => "mip shown, striped with the mip wanted",
            Self::Components => "component groups shaded",
            Self::Borders => "borders of pages, by mip",
            Self::Age => "frames since the newest page came",
            Self::PredictedError => "predicted error of reflectance (RMS)",
            Self::Skipped => "component groups skipped",
        }
    }

    /// Colours and what they mean, sRGB. Between entries of a scale colours go over into each other.
    pub fn legend(self) -> Vec<(String, [u8; 3])> {
        let scale = |labels: [&str; STEPS + 1]| -> Vec<_> {
            labels.map(str::to_owned).into_iter().zip(SCALE).collect()
        };
        let mips = || {
            let label = |mip| {
                if mip == STEPS {
                    format!("mip {mip} or coarser")
                } else {
                    format!("mip {mip}")
                }
            };
            (0..=STEPS).map(label).zip(SCALE).collect::<Vec<_>>()
        };
        let absent = ("nothing resident: mean colour".to_owned(), ABSENT);
        match self {
            Self::None => Vec::new(),
            Self::Mip => mips().into_iter().chain([absent]).collect(),
            Self::Borders => mips(),
            Self::Components => {
                let counts = [0, 1, 3, 7, 15, 31];
                let last = ("63 groups or more".to_owned(), SCALE[STEPS]);
                let entry = |groups: u32| (format!("{groups}"), self.colour(groups.into()));
                counts.map(entry).into_iter().chain([last]).collect()
            }
            Self::Age => {
                let frames = [0, 1, 3, 7, 15, 31, 63, 127, 255, 511];
                let last = ("1023 frames or more".to_owned(), SCALE[0]);
                let entry = |age: u32| (format!("{age}"), self.colour(age.into()));
                frames.map(entry).into_iter().chain([last, absent]).collect()
            }
            Self::PredictedError => scale([
                "0.0001 or less",
                "0.0003",
                "0.001",
                "0.003",
                "0.01",
                "0.03",
                "0.1",
                "0.3",
                "1 or more",
            ]),
            Self::Skipped => {
                let [absent, shaded, left_out, background] = MARKS;
                vec![
                    ("shaded".into(), shaded),
                    (
                        "left out: matters less than the error that is allowed".into(),
                        left_out,
                    ),
                    ("column or page not resident".into(), absent),
                    ("background".into(), background),
                ]
            }
        }
    }

    /// The colour of a value on the overlay's scale, sRGB: a mip, a number of groups, frames, or an error. Twin of
    /// `overlay.wgsl`.
    pub fn colour(self, value: f64) -> [u8; 3] {
        let place = match self {
            Self::Mip | Self::Borders => value / STEPS as f64,
            Self::Components => (1.0 + value).log2() / 6.0,
            Self::Age => 1.0 - (1.0 + value).log2() / 10.0,
            Self::PredictedError => (value.max(1e-9).log10() + 4.0) / 4.0,
            Self::None | Self::Skipped => 0.0,
        };
        let place = place.clamp(0.0, 1.0) * STEPS as f64;
        let below = (place as usize).min(STEPS - 1);
        let share = place - below as f64;
        std::array::from_fn(|channel| {
            let [a, b] = [below, below + 1].map(|step| f64::from(SCALE[step][channel]));
            (a * (1.0 - share) + b * share).round() as u8
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_and_legends_are_on_their_scales() {
        for overlay in Overlay::ALL {
            assert_eq!(Overlay::from_name(overlay.name()), Some(overlay));
            let legend = overlay.legend();
            assert_eq!(legend.is_empty(), overlay == Overlay::None);
            assert_eq!(overlay.title().is_empty(), overlay == Overlay::None);
            let mut colours: Vec<_> = legend.iter().map(|(_, colour)| *colour).collect();
            colours.sort_unstable();
            colours.dedup();
            assert_eq!(
                colours.len(),
                legend.len(),
                "{overlay:?}: a colour means two things"
            );
        }
        assert_eq!(Overlay::from_name("nonsense"), None);
        // The ends, and what lies beyond.
        assert_eq!(Overlay::Mip.colour(3.0), SCALE[3]);
        assert_eq!(Overlay::Mip.colour(11.0), SCALE[8]);
        assert_eq!(Overlay::Components.colour(0.0), SCALE[0]);
        assert_eq!(Overlay::Components.colour(63.0), SCALE[8]);
        assert_eq!(Overlay::Age.colour(0.0), SCALE[8]);
        assert_eq!(Overlay::Age.colour(1e9), SCALE[0]);
        for (error, step) in [
            (0.0, 0),
            (1e-4, 0),
            (1e-3, 2),
            (1e-2, 4),
            (0.1, 6),
            (1.0, 8),
            (9.0, 8),
        ] {
            assert_eq!(Overlay::PredictedError.colour(error), SCALE[step], "{error}");
        }
        let errors = Overlay::PredictedError.legend();
        for (label, colour) in &errors[1..8] {
            let found = Overlay::PredictedError.colour(label.parse().unwrap());
            let apart = found.iter().zip(colour).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(apart <= Some(8), "{label}: {found:?} {colour:?}");
        }
    }

    /// Lightness (CIELAB) rises along the scale: it can be read without hues.
    #[test]
    fn the_scale_rises_in_lightness() {
        use crate::metrics::{lab::lab_from_linear, tone::linear_from_srgb};
        let lightness =
            SCALE.map(|colour| lab_from_linear(colour.map(|c| linear_from_srgb(f64::from(c) / 255.0)))[0]);
        assert!(
            lightness.windows(2).all(|pair| pair[1] > pair[0] + 5.0),
            "{lightness:?}"
        );
    }
}
