//! The exchange format: round trips, and files that lie.

mod common;

use std::path::{Path, PathBuf};

use common::{Shape, material, sampling, stored, write_btf};
use half::f16;
use preprocess::npy::{BtfWriter, Dtype, NpyWriter, Samples, write_npy_f32};
use preprocess::{Error, npy::NpyBtf};

const SHAPE: Shape = Shape {
    views: 3,
    lights: 2,
    width: 5,
    height: 4,
};

#[test]
fn what_is_written_is_read() {
    for dtype in [Dtype::F16, Dtype::F32] {
        let samples = material(SHAPE, 3, 0.1, 1);
        let folder = tempfile::tempdir().unwrap();
        let btf = NpyBtf::open(&write_btf(folder.path(), SHAPE, dtype, &samples)).unwrap();
        assert_eq!(
            (btf.name(), btf.width(), btf.height(), btf.dtype()),
            ("material", 5, 4, dtype)
        );
        assert_eq!(*btf.sampling(), sampling(3, 2));
        assert!(btf.wrap() && !btf.cosine());
        assert_eq!(btf.sample_bytes(), (samples.len() * dtype.bytes()) as u64);
        let expected = stored(&samples, dtype);
        for view in 0..3 {
            for light in 0..2 {
                for texel in 0..20 {
                    let found = btf.texel(view, light, texel as u32 % 5, texel as u32 / 5);
                    for (rgb, found) in found.into_iter().enumerate() {
                        let place = ((view * 2 + light) * 3 + rgb) * 20 + texel;
                        assert_eq!(found, expected[place]);
                        assert_eq!(btf.row(view, light, rgb).get(texel), expected[place]);
                    }
                }
            }
        }
        let block = btf.row_block(4..9);
        let mut converted = vec![0f32; block.len()];
        block.to_f32(&mut converted);
        assert!(
            converted
                .iter()
                .zip(&expected[4 * 20..])
                .all(|(&a, &b)| f64::from(a) == b)
        );
        assert_eq!(matches!(block, Samples::F16(_)), dtype == Dtype::F16);
    }
}

#[test]
fn writers_convert_between_types_and_count_samples() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("material.npy");
    let halves: Vec<f16> = material(SHAPE, 2, 0.1, 1)
        .into_iter()
        .map(f16::from_f32)
        .collect();
    let mut writer = BtfWriter::create(&path, sampling(3, 2), 5, 4, Dtype::F32).unwrap();
    for piece in halves.chunks(37) {
        writer.write_f16(piece).unwrap();
    }
    writer.finish().unwrap();
    let btf = NpyBtf::open(&path).unwrap();
    assert_eq!(
        btf.texel(2, 1, 3, 2)[1],
        halves[((2 * 2 + 1) * 3 + 1) * 20 + 2 * 5 + 3].to_f64()
    );

    let mut writer = NpyWriter::create(&path, Dtype::F32, &[2, 2]).unwrap();
    writer.write_f32(&[1.0; 3]).unwrap();
    assert!(
        writer
            .write_f32(&[1.0; 2])
            .unwrap_err()
            .to_string()
            .contains("1 fit")
    );
    assert!(
        writer
            .finish()
            .unwrap_err()
            .to_string()
            .contains("1 samples were not written")
    );
    assert!(
        NpyBtf::open(&path).is_ok(),
        "a failed write leaves what was there"
    );
    assert!(write_npy_f32(&path, &[2, 2], &[1.0; 5]).is_err());
    assert!(write_npy_f32(&path, &[usize::MAX, 9], &[]).is_err());
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        2,
        "temporary files are gone"
    );
}

