//! FLIP: how visible the difference of two pictures is to somebody who sees them in turn, from 0 to 1.
//!
//! Sources: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild: FLIP: A Difference Evaluator for Alternating
//! Images, 2020 (sections 4.1 and 4.2, constants from its table 1 and the authors' program); Andersson, Nilsson, Shirley,
//! Akenine-Möller: Visualizing Errors in Rendered High Dynamic Range Images, 2021 ([`hdr_flip_map`]). Own, because the crate
//! `nv-flip` binds C++, which browsers and cross builds do not have; the tests compare with the authors' program.
//!
//! All filters here separate into rows and columns: Gaussians, and Gaussians times a function of one coordinate.

use super::{Picture, tone};

/// Pixels per degree of vision: a screen of 3840 pixels and 0.7 m, seen from 0.7 m. The authors' default.
pub const PIXELS_PER_DEGREE: f64 = 3840.0 * std::f64::consts::PI / 180.0;

/// Exponents of colour and feature differences.
const COLOUR_EXPONENT: f64 = 0.7;
const FEATURE_EXPONENT: f64 = 0.5;
/// Up to this share of the largest colour difference, errors take this much of the range.
const KNEE: (f64, f64) = (0.4, 0.95);
/// Degrees between peak and trough of the filter that finds edges and points.
const FEATURE_DEGREES: f64 = 0.082;
/// Contrast sensitivity of achromatic, red-green and blue-yellow, as sums of Gaussians: height, and squared width.
const SENSITIVITY: [&[(f64, f64)]; 3] = [&[(1.0, 0.0047)], &[(1.0, 0.0053)], &[(34.1, 0.04), (13.5, 0.025)]];
/// The largest of those widths: all filters are as wide as that one needs.
const WIDEST: f64 = 0.04;

/// XYZ from linear sRGB, and back; primaries and D65 in the digits of the authors' program.
const XYZ_FROM_RGB: [[f64; 3]; 3] = [
    [
        10135552.0 / 24577794.0,
        8788810.0 / 24577794.0,
        4435075.0 / 24577794.0,
    ],
    [
        2613072.0 / 12288897.0,
        8788810.0 / 12288897.0,
        887015.0 / 12288897.0,
    ],
    [
        1425312.0 / 73733382.0,
        8788810.0 / 73733382.0,
        70074185.0 / 73733382.0,
    ],
];
const RGB_FROM_XYZ: [[f64; 3]; 3] = [
    [3.241003275, -1.537398934, -0.498615861],
    [-0.969224334, 1.875930071, 0.041554224],
    [0.055639423, -0.204011202, 1.057148933],
];
const WHITE: [f64; 3] = [0.950428545, 1.0, 1.088900371];

/// FLIP at each pixel of what a screen shows of two pictures, `[y][x]`: exposed, tone mapped, clipped.
///
/// `None` if the pictures differ in size, or do not hold what their size says.
pub fn flip_map(
    picture: &Picture,
    reference: &Picture,
    exposure_stops: f32,
    pixels_per_degree: f64,
) -> Option<Vec<f64>> {
    let shown = |picture: &Picture| -> Vec<[f64; 3]> {
        let shown = |pixel: &[f32; 3]| tone::display_from_radiance(*pixel, exposure_stops);
        picture.pixels.iter().map(shown).collect()
    };
    let width = same_width(picture, reference)?;
    Some(ldr_flip_map(
        &shown(picture),
        &shown(reference),
        width,
        pixels_per_degree,
    ))
}

