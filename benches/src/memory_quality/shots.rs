//! Pictures and error maps at chosen points.

use engine::gpu::PageFormat;
use engine::metrics::{Picture, flip};

use super::knee::knee;
use super::{Point, Results};

/// FLIP values, 0 to 1, as bytes.
type ErrorMap = Vec<u8>;

/// What is kept of each point until it is known which are shown.
pub(super) struct Kept {
    shown: Vec<[u8; 3]>,
    error: ErrorMap,
}

impl Kept {
    pub(super) fn new(picture: &Picture, reference: &Picture) -> Self {
        let map = flip::flip_map(picture, reference, 0.0, flip::PIXELS_PER_DEGREE).unwrap_or_default();
        Self {
            shown: picture.to_srgb8(0.0),
            error: map.into_iter().map(|flip| (flip * 255.0).round() as u8).collect(),
        }
    }
}

/// A picture to look at.
#[derive(Clone, Debug)]
pub struct Shot {
    /// What it is.
    pub label: String,
    /// Of which point; `None` for references.
    pub point: Option<usize>,
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// sRGB, `[y][x]`.
    pub shown: Vec<[u8; 3]>,
    /// FLIP against full residency, `[y][x]`, 255 for 1; of full residency itself, against the uncompressed BTFs.
    pub error: Option<ErrorMap>,
}

/// Finds the knee, and chooses: too small, right, other ways at equal memory, full, reference.
pub(super) fn choose(results: &mut Results, kept: &[Kept], full: &Picture, truth: Option<&Picture>) {
    let format = results.plan.formats[0];
    let largest = results.plan.shares.iter().copied().fold(0.0, f64::max);
    let curve: Vec<(usize, &Point)> = results.curve(format, largest).collect();
    let coordinates: Vec<_> = curve
        .iter()
        .map(|(_, point)| ((point.bytes().max(1) as f64).ln(), point.full.flip))
        .collect();
    let knee = knee(&coordinates).map(|at| curve[at].0);
    let mut chosen: Vec<(String, usize)> = Vec::new();
    if let Some((first, _)) = curve.first() {
        chosen.push(("too small".into(), *first));
    }
    if let Some(knee) = knee {
        chosen.push(("right: the knee of the curve".into(), knee));
        let bytes = results.points[knee].bytes();
        for &other_format in &results.plan.formats {
            for &share in results
                .plan
                .shares
                .iter()
                .filter(|share| **share != largest || other_format != format)
            {
                let apart = |point: &Point| (point.bytes() as f64 / bytes as f64).ln().abs();
                let nearest = results
                    .curve(other_format, share)
                    .min_by(|a, b| apart(a.1).total_cmp(&apart(b.1)));
                if let Some((at, point)) = nearest.filter(|(_, point)| apart(point) < 0.5) {
                    let what = if share == largest {
                        name(other_format).to_owned()
                    } else {
                        format!(
                            "{} components, {}",
                            4 * u32::from(point.setting.groups),
                            name(other_format)
                        )
                    };
                    chosen.push((format!("about equal memory: {what}"), at));
                }
            }
        }
    }
    let size = (full.width, full.height);
    let shots = chosen.into_iter().map(|(label, at)| Shot {
        label,
        point: Some(at),
        size,
        shown: kept[at].shown.clone(),
        error: Some(kept[at].error.clone()),
    });
    let mut shots: Vec<_> = shots.collect();
    shots.push(Shot {
        label: "full residency".into(),
        point: None,
        size,
        shown: full.to_srgb8(0.0),
        error: truth.map(|truth| Kept::new(full, truth).error),
    });
    if let Some(truth) = truth {
        shots.push(Shot {
            label: "reference: the uncompressed BTFs, shaded in f64".into(),
            point: None,
            size,
            shown: truth.to_srgb8(0.0),
            error: None,
        });
    }
    (results.knee, results.shots) = (knee, shots);
}

/// For people.
pub(super) fn name(format: PageFormat) -> &'static str {
    match format {
        PageFormat::Half => "half floats",
        PageFormat::Byte => "bytes",
    }
}
