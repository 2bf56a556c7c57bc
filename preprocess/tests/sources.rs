//! Sets of images as BTFs: what is read equals what was written.

#[path = "sources/fixtures.rs"]
mod fixtures;

use std::path::Path;
use std::process::Command;

use fixtures::{LIGHTS, VIEWS, encode, exr, float_picture, grey, picture, png, utia, write_files, zip};
use image::ImageFormat;
use preprocess::npy::{Dtype, NpyBtf};
use preprocess::source::{Color, Conversion, Overrides, convert, inspect};
use preprocess::{Btf, npy};

/// All samples of one image.
fn samples(btf: &Btf, image: usize) -> Vec<f32> {
    let mut buffer = Vec::new();
    let samples = btf.samples(image..image + 1, &mut buffer).unwrap();
    let mut out = vec![0.0; samples.len()];
    samples.to_f32(&mut out);
    out
}

fn linear(srgb: u8) -> f32 {
    let value = f64::from(srgb) / 255.0;
    (if value <= 0.04045 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }) as f32
}

fn degrees(directions: &[tileset::Direction]) -> Vec<[u32; 2]> {
    let whole = |angle: f64| angle.to_degrees().round() as u32;
    directions
        .iter()
        .map(|direction| [whole(direction.theta), whole(direction.phi)])
        .collect()
}

/// Samples of a `.npy` that Python wrote, without its header.
fn read_npy(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[header..]
        .chunks_exact(4)
        .map(|sample| f32::from_le_bytes(sample.try_into().unwrap()))
        .collect()
}

#[test]
fn a_folder_and_a_zip_hold_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let files = utia();
    write_files(&folder.path().join("set"), &files);
    write_files(
        &folder.path().join("set"),
        &[("readme.txt".into(), b"no image".to_vec())],
    );
    std::fs::write(folder.path().join("set.zip"), zip(&files)).unwrap();
    for name in ["set", "set.zip"] {
        let btf = Btf::open(&folder.path().join(name)).unwrap();
        assert_eq!((btf.name(), btf.width(), btf.height()), ("set", 5, 3));
        assert_eq!(
            (degrees(btf.views()), degrees(btf.lights())),
            (VIEWS.to_vec(), LIGHTS.to_vec())
        );
        assert!(
            !btf.wrap() && btf.cosine() && btf.format().contains("UTIA"),
            "{}",
            btf.format()
        );
        // An encoded image, and twice 5 × 3 texels of 3 bytes.
        assert!(btf.decoding_bytes() > 2 * 5 * 3 * 3);
        assert!(btf.stored_bytes() > 0 && btf.place(5).ends_with("tl045_pl000_tv030_pv000.png"));
        for (view, light) in (0..3).flat_map(|view| (0..4).map(move |light| (view, light))) {
            let samples = samples(&btf, view * 4 + light);
            for (texel, (y, x)) in (0..3u8).flat_map(|y| (0..5u8).map(move |x| (y, x))).enumerate() {
                let expected = [grey(view, light), 10 * x, 10 * y].map(linear);
                let found = [0, 1, 2].map(|rgb| samples[rgb * 15 + texel]);
                assert_eq!(found, expected, "{name} view {view} light {light} texel {texel}");
            }
        }
        // Blocks of images, from many threads at once, with a buffer that grows and shrinks.
        let single: Vec<f32> = (0..12).flat_map(|image| samples(&btf, image)).collect();
        std::thread::scope(|scope| {
            for first in 0..8 {
                let (btf, single) = (&btf, &single);
                scope.spawn(move || {
                    let mut buffer = Vec::new();
                    for count in [4, 1, 3] {
                        let found = btf.samples(first..first + count, &mut buffer).unwrap();
                        assert_eq!(
                            found,
                            npy::Samples::F32(&single[first * 45..(first + count) * 45])
                        );
                    }
                });
            }
        });
    }
}

