//! Structural similarity of grey pictures.
//!
//! Source: Wang, Bovik, Sheikh, Simoncelli: Image Quality Assessment: From Error Visibility to Structural
//! Similarity, 2004: Gaussian window of 11×11 with σ = 1.5, K1 = 0.01, K2 = 0.03, covariances of the
//! population.

/// Pixels from the middle of the window to its edge.
const RADIUS: usize = 5;
const SIGMA: f64 = 1.5;
/// (K1 L)² and (K2 L)² for values in [0, 1].
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// SSIM at each pixel of two pictures of `width` columns with values in [0, 1]; pictures are mirrored at
/// their edges.
///
/// # Panics
/// If the pictures differ in size or do not hold whole rows.
pub fn ssim_map(a: &[f64], b: &[f64], width: usize) -> Vec<f64> {
    assert!(
        a.len() == b.len() && (a.is_empty() || a.len().is_multiple_of(width)),
        "pictures of the same size"
    );
    let blurred_product = |a: &[f64], b: &[f64]| {
        let product: Vec<f64> = a.iter().zip(b).map(|(a, b)| a * b).collect();
        blur(&product, width)
    };
    let (mean_a, mean_b) = (blur(a, width), blur(b, width));
    let (aa, bb, ab) = (
        blurred_product(a, a),
        blurred_product(b, b),
        blurred_product(a, b),
    );
    (0..a.len())
        .map(|at| {
            let (mean_a, mean_b) = (mean_a[at], mean_b[at]);
            let means = mean_a * mean_a + mean_b * mean_b;
            let variances = aa[at] + bb[at] - means;
            let covariance = ab[at] - mean_a * mean_b;
            (2.0 * mean_a * mean_b + C1) * (2.0 * covariance + C2) / ((means + C1) * (variances + C2))
        })
        .collect()
}

/// Mean of SSIM over the covered pixels whose whole window lies in the picture, as Wang et al. take it, or
/// over all covered pixels if there are none such. `None` if no pixel is covered.
///
/// # Panics
/// As [`ssim_map`].
pub fn mean_ssim(a: &[f64], b: &[f64], width: usize, covered: impl Fn(usize) -> bool) -> Option<f64> {
    let map = ssim_map(a, b, width);
    let height = map.len() / width.max(1);
    let whole = |at: &usize| {
        let (x, y) = (at % width, at / width);
        x >= RADIUS && y >= RADIUS && x + RADIUS < width && y + RADIUS < height
    };
    let mean = |at: Vec<usize>| {
        (!at.is_empty()).then(|| at.iter().map(|&at| map[at]).sum::<f64>() / at.len() as f64)
    };
    let covered: Vec<usize> = (0..map.len()).filter(|&at| covered(at)).collect();
    mean(covered.iter().copied().filter(whole).collect()).or_else(|| mean(covered))
}

fn blur(values: &[f64], width: usize) -> Vec<f64> {
    if values.is_empty() {
        return Vec::new();
    }
    let height = values.len() / width;
    let window = window();
    let at = |x: usize, y: usize| values[y * width + x];
    let across = filter(width, height, &window, |x, y, offset| {
        at(mirror(x, offset, width), y)
    });
    let at = |x: usize, y: usize| across[y * width + x];
    filter(width, height, &window, |x, y, offset| {
        at(x, mirror(y, offset, height))
    })
}

fn filter(
    width: usize,
    height: usize,
    window: &[f64],
    value: impl Fn(usize, usize, usize) -> f64,
) -> Vec<f64> {
    let mut out = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            out.push(
                window
                    .iter()
                    .enumerate()
                    .map(|(offset, weight)| weight * value(x, y, offset))
                    .sum(),
            );
        }
    }
    out
}

fn window() -> Vec<f64> {
    let bell = |offset: usize| (-(offset as f64 - RADIUS as f64).powi(2) / (2.0 * SIGMA * SIGMA)).exp();
    let window: Vec<f64> = (0..=2 * RADIUS).map(bell).collect();
    let sum: f64 = window.iter().sum();
    window.into_iter().map(|weight| weight / sum).collect()
}

/// Position `at` + `offset` − RADIUS, mirrored at the edges between pixels.
fn mirror(at: usize, offset: usize, len: usize) -> usize {
    let period = 2 * len as i64;
    let folded = (at as i64 + offset as i64 - RADIUS as i64).rem_euclid(period);
    folded.min(period - 1 - folded) as usize
}
