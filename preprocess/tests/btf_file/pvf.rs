//! Per-view factorizations.

use preprocess::Btf;

use crate::common::{Bytes, META, SMALL, Shape, compare, kept, number};

/// A per-view file: view v has v + 1 components.
pub(crate) fn pvf(start: Bytes, shape: Shape, size: usize, transposed: bool) -> Bytes {
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

pub(crate) fn pvf_value(
    shape: Shape,
    size: usize,
    transposed: bool,
    image: usize,
    rgb: usize,
    texel: usize,
) -> f64 {
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
pub(crate) fn pvf_start(way: usize, shape: Shape) -> Bytes {
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