#[test]
fn float_images_are_linear_and_override_is_obeyed() {
    let folder = tempfile::tempdir().unwrap();
    for (format, extension) in [(ImageFormat::Hdr, "hdr"), (ImageFormat::OpenExr, "exr")] {
        let set = folder.path().join(extension);
        let names = [("tv10.5_pv350_tl20_pl0", 0), ("tv10.5_pv350_tl20.25_pl0", 1)];
        let files: Vec<_> = names
            .iter()
            .map(|&(name, light)| {
                (
                    format!("{name}.{extension}"),
                    encode(&float_picture(1, light, 4, 3), format),
                )
            })
            .collect();
        write_files(&set, &files);
        let btf = Btf::open(&set).unwrap();
        assert_eq!(
            (btf.views().len(), btf.lights().len(), btf.cosine()),
            (1, 2, false)
        );
        assert!((btf.lights()[1].theta.to_degrees() - 20.25).abs() < 1e-9);
        let found = samples(&btf, 1);
        for texel in 0..12 {
            let expected = [1.25, 0.5 * (texel % 4) as f32, 8.0 * (texel / 4) as f32 + 0.5];
            for (rgb, expected) in expected.into_iter().enumerate() {
                let found = found[rgb * 12 + texel];
                // RGBE has eight bits for the largest of the three.
                assert!(
                    (found - expected).abs() <= 17.0 / 128.0,
                    "{extension} {rgb} {texel}: {found} {expected}"
                );
                assert!(format == ImageFormat::Hdr || found == expected);
            }
        }
        let overrides = Overrides {
            wrap: Some(true),
            cosine: Some(true),
            color: Some(Color::Xyz),
        };
        let btf = Btf::open_with(&set, &overrides).unwrap();
        assert!(btf.wrap() && btf.cosine());
        assert_ne!(samples(&btf, 1), found, "XYZ is converted");
    }
    let set = folder.path().join("png");
    write_files(&set, &[("tl0_pl0.png".into(), png(0, 0))]);
    let color = Some(Color::Linear);
    let btf = Btf::open_with(
        &set,
        &Overrides {
            color,
            ..Overrides::default()
        },
    )
    .unwrap();
    assert_eq!(samples(&btf, 0)[0], f32::from(grey(0, 0)) / 255.0);
    assert!(
        btf.notes().iter().any(|note| note.contains("view")),
        "{:?}",
        btf.notes()
    );
}

#[test]
fn exr_channels_are_taken_by_name_and_those_of_utia_as_xyz() {
    let folder = tempfile::tempdir().unwrap();
    let white = [0.9505, 1.0, 1.089];
    let [x, y, z] = white.map(|value| [value; 4]);
    let ramp = [0.0, 1.0, 2.0, -0.5];
    let cases: [(&str, Vec<u8>, [f32; 3]); 7] = [
        (
            "tv0_pv0_tl0_pl0.exr",
            exr(&[("X", x), ("Y", y), ("Z", z)], 2, 2),
            [1.0; 3],
        ),
        (
            "tl000_pl000_tv000_pv000.exr",
            exr(&[("B", z), ("G", y), ("R", x)], 2, 2),
            [1.0; 3],
        ),
        (
            "tv0_pv0_tl0_pl0.exr",
            exr(&[("B", z), ("G", y), ("R", x)], 2, 2),
            white,
        ),
        (
            "tl000_pl000_tv000_pv000.exr",
            exr(&[("A", x), ("Y", y)], 2, 2),
            [1.0; 3],
        ),
        (
            "tl0_pl0_tv0_pv0.exr",
            exr(&[("A", x), ("v.B", ramp), ("v.G", y), ("v.R", x)], 2, 2),
            [0.9505, 1.0, 0.0],
        ),
        (
            "tl0_pl0_tv0_pv0.exr",
            exr(
                &[
                    ("B", ramp),
                    ("G", ramp),
                    ("R", ramp),
                    ("T.400,0nm", y),
                    ("T.550,0nm", y),
                    ("T.700,0nm", y),
                ],
                2,
                2,
            ),
            [1.0; 3],
        ),
        (
            "tl0_pl0_tv0_pv0.exr",
            exr(
                &[("400nm", z), ("500nm", x), ("600nm", y), ("700nm", [0.0; 4])],
                2,
                2,
            ),
            [0.80386, 0.98140, 1.02132],
        ),
    ];
    for (index, (name, bytes, expected)) in cases.into_iter().enumerate() {
        let set = folder.path().join(index.to_string());
        write_files(&set, &[(name.to_owned(), bytes)]);
        let found = samples(&Btf::open(&set).unwrap(), 0);
        for (rgb, expected) in expected.into_iter().enumerate() {
            assert!((found[4 * rgb] - expected).abs() < 2e-3, "{index}: {found:?}");
        }
        assert!(index != 4 || found[8..] == ramp, "rows from the top: {found:?}");
    }
}

