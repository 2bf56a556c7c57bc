//! The factors of a file as a product of real matrices, without a new factorization.

use faer::MatRef;

use super::product::{Mean, Product, Side};
use crate::Result;
use crate::source::LowRank;

/// Items whose rows are read at a time.
const BLOCK: usize = 4096;

/// The product with its colours turned into RGB: `matrix[rgb][channel]` and a mean.
///
/// A texel factor that serves all channels keeps its terms; otherwise every channel brings its own. A mean that is
/// not zero brings one more term, means of texels bring three.
pub(super) fn low_rank(
    product: &Product,
    (matrix, mean): ([[f32; 3]; 3], [f32; 3]),
    images: usize,
    texels: usize,
) -> Result<LowRank> {
    let shared = matches!(product.texels, Side::Shared(_));
    let counts = product.texels.terms();
    // The first term of each channel: the same one where they share the texel factor.
    let first = if shared {
        [0; 3]
    } else {
        [0, counts[0], counts[0] + counts[1]]
    };
    let terms = first[2] + counts[2];
    let mut result = LowRank {
        terms,
        u: vec![0.0; terms * images * 3],
        v: vec![0.0; terms * texels],
    };
    for start in (0..images).step_by(BLOCK) {
        let rows = product.images.read(start..(start + BLOCK).min(images))?;
        for channel in 0..3 {
            let rows = rows.channel(channel);
            for rgb in (0..3).filter(|&rgb| matrix[rgb][channel] != 0.0) {
                let scale = matrix[rgb][channel];
                each(rows, |image, term, value| {
                    let row = 3 * (start + image) + rgb;
                    result.u[(first[channel] + term) * images * 3 + row] += scale * value;
                });
            }
        }
    }
    for start in (0..texels).step_by(BLOCK) {
        let rows = product.texels.read(start..(start + BLOCK).min(texels))?;
        let channels = if shared { 1 } else { 3 };
        for (channel, first) in first.into_iter().enumerate().take(channels) {
            each(rows.channel(channel), |texel, term, value| {
                result.v[(first + term) * texels + start + texel] = value;
            });
        }
    }
    if mean != [0.0; 3] {
        let u = mean.repeat(images);
        result.push(u, vec![1.0; texels]);
    }
    let map = |value: [f32; 3]| -> [f32; 3] {
        std::array::from_fn(|rgb| (0..3).map(|channel| matrix[rgb][channel] * value[channel]).sum())
    };
    match &product.mean {
        Mean::Zero => {}
        Mean::Images(means) => {
            let mut u = Vec::new();
            means.read(0..means.rows(), &mut u)?;
            u.as_chunks_mut::<3>()
                .0
                .iter_mut()
                .for_each(|value| *value = map(*value));
            result.push(u, vec![1.0; texels]);
        }
        Mean::Texels(means) => {
            let mut all = Vec::new();
            means.read(0..means.rows(), &mut all)?;
            for channel in 0..3 {
                let column = std::array::from_fn(|c| if c == channel { 1.0 } else { 0.0 });
                let v = all.iter().skip(channel).step_by(3).copied().collect();
                result.push(map(column).repeat(images), v);
            }
        }
    }
    Ok(result)
}

impl LowRank {
    /// Adds a term.
    fn push(&mut self, u: Vec<f32>, v: Vec<f32>) {
        self.terms += 1;
        self.u.extend(u);
        self.v.extend(v);
    }
}

/// Calls `work` for every (row, column, value).
fn each(matrix: MatRef<'_, f32>, mut work: impl FnMut(usize, usize, f32)) {
    for column in 0..matrix.ncols() {
        for row in 0..matrix.nrows() {
            work(row, column, matrix[(row, column)]);
        }
    }
}
