//! Spectra: channels named by wavelengths.

use preprocess::npy::Samples;

use crate::common::{Bytes, Factor, META, Meta, SMALL, Shape, number};

const SHAPE: Shape = SMALL;
/// Every 20 nm, in an order that is not that of wavelengths.
const NAMES: [&str; 16] = [
    "700nm", "400nm", "420", "440.0", "460.0NM", "480nm", "500nm", "520", "540nm", "560nm", "580nm", "600 ",
    "620nm", "640nm", "660nm", "680nm",
];
const NM: [f64; 16] = [
    700.0, 400.0, 420.0, 440.0, 460.0, 480.0, 500.0, 520.0, 540.0, 560.0, 580.0, 600.0, 620.0, 640.0, 660.0,
    680.0,
];
/// What [`orange`] is under D65, by colour-science 0.4.7.
const ORANGE: [f64; 3] = [0.87443, 0.32879, 0.18982];

/// A step at 560 nm with a bump at 450 nm.
fn orange(nm: f64) -> f64 {
    0.15 + 0.6 / (1.0 + (-(nm - 560.0) / 18.0).exp()) + 0.1 * (-((nm - 450.0) / 25.0).powi(2)).exp()
}

const fn meta(channels: &'static [&'static str]) -> Meta {
    Meta { channels, ..META }
}

fn fmf(signature: &str, transposed: bool, meta: Meta, range: u32) -> Bytes {
    let mut bytes = Bytes::common(signature, meta, SHAPE);
    if signature == "!FMF12FCER" {
        bytes.0.push(1);
        bytes.u32(range as usize);
    }
    bytes.u32(1);
    let channels = meta.channels.len();
    let (u, v): (Factor<'_>, Factor<'_>) = (
        &|row, _| orange(NM[row % channels]) * number(1, row / channels, 0),
        &|row, _| number(2, row, 0),
    );
    let (images, texels) = (SHAPE.images(), SHAPE.texels());
    let (rows, columns) = if transposed {
        (texels, images)
    } else {
        (images, texels)
    };
    bytes.factorization(4, 1, (channels * rows, u), (columns, v));
    bytes
}

fn bdi(meta: Meta) -> Bytes {
    let mut bytes = Bytes::common("!BDIF06R2!", meta, SHAPE);
    bytes.u32(2);
    bytes.0.push(0);
    bytes.0.extend(vec![1; SHAPE.texels()]);
    bytes.frames(0);
    let texels: Vec<usize> = (0..SHAPE.texels()).collect();
    for texels in texels.chunks(2 * SHAPE.width) {
        bytes.u32(texels.len() * SHAPE.images() * meta.channels.len() * 2);
        for &texel in texels {
            for image in 0..SHAPE.images() {
                for nm in NM {
                    bytes.scalar(2, orange(nm) * number(1, image, 0) * number(2, texel, 0));
                }
            }
        }
    }
    bytes
}

fn compare(bytes: &Bytes, value: impl Fn(usize, usize) -> f64) {
    let btf = bytes.open().unwrap();
    let mut buffer = Vec::new();
    let Samples::F32(samples) = btf.samples(0..SHAPE.images(), &mut buffer).unwrap() else {
        panic!("f32")
    };
    assert_eq!(samples.len(), 3 * SHAPE.images() * SHAPE.texels());
    for (index, &sample) in samples.iter().enumerate() {
        let (row, texel) = (index / SHAPE.texels(), index % SHAPE.texels());
        let value = value(row / 3, texel);
        let expected = ORANGE[row % 3] * value;
        assert!(
            (f64::from(sample) - expected).abs() < 0.011 * value.abs() + 1e-3,
            "row {row} texel {texel}: {sample}, expected {expected}"
        );
    }
    assert!(
        btf.notes().iter().any(|note| note.contains("400nm to 700nm")),
        "{:?}",
        btf.notes()
    );
    if let Some(low_rank) = btf.low_rank().unwrap() {
        let images = 3 * SHAPE.images();
        for (index, &sample) in samples.iter().enumerate() {
            let (row, texel) = (index / SHAPE.texels(), index % SHAPE.texels());
            let product: f32 = (0..low_rank.terms)
                .map(|term| low_rank.u[term * images + row] * low_rank.v[term * SHAPE.texels() + texel])
                .sum();
            assert!((product - sample).abs() < 1e-5, "{product} {sample}");
        }
    }
}

#[test]
fn spectra_become_linear_rgb() {
    let meta = meta(&NAMES);
    let value = |image: usize, texel: usize| number(1, image, 0) * number(2, texel, 0);
    for signature in ["!FMF06FC", "!FMF06FCR", "!FMF12FCER"] {
        compare(&fmf(signature, false, meta, 0), value);
        compare(&fmf(signature, true, meta, 0), |image, texel| {
            number(1, texel, 0) * number(2, image, 0)
        });
    }
    compare(&bdi(meta), value);
}

#[test]
fn what_is_not_known_of_spectra_is_said() {
    let said = |bytes: Bytes, words: &[&str]| {
        let error = bytes.error();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    };
    let full = meta(&NAMES);
    said(fmf("!FMF12FCER", false, full, 1), &["logarithms", "16 channels"]);
    for signature in ["!DFMF08FCR", "!PVF06FC"] {
        said(
            Bytes::common(signature, full, SHAPE),
            &["16 channels", "not public"],
        );
    }
    said(
        fmf("!FMF06FC", false, meta(&["400nm", "X", "500nm", "600nm"]), 0),
        &["4 channels", "channel 1", "\"X\"", "550nm"],
    );
    said(
        fmf("!FMF06FC", false, meta(&["400nm", "500", "400", "600nm"]), 0),
        &["two channels of 400 nm"],
    );
    said(
        fmf("!FMF06FC", false, meta(&["400nm"]), 0),
        &["1 channels", "expected 3"],
    );
}
