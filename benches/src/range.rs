//! Weights of rows and compression of the range of samples, measured against each other at equal rank.
//!
//! A renderer would have to undo a curve after the sum over components, and could not filter textures before it; so
//! curves are measured here and not built in. Weights change nothing but the choice of textures.

use std::ops::Range;
use std::path::Path;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use preprocess::npy::Samples;
use preprocess::source::Images;
use preprocess::{Btf, Factors, Settings, Weights, factorize::factorize};
use serde::Serialize;

use crate::Result;

/// Of so many images one is judged: a prime, so that all lights and views have their turn.
const JUDGED: usize = 7;
/// The knee of the logarithm, in root mean squares of the BTF.
const KNEE: f64 = 0.1;

/// What is done to samples before they are factorized, and undone after the product. Signs are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Curve {
    /// Nothing.
    Linear,
    /// log(1 + x/ε).
    Log(f32),
    /// x to the power of 1/2.2.
    Power,
}

impl Curve {
    fn forth(self, x: f32) -> f32 {
        match self {
            Curve::Linear => x,
            Curve::Log(epsilon) => (x.abs() / epsilon).ln_1p().copysign(x),
            Curve::Power => x.abs().powf(1.0 / 2.2).copysign(x),
        }
    }

    fn back(self, y: f32) -> f32 {
        match self {
            Curve::Linear => y,
            Curve::Log(epsilon) => (y.abs().exp_m1() * epsilon).copysign(y),
            Curve::Power => y.abs().powf(2.2).copysign(y),
        }
    }
}

/// What a way of factorizing comes out like.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Which one.
    pub way: &'static str,
    /// Terms.
    pub components: usize,
    /// Root mean square error relative to the root mean square, linear.
    pub relative_rmse: f64,
    /// Root mean square error of sRGB values from 0 to 1 of samples that are clamped to that range.
    pub tone_mapped_rmse: f64,
    /// Mean of the CIELAB differences ΔE*ab of the same colours.
    pub mean_delta_e: f64,
}

/// Factorizes the BTF at `path` in five ways with as many terms each, and compares the products with it on every seventh
/// image. `progress` gets the name of each way before it begins.
///
/// # Errors
/// Those of [`Btf::open`] and [`factorize()`].
pub fn run(path: &Path, settings: &Settings, progress: &dyn Fn(&str)) -> Result<Vec<Row>> {
    let btf = Btf::open(path)?;
    let mut rows = Vec::new();
    for (way, weights) in [
        ("as is", Weights::Uniform),
        ("by solid angle", Weights::SolidAngle),
        ("robust", Weights::Robust),
    ] {
        progress(way);
        let settings = Settings { weights, ..*settings };
        let factors = factorize(&btf, &settings, &|_| ())?;
        rows.push((judge(&btf, &factors, Curve::Linear, way)?, factors.btf_rms()));
    }
    let knee = KNEE * rows[0].1.max(f64::from(f32::MIN_POSITIVE));
    for (way, curve) in [
        ("log(1 + x/e)", Curve::Log(knee as f32)),
        ("x^(1/2.2)", Curve::Power),
    ] {
        progress(way);
        let images = Box::new(Curved {
            btf: Btf::open(path)?,
            curve,
        });
        let size = (btf.width(), btf.height());
        let curved = Btf::new(path, btf.sampling().clone(), size, images)?;
        let factors = factorize(&curved, settings, &|_| ())?;
        rows.push((judge(&btf, &factors, curve, way)?, 0.0));
    }
    Ok(rows.into_iter().map(|(row, _)| row).collect())
}

/// An aligned table for people.
pub fn table(rows: &[Row]) -> String {
    let mut text = format!(
        "{:<16}{:>6}{:>16}{:>19}{:>14}\n",
        "way", "terms", "relative RMSE", "tone-mapped RMSE", "mean dE*ab"
    );
    for row in rows {
        text += &format!(
            "{:<16}{:>6}{:>14.2} %{:>19.4}{:>14.2}\n",
            row.way,
            row.components,
            100.0 * row.relative_rmse,
            row.tone_mapped_rmse,
            row.mean_delta_e
        );
    }
    text
}

/// A BTF whose samples are compressed.
#[derive(Debug)]
struct Curved {
    btf: Btf,
    curve: Curve,
}

impl Images for Curved {
    fn format(&self) -> String {
        format!("{} through {:?}", self.btf.format(), self.curve)
    }

    fn stored_bytes(&self) -> u64 {
        self.btf.stored_bytes()
    }

    fn samples<'a>(
        &'a self,
        images: Range<usize>,
        buffer: &'a mut Vec<f32>,
    ) -> preprocess::Result<Samples<'a>> {
        let mut decoded = Vec::new();
        let samples = self.btf.samples(images, &mut decoded)?;
        buffer.resize(samples.len(), 0.0);
        samples.to_f32(buffer);
        buffer
            .iter_mut()
            .for_each(|sample| *sample = self.curve.forth(*sample));
        Ok(Samples::F32(buffer))
    }

    fn place(&self, image: usize) -> String {
        self.btf.place(image)
    }
}

