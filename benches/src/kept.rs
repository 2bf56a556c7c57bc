//! Factors on disk: a codec that changes is measured again without factorizing again.
//!
//! A folder NAME with `factors.json`, `u.npy` (`[component][view][light][rgb]`) and `v.npy` (`[component][y][x]`), f32:
//! U' and V' as [`Factors`] has them. `v.npy` is also what the peers' programs code.

use std::ops::Range;
use std::path::{Path, PathBuf};

use preprocess::npy::{Samples, Sampling, write_npy_f32};
use preprocess::source::Images;
use preprocess::{Btf, Factors};
use serde::{Deserialize, Serialize};
use tileset::{Direction, MAX_COMPONENTS, MAX_DIRECTIONS, MAX_SIDE_TEXELS};

use crate::factorize::Factorized;
use crate::{Error, Result, npy};

/// Name of the file that makes a folder one of kept factors.
const DESCRIPTION: &str = "factors.json";

/// Factors of a BTF, and what an archive needs to know of the BTF beside them.
#[derive(Clone, Debug)]
pub struct KeptFactors {
    /// Name of the material.
    pub name: String,
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Directions, wrapping, cosine.
    pub sampling: Sampling,
    /// U', V' and singular values; where time and bytes went is not kept.
    pub factors: Factors,
    /// How the factors were made, where that was measured.
    pub factorized: Option<Factorized>,
}

/// `factors.json`.
#[derive(Serialize, Deserialize)]
struct Description {
    name: String,
    width: u32,
    height: u32,
    wrap: bool,
    cosine: bool,
    views: Vec<Direction>,
    lights: Vec<Direction>,
    components: usize,
    singular_values: Vec<f64>,
    energy: f64,
    residual_energy: f64,
    mean_rgb: [f64; 3],
    factorized: Option<Factorized>,
}

impl KeptFactors {
    /// Factors that were just made from `btf`.
    pub fn new(btf: &Btf, factors: Factors, factorized: Option<Factorized>) -> Self {
        Self {
            name: btf.name().to_owned(),
            width: btf.width(),
            height: btf.height(),
            sampling: btf.sampling().clone(),
            factors,
            factorized,
        }
    }

    /// Whether `path` is a folder of kept factors.
    pub fn is_kept(path: &Path) -> bool {
        path.join(DESCRIPTION).is_file()
    }

    /// Writes the folder, which is created if need be.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Preprocess`].
    pub fn save(&self, folder: &Path) -> Result<()> {
        std::fs::create_dir_all(folder).map_err(Error::io(folder, "create"))?;
        let factors = &self.factors;
        let description = Description {
            name: self.name.clone(),
            width: self.width,
            height: self.height,
            wrap: self.sampling.wrap,
            cosine: self.sampling.cosine,
            views: self.sampling.views.clone(),
            lights: self.sampling.lights.clone(),
            components: factors.components,
            singular_values: factors.singular_values.clone(),
            energy: factors.energy,
            residual_energy: factors.residual_energy,
            mean_rgb: factors.mean_rgb,
            factorized: self.factorized,
        };
        // The description is written last: a folder that has it is complete.
        write_npy_f32(&folder.join("u.npy"), &self.u_shape(), &factors.u)?;
        write_npy_f32(&folder.join("v.npy"), &self.v_shape(), &factors.v)?;
        let path = folder.join(DESCRIPTION);
        let text = serde_json::to_vec_pretty(&description).expect("numbers and text always serialize");
        std::fs::write(&path, text).map_err(Error::io(&path, "write"))
    }

    /// Reads the folder.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Kept`] if its files contradict each other.
    pub fn load(folder: &Path) -> Result<Self> {
        let path = folder.join(DESCRIPTION);
        let text = std::fs::read(&path).map_err(Error::io(&path, "read"))?;
        let kept = |detail| Error::Kept {
            path: path.clone(),
            detail,
        };
        let description: Description =
            serde_json::from_slice(&text).map_err(|error| kept(error.to_string()))?;
        description.check().map_err(kept)?;
        let mut loaded = description.without_factors();
        loaded.factors.u = npy::read_f32(&folder.join("u.npy"), &loaded.u_shape())?;
        loaded.factors.v = npy::read_f32(&folder.join("v.npy"), &loaded.v_shape())?;
        Ok(loaded)
    }

    /// A BTF with this name, these sizes and directions, whose samples are the product of the factors.
    ///
    /// # Errors
    /// [`Error::Preprocess`] for directions or sides that no archive accepts.
    pub fn btf(&self) -> Result<Btf> {
        let product = Product {
            columns: self.factors.columns,
            u: self.factors.u.clone(),
            v: self.factors.v.clone(),
        };
        let path = PathBuf::from(format!("{}.npy", self.name));
        let size = (self.width, self.height);
        Ok(Btf::new(&path, self.sampling.clone(), size, Box::new(product))?)
    }

    fn u_shape(&self) -> [usize; 4] {
        let Sampling { views, lights, .. } = &self.sampling;
        [self.factors.components, views.len(), lights.len(), 3]
    }

    fn v_shape(&self) -> [usize; 3] {
        [self.factors.components, self.height as usize, self.width as usize]
    }
}

