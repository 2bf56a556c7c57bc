//! UBO `.btf` files, written byte by byte: every signature, scalar, order of storage and colour model against
//! numbers computed in f64; every contradiction named; no bytes that panic.

use std::f64::consts::TAU;
use std::io::Write;
use std::path::PathBuf;

use half::f16;
use preprocess::Btf;
use preprocess::npy::Samples;
use proptest::prelude::*;

/// Sizes of a file.
#[derive(Clone, Copy, Debug)]
struct Shape {
    views: usize,
    lights: usize,
    width: usize,
    height: usize,
}

const SMALL: Shape = Shape {
    views: 3,
    lights: 2,
    width: 4,
    height: 3,
};

impl Shape {
    fn images(self) -> usize {
        self.views * self.lights
    }

    fn texels(self) -> usize {
        self.width * self.height
    }
}

/// What the meta data say.
#[derive(Clone, Copy)]
struct Meta {
    version: u32,
    cosine: bool,
}

const META: Meta = Meta {
    version: 4,
    cosine: false,
};

/// Bytes in the making.
#[derive(Clone, Default)]
struct Bytes(Vec<u8>);

impl Bytes {
    fn u32(&mut self, value: usize) {
        self.0.extend((value as u32).to_le_bytes());
    }

    fn f32(&mut self, value: f64) {
        self.0.extend((value as f32).to_le_bytes());
    }

    fn scalar(&mut self, size: usize, value: f64) {
        match size {
            2 => self.0.extend(f16::from_f64(value).to_le_bytes()),
            4 => self.0.extend((value as f32).to_le_bytes()),
            _ => self.0.extend(value.to_le_bytes()),
        }
    }

    fn begin(signature: &str, meta: Meta) -> Self {
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
            bytes.u32(3);
            for name in ["R", "G", "B"] {
                bytes.u32(1);
                bytes.0.extend(name.as_bytes());
            }
        }
        let size = (bytes.0.len() - start) as u32;
        bytes.0[start..start + 4].copy_from_slice(&size.to_le_bytes());
        bytes
    }

    fn directions(&mut self, shape: Shape) {
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

    fn size(&mut self, shape: Shape) {
        self.u32(shape.width);
        self.u32(shape.height);
    }

    fn frames(&mut self, count: usize) {
        self.u32(count);
        (0..9 * count).for_each(|i| self.f32(f64::from(u8::from(i % 4 == 0))));
    }

    fn common(signature: &str, meta: Meta, shape: Shape) -> Self {
        let mut bytes = Self::begin(signature, meta);
        bytes.directions(shape);
        bytes.size(shape);
        if signature.ends_with('R') {
            bytes.frames(shape.texels());
        }
        bytes
    }

    /// Scalar size, components, rows, columns, singular values, U, S·V.
    fn factorization(&mut self, size: usize, terms: usize, u: (usize, Factor<'_>), v: (usize, Factor<'_>)) {
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

    fn write(&self) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloth.btf");
        std::fs::write(&path, &self.0).unwrap();
        (folder, path)
    }

    fn open(&self) -> preprocess::Result<Btf> {
        let (_folder, path) = self.write();
        Btf::open(&path)
    }

    fn error(&self) -> String {
        match self.open() {
            Err(error) => error.to_string(),
            Ok(btf) => panic!("{} opens", btf.format()),
        }
    }
}

type Factor<'a> = &'a dyn Fn(usize, usize) -> f64;

fn view_angles(view: usize) -> (f64, f64) {
    (0.3 * view as f64 % 1.5, 0.7 * view as f64)
}

fn light_angles(light: usize) -> (f64, f64) {
    (0.2 * light as f64 % 1.4, TAU - 0.4 * light as f64)
}

/// As a scalar of `size` bytes keeps it.
fn kept(size: usize, value: f64) -> f64 {
    match size {
        2 => f16::from_f64(value).to_f64(),
        4 => f64::from(value as f32),
        _ => value,
    }
}