/// HDR-FLIP at each pixel of the radiance of two pictures, before any tone mapping of ours: the largest FLIP over exposures in
/// steps of at most one stop, from where the brightest pixel of the reference to where its median is nearly white under the
/// ACES curve of the paper.
///
/// `None` as [`flip_map`].
pub fn hdr_flip_map(picture: &Picture, reference: &Picture, pixels_per_degree: f64) -> Option<Vec<f64>> {
    let width = same_width(picture, reference)?;
    let (start, stop) = exposures(reference);
    let count = ((stop - start).ceil() as usize).clamp(2, MOST_EXPOSURES);
    let mut largest = vec![0f64; picture.pixels.len()];
    for exposure in 0..count {
        let factor = (start + (stop - start) * exposure as f64 / (count - 1) as f64).exp2();
        let mapped = |picture: &Picture| -> Vec<[f64; 3]> {
            let mapped = |pixel: &[f32; 3]| pixel.map(|channel| aces(f64::from(channel) * factor));
            picture.pixels.iter().map(mapped).collect()
        };
        let map = ldr_flip_map(&mapped(picture), &mapped(reference), width, pixels_per_degree);
        for (largest, flip) in largest.iter_mut().zip(map) {
            // A value that is not a number stays one.
            if flip.is_nan() || flip > *largest {
                *largest = flip;
            }
        }
    }
    Some(largest)
}

/// Mean FLIP over the covered pixels (`[y][x]`; all if it is `None`), as [`flip_map`].
///
/// `None` as that, or if nothing is covered.
pub fn mean_flip(
    picture: &Picture,
    reference: &Picture,
    covered: Option<&[bool]>,
    exposure_stops: f32,
) -> Option<f64> {
    mean(
        flip_map(picture, reference, exposure_stops, PIXELS_PER_DEGREE)?,
        covered,
    )
}

/// Mean HDR-FLIP over the covered pixels, as [`hdr_flip_map`].
///
/// `None` as that, or if nothing is covered.
pub fn mean_hdr_flip(picture: &Picture, reference: &Picture, covered: Option<&[bool]>) -> Option<f64> {
    mean(hdr_flip_map(picture, reference, PIXELS_PER_DEGREE)?, covered)
}

fn mean(map: Vec<f64>, covered: Option<&[bool]>) -> Option<f64> {
    if covered.is_some_and(|covered| covered.len() != map.len()) {
        return None;
    }
    let counted = (0..map.len()).filter(|&at| covered.is_none_or(|covered| covered[at]));
    let (sum, count) = counted.fold((0.0, 0usize), |(sum, count), at| (sum + map[at], count + 1));
    (count > 0).then(|| sum / count as f64)
}

fn same_width(picture: &Picture, reference: &Picture) -> Option<usize> {
    let size = |picture: &Picture| (picture.width, picture.height, picture.pixels.len());
    let count = picture.width as usize * picture.height as usize;
    (size(picture) == size(reference) && count == picture.pixels.len() && count > 0)
        .then_some(picture.width as usize)
}

/// Most exposures of one picture: floats have 277 stops.
const MOST_EXPOSURES: usize = 300;
/// The exposed radiance that the ACES curve maps to 0.85.
const NEARLY_WHITE: f64 = 0.85;
/// ACES curve: numerator and denominator in x², x and 1, after K. Narkowicz: ACES Filmic Tone Mapping Curve, 2015.
const ACES: [[f64; 3]; 2] = [[0.36 * 2.51, 0.6 * 0.03, 0.0], [0.36 * 2.43, 0.6 * 0.59, 0.14]];

fn aces(x: f64) -> f64 {
    // Neither `f64::max` nor `f64::min`, which pass over values that are not numbers; `clamp` does not.
    let x = x.clamp(0.0, 1e30);
    let of = |[a, b, c]: [f64; 3]| (a * x + b) * x + c;
    (of(ACES[0]) / of(ACES[1])).clamp(0.0, 1.0)
}

/// Stops of the least and of the largest exposure.
fn exposures(reference: &Picture) -> (f64, f64) {
    let difference = |at: usize| ACES[0][at] - NEARLY_WHITE * ACES[1][at];
    let (half, product) = (0.5 * difference(1) / difference(0), difference(2) / difference(0));
    let white = -half + (half * half - product).sqrt();
    let mut luminances: Vec<f64> = reference
        .pixels
        .iter()
        .map(|pixel| {
            let [r, g, b] = pixel.map(f64::from);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        })
        .filter(|luminance| luminance.is_finite())
        .collect();
    luminances.sort_unstable_by(f64::total_cmp);
    let Some(&brightest) = luminances.last().filter(|brightest| **brightest > 0.0) else {
        return (0.0, 0.0);
    };
    // Of two in the middle the larger, as the authors' program.
    let median = luminances[luminances.len() / 2];
    let start = (white / brightest).log2();
    // A picture that is half black has no exposure that would make its median white.
    let stop = if median > 0.0 {
        (white / median).log2()
    } else {
        start + 16.0
    };
    (start, stop.max(start))
}