impl Description {
    fn check(&self) -> std::result::Result<(), String> {
        let within = |what: &str, found: usize, limit: u32| {
            (1..=limit as usize)
                .contains(&found)
                .then_some(())
                .ok_or(format!("{what} is {found}, expected 1 to {limit}"))
        };
        within("width", self.width as usize, MAX_SIDE_TEXELS)?;
        within("height", self.height as usize, MAX_SIDE_TEXELS)?;
        within("number of views", self.views.len(), MAX_DIRECTIONS)?;
        within("number of lights", self.lights.len(), MAX_DIRECTIONS)?;
        within("number of components", self.components, MAX_COMPONENTS)?;
        if self.singular_values.len() != self.components {
            let found = self.singular_values.len();
            return Err(format!(
                "{found} singular values of {} components",
                self.components
            ));
        }
        Ok(())
    }

    fn without_factors(self) -> KeptFactors {
        let factors = Factors {
            rows: self.views.len() * self.lights.len() * 3,
            columns: self.width as usize * self.height as usize,
            components: self.components,
            singular_values: self.singular_values,
            energy: self.energy,
            residual_energy: self.residual_energy,
            mean_rgb: self.mean_rgb,
            ..Factors::default()
        };
        KeptFactors {
            name: self.name,
            width: self.width,
            height: self.height,
            sampling: Sampling {
                views: self.views,
                lights: self.lights,
                wrap: self.wrap,
                cosine: self.cosine,
            },
            factors,
            factorized: self.factorized,
        }
    }
}

/// The product of factors, as a source of samples.
#[derive(Debug)]
struct Product {
    columns: usize,
    u: Vec<f32>,
    v: Vec<f32>,
}

impl Images for Product {
    fn format(&self) -> String {
        "kept factors".to_owned()
    }

    fn stored_bytes(&self) -> u64 {
        4 * (self.u.len() + self.v.len()) as u64
    }

    fn samples<'a>(
        &'a self,
        images: Range<usize>,
        buffer: &'a mut Vec<f32>,
    ) -> preprocess::Result<Samples<'a>> {
        let components = self.v.len() / self.columns;
        let rows = self.u.len() / components;
        buffer.clear();
        buffer.resize(3 * images.len() * self.columns, 0.0);
        let first = 3 * images.start;
        for (i, row) in buffer.chunks_exact_mut(self.columns).enumerate() {
            for (u, v) in self.u.chunks_exact(rows).zip(self.v.chunks_exact(self.columns)) {
                let weight = u[first + i];
                row.iter_mut()
                    .zip(v)
                    .for_each(|(sample, v)| *sample += weight * v);
            }
        }
        Ok(Samples::F32(buffer))
    }

    fn place(&self, image: usize) -> String {
        format!("image {image} of the product of factors")
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Smooth factors of a few directions, their energies as the factorization would state them.
    pub(crate) fn example(components: usize, side: u32) -> KeptFactors {
        let directions: Vec<Direction> = (0..4)
            .map(|i| Direction {
                theta: 0.3 * f64::from(i),
                phi: f64::from(i),
            })
            .collect();
        let (rows, columns) = (directions.len().pow(2) * 3, (side * side) as usize);
        let textures = crate::eigen_textures(side).texels;
        let v: Vec<f32> = (0..components)
            .flat_map(|c| {
                textures
                    .iter()
                    .map(move |texel| texel[c % 4] / (1 + c / 4) as f32)
            })
            .collect();
        let u: Vec<f32> = (0..components)
            .flat_map(|c| (0..rows).map(move |row| if (row >> c) & 1 == 0 { 1.0 } else { -1.0 }))
            .collect();
        let energy: f64 = v.iter().map(|&value| f64::from(value).powi(2)).sum();
        KeptFactors {
            name: "waves".to_owned(),
            width: side,
            height: side,
            sampling: Sampling {
                views: directions.clone(),
                lights: directions,
                wrap: true,
                cosine: false,
            },
            factors: Factors {
                rows,
                columns,
                components,
                u,
                v,
                singular_values: vec![1.0; components],
                energy: 1.5 * energy * rows as f64,
                residual_energy: 0.5 * energy * rows as f64,
                mean_rgb: [0.1; 3],
                ..Factors::default()
            },
            factorized: None,
        }
    }

    #[test]
    fn factors_come_back_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let kept = example(5, 16);
        assert!(!KeptFactors::is_kept(folder.path()));
        kept.save(folder.path()).unwrap();
        assert!(KeptFactors::is_kept(folder.path()));
        let loaded = KeptFactors::load(folder.path()).unwrap();
        assert_eq!((&loaded.name, loaded.width), (&kept.name, kept.width));
        assert_eq!(loaded.sampling, kept.sampling);
        assert_eq!(loaded.factors.u, kept.factors.u);
        assert_eq!(loaded.factors.v, kept.factors.v);
        assert_eq!(loaded.factors.relative_error(), kept.factors.relative_error());

        std::fs::copy(folder.path().join("u.npy"), folder.path().join("v.npy")).unwrap();
        let refusal = KeptFactors::load(folder.path()).unwrap_err().to_string();
        assert!(
            refusal.contains("v.npy") && refusal.contains("shape"),
            "{refusal}"
        );
    }

    #[test]
    fn samples_are_the_product() {
        let kept = example(3, 8);
        let btf = kept.btf().unwrap();
        let mut buffer = Vec::new();
        let samples = btf.samples(2..4, &mut buffer).unwrap();
        let Factors {
            rows, columns, u, v, ..
        } = &kept.factors;
        for (row, texel) in [(0, 0), (5, 63), (3, 17)] {
            let expected: f32 = (0..3)
                .map(|c| u[c * rows + 6 + row] * v[c * columns + texel])
                .sum();
            assert!((samples.get(row * columns + texel) - f64::from(expected)).abs() < 1e-6);
        }
    }
}