/// Numbers between -1 and 1 that differ for every argument.
fn number(seed: usize, row: usize, term: usize) -> f64 {
    (1.0 + 12.9898 * row as f64 + 78.233 * term as f64 + 37.719 * seed as f64).sin()
}

/// Samples of a test: ρ of image, rgb, texel.
type Expected<'a> = &'a dyn Fn(usize, usize, usize) -> f64;

/// Reads all images and some in the middle, and compares them and the product of factors, if there is one.
fn compare(btf: &Btf, shape: Shape, expected: Expected<'_>) {
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

/// An FMF file of `terms` terms; `range` is the range reduction, which only `!FMF12FCER` can say.
fn fmf(
    signature: &str,
    shape: Shape,
    size: usize,
    terms: usize,
    transposed: bool,
    range: Option<u32>,
) -> Bytes {
    let mut bytes = Bytes::common(signature, META, shape);
    if let Some(range) = range {
        bytes.0.push(2);
        bytes.u32(range as usize);
        bytes.u32(2);
        bytes.u32(3);
        bytes.0.extend([0; 12]);
    }
    bytes.u32(terms);
    let (u, v): (Factor<'_>, Factor<'_>) = (&|row, term| number(1, row, term), &|row, term| {
        number(2, row, term)
    });
    let (images, texels) = (shape.images(), shape.texels());
    let rows = if transposed {
        (3 * texels, images)
    } else {
        (3 * images, texels)
    };
    bytes.factorization(size, terms, (rows.0, u), (rows.1, v));
    bytes
}

fn fmf_value(size: usize, terms: usize, transposed: bool, image: usize, rgb: usize, texel: usize) -> f64 {
    let (u, v) = if transposed {
        (3 * texel + rgb, image)
    } else {
        (3 * image + rgb, texel)
    };
    (0..terms)
        .map(|t| kept(size, number(1, u, t)) * kept(size, number(2, v, t)))
        .sum()
}

#[test]
fn full_matrix_factorizations() {
    for signature in ["!FMF06FC", "!FMF06FCR", "!FMF12FCER"] {
        for (size, transposed, range) in [
            (2, false, 0),
            (4, true, 0),
            (8, false, 1),
            (2, true, 1),
            (4, false, 1),
        ] {
            let range = (signature == "!FMF12FCER").then_some(range);
            let btf = fmf(signature, SMALL, size, 3, transposed, range).open().unwrap();
            let log = range == Some(1);
            compare(&btf, SMALL, &|image, rgb, texel| {
                let value = fmf_value(size, 3, transposed, image, rgb, texel);
                if log { value.exp() - 1e-5 } else { value }
            });
            let low_rank = btf.low_rank().unwrap();
            let terms = if transposed { 9 } else { 3 };
            assert_eq!(
                low_rank.map(|low_rank| low_rank.terms),
                (!log).then_some(terms),
                "{signature} {size}"
            );
            assert!(!btf.cosine() && !btf.wrap() && btf.name() == "cloth");
            assert!(
                btf.format().contains("full matrix factorization"),
                "{}",
                btf.format()
            );
            let notes = btf.notes().join("\n");
            assert_eq!(
                notes.contains("12 local frames"),
                signature != "!FMF06FC",
                "{notes}"
            );
            assert_eq!(notes.contains("height map of 2x3"), range.is_some(), "{notes}");
        }
    }
}

#[test]
fn one_view_one_light_one_texel() {
    let shapes = [
        (1, 5, 3, 2),
        (4, 1, 2, 3),
        (1, 1, 1, 1),
        (2, 3, 1, 7),
        (2, 2, 7, 1),
    ];
    for (views, lights, width, height) in shapes {
        let shape = Shape {
            views,
            lights,
            width,
            height,
        };
        let btf = fmf("!FMF06FC", shape, 4, 2, false, None).open().unwrap();
        compare(&btf, shape, &|image, rgb, texel| {
            fmf_value(4, 2, false, image, rgb, texel)
        });
    }
}

#[test]
fn many_blocks_of_texels_and_images() {
    let shape = Shape {
        views: 6,
        lights: 50,
        width: 31,
        height: 37,
    };
    let btf = fmf("!FMF06FC", shape, 2, 2, false, None).open().unwrap();
    compare(&btf, shape, &|image, rgb, texel| {
        fmf_value(2, 2, false, image, rgb, texel)
    });
}

#[test]
fn old_meta_data_and_the_cosine_flag() {
    for version in 0..=4 {
        let meta = Meta {
            version,
            cosine: true,
        };
        let mut bytes = Bytes::common("!FMF06FC", meta, SMALL);
        bytes.u32(1);
        bytes.factorization(4, 1, (18, &|_, _| 1.0), (12, &|_, _| 0.5));
        let btf = bytes.open().unwrap();
        assert_eq!(btf.cosine(), version > 1, "version {version}");
        compare(&btf, SMALL, &|_, _, _| 0.5);
    }
}

/// A size of the meta data whose lowest byte is 'R' is not taken for the R of a signature.
#[test]
fn a_size_that_looks_like_an_r() {
    for signature in ["!FMF06FC", "!FMF06FCR"] {
        let mut bytes = Bytes(signature.as_bytes().to_vec());
        let xml = (0x152 - 272) as usize;
        bytes.u32(0x152);
        bytes.u32(3);
        bytes.0.extend([0; 240 + 4 + 12 + 4]);
        bytes.u32(xml);
        bytes.0.extend(vec![b'x'; xml]);
        bytes.directions(SMALL);
        bytes.size(SMALL);
        if signature.ends_with('R') {
            bytes.frames(0);
        }
        bytes.u32(1);
        bytes.factorization(4, 1, (18, &|_, _| 1.0), (12, &|_, _| 0.5));
        compare(&bytes.open().unwrap(), SMALL, &|_, _, _| 0.5);
    }
}

const PCA_MEAN: [f64; 3] = [0.25, -0.5, 0.125];
const PCA_MATRIX: [[f64; 3]; 3] = [[0.5, 0.25, -1.0], [2.0, 0.125, 1.0], [-0.5, 1.5, 3.0]];
/// Components of the three channels.
const TERMS: [usize; 3] = [3, 1, 2];

fn dfmf(model: i32, size: usize, transposed: bool) -> Bytes {
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
fn rgb(model: i32, [a, b, c]: [f64; 3]) -> [f64; 3] {
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

/// A per-view file: view v has v + 1 components.
fn pvf(start: Bytes, shape: Shape, size: usize, transposed: bool) -> Bytes {
    let mut bytes = start;
    for view in 0..shape.views {
        let terms = view + 1;
        let (weights, dimensions) = if transposed {
            (shape.lights, 3 * shape.texels())
        } else {
            (shape.texels(), 3 * shape.lights)
        };
        bytes.0.push(size as u8);
        bytes.u32(terms);
        bytes.u32(weights);
        bytes.u32(dimensions);
        (0..terms).for_each(|_| bytes.scalar(size, f64::NAN));
        (0..dimensions).for_each(|row| bytes.scalar(size, number(30 + view, row, 0)));
        for (seed, rows) in [(50 + view, dimensions), (70 + view, weights)] {
            for row in 0..rows {
                (0..terms).for_each(|term| bytes.scalar(size, number(seed, row, term)));
            }
        }
    }
    bytes
}

fn pvf_value(shape: Shape, size: usize, transposed: bool, image: usize, rgb: usize, texel: usize) -> f64 {
    let (view, light) = (image / shape.lights, image % shape.lights);
    let (dimension, weight) = if transposed {
        (3 * texel + rgb, light)
    } else {
        (3 * light + rgb, texel)
    };
    let term = |t| kept(size, number(50 + view, dimension, t)) * kept(size, number(70 + view, weight, t));
    kept(size, number(30 + view, dimension, 0)) + (0..view + 1).map(term).sum::<f64>()
}

/// The beginning of a per-view file in each of its three ways: signature, R and the older magic.
fn pvf_start(way: usize, shape: Shape) -> Bytes {
    if way < 2 {
        let mut bytes = Bytes::common(["!PVF06FC", "!PVF06FCR"][way], META, shape);
        bytes.u32(shape.views);
        bytes.u32(shape.views);
        return bytes;
    }
    let mut bytes = Bytes(if way == 2 {
        b"!PVF06FC".to_vec()
    } else {
        Vec::new()
    });
    bytes.u32(301_074);
    bytes.u32(shape.views);
    bytes.size(shape);
    bytes.u32(shape.views);
    bytes.directions(shape);
    bytes
}

#[test]
fn per_view_factorizations() {
    let one_view = Shape { views: 1, ..SMALL };
    for way in 0..4 {
        for (shape, size, transposed) in [
            (SMALL, 2, false),
            (SMALL, 4, true),
            (SMALL, 8, false),
            (one_view, 2, false),
            (one_view, 8, true),
        ] {
            let btf = pvf(pvf_start(way, shape), shape, size, transposed)
                .open()
                .unwrap();
            compare(&btf, shape, &|image, rgb, texel| {
                pvf_value(shape, size, transposed, image, rgb, texel)
            });
            let terms = btf.low_rank().unwrap().map(|low_rank| low_rank.terms);
            let expected = if transposed { 3 + 3 } else { 2 };
            assert_eq!(terms, (shape.views == 1).then_some(expected), "{shape:?}");
        }
    }
}

/// Factors that are not finite are an error where they are handed on, and bad samples where they are multiplied.
#[test]
fn factors_that_are_not_finite_are_named() {
    let mut bytes = Bytes::common("!FMF06FC", META, SMALL);
    bytes.u32(2);
    let u = |row, term| if (row, term) == (13, 1) { f64::NAN } else { 1.0 };
    bytes.factorization(4, 2, (18, &u), (12, &|_, _| 0.5));
    let (_folder, path) = bytes.write();
    let btf = Btf::open(&path).unwrap();
    let error = btf.low_rank().unwrap_err().to_string();
    assert!(error.contains("NaN in component 1 of image 4"), "{error}");
    let mut buffer = Vec::new();
    let samples = btf.samples(4..5, &mut buffer).unwrap();
    assert!(samples.get(11).is_finite() && samples.get(12).is_nan() && samples.get(24).is_finite());
}

#[derive(Clone, Copy, Debug)]
struct Bdi {
    shape: Shape,
    scan_lines: usize,
    compression: u8,
    holes: bool,
    /// Whether the last chunk is filled up.
    full: bool,
}

impl Bdi {
    fn held(self, texel: usize) -> bool {
        !self.holes || texel % 5 != 1
    }

    fn value(self, image: usize, rgb: usize, texel: usize) -> f64 {
        if self.compression == 2 && !self.held(texel) {
            return 0.0;
        }
        kept(2, number(90 + rgb, image, texel))
    }

    fn bytes(self) -> Bytes {
        let shape = self.shape;
        let mut bytes = Bytes::common("!BDIF06R2!", META, shape);
        bytes.u32(self.scan_lines);
        bytes.0.push(self.compression);
        (0..shape.texels()).for_each(|texel| bytes.0.push(u8::from(self.held(texel))));
        bytes.frames(0);
        let stored: Vec<usize> = (0..shape.texels())
            .filter(|&texel| self.compression != 2 || self.held(texel))
            .collect();
        let chunk_texels = shape.width * self.scan_lines;
        for texels in stored.chunks(chunk_texels) {
            let mut chunk = Bytes::default();
            for &texel in texels {
                for row in 0..3 * shape.images() {
                    chunk.scalar(2, self.value(row / 3, row % 3, texel));
                }
            }
            if self.full {
                chunk.0.resize(chunk_texels * 3 * shape.images() * 2, 0);
            }
            if self.compression == 1 {
                let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
                encoder.write_all(&chunk.0).unwrap();
                chunk.0 = encoder.finish().unwrap();
            }
            bytes.u32(chunk.0.len());
            bytes.0.extend(chunk.0);
        }
        bytes
    }
}

#[test]
fn all_samples_plain_bzip2_and_sparse() {
    let wide = Shape {
        views: 2,
        lights: 5,
        width: 9,
        height: 7,
    };
    for compression in 0..3 {
        for (shape, scan_lines, holes, full) in [
            (SMALL, 1, false, false),
            (SMALL, 2, true, true),
            (wide, 4, true, false),
            (wide, 100, false, true),
        ] {
            let bdi = Bdi {
                shape,
                scan_lines,
                compression,
                holes,
                full,
            };
            let btf = bdi.bytes().open().unwrap();
            compare(&btf, shape, &|image, rgb, texel| bdi.value(image, rgb, texel));
            assert!(btf.low_rank().unwrap().is_none());
            assert_eq!(
                btf.notes().join("\n").contains("texels are"),
                holes,
                "{:?}",
                btf.notes()
            );
        }
    }
}

#[test]
fn the_scratch_file_is_made_once_and_leaves_nothing() {
    let bdi = Bdi {
        shape: SMALL,
        scan_lines: 1,
        compression: 1,
        holes: false,
        full: false,
    };
    let (folder, path) = bdi.bytes().write();
    let btf = Btf::open(&path).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| compare(&btf, SMALL, &|image, rgb, texel| bdi.value(image, rgb, texel)));
        }
    });
    drop(btf);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn damaged_chunks_are_named() {
    let bdi = Bdi {
        shape: SMALL,
        scan_lines: 1,
        compression: 1,
        holes: false,
        full: false,
    };
    let bytes = bdi.bytes();
    let begin = bytes.0.windows(4).rposition(|window| window == b"BZh9").unwrap();
    let read = |bytes: &Bytes| {
        let (_folder, path) = bytes.write();
        let mut buffer = Vec::new();
        let btf = Btf::open(&path).unwrap();
        let error = btf.samples(0..1, &mut buffer).unwrap_err();
        error.to_string()
    };
    let mut damaged = bytes.clone();
    damaged.0[begin] = b'X';
    let error = read(&damaged);
    assert!(
        error.contains("chunk 2 of") && error.contains(&format!("byte {begin}")),
        "{error}"
    );
    // The chunks in another order, with one that holds too much in the middle.
    let large = Bdi { scan_lines: 3, ..bdi }.bytes();
    let chunk = large.0[large.0.windows(4).rposition(|window| window == b"BZh9").unwrap() - 4..].to_vec();
    let first = bytes.0.windows(4).position(|window| window == b"BZh9").unwrap() - 4;
    let size = u32::from_le_bytes(bytes.0[first..first + 4].try_into().unwrap()) as usize;
    let mut swollen = bytes.clone();
    swollen.0.splice(first..first + 4 + size, chunk);
    let error = read(&swollen);
    assert!(
        error.contains("chunk 0") && error.contains("more than the 72 samples"),
        "{error}"
    );
}

