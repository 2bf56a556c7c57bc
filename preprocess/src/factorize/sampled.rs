//! Factors of a BTF that nobody has as a whole: of some texels under all directions, and of all texels under some.
//!
//! Where samples are made and not measured, making them is what takes time, and most of them tell nothing new: a matrix of
//! rank k is determined by little more than k of its columns and k of its rows. Eigen-ABRDFs U' come from the texels that
//! are known under all directions. Each texel's coefficients are then those that are most likely for what it shows under
//! the few directions S, where the coefficients' variances Λ and the mean square r² of what the terms leave out are
//! those of the known texels: V' = (U'_SᵀU'_S + r²Λ⁻¹)⁻¹ U'_Sᵀ B_S, ridge regression (Hoerl and Kennard, 1970), which
//! minimizes the error of V' where what is left out is noise (Gauß, Markov).
//!
//! What that costs beside the best factors is measured on texels that had no part in it.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::linalg::solvers::Solve;
use faer::{Accum, Mat, MatMut, MatRef, Par, Side};
use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use super::{Factors, Settings, factorize, grow, low_rank};
use crate::npy::Samples;
use crate::progress::ProgressFn;
use crate::source::LowRank;
use crate::{Btf, Error, Result};

/// Texels that a thread projects at a time.
const PANEL_TEXELS: usize = 2048;
/// Least share of the samples' mean square that is taken for noise: keeps the solution finite where rows are missing.
const LEAST_NOISE: f64 = 1e-9;

/// Factors in the making.
pub struct Sampled {
    /// Of the known texels.
    known: Factors,
    /// Images that are given for all texels.
    images: Vec<usize>,
    /// What rows of these images are multiplied with, `[image][rgb][component]`.
    projection: Vec<f32>,
    /// Coefficients so far, `[component][texel]`.
    v: Vec<f32>,
    columns: usize,
    /// Images that were added.
    added: usize,
}

impl Sampled {
    /// Begins with the texels of `known`. All `columns` texels will follow in the listed images (view·lights + light).
    ///
    /// # Errors
    /// As [`factorize()`]; [`Error::Invalid`] if there is no such image.
    pub fn new(
        known: &Btf,
        images: &[usize],
        columns: usize,
        settings: &Settings,
        progress: ProgressFn<'_>,
    ) -> Result<Self> {
        if let Some(image) = images.iter().find(|&&image| image >= known.image_count()) {
            return Err(Error::Invalid {
                what: "image",
                found: image.to_string(),
                expected: "one of the BTF's",
            });
        }
        let known = factorize(known, settings, progress)?;
        let projection = projection(&known, images)?;
        Ok(Self {
            v: vec![0.0; known.components * columns],
            known,
            images: images.to_vec(),
            projection,
            columns,
            added: 0,
        })
    }

    /// The next images of the list: `[image][rgb][texel]`.
    ///
    /// # Panics
    /// If it is not a whole number of images, or more than were announced.
    pub fn add(&mut self, samples: &[f16]) {
        let image = 3 * self.columns;
        assert!(samples.len().is_multiple_of(image), "whole images");
        let images = self.added..self.added + samples.len() / image;
        assert!(images.end <= self.images.len(), "images of the list");
        self.added = images.end;
        project(
            &self.projection,
            self.known.components,
            images,
            samples,
            self.columns,
            &mut self.v,
        );
    }

    /// The factors: those of a singular value decomposition of the product. `btf` says what the BTF is, its samples are not
    /// read. The error is measured on the texels of `others`, under all directions; they must not be among those that it
    /// began with.
    ///
    /// # Errors
    /// As [`factorize()`].
    ///
    /// # Panics
    /// If images of the list are missing.
    pub fn finish(
        self,
        btf: &Btf,
        others: &Btf,
        settings: &Settings,
        progress: ProgressFn<'_>,
    ) -> Result<Factors> {
        assert_eq!(self.added, self.images.len(), "images of the list");
        let columns = others.columns();
        let mut v = vec![0.0; self.known.components * columns];
        let mut buffer = Vec::new();
        for (listed, &image) in self.images.iter().enumerate() {
            let halves = match others.samples(image..image + 1, &mut buffer)? {
                Samples::F16(samples) => samples.to_vec(),
                Samples::F32(samples) => samples.iter().map(|&value| f16::from_f32(value)).collect(),
            };
            let images = listed..listed + 1;
            project(
                &self.projection,
                self.known.components,
                images,
                &halves,
                columns,
                &mut v,
            );
        }
        let left_out: f64 = grow::left_out(others, &self.known.u, &v, progress)?.iter().sum();
        let product = LowRank {
            terms: self.known.components,
            u: self.known.u,
            v: self.v,
        };
        Ok(Factors {
            energy: self.known.energy / self.known.columns as f64 * self.columns as f64,
            residual_energy: left_out / columns as f64 * self.columns as f64,
            estimated: true,
            ..low_rank::factorize_product(btf, product, settings)?
        })
    }
}