#[test]
fn impossible_btfs_are_not_begun() {
    let folder = tempfile::tempdir().unwrap();
    let create = |name: &str, sampling, width| {
        BtfWriter::create(&folder.path().join(name), sampling, width, 4, Dtype::F16)
    };
    assert!(create("a.bin", sampling(1, 1), 4).is_err());
    assert!(create("a.npy", sampling(0, 1), 4).is_err());
    assert!(create("a.npy", sampling(1, 1), 0).is_err());
    assert!(create("a.npy", sampling(1, 1), 1 << 17).is_err());
    let mut degrees = sampling(1, 1);
    degrees.views[0].theta = 45.0;
    assert!(
        create("a.npy", degrees, 4)
            .err()
            .unwrap()
            .to_string()
            .contains("radians")
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// A `.npy` file of any header, `bytes` samples bytes, and a fitting `.json`.
fn forge(folder: &Path, descr: &str, fortran: &str, shape: &str, bytes: usize) -> PathBuf {
    let path = folder.join("forged.npy");
    let dictionary = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
    let padded = format!("{dictionary:<117}\n");
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend((padded.len() as u16).to_le_bytes());
    file.extend(padded.as_bytes());
    file.resize(file.len() + bytes, 0);
    std::fs::write(&path, file).unwrap();
    let json =
        r#"{"views": [[0, 0], [0.5, 1]], "lights": [[0.25, 0]], "wrap": false, "cosine": true, "note": "x"}"#;
    std::fs::write(folder.join("forged.json"), json).unwrap();
    path
}

#[test]
fn lying_files_are_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let good = "(2, 1, 3, 4, 5)";
    let whole = 2 * 3 * 4 * 5 * 2;
    let btf = NpyBtf::open(&forge(folder.path(), "<f2", "False", good, whole)).unwrap();
    assert!(!btf.wrap() && btf.cosine());
    for (descr, fortran, shape, bytes, reason) in [
        (">f2", "False", good, whole, "\"<f2\" or \"<f4\""),
        ("<f8", "False", good, whole * 4, "astype"),
        ("<f2", "True", good, whole, "Fortran"),
        ("<f2", "False", "(2, 3, 4, 5)", whole, "4 axes"),
        ("<f2", "False", "(2, 1, 4, 5, 3)", whole, "4 channels"),
        ("<f2", "False", "(0, 1, 3, 4, 5)", 0, "0 views"),
        ("<f2", "False", "(2, 1, 3, 4, 0)", 0, "0 columns"),
        ("<f2", "False", "(2, 9999, 3, 4, 5)", whole, "9999 lights"),
        (
            "<f2",
            "False",
            "(2, 1, 3, 4, 4294967296)",
            whole,
            "4294967296 columns",
        ),
        ("<f2", "False", good, whole - 1, "cut short"),
        ("<f2", "False", good, whole + 1, "header is wrong"),
        ("<f4", "False", good, whole, "takes 480"),
        ("<f2", "False", "(4096, 4096, 3, 65536, 65536)", whole, "takes"),
        (
            "<f2",
            "False",
            "(1, 2, 3, 4, 5)",
            whole,
            "names 2 views and 1 lights",
        ),
    ] {
        let error = NpyBtf::open(&forge(folder.path(), descr, fortran, shape, bytes))
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(reason) && error.contains("forged"),
            "{shape}: {error}"
        );
    }
}

#[test]
fn wrong_directions_are_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = forge(folder.path(), "<f2", "False", "(2, 1, 3, 4, 5)", 240);
    let json = folder.path().join("forged.json");
    for (text, reason) in [
        ("", "EOF"),
        ("{}", "missing field"),
        (
            r#"{"views": [[0, 0], [1]], "lights": [[0, 0]], "wrap": true, "cosine": true}"#,
            "expected",
        ),
        (
            r#"{"views": [], "lights": [[0, 0]], "wrap": true, "cosine": true}"#,
            "0 views",
        ),
        (
            r#"{"views": [[0, 0], [60, 0]], "lights": [[0, 0]], "wrap": true, "cosine": true}"#,
            "radians",
        ),
        (
            r#"{"views": [[0, 0], [-1, 0]], "lights": [[0, 0]], "wrap": true, "cosine": true}"#,
            "views[1]",
        ),
        (
            r#"{"views": [[0, 0], [1e999, 0]], "lights": [[0, 0]], "wrap": true, "cosine": true}"#,
            "out of range",
        ),
    ] {
        std::fs::write(&json, text).unwrap();
        let error = NpyBtf::open(&path).unwrap_err().to_string();
        assert!(
            error.contains(reason) && error.contains("forged.json"),
            "{text}: {error}"
        );
    }
    std::fs::remove_file(&json).unwrap();
    assert!(matches!(NpyBtf::open(&path), Err(Error::Io { .. })));
}

#[test]
fn what_is_no_npy_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(
        NpyBtf::open(&folder.path().join("none.npy")),
        Err(Error::Io { .. })
    ));
    assert!(matches!(
        NpyBtf::open(folder.path()),
        Err(Error::Format { .. } | Error::Io { .. })
    ));
    let path = folder.path().join("x.npy");
    for bytes in [&b""[..], b"x", b"\x93NUMPY", b"\x93NUMPY\x01\x00\xff\xff"] {
        std::fs::write(&path, bytes).unwrap();
        assert!(matches!(NpyBtf::open(&path), Err(Error::Format { .. })));
    }
    // Samples of f32 that begin at an odd byte.
    let dictionary = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 1, 3, 1, 1), }\n";
    forge(folder.path(), "<f2", "False", "(2, 1, 3, 4, 5)", 240);
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((dictionary.len() as u16).to_le_bytes());
    bytes.extend(dictionary.as_bytes());
    bytes.resize(bytes.len() + 24, 0);
    let path = folder.path().join("forged.npy");
    std::fs::write(&path, bytes).unwrap();
    assert!(
        NpyBtf::open(&path)
            .unwrap_err()
            .to_string()
            .contains("multiple of 4")
    );
}
