//! From a BTF to an archive and back to numpy files.

mod common;

use std::path::Path;
use std::sync::Mutex;

use common::{Shape, material, product_error, stored, write_btf};
use preprocess::npy::Dtype;
use preprocess::{Error, Options, Phase, Report, export, run};
use tileset::Archive;

/// The f32 samples of a `.npy` file that this crate wrote, after checking its shape.
fn read_npy(path: &Path, shape: &[usize]) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    let data = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8_lossy(&bytes[10..data]).into_owned();
    let axes: Vec<String> = shape.iter().map(usize::to_string).collect();
    assert!(
        header.contains(&format!("'shape': ({})", axes.join(", "))),
        "{header}"
    );
    assert!(header.contains("<f4"));
    bytes[data..]
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect()
}

/// Preprocesses and exports; gives the report and the measured relative error of the exported product.
fn round_trip(shape: Shape, dtype: Dtype, samples: &[f32], components: u32, quality: f64) -> (Report, f64) {
    let folder = tempfile::tempdir().unwrap();
    let input = write_btf(folder.path(), shape, dtype, samples);
    let mut options = Options::new(&input, folder.path().join("material.bsvtf"));
    options.settings.components = components;
    options.settings.memory_bytes = 1 << 30;
    options.quality = quality;
    let report = run(&options, &|_| ()).unwrap();
    let out = folder.path().join("export");
    export(&options.output, &out, &|_| ()).unwrap();
    let kept = report.components as usize;
    let u = read_npy(&out.join("u.npy"), &[kept, shape.views, shape.lights, 3]);
    let v = read_npy(&out.join("v.npy"), &[kept, shape.height, shape.width]);
    let measured = product_error(&stored(samples, dtype), shape.rows(), shape.columns(), &u, &v);

    let archive = Archive::open(std::fs::File::open(&options.output).unwrap()).unwrap();
    let manifest = &archive.index.manifest;
    assert_eq!(manifest.errors.total_relative(), report.relative_error);
    assert_eq!(manifest.components, report.components);
    assert_eq!(
        report.archive.archive_bytes,
        std::fs::metadata(&options.output).unwrap().len()
    );
    assert_eq!(
        report.archive.pages,
        u64::from(manifest.groups() * archive.index.pyramid.tile_count())
    );
    let meta: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("meta.json")).unwrap()).unwrap();
    assert_eq!(meta["relative_error"].as_f64().unwrap(), report.relative_error);
    assert_eq!(meta["views"].as_array().unwrap().len(), shape.views);
    (report, measured)
}

#[test]
fn the_stated_error_is_that_of_the_exported_product() {
    for (shape, dtype, components, quality, noise) in [
        (
            Shape {
                views: 4,
                lights: 5,
                width: 70,
                height: 33,
            },
            Dtype::F16,
            6,
            0.02,
            0.02,
        ),
        (
            Shape {
                views: 4,
                lights: 5,
                width: 70,
                height: 33,
            },
            Dtype::F16,
            6,
            0.3,
            0.02,
        ),
        (
            Shape {
                views: 4,
                lights: 5,
                width: 70,
                height: 33,
            },
            Dtype::F32,
            9,
            0.01,
            0.0,
        ),
        (
            Shape {
                views: 3,
                lights: 3,
                width: 131,
                height: 66,
            },
            Dtype::F32,
            5,
            0.05,
            0.3,
        ),
        (
            Shape {
                views: 2,
                lights: 2,
                width: 40,
                height: 40,
            },
            Dtype::F16,
            100,
            0.005,
            0.1,
        ),
        (
            Shape {
                views: 3,
                lights: 2,
                width: 5,
                height: 3,
            },
            Dtype::F16,
            4,
            0.02,
            0.1,
        ),
    ] {
        let samples = material(shape, 8, noise, 11);
        let (report, measured) = round_trip(shape, dtype, &samples, components, quality);
        let ratio = report.relative_error / measured;
        assert!(
            (ratio - 1.0).abs() < 0.02,
            "{shape:?}: stated {}, measured {measured}",
            report.relative_error
        );
        let sum =
            report.rank_error.rms.powi(2) + report.half_error.rms.powi(2) + report.codec_error.rms.powi(2);
        assert!((sum.sqrt() / report.btf_rms / report.relative_error - 1.0).abs() < 1e-9);
    }
}

#[test]
fn a_finer_quantizer_loses_less() {
    let shape = Shape {
        views: 3,
        lights: 3,
        width: 80,
        height: 48,
    };
    let samples = material(shape, 8, 0.02, 2);
    let (coarse, _) = round_trip(shape, Dtype::F16, &samples, 4, 0.2);
    let (fine, _) = round_trip(shape, Dtype::F16, &samples, 4, 0.02);
    assert!(fine.codec_error.rms < 0.5 * coarse.codec_error.rms);
    assert!(fine.archive.page_bytes > coarse.archive.page_bytes);
    assert_eq!(fine.rank_error, coarse.rank_error);
}

