//! Decorrelated full matrix factorizations of every colour model.

use crate::common::{Bytes, META, SMALL, compare, kept, number};

const PCA_MEAN: [f64; 3] = [0.25, -0.5, 0.125];
const PCA_MATRIX: [[f64; 3]; 3] = [[0.5, 0.25, -1.0], [2.0, 0.125, 1.0], [-0.5, 1.5, 3.0]];
/// Components of the three channels.
const TERMS: [usize; 3] = [3, 1, 2];

pub(crate) fn dfmf(model: i32, size: usize, transposed: bool) -> Bytes {
    let mut bytes = Bytes::common("!DFMF08FCR", META, SMALL);
    bytes.u32(3);
    bytes.0.extend(model.to_le_bytes());
    PCA_MEAN.iter().for_each(|&mean| bytes.f32(mean));
    PCA_MATRIX
        .as_flattened()
        .iter()
        .for_each(|&entry| bytes.f32(entry));
    for (channel, terms) in TERMS.into_iter().enumerate() {
        let u = |row, term| number(10 + channel, row, term);
        let v = |row, term| number(20 + channel, row, term);
        let (images, texels) = (SMALL.images(), SMALL.texels());
        let rows = if transposed {
            (texels, images)
        } else {
            (images, texels)
        };
        bytes.factorization(size, terms, (rows.0, &u), (rows.1, &v));
    }
    bytes
}

/// The models again, in f64.
pub(crate) fn rgb(model: i32, [a, b, c]: [f64; 3]) -> [f64; 3] {
    const E: f64 = 1e-5;
    let yuv = |y: f64, u: f64, v: f64| [y + 1.13983 * v, y - 0.39465 * u - 0.5806 * v, y + 2.03211 * u];
    match model {
        0 => [a, b, c],
        1 => yuv(a, b, c),
        2 => {
            let fy = (a + 16.0) / 116.0;
            let cube = |f: f64| {
                if f > 6.0 / 29.0 {
                    f.powi(3)
                } else {
                    (f - 4.0 / 29.0) * 108.0 / 841.0
                }
            };
            let [x, y, z] = [
                0.96422 * cube(fy + b / 500.0),
                cube(fy),
                0.82521 * cube(fy - c / 200.0),
            ];
            [
                3.133856 * x - 1.6168667 * y - 0.4906146 * z,
                -0.9787684 * x + 1.9161415 * y + 0.033454 * z,
                0.0719453 * x - 0.2289914 * y + 1.4052427 * z,
            ]
        }
        3 => std::array::from_fn(|j| {
            a * PCA_MATRIX[0][j] + b * PCA_MATRIX[1][j] + c * PCA_MATRIX[2][j] + PCA_MEAN[j]
        }),
        4 => [a + b - c, a + c, a - b - c],
        5 => [a * (1.0 - b - c), a * b, a * c],
        9 => yuv(a.exp() - E, b, c),
        10 => yuv(
            a.exp() - E,
            b.signum() * E * b.abs().exp(),
            c.signum() * E * c.abs().exp(),
        ),
        11 => yuv(a.exp() - E, b * a.exp(), c * a.exp()),
        12 => [a.exp() - E, b.exp() - E, c.exp() - E],
        _ => unreachable!(),
    }
}

#[test]
fn decorrelated_factorizations_of_every_colour_model() {
    for model in [0, 1, 2, 3, 4, 5, 9, 10, 11, 12] {
        for (size, transposed) in [(2, false), (4, true), (8, false)] {
            let btf = dfmf(model, size, transposed).open().unwrap();
            compare(&btf, SMALL, &|image, channel, texel| {
                let values = std::array::from_fn(|c| {
                    let (u, v) = if transposed {
                        (texel, image)
                    } else {
                        (image, texel)
                    };
                    (0..TERMS[c])
                        .map(|t| kept(size, number(10 + c, u, t)) * kept(size, number(20 + c, v, t)))
                        .sum()
                });
                rgb(model, values)[channel]
            });
            let terms = match model {
                0 | 1 | 4 => Some(6),
                3 => Some(7),
                _ => None,
            };
            assert_eq!(
                btf.low_rank().unwrap().map(|low_rank| low_rank.terms),
                terms,
                "model {model}"
            );
        }
    }
}

/// Highlights stay: nothing is clamped to [0, 1].
#[test]
fn high_dynamic_range_is_kept() {
    let mut bytes = Bytes::common("!DFMF08FCR", META, SMALL);
    bytes.u32(1);
    bytes.u32(11);
    (0..12).for_each(|_| bytes.f32(f64::NAN));
    for value in [6.0, -0.75, 0.5] {
        bytes.factorization(8, 1, (6, &|_, _| 1.0), (12, &move |_, _| value));
    }
    let btf = bytes.open().unwrap();
    compare(&btf, SMALL, &|_, channel, _| rgb(11, [6.0, -0.75, 0.5])[channel]);
    let peak = rgb(11, [6.0, -0.75, 0.5]);
    assert!(peak[0] > 600.0 && peak[2] < -200.0, "{peak:?}");
}
