//! Files of `.btf` written byte by byte, and what they must read as.

use half::f16;
use preprocess::Btf;
use preprocess::npy::Samples;
use std::f64::consts::TAU;
use std::path::PathBuf;

/// Sizes of a file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    pub(crate) views: usize,
    pub(crate) lights: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

pub(crate) const SMALL: Shape = Shape {
    views: 3,
    lights: 2,
    width: 4,
    height: 3,
};

impl Shape {
    pub(crate) fn images(self) -> usize {
        self.views * self.lights
    }

    pub(crate) fn texels(self) -> usize {
        self.width * self.height
    }
}

/// What the meta data say.
#[derive(Clone, Copy)]
pub(crate) struct Meta {
    pub(crate) version: u32,
    pub(crate) cosine: bool,
    pub(crate) channels: &'static [&'static str],
}

pub(crate) const META: Meta = Meta {
    version: 4,
    cosine: false,
    channels: &["R", "G", "B"],
};

/// Bytes in the making.
#[derive(Clone, Default)]
pub(crate) struct Bytes(pub(crate) Vec<u8>);

impl Bytes {
    pub(crate) fn u32(&mut self, value: usize) {
        self.0.extend((value as u32).to_le_bytes());
    }

    pub(crate) fn f32(&mut self, value: f64) {
        self.0.extend((value as f32).to_le_bytes());
    }

    pub(crate) fn scalar(&mut self, size: usize, value: f64) {
        match size {
            2 => self.0.extend(f16::from_f64(value).to_le_bytes()),
            4 => self.0.extend((value as f32).to_le_bytes()),
            _ => self.0.extend(value.to_le_bytes()),
        }
    }

    pub(crate) fn begin(signature: &str, meta: Meta) -> Self {
        let mut bytes = Self(signature.as_bytes().to_vec());
        let start = bytes.0.len();
        bytes.u32(0);
        bytes.u32(meta.version as usize);
        bytes.0.extend([b's'; 3 * 80]);
        bytes.f32(10.0);
        (0..3).for_each(|_| bytes.f32(1.0));
        if meta.version > 1 {
            bytes.u32(meta.cosine.into());
        }
        if meta.version > 2 {
            bytes.u32(7);
            bytes.0.extend(b"<a></a>");
        }
        if meta.version > 3 {
            bytes.u32(meta.channels.len());
            for name in meta.channels {
                bytes.u32(name.len());
                bytes.0.extend(name.as_bytes());
            }
        }
        let size = (bytes.0.len() - start) as u32;
        bytes.0[start..start + 4].copy_from_slice(&size.to_le_bytes());
        bytes
    }

    pub(crate) fn directions(&mut self, shape: Shape) {
        self.u32(shape.views);
        for view in 0..shape.views {
            let (theta, phi) = view_angles(view);
            self.f32(theta);
            self.f32(phi);
            self.u32(shape.lights);
            for light in 0..shape.lights {
                let (theta, phi) = light_angles(light);
                self.f32(theta);
                self.f32(phi);
            }
        }
    }

    pub(crate) fn size(&mut self, shape: Shape) {
        self.u32(shape.width);
        self.u32(shape.height);
    }

    pub(crate) fn frames(&mut self, count: usize) {
        self.u32(count);
        (0..9 * count).for_each(|i| self.f32(f64::from(u8::from(i % 4 == 0))));
    }

    pub(crate) fn common(signature: &str, meta: Meta, shape: Shape) -> Self {
        let mut bytes = Self::begin(signature, meta);
        bytes.directions(shape);
        bytes.size(shape);
        if signature.ends_with('R') {
            bytes.frames(shape.texels());
        }
        bytes
    }

