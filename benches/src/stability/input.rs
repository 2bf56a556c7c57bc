//! BTFs in memory.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use preprocess::Btf;
use preprocess::npy::{Samples, Sampling};
use preprocess::source::Images;
use serde::Serialize;
use tileset::Direction;

use crate::Result;

/// Sizes of a BTF.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Shape {
    /// View directions.
    pub views: usize,
    /// Light directions.
    pub lights: usize,
    /// Texels in a row.
    pub width: usize,
    /// Rows of texels.
    pub height: usize,
}

impl Shape {
    /// Rows of the matrix: views × lights × 3.
    pub fn rows(self) -> usize {
        self.views * self.lights * 3
    }

    /// Columns of the matrix: texels.
    pub fn columns(self) -> usize {
        self.width * self.height
    }

    /// Samples of the BTF.
    pub fn samples(self) -> usize {
        self.rows() * self.columns()
    }
}

/// Samples `[view][light][rgb][y][x]` of a BTF that wraps, cosine left out.
#[derive(Clone, Debug)]
pub struct Input {
    /// Sizes.
    pub shape: Shape,
    /// The samples.
    pub samples: Arc<[f32]>,
}

impl Input {
    /// The samples as a BTF.
    ///
    /// # Errors
    /// [`preprocess::Error::Format`] for a shape that no archive accepts.
    pub fn btf(&self, name: &str) -> Result<Btf> {
        let Shape {
            views,
            lights,
            width,
            height,
        } = self.shape;
        let sampling = Sampling {
            views: directions(views),
            lights: directions(lights),
            wrap: true,
            cosine: false,
        };
        let images = InMemory {
            samples: self.samples.clone(),
            image: 3 * self.shape.columns(),
        };
        let size = (width as u32, height as u32);
        Ok(Btf::new(Path::new(name), sampling, size, Box::new(images))?)
    }

    /// The samples that a BTF of this shape gives.
    ///
    /// # Errors
    /// Those of [`Btf::samples`].
    pub fn read(shape: Shape, btf: &Btf) -> Result<Self> {
        let mut buffer = Vec::new();
        let mut samples = vec![0.0; shape.samples()];
        btf.samples(0..btf.image_count(), &mut buffer)?
            .to_f32(&mut samples);
        Ok(Self {
            shape,
            samples: samples.into(),
        })
    }
}

/// `count` different directions, on a spiral from the normal outwards.
fn directions(count: usize) -> Vec<Direction> {
    (0..count)
        .map(|i| Direction {
            theta: 1.3 * i as f64 / count as f64,
            phi: 2.4 * i as f64 % std::f64::consts::TAU,
        })
        .collect()
}

/// Lends its samples as a mapped file does.
#[derive(Debug)]
struct InMemory {
    samples: Arc<[f32]>,
    /// Samples of an image.
    image: usize,
}

impl Images for InMemory {
    fn format(&self) -> String {
        "samples in memory".to_owned()
    }

    fn stored_bytes(&self) -> u64 {
        size_of_val(&self.samples[..]) as u64
    }

    fn samples<'a>(&'a self, images: Range<usize>, _: &'a mut Vec<f32>) -> preprocess::Result<Samples<'a>> {
        let range = images.start * self.image..images.end * self.image;
        Ok(Samples::F32(&self.samples[range]))
    }

    fn place(&self, image: usize) -> String {
        format!("image {image}")
    }
}
