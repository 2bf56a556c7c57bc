//! One mip of a group's eigen-textures before coding, and the filter that makes the next coarser one.

/// One group's eigen-textures at one mip, `[y][x][component]`, scaled, before coding.
#[derive(Clone, Debug, PartialEq)]
pub struct MipImage {
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// width × height texels.
    pub texels: Vec<[f32; 4]>,
}

impl MipImage {
    /// The next coarser mip: box filter weighted by covered area, sides halved and rounded up.
    ///
    /// A coarse texel covers W / ⌈W/2⌉ fine ones: two, or a little less where W is odd. None reaches beyond
    /// the edge, so wrapping makes no difference; the mean of the mip is kept exactly either way. Sums run
    /// in f64.
    ///
    /// # Panics
    /// If `texels` does not hold width × height texels.
    pub fn downsample(&self, _wrap: bool) -> MipImage {
        assert_eq!(
            self.texels.len(),
            self.width as usize * self.height as usize,
            "texels of the mip"
        );
        let columns = coverage(self.width);
        let rows = coverage(self.height);
        let mut texels = Vec::with_capacity(columns.len() * rows.len());
        let mut line = vec![[0f64; 4]; self.width as usize];
        for row in rows {
            line.fill([0.0; 4]);
            for (y, weight) in row.taps() {
                let fine = &self.texels[y * line.len()..][..line.len()];
                for (sum, texel) in line.iter_mut().zip(fine) {
                    for c in 0..4 {
                        sum[c] += f64::from(texel[c]) * weight;
                    }
                }
            }
            texels.extend(columns.iter().map(|column| {
                let mut sum = [0f64; 4];
                for (x, weight) in column.taps() {
                    for c in 0..4 {
                        sum[c] += line[x][c] * weight;
                    }
                }
                sum.map(|value| value as f32)
            }));
        }
        MipImage {
            width: self.width.div_ceil(2),
            height: self.height.div_ceil(2),
            texels,
        }
    }
}

/// The fine texels under one coarse texel: at most three in a row, with their shares.
struct Coverage {
    start: usize,
    weights: [f64; 3],
    count: usize,
}

impl Coverage {
    fn taps(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.weights[..self.count]
            .iter()
            .enumerate()
            .map(|(i, &weight)| (self.start + i, weight))
    }
}

/// What each texel of the coarser side covers of the finer one. Lengths are counted in 1/coarse of a fine
/// texel, so that they are whole numbers.
fn coverage(fine: u32) -> Vec<Coverage> {
    let (fine, coarse) = (u64::from(fine), u64::from(fine.div_ceil(2)));
    (0..coarse)
        .map(|i| {
            let (begin, end) = (i * fine, (i + 1) * fine);
            let start = begin / coarse;
            let count = end.div_ceil(coarse) - start;
            let weights = std::array::from_fn(|k| {
                let texel = start + k as u64;
                let overlap = end
                    .min((texel + 1) * coarse)
                    .saturating_sub(begin.max(texel * coarse));
                overlap as f64 / fine as f64
            });
            Coverage {
                start: start as usize,
                weights,
                count: count as usize,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn even_sides_average_two_by_two() {
        let texels = (0..8).map(|i| [i as f32, 0.0, 1.0, -(i as f32)]).collect();
        let coarse = MipImage {
            width: 4,
            height: 2,
            texels,
        }
        .downsample(false);
        assert_eq!((coarse.width, coarse.height), (2, 1));
        assert_eq!(coarse.texels, [[2.5, 0.0, 1.0, -2.5], [4.5, 0.0, 1.0, -4.5]]);
    }

    #[test]
    fn three_texels_share_the_middle_one() {
        let texels = [0.0, 3.0, 9.0].map(|value| [value; 4]).to_vec();
        let coarse = MipImage {
            width: 3,
            height: 1,
            texels,
        }
        .downsample(true);
        // Two thirds of the first and one third of the second, and so on.
        assert_eq!(coarse.texels, [[1.0; 4], [7.0; 4]]);
    }

    proptest! {
        #[test]
        fn every_fine_texel_is_counted_once(fine in 1u32..5000) {
            let mut share = vec![0f64; fine as usize];
            for column in coverage(fine) {
                prop_assert!(column.count <= 3);
                let weights: Vec<_> = column.taps().collect();
                prop_assert!((weights.iter().map(|(_, weight)| weight).sum::<f64>() - 1.0).abs() < 1e-12);
                for (x, weight) in weights {
                    prop_assert!(weight > 0.0);
                    share[x] += weight;
                }
            }
            let wanted = f64::from(fine.div_ceil(2)) / f64::from(fine);
            prop_assert!(share.iter().all(|share| (share - wanted).abs() < 1e-12));
        }
    }
}