    /// Scalar size, components, rows, columns, singular values, U, S·V.
    pub(crate) fn factorization(
        &mut self,
        size: usize,
        terms: usize,
        u: (usize, Factor<'_>),
        v: (usize, Factor<'_>),
    ) {
        self.0.push(size as u8);
        self.u32(terms);
        self.u32(u.0);
        self.u32(v.0);
        // Singular values are not read: anything must do.
        (0..terms).for_each(|_| self.scalar(size, f64::NAN));
        for (rows, factor) in [u, v] {
            for row in 0..rows {
                (0..terms).for_each(|term| self.scalar(size, factor(row, term)));
            }
        }
    }

    pub(crate) fn write(&self) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloth.btf");
        std::fs::write(&path, &self.0).unwrap();
        (folder, path)
    }

    pub(crate) fn open(&self) -> preprocess::Result<Btf> {
        let (_folder, path) = self.write();
        Btf::open(&path)
    }

    pub(crate) fn error(&self) -> String {
        match self.open() {
            Err(error) => error.to_string(),
            Ok(btf) => panic!("{} opens", btf.format()),
        }
    }
}

pub(crate) type Factor<'a> = &'a dyn Fn(usize, usize) -> f64;

pub(crate) fn view_angles(view: usize) -> (f64, f64) {
    (0.3 * view as f64 % 1.5, 0.7 * view as f64)
}

pub(crate) fn light_angles(light: usize) -> (f64, f64) {
    (0.2 * light as f64 % 1.4, TAU - 0.4 * light as f64)
}

/// As a scalar of `size` bytes keeps it.
pub(crate) fn kept(size: usize, value: f64) -> f64 {
    match size {
        2 => f16::from_f64(value).to_f64(),
        4 => f64::from(value as f32),
        _ => value,
    }
}

/// Numbers between -1 and 1 that differ for every argument.
pub(crate) fn number(seed: usize, row: usize, term: usize) -> f64 {
    (1.0 + 12.9898 * row as f64 + 78.233 * term as f64 + 37.719 * seed as f64).sin()
}

/// Samples of a test: ρ of image, rgb, texel.
pub(crate) type Expected<'a> = &'a dyn Fn(usize, usize, usize) -> f64;

/// Reads all images and some in the middle, and compares them and the product of factors, if there is one.
pub(crate) fn compare(btf: &Btf, shape: Shape, expected: Expected<'_>) {
    assert_eq!(
        (btf.views().len(), btf.lights().len()),
        (shape.views, shape.lights)
    );
    assert_eq!(
        (btf.width() as usize, btf.height() as usize),
        (shape.width, shape.height)
    );
    for (index, view) in btf.views().iter().enumerate() {
        let (theta, phi) = view_angles(index);
        assert!(
            (view.theta - theta).abs() < 1e-6 && (view.phi - phi).abs() < 1e-5,
            "view {index}"
        );
    }
    for (index, light) in btf.lights().iter().enumerate() {
        let (theta, phi) = light_angles(index);
        assert!(
            (light.theta - theta).abs() < 1e-6 && (light.phi - phi).abs() < 1e-5,
            "light {index}"
        );
    }
    let (images, texels) = (shape.images(), shape.texels());
    let check = |value: f64, image: usize, rgb: usize, texel: usize| {
        let truth = expected(image, rgb, texel);
        let close = (value - truth).abs() <= 2e-5 * truth.abs().max(1.0);
        assert!(
            close,
            "image {image}, channel {rgb}, texel {texel}: {value}, expected {truth}"
        );
    };
    let mut buffer = vec![f32::NAN; 5];
    for range in [
        0..images,
        images / 3..images / 3 + 1,
        images / 2..images,
        1.min(images)..images,
    ] {
        let samples = btf.samples(range.clone(), &mut buffer).unwrap();
        assert_eq!(samples.len(), range.len() * 3 * texels);
        let Samples::F32(samples) = samples else {
            panic!("f32")
        };
        for (index, &sample) in samples.iter().enumerate() {
            let (row, texel) = (index / texels, index % texels);
            check(sample.into(), range.start + row / 3, row % 3, texel);
        }
    }
    let Some(low_rank) = btf.low_rank().unwrap() else {
        return;
    };
    let rows = 3 * images;
    assert_eq!(
        (low_rank.u.len(), low_rank.v.len()),
        (low_rank.terms * rows, low_rank.terms * texels)
    );
    for row in 0..rows {
        for texel in 0..texels {
            let term =
                |t: usize| f64::from(low_rank.u[t * rows + row]) * f64::from(low_rank.v[t * texels + texel]);
            check((0..low_rank.terms).map(term).sum(), row / 3, row % 3, texel);
        }
    }
}