/// FLIP of linear RGB in [0, 1].
fn ldr_flip_map(test: &[[f64; 3]], reference: &[[f64; 3]], width: usize, pixels_per_degree: f64) -> Vec<f64> {
    let [test, reference] = [test, reference].map(|picture| Seen::new(picture, width, pixels_per_degree));
    let largest = {
        let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(hunt);
        hyab(green, blue).powf(COLOUR_EXPONENT)
    };
    let knee = KNEE.0 * largest;
    let at = |at: usize| {
        let colour = hyab(test.colours[at], reference.colours[at]).powf(COLOUR_EXPONENT);
        let colour = if colour < knee {
            colour * KNEE.1 / knee
        } else {
            KNEE.1 + (colour - knee) / (largest - knee) * (1.0 - KNEE.1)
        };
        let apart = |a: [f64; 2], b: [f64; 2]| (a[0].hypot(a[1]) - b[0].hypot(b[1])).abs();
        let edges = apart(test.edges[at], reference.edges[at]);
        let points = apart(test.points[at], reference.points[at]);
        let feature = (edges.max(points) / std::f64::consts::SQRT_2).powf(FEATURE_EXPONENT);
        colour.powf(1.0 - feature)
    };
    (0..test.colours.len()).map(at).collect()
}

/// A picture as it is seen from a distance.
struct Seen {
    /// Filtered by contrast sensitivity; L*, a*, b* with Hunt's adjustment.
    colours: Vec<[f64; 3]>,
    /// Edges and points, across and along.
    edges: Vec<[f64; 2]>,
    points: Vec<[f64; 2]>,
}

impl Seen {
    fn new(picture: &[[f64; 3]], width: usize, pixels_per_degree: f64) -> Self {
        let opponent: Vec<[f64; 3]> = picture.iter().map(|&pixel| opponent_from_linear(pixel)).collect();
        let channel = |channel: usize| -> Vec<f64> { opponent.iter().map(|pixel| pixel[channel]).collect() };
        let filtered: [Vec<f64>; 3] =
            std::array::from_fn(|c| by_sensitivity(&channel(c), width, SENSITIVITY[c], pixels_per_degree));
        let colours = (0..picture.len()).map(|at| {
            let rgb = linear_from_opponent([0, 1, 2].map(|c: usize| filtered[c][at]));
            hunt(rgb.map(|channel| channel.clamp(0.0, 1.0)))
        });
        let lightness: Vec<f64> = opponent.iter().map(|pixel| (pixel[0] + 16.0) / 116.0).collect();
        let sigma = 0.5 * FEATURE_DEGREES * pixels_per_degree;
        let radius = (3.0 * sigma).ceil() as i32;
        let bell = |x: f64| (-x * x / (2.0 * sigma * sigma)).exp();
        let smooth = normalized(kernel(radius, bell));
        let features = |weight: &dyn Fn(f64) -> f64| -> Vec<[f64; 2]> {
            let steep = balanced(kernel(radius, weight));
            let across = filter(&lightness, width, &steep, &smooth);
            let along = filter(&lightness, width, &smooth, &steep);
            across.into_iter().zip(along).map(Into::into).collect()
        };
        Self {
            colours: colours.collect(),
            edges: features(&|x| -x * bell(x)),
            points: features(&|x| (x * x / (sigma * sigma) - 1.0) * bell(x)),
        }
    }
}

/// A channel filtered by a sum of Gaussians.
fn by_sensitivity(
    channel: &[f64],
    width: usize,
    gaussians: &[(f64, f64)],
    pixels_per_degree: f64,
) -> Vec<f64> {
    use std::f64::consts::PI;
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i32;
    let mut sum = vec![0.0; channel.len()];
    let mut total = 0.0;
    for &(height, width_squared) in gaussians {
        let bell = |x: f64| (-(PI * x / pixels_per_degree).powi(2) / width_squared).exp();
        let weights = kernel(radius, bell);
        let weight = height * (PI / width_squared).sqrt() * weights.iter().sum::<f64>().powi(2);
        let weights = normalized(weights);
        let filtered = filter(channel, width, &weights, &weights);
        sum.iter_mut()
            .zip(filtered)
            .for_each(|(sum, filtered)| *sum += weight * filtered);
        total += weight;
    }
    sum.iter_mut().for_each(|sum| *sum /= total);
    sum
}

