//! What all columns of an archive share: the colour basis, the profile, the models.

use half::{f16, slice::HalfFloatSliceExt};

use super::{
    context::{CLASSES, EMPTY, Profile},
    symbols::{self, Models},
    transform::Transform,
};
use crate::{
    Column, Direction, Error, GROUP_COMPONENTS, MAX_DIRECTIONS, Result,
    codec::{
        rans::{self, MAX_SYMBOLS},
        texel::Texel,
    },
    error::corrupt,
    frame,
    manifest::MAX_COLUMN_TEXELS,
};

/// Most bytes of the tables of an archive.
pub const MAX_COLUMN_TABLE_BYTES: u32 =
    frame::bound(raw_bound(MAX_DIRECTIONS as usize, MAX_DIRECTIONS as usize)) as u32;
/// Bytes in front of the profile: the colour basis and where values are reconstructed.
const FIXED_BYTES: usize = 9 * 2 + 2;
/// Elements of the colour basis are multiples of this.
const COLOUR_UNIT: f64 = 1.0 / 32767.0;
/// What is added to a magnitude is a multiple of this.
const SHIFT_UNIT: f32 = 1.0 / 256.0;

/// Largest half float.
pub(super) const LARGEST: f32 = 65504.0;

const fn raw_bound(views: usize, lights: usize) -> usize {
    FIXED_BYTES + views + lights + 3 + CLASSES + 2 + CLASSES * (2 + 2 * MAX_SYMBOLS)
}

/// What a decoder of columns needs beside the manifest and the record of a group; shared by all groups of an
/// archive.
#[derive(Clone)]
pub struct ColumnTables {
    /// `[function][rgb]` in units of [`COLOUR_UNIT`], before they are made orthonormal.
    pub(super) colours: [[i16; 3]; 3],
    /// Added to magnitudes of one, and of more, in units of [`SHIFT_UNIT`].
    pub(super) shifts: [i8; 2],
    pub(super) profile: Profile,
    pub(super) models: Models,
    pub(super) transform: Transform,
}

impl std::fmt::Debug for ColumnTables {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ColumnTables")
            .field("views", &self.profile.views.len())
            .field("lights", &self.profile.lights.len())
            .field("models", &self.models.models.len())
            .finish_non_exhaustive()
    }
}

impl ColumnTables {
    /// The tables as bytes, one zstd frame.
    ///
    /// # Errors
    /// [`Error::Io`] if there is no memory for the compressor.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let mut raw: Vec<u8> = self
            .colours
            .iter()
            .flatten()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        let profile = [
            &self.profile.views[..],
            &self.profile.lights,
            &self.profile.colours,
        ]
        .concat();
        raw.extend(self.shifts.iter().chain(&profile).map(|&value| value as u8));
        raw.extend(self.models.of_class);
        rans::write_models(&self.models.models, &mut raw);
        frame::compress(&raw)
    }

    /// Reads the tables of an archive with these directions, and prepares its transforms. Memory: 5 KiB a model,
    /// of which there are 32 at most, and four bytes for each pair of up to 256 directions. Time: 0.6 ms
    /// for 81 directions, 3 ms for 151, and it grows with the cube up to 256.
    ///
    /// # Errors
    /// [`Error::Corrupt`] if the bytes are no tables for so many directions, [`Error::OverLimit`] or
    /// [`Error::Invalid`] if no archive can have these directions.
    pub fn from_bytes(bytes: &[u8], views: &[Direction], lights: &[Direction]) -> Result<Self> {
        check_directions(views, lights)?;
        let failed = |detail: String| corrupt("tables of the columns", 0, detail);
        let raw = frame::decompress(bytes, raw_bound(views.len(), lights.len())).map_err(failed)?;
        let fixed = FIXED_BYTES + views.len() + lights.len() + 3 + CLASSES;
        let Some((fixed, mut models)) = raw.split_at_checked(fixed) else {
            return Err(failed(format!(
                "{} bytes, at least {fixed} are needed",
                raw.len()
            )));
        };
        let (colours, rest) = fixed.split_at(18);
        let (shifts, rest) = rest.split_at(2);
        let (profile_views, rest) = rest.split_at(views.len());
        let (profile_lights, rest) = rest.split_at(lights.len());
        let (profile_colours, of_class) = rest.split_at(3);
        let signed = |bytes: &[u8]| bytes.iter().map(|&byte| byte as i8).collect::<Vec<i8>>();
        let colours: [[i16; 3]; 3] = std::array::from_fn(|i| {
            std::array::from_fn(|j| i16::from_le_bytes([colours[6 * i + 2 * j], colours[6 * i + 2 * j + 1]]))
        });
        let read = rans::read_models(&mut models, CLASSES).map_err(failed)?;
        if !models.is_empty() {
            return Err(failed(format!("{} bytes follow the models", models.len())));
        }
        let of_class: [u8; CLASSES] = std::array::from_fn(|class| of_class[class]);
        if let Some(class) = of_class
            .iter()
            .position(|&model| usize::from(model) >= read.len())
        {
            return Err(failed(format!(
                "class {class} has model {} of {}",
                of_class[class],
                read.len()
            )));
        }
        Self::new(
            colours,
            [shifts[0] as i8, shifts[1] as i8],
            Profile {
                views: signed(profile_views),
                lights: signed(profile_lights),
                colours: std::array::from_fn(|i| profile_colours[i] as i8),
            },
            Models {
                models: read,
                of_class,
            },
            |matrix| Transform::new(views, lights, matrix),
        )
        .ok_or_else(|| failed("the colour basis is no basis".into()))
    }

    /// `None` if the colours are linearly dependent.
    pub(super) fn new(
        colours: [[i16; 3]; 3],
        shifts: [i8; 2],
        profile: Profile,
        models: Models,
        transform: impl FnOnce([[f32; 3]; 3]) -> Transform,
    ) -> Option<Self> {
        let transform = transform(orthonormal(colours)?);
        Some(Self {
            colours,
            shifts,
            profile,
            models,
            transform,
        })
    }

    /// Decodes the column of a group. `steps` are the quantizer steps of all components of the archive, as its
    /// encoder got them; the last group may have fewer than four, the others are zero.
    ///
    /// # Errors
    /// [`Error::Corrupt`] if the bytes are no record of a column of this size, [`Error::Invalid`] for a step that
    /// is not positive.
    pub fn decode(&self, group: u16, steps: &[f64], bytes: &[u8]) -> Result<Column> {
        let failed = |detail: String| corrupt(format!("column of group {group}"), 0, detail);
        let steps = group_steps(steps, group.into())?;
        let Some((levels, stream)) = bytes.split_first_chunk::<4>() else {
            return Err(failed(format!("{} bytes, at least 4 are needed", bytes.len())));
        };
        let levels = levels.map(|byte| byte as i8);
        if let Some(c) = (0..4).find(|&c| levels[c] != EMPTY && !steps[c].is_finite()) {
            return Err(failed(format!(
                "component {c} of the group has values, but no finite step"
            )));
        }
        let mut coefficients = vec![Texel::default(); self.transform.texels()];
        let shifts = self.shifts.map(|shift| f32::from(shift) * SHIFT_UNIT);
        let take = |place: usize, c: usize, magnitude: u32, negative: bool| {
            let value = (magnitude as f32 + shifts[usize::from(magnitude > 1)]) * steps[c];
            coefficients[place].0[c] = if negative { -value } else { value };
        };
        if levels == [EMPTY; 4] {
            if !stream.is_empty() {
                return Err(failed("bytes follow an empty column".into()));
            }
        } else if stream.is_empty() {
            return Err(failed("no levels follow, but not all components are zero".into()));
        } else {
            symbols::decode(&self.profile, levels, &self.models, stream, take).map_err(failed)?;
        }
        let mut values = self.transform.inverse(&coefficients);
        let floats: &mut [f32] = bytemuck::cast_slice_mut(&mut values);
        let mut finite = true;
        for value in &mut *floats {
            finite &= value.is_finite();
            *value = value.clamp(-LARGEST, LARGEST);
        }
        if !finite {
            return Err(failed("a value is infinite or not a number".into()));
        }
        let mut texels = vec![[f16::ZERO; 4]; floats.len() / 4];
        texels.as_flattened_mut().convert_from_f32_slice(floats);
        Ok(Column { texels })
    }
}

