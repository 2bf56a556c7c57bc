//! OpenEXR: half, float or integer channels, by name.
//!
//! Read are a spectrum, or R, G, B or X, Y, Z, or one grey channel, of the first flat layer; other channels are left
//! out. A spectrum goes before R, G, B, which then are a preview of it.

use std::io::Cursor;

use exr::image::FlatSamples;
use exr::meta::MetaData;
use exr::meta::attribute::{Chromaticities, SampleType};
use exr::prelude::{ReadChannels, ReadLayers, read};
use half::slice::HalfFloatSliceExt;

use super::color::{linear_from_srgb, rgb_from_xyz};
use super::{Color, Reading, spectrum};

/// Channels named in an error at most.
const MAX_NAMES: usize = 12;

/// Width and height, and the bytes of a decoded texel: of all channels, as all are decoded.
pub(super) fn size(bytes: &[u8]) -> Result<((u32, u32), u64), String> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|error| error.to_string())?;
    let header = meta
        .headers
        .iter()
        .find(|header| !header.deep)
        .ok_or("has deep layers only, expected a flat image")?;
    if header
        .channels
        .list
        .iter()
        .any(|channel| channel.sampling.x() != 1 || channel.sampling.y() != 1)
    {
        return Err("has channels of a lower resolution than its size, expected full channels".into());
    }
    let texel_bytes: u64 = header
        .channels
        .list
        .iter()
        .map(|channel| match channel.sample_type {
            SampleType::F16 => 2,
            SampleType::F32 | SampleType::U32 => 4,
        })
        .sum();
    let side = |side: usize| u32::try_from(side).map_err(|_| format!("has a side of {side} texels"));
    Ok((
        (side(header.layer_size.x())?, side(header.layer_size.y())?),
        texel_bytes.max(1),
    ))
}

/// Decodes to `[rgb][y][x]`; the caller has checked the size.
pub(super) fn decode(
    bytes: &[u8],
    expected: (u32, u32),
    reading: Reading,
    out: &mut [f32],
) -> Result<(), String> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel() // images are decoded in parallel
        .from_buffered(Cursor::new(bytes))
        .map_err(|error| error.to_string())?;
    let layer = &image.layer_data;
    if (layer.size.x(), layer.size.y()) != (expected.0 as usize, expected.1 as usize) {
        return Err("has flat layers of different sizes, expected one".into());
    }
    let channels = &layer.channel_data.list;
    let names: Vec<String> = channels.iter().map(|channel| channel.name.to_string()).collect();
    let texels = out.len() / 3;
    let plane_of = |channel: usize, plane: &mut [f32]| to_floats(&channels[channel].sample_data, plane);
    let spectrum = spectrum::samples(&names)?;
    if !spectrum.is_empty() {
        out.fill(0.0);
        let mut plane = vec![0.0; texels];
        for sample in spectrum {
            plane_of(sample.channel, &mut plane)?;
            for (out, weight) in out.chunks_exact_mut(texels).zip(sample.rgb) {
                out.iter_mut()
                    .zip(&plane)
                    .for_each(|(out, value)| *out += weight * value);
            }
        }
        return Ok(());
    }
    let Some((picked, named_xyz)) = pick(&names) else {
        let shown = names
            .iter()
            .take(MAX_NAMES)
            .cloned()
            .collect::<Vec<_>>()
            .join(", ");
        return Err(format!(
            "has the {} channels {shown}{}, expected R, G, B or X, Y, Z or one channel, or wavelengths as in \
             T.550nm",
            names.len(),
            if names.len() > MAX_NAMES { ", …" } else { "" }
        ));
    };
    for (plane, channel) in out.chunks_exact_mut(texels).zip(picked) {
        plane_of(channel, plane)?;
    }
    let told = image.attributes.chromaticities.as_ref().map(are_xyz);
    let is_xyz = named_xyz || told.unwrap_or(reading.exr_rgb_is_xyz && picked[0] != picked[1]);
    match reading
        .color
        .unwrap_or(if is_xyz { Color::Xyz } else { Color::Linear })
    {
        Color::Linear => {}
        Color::Xyz => rgb_from_xyz(out),
        Color::Srgb => out
            .iter_mut()
            .for_each(|value| *value = linear_from_srgb((*value).into()) as f32),
    }
    Ok(())
}

/// One channel as floats.
fn to_floats(samples: &FlatSamples, plane: &mut [f32]) -> Result<(), String> {
    if samples.len() != plane.len() {
        return Err(format!(
            "has {} samples in a channel, expected {}",
            samples.len(),
            plane.len()
        ));
    }
    match samples {
        FlatSamples::F16(samples) => samples.convert_to_f32_slice(plane),
        FlatSamples::F32(samples) => plane.copy_from_slice(samples),
        FlatSamples::U32(samples) => {
            plane
                .iter_mut()
                .zip(samples)
                .for_each(|(out, &sample)| *out = sample as f32);
        }
    }
    Ok(())
}

/// Which channels are red, green and blue or X, Y and Z, and whether they are the latter. A layer's name may stand
/// before that of the channel.
fn pick(names: &[String]) -> Option<([usize; 3], bool)> {
    let find = |wanted: &str| {
        names.iter().position(|name| {
            name.rsplit('.')
                .next()
                .is_some_and(|last| last.eq_ignore_ascii_case(wanted))
        })
    };
    let all = |wanted: [&str; 3]| Some([find(wanted[0])?, find(wanted[1])?, find(wanted[2])?]);
    let grey = || {
        find("Y")
            .or((names.len() == 1).then_some(0))
            .map(|grey| [grey; 3])
    };
    None.or_else(|| all(["R", "G", "B"]).map(|rgb| (rgb, false)))
        .or_else(|| all(["X", "Y", "Z"]).map(|xyz| (xyz, true)))
        .or_else(|| grey().map(|grey| (grey, false)))
}

/// Whether the primaries are those of XYZ itself: x = 1; y = 1; neither.
fn are_xyz(primaries: &Chromaticities) -> bool {
    let near = |found: [f32; 2], wanted: [f32; 2]| {
        found
            .iter()
            .zip(wanted)
            .all(|(found, wanted)| (found - wanted).abs() < 1e-3)
    };
    near([primaries.red.x(), primaries.red.y()], [1.0, 0.0])
        && near([primaries.green.x(), primaries.green.y()], [0.0, 1.0])
        && near([primaries.blue.x(), primaries.blue.y()], [0.0, 0.0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_found_by_name() {
        let pick = |names: &[&str]| pick(&names.iter().map(ToString::to_string).collect::<Vec<_>>());
        assert_eq!(pick(&["A", "B", "G", "R"]), Some(([3, 2, 1], false)));
        assert_eq!(pick(&["X", "Y", "Z"]), Some(([0, 1, 2], true)));
        assert_eq!(
            pick(&["beauty.b", "beauty.g", "beauty.r", "depth.Z"]),
            Some(([2, 1, 0], false))
        );
        assert_eq!(pick(&["A", "Y"]), Some(([1; 3], false)));
        assert_eq!(pick(&["depth"]), Some(([0; 3], false)));
        assert_eq!(pick(&["S0.400nm", "S0.500nm"]), None);
    }
}