fn kernel(radius: i32, weight: impl Fn(f64) -> f64) -> Vec<f64> {
    (-radius..=radius).map(|x| weight(x.into())).collect()
}

/// Weights that sum to one.
fn normalized(weights: Vec<f64>) -> Vec<f64> {
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

/// Positive weights that sum to 1, and negative ones to −1.
fn balanced(weights: Vec<f64>) -> Vec<f64> {
    let sum = |sign: f64| weights.iter().map(|weight| (weight * sign).max(0.0)).sum::<f64>();
    let (positive, negative) = (sum(1.0), sum(-1.0));
    let balance = |weight: &f64| weight / if *weight < 0.0 { negative } else { positive };
    weights.iter().map(balance).collect()
}

/// Correlation with `across` along rows and `down` along columns; the outermost pixels go on beyond the edges.
fn filter(values: &[f64], width: usize, across: &[f64], down: &[f64]) -> Vec<f64> {
    let mut rows = Vec::with_capacity(values.len());
    let radius = across.len() / 2;
    for row in values.chunks_exact(width) {
        let mut padded = vec![row[0]; radius];
        padded.extend_from_slice(row);
        padded.extend(std::iter::repeat_n(row[width - 1], radius));
        rows.extend(padded.windows(across.len()).map(|window| dot(window, across)));
    }
    let (height, radius) = (values.len() / width, down.len() / 2);
    let mut sums = Vec::with_capacity(values.len());
    for y in 0..height {
        let mut sum = vec![0.0; width];
        for (offset, weight) in down.iter().enumerate() {
            let from = (y + offset).saturating_sub(radius).min(height - 1);
            let row = &rows[from * width..][..width];
            sum.iter_mut()
                .zip(row)
                .for_each(|(sum, value)| *sum += weight * value);
        }
        sums.extend(sum);
    }
    sums
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn transform(matrix: [[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| dot(&row, &vector))
}

/// Y, Cx, Cz: linear lightness, red-green, blue-yellow.
fn opponent_from_linear(rgb: [f64; 3]) -> [f64; 3] {
    let xyz = transform(XYZ_FROM_RGB, rgb);
    let [x, y, z] = [0, 1, 2].map(|axis| xyz[axis] / WHITE[axis]);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn linear_from_opponent([y, cx, cz]: [f64; 3]) -> [f64; 3] {
    let y = (y + 16.0) / 116.0;
    let relative = [y + cx / 500.0, y, y - cz / 200.0];
    transform(RGB_FROM_XYZ, [0, 1, 2].map(|axis| relative[axis] * WHITE[axis]))
}

/// L*, a*, b* with less colour where it is dark (Hunt 1952, as the paper takes it).
fn hunt(rgb: [f64; 3]) -> [f64; 3] {
    let xyz = transform(XYZ_FROM_RGB, rgb);
    let curve = |t: f64| {
        const EDGE: f64 = 6.0 / 29.0;
        if t > EDGE * EDGE * EDGE {
            t.cbrt()
        } else {
            t / (3.0 * EDGE * EDGE) + 4.0 / 29.0
        }
    };
    let [x, y, z] = [0, 1, 2].map(|axis| curve(xyz[axis] / WHITE[axis]));
    let lightness = 116.0 * y - 16.0;
    [
        lightness,
        0.01 * lightness * 500.0 * (x - y),
        0.01 * lightness * 200.0 * (y - z),
    ]
}

/// Distance in lightness plus distance in colour (Abasi, Tehran, Fairchild 2020).
fn hyab([l1, a1, b1]: [f64; 3], [l2, a2, b2]: [f64; 3]) -> f64 {
    (l1 - l2).abs() + (a1 - a2).hypot(b1 - b2)
}

#[cfg(test)]
mod tests;
