//! Colour models: from the channels that a file stores to linear RGB.
//!
//! Nothing is clamped: values above one are highlights, and values below zero are errors of the factorization that
//! the mean must keep.
//!
//! Source: the models and their numbers are those of the University of Bonn's btflib (2014 to 2016).

use super::bytes::ByteFile;
use crate::Result;

/// What is added before a logarithm is taken.
pub(super) const EPSILON: f32 = 1e-5;

type Matrix3 = [[f32; 3]; 3];

const IDENTITY: Matrix3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// RGB from YUV.
const RGB_FROM_YUV: Matrix3 = [[1.0, 0.0, 1.13983], [1.0, -0.39465, -0.5806], [1.0, 2.03211, 0.0]];
/// RGB from YCoCg.
const RGB_FROM_YCOCG: Matrix3 = [[1.0, 1.0, -1.0], [1.0, 0.0, 1.0], [1.0, -1.0, -1.0]];
/// Linear RGB of sRGB's primaries from XYZ relative to D50, adapted by Bradford's matrix (Lindbloom).
const RGB_FROM_XYZ_D50: Matrix3 = [
    [3.133_856, -1.616_866_7, -0.490_614_6],
    [-0.978_768_4, 1.916_141_5, 0.033_454],
    [0.071_945_3, -0.228_991_4, 1.405_242_7],
];
/// The D50 white of ICC profiles.
const WHITE_D50: [f32; 3] = [0.964_22, 1.0, 0.825_21];

/// How three stored channels make red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ColourModel {
    /// 0: as they are.
    Rgb,
    /// 1.
    Yuv,
    /// 2: CIE 1976 L*a*b* relative to D50, L from 0 to 100.
    Lab,
    /// 3: `rgb[j] = Σ_i value[i]·matrix[i][j] + mean[j]`.
    Pca { matrix: Matrix3, mean: [f32; 3] },
    /// 4.
    YCoCg,
    /// 5: the sum of all channels, then the shares of the second and third in it.
    Spectral,
    /// 9: log(Y + ε), U, V.
    LogYUv,
    /// 10: log(Y + ε) and sign(U)·log(|U|/ε), V likewise.
    LogYLogUv,
    /// 11: log(Y + ε), U/(Y + ε), V/(Y + ε).
    LogYRelativeUv,
    /// 12: log(RGB + ε); also FMF files with a reduced range.
    LogRgb,
}

impl ColourModel {
    /// The model of number `model`, which stands at byte `at`.
    ///
    /// # Errors
    /// Numbers without a known meaning, and a PCA that is not finite.
    pub(super) fn new(file: &ByteFile, at: u64, model: i32, mean: [f32; 3], matrix: Matrix3) -> Result<Self> {
        Ok(match model {
            0 => ColourModel::Rgb,
            1 => ColourModel::Yuv,
            2 => ColourModel::Lab,
            3 => {
                if matrix.as_flattened().iter().chain(&mean).any(|x| !x.is_finite()) {
                    return Err(file.error(format!(
                        "has a PCA colour model with mean {mean:?} and matrix {matrix:?} (from byte {}), expected \
                         finite numbers",
                        at + 4
                    )));
                }
                ColourModel::Pca { matrix, mean }
            }
            4 => ColourModel::YCoCg,
            5 => ColourModel::Spectral,
            9 => ColourModel::LogYUv,
            10 => ColourModel::LogYLogUv,
            11 => ColourModel::LogYRelativeUv,
            12 => ColourModel::LogRgb,
            6 => {
                return Err(file.error(format!(
                    "has colour model 6 (linear spectral, byte {at}), for which no consistent definition is public: \
                     convert the file to another colour model with the tool that wrote it"
                )));
            }
            other => {
                return Err(file.error(format!(
                    "has colour model {other} (byte {at}), known are 0 RGB, 1 YUV, 2 Lab, 3 PCA, 4 YCoCg, 5 spectral, \
                     9 to 11 logarithmic YUV and 12 logarithmic RGB"
                )));
            }
        })
    }