#[test]
fn degenerate_materials_make_archives() {
    let one = Shape {
        views: 1,
        lights: 1,
        width: 1,
        height: 1,
    };
    let (report, measured) = round_trip(one, Dtype::F16, &[0.5, 0.25, 1.0], 100, 0.02);
    assert_eq!(report.components, 1);
    assert!(measured < 0.02);
    let shape = Shape {
        views: 2,
        lights: 1,
        width: 33,
        height: 2,
    };
    let (report, measured) = round_trip(shape, Dtype::F16, &vec![0.0; shape.samples()], 4, 0.02);
    assert_eq!((report.relative_error, measured), (0.0, 0.0));
    let (_, measured) = round_trip(shape, Dtype::F16, &vec![0.7; shape.samples()], 4, 0.02);
    assert!(measured < 0.01, "{measured}");
}

#[test]
fn values_beyond_half_floats_are_scaled() {
    let shape = Shape {
        views: 2,
        lights: 3,
        width: 40,
        height: 20,
    };
    for scale in [1e6f32, 1e-6] {
        let samples: Vec<f32> = material(shape, 5, 0.02, 2).iter().map(|x| x * scale).collect();
        let (report, measured) = round_trip(shape, Dtype::F32, &samples, 6, 0.02);
        assert_ne!(report.texture_scale, 1.0);
        assert!((report.relative_error / measured - 1.0).abs() < 0.02);
        assert!(measured < 0.05, "{measured}");
    }
}

#[test]
fn a_peak_far_above_the_mean_can_be_coded() {
    let shape = Shape {
        views: 2,
        lights: 2,
        width: 64,
        height: 64,
    };
    let mut samples = vec![1e-3f32; shape.samples()];
    samples[100] = 60_000.0;
    let (report, measured) = round_trip(shape, Dtype::F32, &samples, 2, 1e-6);
    assert!(
        (report.relative_error - measured).abs() < 1e-6,
        "{} {measured}",
        report.relative_error
    );
}

#[test]
fn a_failed_run_leaves_nothing() {
    let shape = Shape {
        views: 2,
        lights: 2,
        width: 8,
        height: 8,
    };
    let folder = tempfile::tempdir().unwrap();
    let mut samples = material(shape, 2, 0.1, 1);
    samples[5] = f32::NAN;
    let input = write_btf(folder.path(), shape, Dtype::F32, &samples);
    let files = || std::fs::read_dir(folder.path()).unwrap().count();
    let before = files();
    let options = Options::new(&input, folder.path().join("out.bsvtf"));
    assert!(matches!(run(&options, &|_| ()), Err(Error::BadSample { .. })));
    assert_eq!(files(), before);

    for quality in [0.0, -1.0, f64::NAN, 11.0] {
        let mut options = options.clone();
        options.quality = quality;
        assert!(matches!(run(&options, &|_| ()), Err(Error::Invalid { .. })));
    }
    let missing = Options::new(&input, folder.path().join("none/out.bsvtf"));
    assert!(matches!(run(&missing, &|_| ()), Err(Error::Io { .. })));
    std::fs::write(folder.path().join("bad.bsvtf"), b"no archive").unwrap();
    assert!(
        export(
            &folder.path().join("bad.bsvtf"),
            &folder.path().join("x"),
            &|_| ()
        )
        .is_err()
    );
    assert!(!folder.path().join("x").exists());
}

#[test]
fn progress_reaches_the_end_of_every_phase() {
    let shape = Shape {
        views: 2,
        lights: 2,
        width: 8,
        height: 8,
    };
    let folder = tempfile::tempdir().unwrap();
    let input = write_btf(folder.path(), shape, Dtype::F32, &material(shape, 6, 0.1, 1));
    let mut options = Options::new(&input, folder.path().join("out.bsvtf"));
    options.settings.components = 3;
    let finished = Mutex::new(Vec::new());
    let report = run(&options, &|progress| {
        assert!(progress.done <= progress.total);
        if progress.done == progress.total {
            finished.lock().unwrap().push(progress.phase);
        }
    })
    .unwrap();
    let expected = [
        Phase::Sketch,
        Phase::PowerIteration(1),
        Phase::Projection,
        Phase::Encoding,
    ];
    assert_eq!(*finished.lock().unwrap(), expected);
    let json = serde_json::to_value(&report).unwrap();
    assert!(json["seconds"]["total"].as_f64().unwrap() > 0.0);
    assert_eq!(
        json["archive"]["archive_bytes"].as_u64().unwrap(),
        report.archive.archive_bytes
    );
}
