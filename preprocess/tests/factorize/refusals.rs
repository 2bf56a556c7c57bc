//! What is refused, by name.

use preprocess::factorize::factorize;
use preprocess::npy::Dtype;
use preprocess::{Btf, Error};

use crate::common::{Shape, material, write_btf};
use crate::support::settings;

#[test]
fn bad_samples_are_named() {
    let shape = Shape {
        views: 3,
        lights: 2,
        width: 5,
        height: 4,
    };
    for (dtype, bad, printed) in [
        (Dtype::F16, f32::NAN, "NaN"),
        (Dtype::F16, f32::INFINITY, "inf"),
        (Dtype::F32, f32::NEG_INFINITY, "-inf"),
        (Dtype::F32, 2e12, "2"),
    ] {
        let mut samples = material(shape, 2, 0.1, 1);
        // View 2, light 1, green, x 3, y 2.
        samples[((2 * 2 + 1) * 3 + 1) * 20 + 2 * 5 + 3] = bad;
        let folder = tempfile::tempdir().unwrap();
        let btf = Btf::open(&write_btf(folder.path(), shape, dtype, &samples)).unwrap();
        let error = factorize(&btf, &settings(4), &|_| ()).unwrap_err();
        let Error::BadSample {
            view: 2,
            light: 1,
            channel: 'g',
            x: 3,
            y: 2,
            ..
        } = error
        else {
            panic!("wrong place: {error}");
        };
        assert!(error.to_string().contains(printed), "{error}");
        assert!(error.to_string().contains("material.npy"), "{error}");
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let shape = Shape {
        views: 1,
        lights: 1,
        width: 2,
        height: 2,
    };
    let folder = tempfile::tempdir().unwrap();
    let btf = Btf::open(&write_btf(folder.path(), shape, Dtype::F16, &[1.0; 12])).unwrap();
    for components in [0, 1025] {
        assert!(matches!(
            factorize(&btf, &settings(components), &|_| ()),
            Err(Error::Invalid { .. })
        ));
    }
}