    /// For people.
    pub(super) fn name(&self) -> &'static str {
        match self {
            ColourModel::Rgb => "RGB",
            ColourModel::Yuv => "YUV",
            ColourModel::Lab => "Lab",
            ColourModel::Pca { .. } => "PCA of colours",
            ColourModel::YCoCg => "YCoCg",
            ColourModel::Spectral => "sum and shares",
            ColourModel::LogYUv => "log Y, U, V",
            ColourModel::LogYLogUv => "log Y, log U, log V",
            ColourModel::LogYRelativeUv => "log Y, U/Y, V/Y",
            ColourModel::LogRgb => "log RGB",
        }
    }

    /// The matrix and mean of a linear model: `rgb[j] = Σ_c matrix[j][c]·value[c] + mean[j]`.
    pub(super) fn linear(&self) -> Option<(Matrix3, [f32; 3])> {
        let zero = [0.0; 3];
        match *self {
            ColourModel::Rgb => Some((IDENTITY, zero)),
            ColourModel::Yuv => Some((RGB_FROM_YUV, zero)),
            ColourModel::YCoCg => Some((RGB_FROM_YCOCG, zero)),
            ColourModel::Pca { matrix, mean } => Some((
                std::array::from_fn(|j| std::array::from_fn(|c| matrix[c][j])),
                mean,
            )),
            _ => None,
        }
    }

    /// Linear red, green and blue of stored channels.
    pub(super) fn rgb(&self, value: [f32; 3]) -> [f32; 3] {
        let [y, u, v] = value;
        match self {
            ColourModel::Rgb => value,
            ColourModel::Yuv => product(&RGB_FROM_YUV, value),
            ColourModel::YCoCg => product(&RGB_FROM_YCOCG, value),
            ColourModel::Pca { .. } => {
                let (matrix, mean) = self.linear().expect("a PCA is linear");
                let rgb = product(&matrix, value);
                std::array::from_fn(|j| rgb[j] + mean[j])
            }
            ColourModel::Lab => {
                let y = (value[0] + 16.0) / 116.0;
                let xyz = [y + u / 500.0, y, y - v / 200.0].map(inverse_lightness);
                product(&RGB_FROM_XYZ_D50, std::array::from_fn(|c| xyz[c] * WHITE_D50[c]))
            }
            ColourModel::Spectral => [y * (1.0 - u - v), y * u, y * v],
            ColourModel::LogYUv => product(&RGB_FROM_YUV, [y.exp() - EPSILON, u, v]),
            ColourModel::LogYLogUv => {
                let exp = |x: f32| {
                    if x == 0.0 {
                        0.0
                    } else {
                        (x.abs().exp() * EPSILON).copysign(x)
                    }
                };
                product(&RGB_FROM_YUV, [y.exp() - EPSILON, exp(u), exp(v)])
            }
            ColourModel::LogYRelativeUv => {
                let exp = y.exp();
                product(&RGB_FROM_YUV, [exp - EPSILON, u * exp, v * exp])
            }
            ColourModel::LogRgb => value.map(|x| x.exp() - EPSILON),
        }
    }
}

fn product(matrix: &Matrix3, value: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|j| (0..3).map(|c| matrix[j][c] * value[c]).sum())
}

/// The inverse of CIE's f: linear below 6/29.
fn inverse_lightness(f: f32) -> f32 {
    const KNEE: f32 = 6.0 / 29.0;
    if f > KNEE {
        f * f * f
    } else {
        3.0 * KNEE * KNEE * (f - 4.0 / 29.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_of_lab_is_white() {
        let white = ColourModel::Lab.rgb([100.0, 0.0, 0.0]);
        assert!(white.iter().all(|c| (c - 1.0).abs() < 1e-4), "{white:?}");
        let black = ColourModel::Lab.rgb([0.0; 3]);
        assert!(black.iter().all(|c| c.abs() < 1e-6), "{black:?}");
    }

    #[test]
    fn linear_models_agree_with_their_matrices() {
        let pca = ColourModel::Pca {
            matrix: [[0.5, 0.25, -1.0], [2.0, 0.125, 1.0], [-0.5, 1.5, 3.0]],
            mean: [0.25, 0.5, -0.75],
        };
        for model in [ColourModel::Rgb, ColourModel::Yuv, ColourModel::YCoCg, pca] {
            let (matrix, mean) = model.linear().unwrap();
            let value = [0.75, -0.25, 0.5];
            let rgb = product(&matrix, value);
            let expected: [f32; 3] = std::array::from_fn(|j| rgb[j] + mean[j]);
            assert_eq!(model.rgb(value), expected);
        }
        assert_eq!(ColourModel::LogRgb.linear(), None);
    }
}
