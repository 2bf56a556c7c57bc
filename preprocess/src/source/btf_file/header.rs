//! What all UBO files begin with: signature, meta data, sampled directions, size of the pictures, local frames.

use tileset::Direction;

use super::bytes::Cursor;
use crate::npy::Sampling;
use crate::source::decode::spectrum;
use crate::{Error, Result};

/// Largest difference of a light's angles between two views that is taken for rounding, in radians.
const SAME_ANGLE: f64 = 1e-4;
/// A right angle with the slack that archives have.
const MAX_THETA: f64 = std::f64::consts::FRAC_PI_2 + 1e-4;
/// Most channels of a spectrum: one a nanometre, and more than that.
const MAX_CHANNELS: u32 = 4096;
/// Wavelengths in nanometres that a channel's name may be without a unit.
const BARE_NM: std::ops::RangeInclusive<f64> = 100.0..=4000.0;
/// Versions of the meta data up to here are known.
const META_VERSION: u32 = 4;
/// The magic number of the older per-view files; it stands in place of the meta data.
pub(super) const OLD_PVF_MAGIC: u32 = 301_074;

/// How the samples are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Full matrix factorization; `extended`: with range reduction and height map.
    Fmf { extended: bool },
    /// Decorrelated full matrix factorization.
    Dfmf,
    /// Per-view factorization.
    Pvf,
    /// Bidirectional images: all samples, one apparent BRDF after the other.
    Bdi,
}

/// The known signatures: bytes, layout, whether local frames follow the size of the pictures.
const SIGNATURES: [(&str, Kind, bool); 7] = [
    ("!FMF12FCER", Kind::Fmf { extended: true }, true),
    ("!DFMF08FCR", Kind::Dfmf, true),
    ("!BDIF06R2!", Kind::Bdi, true),
    ("!FMF06FCR", Kind::Fmf { extended: false }, true),
    ("!PVF06FCR", Kind::Pvf, true),
    ("!FMF06FC", Kind::Fmf { extended: false }, false),
    ("!PVF06FC", Kind::Pvf, false),
];

/// What a file begins with.
#[derive(Clone, Copy, Debug)]
pub(super) struct Signature {
    pub(super) kind: Kind,
    /// Whether local frames are stored.
    pub(super) frames: bool,
}

impl Signature {
    /// Which signature `bytes`, the beginning of a file, hold, and how many bytes it takes.
    ///
    /// `!FMF06FC` may be followed by a meta data size whose lowest byte is 'R': the version behind the size says
    /// which of the two readings is meant, and the longer one is preferred.
    pub(super) fn find(bytes: &[u8]) -> Option<(Self, usize)> {
        let old_pvf = |at: usize| bytes.get(at..at + 4) == Some(&OLD_PVF_MAGIC.to_le_bytes()[..]);
        let plausible = |at: usize| {
            let version = bytes.get(at + 4..at + 8);
            old_pvf(at) || version.is_some_and(|v| v[0] != 0 && v[1..] == [0, 0, 0])
        };
        let matching = || {
            SIGNATURES
                .iter()
                .filter(|(name, _, _)| bytes.starts_with(name.as_bytes()))
        };
        if let Some(&(name, kind, frames)) = matching()
            .find(|(name, _, _)| plausible(name.len()))
            .or_else(|| matching().next())
        {
            return Some((Self { kind, frames }, name.len()));
        }
        let (kind, frames) = (Kind::Pvf, false);
        old_pvf(0).then_some((Self { kind, frames }, 0))
    }

    /// Reads it from the beginning of a file.
    pub(super) fn read(cursor: &mut Cursor<'_>) -> Result<Self> {
        let count = cursor.left().min(18) as usize;
        let beginning = cursor.take("the signature", count)?.to_vec();
        let Some((signature, bytes)) = Self::find(&beginning) else {
            let found = String::from_utf8_lossy(&beginning[..count.min(10)]).into_owned();
            let known: Vec<&str> = SIGNATURES.iter().map(|&(name, _, _)| name).collect();
            return Err(cursor.file().error(format!(
                "begins with {found:?}, which is no signature of an UBO .btf file; known are {}",
                known.join(", ")
            )));
        };
        *cursor = Cursor::new(cursor.file());
        cursor.skip("the signature", bytes as u64)?;
        Ok(signature)
    }
}

/// The header that all layouts share.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) sampling: Sampling,
    pub(super) width: u32,
    pub(super) height: u32,
    /// What is in the file and not in the samples, for people.
    pub(super) notes: Vec<String>,
    /// What a unit of each channel adds to red, green and blue, if the channels are those of a spectrum; else they are
    /// red, green and blue.
    pub(super) spectrum: Option<Vec<[f32; 3]>>,
}