#[test]
fn what_python_writes_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/sources/make.py");
    // The first on the path, or else that of the system.
    let mut failures = Vec::new();
    let written = ["python3", "/usr/bin/python3"].into_iter().any(|python| {
        let output = Command::new(python).arg(script).arg(folder.path()).output();
        let success = output.as_ref().is_ok_and(|output| output.status.success());
        failures.push(output.map(|output| String::from_utf8_lossy(&output.stderr).into_owned()));
        success
    });
    assert!(
        written,
        "needs Python with numpy and Pillow, see `cargo xtask setup`: {failures:?}"
    );

    let wool = Btf::open(&folder.path().join("wool.zip")).unwrap();
    assert_eq!((wool.views(), wool.views().len()), (wool.lights(), 9));
    assert!(
        wool.format().contains("UBO2003") && wool.cosine() && !wool.wrap(),
        "{}",
        wool.format()
    );
    let expected = read_npy(&folder.path().join("wool.npy"));
    let found: Vec<f32> = (0..81).flat_map(|image| samples(&wool, image)).collect();
    assert_eq!(found.len(), expected.len());
    // Two decoders of JPEG may differ by a step of the 8 bits: at most 2.3 / 255 in linear light.
    let worst = found
        .iter()
        .zip(&expected)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max);
    assert!(worst < 2.0 * 2.3 / 255.0, "{worst}");
    let mean = found
        .iter()
        .zip(&expected)
        .map(|(a, b)| f64::from((a - b).abs()))
        .sum::<f64>()
        / found.len() as f64;
    assert!(mean < 0.5 / 255.0, "{mean}");
    assert!(
        wool.image_count() == 81 && found[..96] != found[96 * 4..96 * 5],
        "images differ"
    );

    let capture = Btf::open(&folder.path().join("capture")).unwrap();
    let by_table = Btf::open(&folder.path().join("capture/lights.csv")).unwrap();
    assert_eq!(capture.sampling(), by_table.sampling());
    assert_eq!((capture.views().len(), capture.lights().len()), (1, 5));
    for (index, light) in capture.lights().iter().enumerate() {
        assert!((light.theta - 0.2 * index as f64).abs() < 1e-9);
    }
    let expected = read_npy(&folder.path().join("capture.npy"));
    let found: Vec<f32> = (0..5).flat_map(|image| samples(&capture, image)).collect();
    assert_eq!(found.len(), expected.len());
    for (index, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert!(
            (found - expected).abs() < 1e-6,
            "sample {index}: {found} {expected}"
        );
    }
}