/// Compares the product of factors, with the curve undone, with a BTF.
fn judge(btf: &Btf, factors: &Factors, curve: Curve, way: &'static str) -> Result<Row> {
    let columns = factors.columns;
    let u = MatRef::from_column_major_slice(&factors.u, factors.rows, factors.components);
    let v = MatRef::from_row_major_slice(&factors.v, factors.components, columns);
    // `[x + width·y][rgb]`, so that a colour is three numbers side by side.
    let mut product = Mat::<f32>::zeros(3, columns);
    let (mut buffer, mut truth) = (Vec::new(), vec![0f32; 3 * columns]);
    let (mut energy, mut squares, mut mapped, mut delta_e, mut texels) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for image in (0..btf.image_count()).step_by(JUDGED) {
        btf.samples(image..image + 1, &mut buffer)?.to_f32(&mut truth);
        let u = u.subrows(3 * image, 3);
        matmul(product.as_mut(), Accum::Replace, u, v, 1.0, Par::Seq);
        for texel in 0..columns {
            let exact: [f64; 3] = std::array::from_fn(|c| truth[c * columns + texel].into());
            let found: [f64; 3] = std::array::from_fn(|c| curve.back(product[(c, texel)]).into());
            for (exact, found) in exact.iter().zip(found) {
                energy += exact * exact;
                squares += (exact - found).powi(2);
                mapped += (srgb(*exact) - srgb(found)).powi(2);
            }
            let (exact, found) = (lab(exact), lab(found));
            let square = |c: usize| (exact[c] - found[c]).powi(2);
            delta_e += (square(0) + square(1) + square(2)).sqrt();
            texels += 1.0;
        }
    }
    Ok(Row {
        way,
        components: factors.components,
        relative_rmse: if energy > 0.0 {
            (squares / energy).sqrt()
        } else {
            0.0
        },
        tone_mapped_rmse: f64::sqrt(mapped / (3.0 * texels)),
        mean_delta_e: delta_e / texels,
    })
}

/// The transfer function of sRGB (IEC 61966-2-1, 1999), of a value clamped to 0 to 1.
fn srgb(linear: f64) -> f64 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

/// CIELAB (CIE 15:2004, section 8.2.1) of linear sRGB, clamped to 0 to 1, with white as the reference.
fn lab(rgb: [f64; 3]) -> [f64; 3] {
    // Rows of IEC 61966-2-1's matrix to XYZ.
    const XYZ: [[f64; 3]; 3] = [
        [0.4124, 0.3576, 0.1805],
        [0.2126, 0.7152, 0.0722],
        [0.0193, 0.1192, 0.9505],
    ];
    let [x, y, z] = XYZ.map(|row| {
        let white: f64 = row.iter().sum();
        let sum: f64 = row.iter().zip(rgb).map(|(a, b)| a * b.clamp(0.0, 1.0)).sum();
        let t = sum / white;
        if t > (6.0f64 / 29.0).powi(3) {
            t.cbrt()
        } else {
            t * (29.0f64 / 6.0).powi(2) / 3.0 + 4.0 / 29.0
        }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_undone_and_colours_are_those_of_the_standards() {
        for curve in [Curve::Linear, Curve::Log(0.05), Curve::Power] {
            for x in [-3.0f32, -1e-3, 0.0, 1e-4, 0.5, 1.0, 700.0] {
                let back = curve.back(curve.forth(x));
                assert!(
                    (back - x).abs() <= 1e-5 * x.abs().max(1e-2),
                    "{curve:?}: {back} for {x}"
                );
            }
        }
        assert!((srgb(0.214_041) - 0.5).abs() < 1e-5);
        assert!(srgb(-1.0) == 0.0 && (srgb(7.0) - 1.0).abs() < 1e-12);
        let [l, a, b] = lab([1.0; 3]);
        assert!((l - 100.0).abs() < 1e-9 && a.abs() < 1e-9 && b.abs() < 1e-9);
        // sRGB red, of the usual tables.
        let [l, a, b] = lab([1.0, 0.0, 0.0]);
        assert!((l - 53.24).abs() < 0.02 && (a - 80.09).abs() < 0.05 && (b - 67.2).abs() < 0.1);
    }

    #[test]
    fn products_are_judged_as_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let directions = |count: usize| {
            (0..count)
                .map(|i| tileset::Direction {
                    theta: 0.2 * i as f64,
                    phi: i as f64,
                })
                .collect()
        };
        let sampling = preprocess::npy::Sampling {
            views: directions(4),
            lights: directions(5),
            wrap: true,
            cosine: false,
        };
        // Of rank one in the linear domain, and as powers.
        let samples: Vec<f32> = (0..60 * 48)
            .map(|i| (1.0 + (i / 48 % 7) as f32) * (1.0 + (i % 48 % 5) as f32) * 0.02)
            .collect();
        let dtype = preprocess::npy::Dtype::F32;
        let mut writer = preprocess::npy::BtfWriter::create(&path, sampling, 8, 6, dtype).unwrap();
        writer.write_f32(&samples).unwrap();
        writer.finish().unwrap();
        let settings = Settings {
            components: 1,
            memory_bytes: 1 << 30,
            ..Settings::default()
        };
        let rows = run(&path, &settings, &|_| ()).unwrap();
        let exact =
            |row: &Row| row.relative_rmse < 1e-5 && row.tone_mapped_rmse < 1e-5 && row.mean_delta_e < 1e-3;
        let exactly: Vec<bool> = rows.iter().map(exact).collect();
        // A logarithm makes it another rank.
        assert_eq!(exactly, [true, true, true, false, true], "{rows:?}");
        assert_eq!(table(&rows).lines().count(), 6);
    }
}