impl Header {
    /// Meta data and directions of every layout; the size of the pictures follows.
    pub(super) fn read(cursor: &mut Cursor<'_>) -> Result<Self> {
        let mut notes = Vec::new();
        let (cosine, spectrum) = read_meta(cursor, &mut notes)?;
        let (views, lights) = read_directions(cursor)?;
        let (width, height) = read_size(cursor)?;
        let sampling = Sampling {
            views,
            lights,
            wrap: false,
            cosine,
        };
        Ok(Self {
            sampling,
            width,
            height,
            notes,
            spectrum,
        })
    }

    /// The older per-view header: no meta data, the size before the directions.
    ///
    /// Returns the count of view slots too, which stands between them.
    pub(super) fn read_old_pvf(cursor: &mut Cursor<'_>) -> Result<(Self, u32)> {
        cursor.u32("the number of components")?;
        let (width, height) = read_size(cursor)?;
        let slots = cursor.u32("the number of view slots")?;
        let (views, lights) = read_directions(cursor)?;
        let sampling = Sampling {
            views,
            lights,
            wrap: false,
            cosine: false,
        };
        let notes = Vec::new();
        Ok((
            Self {
                sampling,
                width,
                height,
                notes,
                spectrum: None,
            },
            slots,
        ))
    }

    /// Steps over the local frames of signatures that have them: u32 count, count × `f32[9]`.
    pub(super) fn skip_frames(&mut self, cursor: &mut Cursor<'_>) -> Result<()> {
        let count = cursor.u32("the number of local frames")?;
        cursor.skip(
            format_args!("{count} local frames of 36 bytes"),
            u64::from(count) * 36,
        )?;
        if count > 0 {
            self.notes.push(format!(
                "{count} local frames are stored and not applied: directions are those of the frames"
            ));
        }
        Ok(())
    }

    /// Images: views × lights.
    pub(super) fn images(&self) -> usize {
        self.sampling.views.len() * self.sampling.lights.len()
    }

    /// Channels that are stored.
    pub(super) fn channels(&self) -> usize {
        self.spectrum.as_ref().map_or(3, Vec::len)
    }