fn find(bytes: &Bytes, needle: &[u8]) -> usize {
    bytes
        .0
        .windows(needle.len())
        .position(|window| window == needle)
        .unwrap()
}

/// Where the size of the small file's pictures stands.
fn size_at(bytes: &Bytes) -> usize {
    find(bytes, &[4, 0, 0, 0, 3, 0, 0, 0])
}

fn put(bytes: &Bytes, at: usize, value: &[u8]) -> Bytes {
    let mut bytes = bytes.clone();
    bytes.0[at..at + value.len()].copy_from_slice(value);
    bytes
}

fn named(bytes: &Bytes, parts: &[&str]) {
    let error = bytes.error();
    for part in parts.iter().chain(&["cloth.btf"]) {
        assert!(error.contains(part), "{part:?} is not in {error:?}");
    }
}

const META_BYTES: usize = 4 + 4 + 240 + 4 + 12 + 4 + 4 + 7 + 4 + 3 * 5;
/// Where the directions of an `!FMF06FC` begin.
const DIRECTIONS: usize = 8 + META_BYTES;

#[test]
fn contradictions_are_named() {
    let good = fmf("!FMF06FC", SMALL, 2, 3, false, None);
    good.open().unwrap();
    named(
        &put(&good, 0, b"?"),
        &["\"?FMF06FC", "no signature", "!DFMF08FCR"],
    );
    named(&Bytes::default(), &["no signature"]);
    named(&put(&good, 8, &[1]), &["version 4", "claims"]);
    // The count of channels follows the XML text.
    let channels = DIRECTIONS - 19;
    named(
        &put(&good, channels, &[31]),
        &["31 channels", &format!("byte {channels}"), "expected 3"],
    );
    named(
        &put(&good, channels - 11, &[0, 0, 0, 0x7f]),
        &["XML text", "the file ends at"],
    );
    let nan = f32::NAN.to_le_bytes();
    let view = DIRECTIONS + 4;
    named(
        &put(&good, view, &nan),
        &["view 0 at [NaN", &format!("byte {view}")],
    );
    named(
        &put(&good, view + 12, &30f32.to_le_bytes()),
        &["light 0 of view 0 at [30", "radians"],
    );
    named(
        &put(&good, view + 16, &f32::INFINITY.to_le_bytes()),
        &["light 0 of view 0", "inf"],
    );
    named(&put(&good, DIRECTIONS, &[0; 4]), &["0 views"]);
    named(&put(&good, DIRECTIONS, &[0xff; 4]), &["4294967295 views"]);
    named(&put(&good, view + 8, &[0; 4]), &["0 lights of view 0"]);
    // A view and its two lights take 28 bytes.
    named(
        &put(&good, view + 28 + 8, &[1]),
        &["1 lights for view 1 and 2 for view 0"],
    );
    let moved = put(&good, view + 56 + 20, &0.5f32.to_le_bytes());
    named(
        &moved,
        &[
            "light 1 of view 2 at [0.5",
            "light 1 of view 0 is at [0.2",
            "same lights",
        ],
    );
    named(&put(&good, size_at(&good), &[0]), &["0x3 texels"]);
    named(&put(&good, size_at(&good), &[0, 0, 2]), &["131072x3 texels"]);
    let factors = size_at(&good) + 12;
    named(
        &put(&good, factors, &[3]),
        &["scalars of 3 bytes", &format!("byte {factors}"), "2, 4 or 8"],
    );
    named(&put(&good, factors + 1, &[0]), &["0 components"]);
    named(&put(&good, factors + 1, &[0xff; 4]), &["4294967295 components"]);
    named(
        &put(&good, factors + 5, &[7]),
        &["factors of 7 x 12", "expected 18 x 12", "36 x 6"],
    );
    named(
        &put(&good, factors + 1, &[4]),
        &["cut short", "S*V of 12 x 4 f16"],
    );
    named(&put(&good, factors + 1, &[2]), &["goes on for", "after S*V"]);
    let mut longer = good.clone();
    longer.0.push(0);
    named(&longer, &["goes on for 1 bytes"]);
}