/// Steps of the four components of a group; infinite for components that there are not.
pub(super) fn group_steps(steps: &[f64], group: usize) -> Result<[f32; GROUP_COMPONENTS]> {
    let mut of_group = [f32::INFINITY; GROUP_COMPONENTS];
    for (c, of_group) in of_group.iter_mut().enumerate() {
        let component = group * GROUP_COMPONENTS + c;
        let Some(&step) = steps.get(component) else {
            continue;
        };
        *of_group = step as f32;
        if step.is_nan() || *of_group < f32::MIN_POSITIVE {
            return Err(Error::Invalid {
                what: format!("quantizer step of column component {component}"),
                detail: format!("{step} is no positive number of single precision"),
            });
        }
    }
    Ok(of_group)
}

pub(super) fn check_directions(views: &[Direction], lights: &[Direction]) -> Result<()> {
    for (what, found, limit) in [
        ("view directions", views.len(), MAX_DIRECTIONS),
        ("light directions", lights.len(), MAX_DIRECTIONS),
        (
            "texels of a column",
            views.len() * lights.len() * 3,
            MAX_COLUMN_TEXELS,
        ),
    ] {
        let found = found as u64;
        if found > u64::from(limit) {
            return Err(Error::OverLimit {
                what,
                found,
                limit: limit.into(),
            });
        }
        if found == 0 {
            return Err(Error::Invalid {
                what: what.into(),
                detail: "at least one is needed".into(),
            });
        }
    }
    let bad = views.iter().chain(lights).find(|direction| {
        // Whole turns beyond this would lose precision; a manifest has less.
        !(direction.theta.abs() <= 100.0 && direction.phi.abs() <= 100.0)
    });
    match bad {
        None => Ok(()),
        Some(bad) => Err(Error::Invalid {
            what: "direction".into(),
            detail: format!("theta {} and phi {} are no angles in radians", bad.theta, bad.phi),
        }),
    }
}

/// Rows rounded to [`COLOUR_UNIT`].
pub(super) fn round_colours(rows: &[f64]) -> [[i16; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| (rows[3 * i + j] / COLOUR_UNIT).round() as i16))
}

/// Gram-Schmidt in a fixed order; `None` for rows that are nearly dependent.
fn orthonormal(rows: [[i16; 3]; 3]) -> Option<[[f32; 3]; 3]> {
    let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let mut basis = [[0f64; 3]; 3];
    for i in 0..3 {
        let mut row = rows[i].map(|value| f64::from(value) * COLOUR_UNIT);
        for before in &basis[..i] {
            let along = dot(&row, before);
            row = std::array::from_fn(|j| row[j] - along * before[j]);
        }
        let length = dot(&row, &row).sqrt();
        if length < 0.5 {
            return None;
        }
        basis[i] = row.map(|value| value / length);
    }
    Some(basis.map(|row| row.map(|value| value as f32)))
}
