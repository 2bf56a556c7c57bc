//! Arrays that come through a pipe.

mod common;

use std::fs::File;
use std::io::{Cursor, Read};
use std::path::Path;

use common::{Shape, material, write_btf};
use preprocess::npy::{Dtype, read_once};
use preprocess::source::Overrides;
use preprocess::{Btf, Error, Goal, Options, Settings, run_once};

const SHAPE: Shape = Shape {
    views: 6,
    lights: 5,
    width: 40,
    height: 30,
};

fn options(folder: &Path) -> Options {
    let mut options = Options::new("-", folder.join("made.bsvtf"));
    options.directions = Some(folder.join("material.json"));
    options.settings = Settings {
        components: 12,
        memory_bytes: 1 << 30,
        ..Settings::default()
    };
    options
}

#[test]
fn a_pipe_gives_what_a_single_pass_over_the_file_gives() {
    for dtype in [Dtype::F16, Dtype::F32] {
        let folder = tempfile::tempdir().unwrap();
        let path = write_btf(folder.path(), SHAPE, dtype, &material(SHAPE, 20, 0.02, 3));
        let mut options = options(folder.path());
        let piped = run_once(File::open(&path).unwrap(), &options, &|_| ()).unwrap();
        assert_eq!((piped.passes, piped.rank_estimated), (1, true));
        options.input = path;
        options.settings.passes = Some(1);
        let mapped = preprocess::run(&options, &|_| ()).unwrap();
        assert_eq!(piped.singular_values, mapped.singular_values);
        assert_eq!(piped.measured_error, mapped.measured_error);
        // Nothing to continue from is left behind.
        assert!(!folder.path().join("made.bsvtf.partial").exists());
    }
}

#[test]
fn what_needs_another_pass_is_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    write_btf(folder.path(), SHAPE, Dtype::F16, &material(SHAPE, 4, 0.1, 1));
    type Harm = (&'static str, fn(&mut Options));
    let harms: [Harm; 5] = [
        ("number of passes", |options| options.settings.passes = Some(3)),
        ("repair", |options| options.repair = true),
        ("comparison", |options| options.verify = true),
        ("goal", |options| options.goal = Some(Goal::RelativeError(0.1))),
        ("--directions", |options| options.directions = None),
    ];
    for (named, harm) in harms {
        let mut options = options(folder.path());
        harm(&mut options);
        let error = run_once(Cursor::new(Vec::new()), &options, &|_| ()).unwrap_err();
        assert!(matches!(error, Error::Invalid { .. }), "{error}");
        assert!(error.to_string().contains(named), "{error} should name {named}");
        assert!(error.to_string().contains("pipe"), "{error}");
    }
}

#[test]
fn images_are_read_once_and_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let samples = material(SHAPE, 4, 0.1, 1);
    let path = write_btf(folder.path(), SHAPE, Dtype::F32, &samples);
    let btf = open(std::fs::read(&path).unwrap(), folder.path()).unwrap();
    let mut buffer = Vec::new();
    let image = 3 * SHAPE.columns();
    for images in [0..7, 7..8, 8..30] {
        let expected = &samples[images.start * image..images.end * image];
        assert_eq!(
            btf.samples(images, &mut buffer).unwrap(),
            preprocess::npy::Samples::F32(expected)
        );
    }
    let error = btf.samples(0..1, &mut buffer).unwrap_err().to_string();
    assert!(
        error.contains("can be read once") && error.contains("image 0"),
        "{error}"
    );
}

fn piped(reader: impl Read + Send + 'static, folder: &Path) -> preprocess::Result<Btf> {
    let directions = folder.join("material.json");
    read_once(reader, Path::new("pipe"), &directions, &Overrides::default())
}

fn open(bytes: Vec<u8>, folder: &Path) -> preprocess::Result<Btf> {
    piped(Cursor::new(bytes), folder)
}

#[test]
fn broken_pipes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_btf(folder.path(), SHAPE, Dtype::F16, &material(SHAPE, 4, 0.1, 1));
    let bytes = std::fs::read(&path).unwrap();
    let all = 0..SHAPE.views * SHAPE.lights;
    let read = |bytes: Vec<u8>| {
        let btf = open(bytes, folder.path())?;
        btf.samples(all.clone(), &mut Vec::new())
            .map(|samples| samples.len())
    };
    assert_eq!(read(bytes.clone()).unwrap(), SHAPE.samples());
    let cut = bytes.len() - 1;
    let error = read(bytes[..cut].to_vec()).unwrap_err().to_string();
    assert!(error.contains("inside image 29 of 30"), "{error}");
    let error = read([&bytes[..], &[0]].concat()).unwrap_err().to_string();
    assert!(error.contains("goes on"), "{error}");
    // Any beginning of a header, and lengths that no header has.
    for length in 0..128.min(bytes.len()) {
        let error = open(bytes[..length].to_vec(), folder.path()).unwrap_err();
        assert!(matches!(error, Error::Format { .. }), "{error}");
    }
    for version in [1, 2, 3, 4] {
        let mut bytes = bytes.clone();
        bytes[6] = version;
        bytes[8..12].fill(0xff);
        assert!(open(bytes, folder.path()).is_err());
    }
    // Endless input that is no array is not read on and on.
    let endless = std::io::repeat(b'x');
    assert!(piped(endless, folder.path()).is_err());
    let endless = Cursor::new(b"\x93NUMPY\x02\x00\xff\xff\xff\xff".to_vec()).chain(std::io::repeat(b' '));
    assert!(piped(endless, folder.path()).is_err());
}