#[test]
fn contradictions_of_each_layout_are_named() {
    let good = fmf("!FMF12FCER", SMALL, 2, 3, false, Some(0));
    let frames = size_at(&good) + 8;
    named(
        &put(&good, frames, &[0xff; 4]),
        &["4294967295 local frames", "cut short"],
    );
    let extended = frames + 4 + 36 * 12;
    named(&put(&good, extended, &[3]), &["FMF header of version 3"]);
    named(
        &put(&good, extended + 5, &[0xff; 8]),
        &["height map of 4294967295 x 4294967295"],
    );

    let good = dfmf(0, 2, false);
    let model = size_at(&good) + 8 + 4 + 36 * 12 + 4;
    for (number, text) in [
        (6u8, "linear spectral"),
        (7, "colour model 7"),
        (8, "known are"),
        (13, "colour model 13"),
    ] {
        named(&put(&good, model, &[number]), &[text, &format!("byte {model}")]);
    }
    named(
        &put(&put(&good, model, &[3]), model + 4, &f32::NAN.to_le_bytes()),
        &["PCA", "NaN"],
    );

    let good = pvf(pvf_start(0, SMALL), SMALL, 2, false);
    named(
        &put(&good, size_at(&good) + 12, &[2]),
        &["2 view slots and 3 views"],
    );

    let bdi = Bdi {
        shape: SMALL,
        scan_lines: 2,
        compression: 2,
        holes: true,
        full: false,
    };
    let good = bdi.bytes();
    let lines = size_at(&good) + 8;
    named(&put(&good, lines, &[0]), &["0 scan lines"]);
    named(&put(&good, lines + 4, &[3]), &["compression 3", "2 sparse"]);
    named(&put(&good, lines + 5, &[0; 12]), &["masks out every texel"]);
    let chunk = lines + 5 + 12 + 4;
    named(
        &put(&good, chunk, &[1]),
        &[
            "chunk 0 of",
            &format!("byte {chunk}"),
            "expected 288 for 8 texels",
        ],
    );
    let mut bomb = put(&good, lines + 4, &[1]);
    bomb.0.truncate(chunk);
    (0..2).for_each(|_| bomb.u32(0));
    named(
        &bomb,
        &["432 bytes of samples in 0 bytes of bzip2", "not believed"],
    );
}

