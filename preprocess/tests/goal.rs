//! Archives that meet an error, a PSNR or a number of bytes; and the ledger against what is measured.

mod common;

use common::{Shape, material, write_btf};
use preprocess::npy::Dtype;
use preprocess::{Error, Goal, Options, Report, Weights, run};

const SHAPE: Shape = Shape {
    views: 7,
    lights: 8,
    width: 66,
    height: 40,
};

/// A BTF with a spectrum that falls slowly, and noise.
fn options(folder: &std::path::Path) -> Options {
    let input = write_btf(folder, SHAPE, Dtype::F16, &material(SHAPE, 40, 0.02, 7));
    let mut options = Options::new(input, folder.join("material.bsvtf"));
    options.settings.memory_bytes = 1 << 30;
    options
}

fn with(options: &Options, goal: Goal) -> preprocess::Result<Report> {
    let options = Options {
        goal: Some(goal),
        ..options.clone()
    };
    run(&options, &|_| ())
}

#[test]
fn errors_are_met_and_hardly_undercut() {
    let folder = tempfile::tempdir().unwrap();
    let options = options(folder.path());
    let mut bytes = Vec::new();
    for error in [0.02, 0.05, 0.2] {
        let report = with(&options, Goal::RelativeError(error)).unwrap();
        let met = report.relative_error;
        assert!(
            met <= error && met >= 0.97 * error,
            "{met} for {error}: {report:?}"
        );
        let file = std::fs::metadata(&options.output).unwrap().len();
        assert_eq!(file, report.archive.archive_bytes);
        bytes.push(file);
    }
    assert!(bytes.is_sorted_by(|a, b| a > b), "{bytes:?}");
    // The same as decibels below a white Lambertian surface.
    let decibels = 40.0;
    let report = with(&options, Goal::Psnr(decibels)).unwrap();
    let psnr = report.psnr.unwrap();
    assert!(psnr >= decibels && psnr < decibels + 0.3, "{psnr} dB");
    assert!((psnr + 20.0 * report.total_error.rms.log10()).abs() < 1e-9);
    // Nothing is left beside the archive and its BTF.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
}

#[test]
fn bytes_are_filled_and_more_of_them_are_better() {
    let folder = tempfile::tempdir().unwrap();
    let options = options(folder.path());
    let mut errors = Vec::new();
    for bytes in [30_000, 60_000, 120_000] {
        let report = with(&options, Goal::Bytes(bytes)).unwrap();
        let file = std::fs::metadata(&options.output).unwrap().len();
        assert!(file <= bytes && file >= bytes / 100 * 85, "{file} of {bytes}");
        errors.push(report.relative_error);
    }
    assert!(errors.is_sorted_by(|a, b| a > b), "{errors:?}");
}

#[test]
fn a_chosen_split_is_cheaper_than_fixed_ones() {
    let folder = tempfile::tempdir().unwrap();
    let options = options(folder.path());
    let found = with(&options, Goal::RelativeError(0.1)).unwrap();
    for components in [found.components / 2, 2 * found.components] {
        for step in 0..8 {
            let mut fixed = options.clone();
            fixed.settings.components = components.max(1);
            fixed.quality = 0.02 * 1.6f64.powi(step);
            let report = run(&fixed, &|_| ()).unwrap();
            if report.relative_error <= 0.1 {
                let (bytes, best) = (report.archive.archive_bytes, found.archive.archive_bytes);
                assert!(
                    best as f64 <= bytes as f64 * 1.02,
                    "{best}, {bytes} with {components}"
                );
            }
        }
    }
}

#[test]
fn what_cannot_be_reached_says_what_can() {
    let folder = tempfile::tempdir().unwrap();
    let options = options(folder.path());
    let unreachable = |goal| {
        let error = with(&options, goal).unwrap_err();
        assert!(matches!(error, Error::Unreachable { .. }), "{error}");
        error.to_string()
    };
    let text = unreachable(Goal::Bytes(1500));
    assert!(
        text.contains("1500") && text.contains("components take about"),
        "{text}"
    );
    let text = unreachable(Goal::Psnr(110.0));
    assert!(
        text.contains("110 dB") && text.contains("components leave"),
        "{text}"
    );
    assert!(!options.output.exists());
    for goal in [
        Goal::RelativeError(0.0),
        Goal::RelativeError(f64::NAN),
        Goal::Psnr(-1.0),
        Goal::Bytes(3),
    ] {
        assert!(
            matches!(with(&options, goal), Err(Error::Invalid { .. })),
            "{goal}"
        );
    }
}

#[test]
fn materials_of_few_terms_meet_their_goals() {
    let folder = tempfile::tempdir().unwrap();
    for samples in [
        vec![0.25; SHAPE.samples()],
        vec![0.0; SHAPE.samples()],
        material(SHAPE, 2, 0.0, 1),
    ] {
        let input = write_btf(folder.path(), SHAPE, Dtype::F32, &samples);
        let mut options = Options::new(input, folder.path().join("material.bsvtf"));
        options.settings.memory_bytes = 1 << 30;
        for goal in [Goal::RelativeError(0.01), Goal::Bytes(100_000)] {
            let report = with(&options, goal).unwrap();
            assert!(report.relative_error <= 0.01, "{goal}: {}", report.relative_error);
            assert!(report.components <= 4);
        }
    }
}

#[test]
fn the_ledger_is_what_is_measured_on_the_archive() {
    let folder = tempfile::tempdir().unwrap();
    let base = options(folder.path());
    for (components, quality, weights) in [
        (6, 0.02, Weights::Uniform),
        (30, 0.2, Weights::Uniform),
        (12, 0.5, Weights::SolidAngle),
        (60, 0.002, Weights::Robust),
    ] {
        let mut options = base.clone();
        options.settings.components = components;
        options.settings.weights = weights;
        options.quality = quality;
        let by_factors = run(&options, &|_| ()).unwrap();
        options.verify = true;
        let by_btf = run(&options, &|_| ()).unwrap();
        assert_eq!(
            (by_factors.measured_against, by_btf.measured_against),
            ("factors", "btf")
        );
        for report in [&by_factors, &by_btf] {
            let ratio = report.measured_error.rms / report.total_error.rms;
            assert!(
                (ratio - 1.0).abs() < 0.02,
                "{} by {ratio}",
                report.measured_against
            );
        }
        let ratio = by_factors.measured_error.rms / by_btf.measured_error.rms;
        assert!((ratio - 1.0).abs() < 0.015, "cross terms of {ratio}");
        assert_eq!(by_btf.weighted.is_some(), weights != Weights::Uniform);
        if let (Some(a), Some(b)) = (by_factors.weighted, by_btf.weighted) {
            assert!(
                (a.measured.rms / b.measured.rms - 1.0).abs() < 0.01,
                "{a:?} {b:?}"
            );
            assert!(b.rank.rms < b.measured.rms);
        }
    }
}