/// The matrix that makes coefficients of samples, transposed.
fn projection(known: &Factors, images: &[usize]) -> Result<Vec<f32>> {
    let (components, rows) = (known.components, images.len() * 3);
    let u = Mat::from_fn(rows, components, |row, component| {
        let of_all = images[row / 3] * 3 + row % 3;
        f64::from(known.u[component * known.rows + of_all])
    });
    let noise = known
        .rank_rms()
        .powi(2)
        .max(LEAST_NOISE * known.btf_rms().powi(2))
        .max(f64::MIN_POSITIVE);
    let mut normal = u.transpose() * &u;
    for (component, norm) in known.singular_values.iter().enumerate() {
        let variance = norm * norm / (known.rows as f64 * known.columns as f64);
        normal[(component, component)] += noise / variance.max(LEAST_NOISE * noise);
    }
    let factored = normal
        .llt(Side::Lower)
        .map_err(|_| Error::NotConverged("projection of texels"))?;
    let solved = factored.solve(u.transpose());
    Ok((0..rows)
        .flat_map(|row| (0..components).map(move |component| (component, row)))
        .map(|at| solved[at] as f32)
        .collect())
}

/// Adds what the images of the range, `[image][rgb][texel]`, say of the coefficients `[component][texel]`.
fn project(
    projection: &[f32],
    components: usize,
    images: Range<usize>,
    samples: &[f16],
    columns: usize,
    v: &mut [f32],
) {
    let rows = images.len() * 3;
    let projection = &projection[images.start * 3 * components..][..rows * components];
    let projection = MatRef::from_row_major_slice(projection, rows, components);
    MatMut::from_column_major_slice_mut(v, columns, components)
        .par_row_chunks_mut(PANEL_TEXELS)
        .enumerate()
        .for_each(|(panel, v)| {
            let (first, texels) = (panel * PANEL_TEXELS, v.nrows());
            let mut floats = vec![0.0; rows * texels];
            for (floats, halves) in floats.chunks_exact_mut(texels).zip(samples.chunks_exact(columns)) {
                halves[first..first + texels].convert_to_f32_slice(floats);
            }
            let floats = MatRef::from_row_major_slice(&floats, rows, texels);
            matmul(v, Accum::Add, floats.transpose(), projection, 1.0, Par::Seq);
        });
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use tileset::Direction;

    use super::*;
    use crate::npy::Sampling;
    use crate::source::Images;

    const SIDE: usize = 12;
    const TERMS: usize = 6;

    fn noise(seed: usize) -> f32 {
        let bits = (seed as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((bits ^ bits >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / 8_388_608.0 - 1.0
    }

    /// Six terms of falling weight and a little noise, of the texels that are listed.
    #[derive(Debug)]
    struct Made(Vec<usize>);

    impl Made {
        fn sample(row: usize, texel: usize) -> f32 {
            let terms = (0..TERMS).map(|term| {
                0.6f32.powi(term as i32) * noise(row * 31 + term) * noise(1_000_000 + texel * 37 + term)
            });
            terms.sum::<f32>() + 0.02 * noise(2_000_000 + row * 10_007 + texel)
        }

        fn btf(texels: Vec<usize>) -> Btf {
            let direction = |n: usize| Direction {
                theta: 0.1 * n as f64,
                phi: n as f64,
            };
            let sampling = Sampling {
                views: (0..SIDE).map(direction).collect(),
                lights: (0..SIDE).map(direction).collect(),
                wrap: true,
                cosine: true,
            };
            let width = texels.len() as u32;
            Btf::new(Path::new("made"), sampling, (width, 1), Box::new(Made(texels))).unwrap()
        }
    }

    impl Images for Made {
        fn format(&self) -> String {
            "made".into()
        }

        fn stored_bytes(&self) -> u64 {
            0
        }

        fn samples<'a>(&'a self, images: Range<usize>, buffer: &'a mut Vec<f32>) -> Result<Samples<'a>> {
            buffer.clear();
            for row in images.start * 3..images.end * 3 {
                buffer.extend(self.0.iter().map(|&texel| Made::sample(row, texel)));
            }
            Ok(Samples::F32(buffer))
        }

        fn place(&self, image: usize) -> String {
            format!("image {image}")
        }
    }

    #[test]
    fn a_part_of_rows_and_columns_is_nearly_as_good_as_all() {
        let (texels, known) = (900, 200);
        let all = Made::btf((0..texels).collect());
        let settings = Settings {
            components: TERMS as u32,
            ..Settings::default()
        };
        let best = factorize(&all, &settings, &|_| ()).unwrap();

        let images: Vec<usize> = (0..SIDE * SIDE).step_by(6).collect();
        let known_texels = Made::btf((0..known).map(|n| n * 4).collect());
        let mut sampled = Sampled::new(&known_texels, &images, texels, &settings, &|_| ()).unwrap();
        for &image in &images {
            let mut buffer = Vec::new();
            let Samples::F32(samples) = all.samples(image..image + 1, &mut buffer).unwrap() else {
                panic!("floats")
            };
            let halves: Vec<f16> = samples.iter().map(|&value| f16::from_f32(value)).collect();
            sampled.add(&halves);
        }
        let others = Made::btf((0..60).map(|n| n * 12 + 1).collect());
        let found = sampled.finish(&all, &others, &settings, &|_| ()).unwrap();

        let true_energy: f64 = grow::left_out(&all, &found.u, &found.v, &|_| ())
            .unwrap()
            .iter()
            .sum();
        let (stated, measured) = (found.rank_rms(), found.rms(true_energy));
        assert!((stated / measured - 1.0).abs() < 0.05, "{stated} {measured}");
        assert!(measured < 1.1 * best.rank_rms(), "{measured} {}", best.rank_rms());
        assert!((found.btf_rms() / best.btf_rms() - 1.0).abs() < 0.1);
        assert!(found.estimated && found.components == TERMS);
        assert!(Sampled::new(&known_texels, &[SIDE * SIDE], texels, &settings, &|_| ()).is_err());
    }
}