#[test]
fn conversion_writes_what_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_files(&at("set"), &utia());
    let btf = Btf::open(&at("set")).unwrap();
    let conversion = |dtype, view, light| Conversion { dtype, view, light };
    let told = std::cell::Cell::new((0, 0));
    let progress = |done, total| told.set((done, total));
    convert(
        &btf,
        &at("all.npy"),
        conversion(Dtype::F32, None, None),
        &progress,
    )
    .unwrap();
    assert_eq!(told.get(), (12, 12));
    let all = Btf::open(&at("all.npy")).unwrap();
    assert_eq!(all.sampling(), btf.sampling());
    for image in 0..12 {
        assert_eq!(samples(&all, image), samples(&btf, image));
    }
    convert(
        &btf,
        &at("one.npy"),
        conversion(Dtype::F16, None, Some(2)),
        &progress,
    )
    .unwrap();
    assert_eq!(told.get(), (3, 3));
    let one = NpyBtf::open(&at("one.npy")).unwrap();
    assert_eq!(
        (one.lights(), one.views(), one.dtype()),
        (&btf.lights()[2..3], btf.views(), Dtype::F16)
    );
    assert!((one.texel(1, 0, 0, 0)[0] - f64::from(linear(grey(1, 2)))).abs() < 1e-3);
    convert(
        &btf,
        &at("one.npy"),
        conversion(Dtype::F16, Some(1), None),
        &progress,
    )
    .unwrap();
    assert_eq!(NpyBtf::open(&at("one.npy")).unwrap().rows(), 12);

    let fails = |btf: &Btf, to: &str, conversion| {
        let error = convert(btf, &at(to), conversion, &progress).unwrap_err();
        assert!(to != "new.npy" || !at(to).exists());
        error.to_string()
    };
    assert!(fails(&btf, "new.npy", conversion(Dtype::F16, Some(3), None)).contains('3'));
    assert!(fails(&all, "all.npy", conversion(Dtype::F16, None, None)).contains("input itself"));
    let bright = exr(&[("Y", [65536.0f32.min(60000.0), 1.0, 1.0, 1.0])], 2, 2);
    write_files(&at("bright"), &[("tl0_pl0.exr".into(), bright)]);
    convert(
        &Btf::open(&at("bright")).unwrap(),
        &at("b.npy"),
        conversion(Dtype::F16, None, None),
        &progress,
    )
    .unwrap();
    let huge = encode(&float_picture(70000, 0, 2, 2), ImageFormat::OpenExr);
    write_files(&at("huge"), &[("tl0_pl0.exr".into(), huge)]);
    let huge = Btf::open(&at("huge")).unwrap();
    let error = fails(&huge, "new.npy", conversion(Dtype::F16, None, None));
    assert!(
        error.contains("tl0_pl0.exr") && error.contains("70000"),
        "{error}"
    );
    convert(
        &huge,
        &at("huge.npy"),
        conversion(Dtype::F32, None, None),
        &progress,
    )
    .unwrap();
}

#[test]
fn inspection_tells_sizes_directions_and_range() {
    let folder = tempfile::tempdir().unwrap();
    let set = folder.path().join("set");
    write_files(&set, &utia());
    write_files(
        &set,
        &[(
            "preview.jpg".into(),
            encode(&picture(0, 0, 9, 9), ImageFormat::Jpeg),
        )],
    );
    let found = inspect(&set, &Overrides::default());
    assert!(found.usable && found.problems.is_empty(), "{:?}", found.problems);
    assert_eq!((found.width, found.height, found.images), (Some(5), Some(3), 12));
    assert_eq!((found.missing_images, found.matrix), (0, Some([36, 15])));
    assert_eq!(found.views_equal_lights, Some(false));
    let rings: Vec<_> = found
        .lights
        .unwrap()
        .rings
        .iter()
        .map(|ring| (ring.theta, ring.count))
        .collect();
    assert_eq!(rings, [(0.0, 1), (45.0, 3)]);
    let sample = found.sample.unwrap();
    assert_eq!(
        (sample.images, sample.min, sample.max),
        (12, 0.0, linear(grey(2, 3)))
    );
    assert!(
        found.notes.iter().any(|note| note.contains("preview.jpg")),
        "{:?}",
        found.notes
    );
    assert!(found.estimate.unwrap().pass_seconds > 0.0);
    serde_json::to_string(&found.notes).unwrap();

    // The exchange format, with a NaN in it.
    let path = folder.path().join("nan.npy");
    let direction = tileset::Direction { theta: 0.5, phi: 0.0 };
    let sampling = npy::Sampling {
        views: vec![direction],
        lights: vec![direction],
        wrap: true,
        cosine: true,
    };
    let mut writer = npy::BtfWriter::create(&path, sampling, 2, 1, Dtype::F32).unwrap();
    writer
        .write_f32(&[1.0, -2.0, f32::NAN, 70000.0, 5.0, f32::INFINITY])
        .unwrap();
    writer.finish().unwrap();
    let found = inspect(&path, &Overrides::default());
    let sample = found.sample.unwrap();
    assert_eq!((sample.min, sample.max), (-2.0, 70000.0));
    assert_eq!(
        (sample.nan, sample.infinite, sample.negative, sample.beyond_half),
        (1, 1, 1, 1)
    );
    assert!(
        !found.usable && found.problems[0].contains("channel g"),
        "{:?}",
        found.problems
    );
}