/// One file of every layout.
fn samples_of_files() -> Vec<Bytes> {
    let bdi = |compression| {
        Bdi {
            shape: SMALL,
            scan_lines: 2,
            compression,
            holes: true,
            full: false,
        }
        .bytes()
    };
    vec![
        fmf("!FMF06FC", SMALL, 2, 3, false, None),
        fmf("!FMF12FCER", SMALL, 4, 2, true, Some(1)),
        dfmf(3, 2, false),
        dfmf(11, 8, true),
        pvf(pvf_start(0, SMALL), SMALL, 2, false),
        pvf(pvf_start(2, SMALL), SMALL, 4, true),
        bdi(0),
        bdi(1),
        bdi(2),
    ]
}

#[test]
fn every_truncation_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cloth.btf");
    for good in samples_of_files() {
        std::fs::write(&path, &good.0).unwrap();
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        for length in (0..good.0.len()).rev() {
            file.set_len(length as u64).unwrap();
            let error = Btf::open(&path).unwrap_err().to_string();
            let about = error.contains("cut short") || error.contains("signature");
            assert!(about, "{length} of {} bytes: {error}", good.0.len());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, ..ProptestConfig::default() })]

    /// Whatever is in the file: an error or samples, never a panic.
    #[test]
    fn no_bytes_panic(
        file in 0usize..9,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        header in any::<bool>(),
    ) {
        let mut bytes = samples_of_files().swap_remove(file);
        for (index, value) in edits {
            // Half of the runs change the counts behind the directions only, which matter most.
            let range = if header { 290..bytes.0.len().min(900) } else { 0..bytes.0.len() };
            let at = range.start + index.index(range.len());
            bytes.0[at] = value;
        }
        let (_folder, path) = bytes.write();
        if let Ok(btf) = Btf::open(&path) {
            let mut buffer = Vec::new();
            for image in 0..btf.image_count().min(9) {
                if let Ok(samples) = btf.samples(image..image + 1, &mut buffer) {
                    prop_assert_eq!(samples.len(), 3 * btf.columns());
                }
                prop_assert!(!btf.place(image).is_empty());
            }
            let _ = btf.low_rank();
        }
    }
}
