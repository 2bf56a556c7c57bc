//! Full matrix factorizations.

use crate::common::{Bytes, Factor, META, Meta, SMALL, Shape, compare, kept, number};

/// An FMF file of `terms` terms; `range` is the range reduction, which only `!FMF12FCER` can say.
pub(crate) fn fmf(
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

pub(crate) fn fmf_value(
    size: usize,
    terms: usize,
    transposed: bool,
    image: usize,
    rgb: usize,
    texel: usize,
) -> f64 {
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
            ..META
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