    /// Texels of an image.
    pub(super) fn texels(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// The meta data: whether the samples include the cosine, and the spectrum.
fn read_meta(cursor: &mut Cursor<'_>, notes: &mut Vec<String>) -> Result<(bool, Option<Vec<[f32; 3]>>)> {
    let start = cursor.at();
    let size = cursor.u32("the size of the meta data")?;
    let version = cursor.u32("the version of the meta data")?;
    cursor.skip("measurement setup, image sensor and light source", 3 * 80)?;
    cursor.skip("pixels per millimetre", 4)?;
    let mut scale = [0.0; 3];
    for scale in &mut scale {
        *scale = cursor.f32("the rgb scale")?;
    }
    if scale != [0.0; 3] && scale != [1.0; 3] {
        notes.push(format!("rgb scale {scale:?} is stored and not applied"));
    }
    let cosine = version > 1 && cursor.u32("the cosine flag")? != 0;
    if version > 2 {
        let bytes = cursor.u32("the size of the XML text")?;
        cursor.skip("the XML text", bytes.into())?;
    }
    let spectrum = if version > 3 {
        read_channels(cursor, notes)?
    } else {
        None
    };
    let found = cursor.at() - start;
    if found != u64::from(size) {
        return Err(cursor.file().error(format!(
            "has meta data of version {version} that claims {size} bytes at byte {start}, but its fields take \
             {found} (versions up to {META_VERSION} are known)"
        )));
    }
    Ok((cosine, spectrum))
}

/// The channels: what they add to red, green and blue if their names are wavelengths, as `550nm`, `S0.550nm` or `550`.
fn read_channels(cursor: &mut Cursor<'_>, notes: &mut Vec<String>) -> Result<Option<Vec<[f32; 3]>>> {
    let at = cursor.at();
    let count = cursor.u32("the number of channels")?;
    if !(3..=MAX_CHANNELS).contains(&count) {
        return Err(cursor.file().error(format!(
            "holds {count} channels (byte {at}), expected 3, red, green and blue, or a spectrum of 3 to {MAX_CHANNELS}"
        )));
    }
    let mut names = Vec::new();
    for channel in 0..count {
        let bytes = cursor.u32(format_args!("the size of the name of channel {channel}"))?;
        let shown = bytes.min(64);
        let what = format!("the name of channel {channel}");
        let name = cursor.take(&what, shown as usize)?;
        let name = String::from_utf8_lossy(name).trim_end_matches('\0').to_owned();
        cursor.skip(&what, u64::from(bytes - shown))?;
        names.push(name);
    }
    let with_unit: Vec<String> = names
        .iter()
        .map(|name| match name.trim().parse() {
            Ok(nm) if BARE_NM.contains(&nm) => format!("{}nm", name.trim()),
            _ => name.trim().to_owned(),
        })
        .collect();
    let spectrum = spectrum::samples(&with_unit).map_err(|detail| cursor.file().error(detail))?;
    if spectrum.len() == names.len() {
        let (first, last) = (&spectrum[0], &spectrum[names.len() - 1]);
        notes.push(format!(
            "a spectrum of {count} channels, {} to {}, is shown as linear RGB under D65",
            with_unit[first.channel], with_unit[last.channel]
        ));
        let mut weights = vec![[0.0; 3]; names.len()];
        for sample in spectrum {
            weights[sample.channel] = sample.rgb;
        }
        return Ok(Some(weights));
    }
    if count != 3 {
        let known: Vec<usize> = spectrum.iter().map(|sample| sample.channel).collect();
        let other = (0..names.len())
            .find(|channel| !known.contains(channel))
            .unwrap_or(0);
        return Err(cursor.file().error(format!(
            "holds {count} channels (byte {at}), of which channel {other} is named {:?}: expected 3, red, green and blue, \
             or all named by their wavelengths in nanometres, as \"550nm\" or \"550\"",
            names[other]
        )));
    }
    if names != ["R", "G", "B"] {
        notes.push(format!("channels {names:?} are taken as red, green and blue"));
    }
    Ok(None)
}

fn read_size(cursor: &mut Cursor<'_>) -> Result<(u32, u32)> {
    let at = cursor.at();
    let (width, height) = (cursor.u32("the width")?, cursor.u32("the height")?);
    let sides = 1..=tileset::MAX_SIDE_TEXELS;
    if !sides.contains(&width) || !sides.contains(&height) {
        return Err(cursor.file().error(format!(
            "has pictures of {width}x{height} texels (byte {at}), accepted are 1 to {} a side",
            sides.end()
        )));
    }
    Ok((width, height))
}

fn count(cursor: &mut Cursor<'_>, what: &str) -> Result<u32> {
    let at = cursor.at();
    let count = cursor.u32(format_args!("the number of {what}"))?;
    if count == 0 || count > tileset::MAX_DIRECTIONS {
        return Err(cursor.file().error(format!(
            "has {count} {what} (byte {at}), expected 1 to {}",
            tileset::MAX_DIRECTIONS
        )));
    }
    Ok(count)
}

/// Views and lights: u32 views, for each theta, phi, u32 lights, lights × (theta, phi). One set of lights serves all
/// views.
fn read_directions(cursor: &mut Cursor<'_>) -> Result<(Vec<Direction>, Vec<Direction>)> {
    let view_count = count(cursor, "views")?;
    let (mut views, mut lights) = (Vec::new(), Vec::<Direction>::new());
    for view in 0..view_count {
        views.push(read_direction(cursor, format_args!("view {view}"))?);
        let light_count = count(cursor, &format!("lights of view {view}"))?;
        if view > 0 && light_count as usize != lights.len() {
            return Err(cursor.file().error(format!(
                "has {light_count} lights for view {view} and {} for view 0: every view must have the same lights; \
                 resample them to one set first",
                lights.len()
            )));
        }
        for light in 0..light_count {
            let at = cursor.at();
            let direction = read_direction(cursor, format_args!("light {light} of view {view}"))?;
            let Some(first) = lights.get(light as usize).filter(|_| view > 0) else {
                lights.push(direction);
                continue;
            };
            if !same(first, &direction) {
                return Err(differs(cursor, at, (view, light), first, &direction));
            }
        }
    }
    Ok((views, lights))
}

fn differs(
    cursor: &Cursor<'_>,
    at: u64,
    (view, light): (u32, u32),
    first: &Direction,
    found: &Direction,
) -> Error {
    cursor.file().error(format!(
        "has light {light} of view {view} at [{}, {}] (byte {at}), but light {light} of view 0 is at [{}, {}]: \
         every view must have the same lights; resample them to one set first",
        found.theta as f32, found.phi as f32, first.theta as f32, first.phi as f32
    ))
}

/// Whether two directions are the same but for rounding. Azimuths mean nothing at the pole and count modulo a turn.
fn same(a: &Direction, b: &Direction) -> bool {
    let turn = std::f64::consts::TAU;
    let phi = (a.phi - b.phi).rem_euclid(turn);
    (a.theta - b.theta).abs() <= SAME_ANGLE
        && phi.min(turn - phi) * a.theta.sin().max(b.theta.sin()) <= SAME_ANGLE
}

fn read_direction(cursor: &mut Cursor<'_>, what: std::fmt::Arguments<'_>) -> Result<Direction> {
    let at = cursor.at();
    let theta = f64::from(cursor.f32(format_args!("theta of {what}"))?);
    let phi = f64::from(cursor.f32(format_args!("phi of {what}"))?);
    if !(0.0..=MAX_THETA).contains(&theta) || !phi.is_finite() {
        return Err(cursor.file().error(format!(
            "has {what} at [{theta}, {phi}] (byte {at}), expected theta from 0 to pi/2 and a finite phi, both in \
             radians"
        )));
    }
    Ok(Direction { theta, phi })
}
