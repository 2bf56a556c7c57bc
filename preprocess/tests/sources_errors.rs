//! What is wrong with a set of images is named: which file, what was found, what was expected.

#[path = "sources/fixtures.rs"]
mod fixtures;

use std::path::Path;

use fixtures::{encode, exr, float_picture, picture, png, utia, write_files, zip};
use image::ImageFormat;
use preprocess::Btf;
use preprocess::source::{Color, Overrides, inspect};
use proptest::prelude::*;

type Files = Vec<(String, Vec<u8>)>;

/// The error of opening or of reading all images.
fn error(path: &Path) -> String {
    let read = || -> preprocess::Result<()> {
        let btf = Btf::open(path)?;
        btf.samples(0..btf.image_count(), &mut Vec::new())?;
        Ok(())
    };
    let error = read().expect_err("must not be read").to_string();
    let found = inspect(path, &Overrides::default());
    assert!(
        !found.usable && !found.problems.is_empty(),
        "inspection finds it: {error}"
    );
    error
}

#[track_caller]
fn expect(error: &str, parts: &[&str]) {
    for part in parts {
        assert!(error.contains(part), "{part:?} is not in: {error}");
    }
}

/// Errors of a folder with these files.
fn of_folder(files: &Files) -> String {
    let folder = tempfile::tempdir().unwrap();
    let set = folder.path().join("wool");
    write_files(&set, files);
    let error = error(&set);
    expect(&error, &["wool"]);
    error
}

/// Errors of a zip of these bytes.
fn of_zip(bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wool.zip");
    std::fs::write(&path, bytes).unwrap();
    let error = error(&path);
    expect(&error, &["wool.zip"]);
    error
}

#[test]
fn missing_images_are_named() {
    let mut files = utia();
    files.remove(6); // view 1, light 2
    expect(
        &of_folder(&files),
        &[
            "1 of the 12 images of 3 views x 4 lights missing",
            "tv30 pv0 tl45 pl120",
        ],
    );
    expect(
        &of_zip(&zip(&files)),
        &["tv30 pv0 tl45 pl120", "1 of the views incomplete"],
    );
    files.truncate(5);
    expect(&of_folder(&files), &["3 of the 8", "tv30 pv0 tl45 pl0"]);

    let folder = tempfile::tempdir().unwrap();
    write_files(folder.path(), &files);
    let found = inspect(folder.path(), &Overrides::default());
    assert_eq!(
        (found.images, found.missing_images, found.missing.len()),
        (5, 3, 3)
    );
    assert_eq!((found.views.unwrap().count, found.lights.unwrap().count), (2, 4));
}

#[test]
fn lights_that_differ_between_views_are_told() {
    let files: Files = [(0, 0), (0, 20), (30, 40), (30, 60)]
        .map(|(tv, tl)| (format!("tv{tv}_pv0_tl{tl}_pl0.png"), png(0, 0)))
        .into();
    expect(
        &of_folder(&files),
        &[
            "lights differ between views",
            "4 of the 8",
            "each view has 2 to 2",
        ],
    );
}

#[test]
fn two_images_of_the_same_directions_are_both_named() {
    let twice = |name: &str| {
        let mut files = utia();
        files.push((name.into(), png(0, 0)));
        of_folder(&files)
    };
    expect(
        &twice("copy/tl045_pl360_tv000_pv000.png"),
        &[
            "same view and light",
            "copy/tl045_pl360",
            "tv000_pv000/tl045_pl000",
        ],
    );
    expect(
        &twice("tl000_pl090_tv000_pv045.png"),
        &["tl000_pl090_tv000_pv045.png", "tl000_pl000_tv000_pv000.png"],
    );
    expect(
        &twice("tl000_pl000_tv000.png"),
        &["tl000_pl000_tv000.png", "only one of the two angles of the view"],
    );
    expect(&twice("tl000_pl000.png"), &["tl000_pl000.png", "lacks the view"]);
    expect(&twice("tl095_pl000_tv000_pv000.png"), &["theta 95"]);
}

#[test]
fn wrong_sizes_are_named_with_their_image() {
    for (format, extension) in [
        (ImageFormat::Png, "png"),
        (ImageFormat::OpenExr, "exr"),
        (ImageFormat::Hdr, "hdr"),
    ] {
        let image = |width| match format {
            ImageFormat::Png => encode(&picture(0, 0, width, 3), format),
            _ => encode(&float_picture(0, 0, width, 3), format),
        };
        let files: Files = vec![
            (format!("tl0_pl0.{extension}"), image(5)),
            (format!("tl10_pl0.{extension}"), image(5)),
            (format!("tl20_pl0.{extension}"), image(6)),
        ];
        expect(
            &of_folder(&files),
            &[&format!("tl20_pl0.{extension}"), "6x3", "expected 5x3"],
        );
    }
}

#[test]
fn damaged_images_are_named() {
    let jpeg = encode(&picture(1, 1, 64, 64), ImageFormat::Jpeg);
    let exr = encode(&float_picture(0, 0, 5, 3), ImageFormat::OpenExr);
    let hdr = encode(&float_picture(0, 0, 5, 3), ImageFormat::Hdr);
    for (extension, bytes, cut) in [
        ("jpg", &jpeg, jpeg.len() - 20),
        ("png", &png(0, 0), 60),
        ("exr", &exr, exr.len() - 7),
        ("hdr", &hdr, hdr.len() - 7),
    ] {
        let good = (format!("tl0_pl0.{extension}"), bytes.clone());
        let cut = (format!("tl10_pl0.{extension}"), bytes[..cut].to_vec());
        expect(
            &of_folder(&vec![good, cut]),
            &[&format!("tl10_pl0.{extension}: ")],
        );
    }
    expect(
        &of_folder(&vec![("tl0_pl0.png".into(), b"GIF89a".to_vec())]),
        &["tl0_pl0.png", "expected a JPEG, PNG"],
    );
    expect(
        &of_folder(&vec![("tl0_pl0.png".into(), Vec::new())]),
        &["tl0_pl0.png", "begins with bytes []"],
    );
    let spectral = fixtures::exr(&[("400nm", [0.0; 4]), ("500nm", [0.0; 4])], 2, 2);
    expect(
        &of_folder(&vec![("tl0_pl0.exr".into(), spectral)]),
        &["400nm, 500nm", "expected R, G, B"],
    );
}

#[test]
fn lying_headers_do_not_allocate() {
    // PNG: width and height after the signature and the chunk's length and name, then a checksum.
    let mut png = png(0, 0);
    png[16..24].copy_from_slice(&[0, 0, 0xff, 0xff, 0, 0, 0xff, 0xff]);
    let mut crc = flate2::Crc::new();
    crc.update(&png[12..29]);
    png[29..33].copy_from_slice(&crc.sum().to_be_bytes());
    // HDR: a line of text.
    let hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\n\x02\x02\xea\x60".to_vec();
    // JPEG: in the frame header, after its length and precision.
    let mut jpeg = encode(&picture(0, 0, 8, 8), ImageFormat::Jpeg);
    let frame = jpeg.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0xff, 0xfe, 0xff, 0xfe]);
    let exr = exr(&[("Y", [1.0; 4])], 60_000, 60_000);
    for (extension, bytes) in [("png", png), ("hdr", hdr), ("jpg", jpeg), ("exr", exr)] {
        let name = format!("tl0_pl0.{extension}");
        expect(
            &of_folder(&vec![(name.clone(), bytes)]),
            &[&name, "its header promises", "cannot hold"],
        );
    }
}

#[test]
fn damaged_zips_are_told() {
    let whole = zip(&utia());
    expect(
        &of_zip(&whole[..whole.len() / 2]),
        &["cut short", &(whole.len() / 2).to_string()],
    );
    expect(&of_zip(b"PK\x03\x04"), &["cut short", "4 bytes"]);
    expect(&of_zip(&zip(&Vec::new())), &["holds 0 files"]);
    // A flipped bit in the samples of the first entry, which is stored: the checksum finds it.
    let mut flipped = whole.clone();
    flipped[120] ^= 1;
    expect(
        &of_zip(&flipped),
        &["tl000_pl000_tv000_pv000.png", "byte 0 of the zip"],
    );
    // A size in the directory that is not what comes out. The directory begins at the last signature of the kind.
    let first = whole.windows(4).position(|bytes| bytes == b"PK\x01\x02").unwrap();
    let mut lying = whole.clone();
    lying[first + 24..first + 28].copy_from_slice(&0xfff0_0000u32.to_le_bytes());
    expect(&of_zip(&lying), &["tl000_pl000_tv000_pv000.png"]);
    let mut lying = whole.clone();
    lying[first + 20..first + 24].copy_from_slice(&0xfff0_0000u32.to_le_bytes());
    expect(&of_zip(&lying), &["tl000_pl000_tv000_pv000.png", "ends beyond"]);
    let mut method = whole;
    method[first + 10] = 12;
    expect(
        &of_zip(&method),
        &["tl000_pl000_tv000_pv000.png", "expected stored or deflated"],
    );
}

#[test]
fn tables_that_do_not_fit_are_told() {
    let table = |text: &str| {
        of_folder(&vec![
            ("a.png".into(), png(0, 0)),
            ("list.csv".into(), text.as_bytes().to_vec()),
        ])
    };
    expect(
        &table("file,theta_light,phi_light\na.png,0,0\nb.png,1,0"),
        &["list.csv", "b.png (line 3)"],
    );
    expect(
        &table("file,theta_light,phi_light\na.png,0,0\na.png,0,9"),
        &["a.png and a.png"],
    );
    expect(
        &table("file,theta_light,phi_light\na.png,0"),
        &["list.csv", "line 2"],
    );
    expect(
        &table("file,theta_light,phi_light\na.png,0,nan"),
        &["list.csv", "line 2", "phi NaN"],
    );
    expect(
        &table("name\na.png"),
        &["none with directions", "tv30_pv60_tl15_pl0.png", "directions.csv"],
    );
    let mut two = vec![("a.png".to_owned(), png(0, 0))];
    for name in ["one.csv", "two.csv"] {
        two.push((name.into(), b"file,theta_light,phi_light\na.png,0,0".to_vec()));
    }
    expect(&of_folder(&two), &["one.csv", "two.csv", "second table"]);
}

#[test]
fn what_is_no_btf_is_told() {
    expect(
        &of_folder(&vec![("tl0_pl0.tif".into(), vec![1])]),
        &["1 that are not", "convert them to PNG"],
    );
    expect(
        &of_folder(&vec![("notes.txt".into(), vec![1])]),
        &["expected JPEG"],
    );
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        error(&path)
    };
    expect(&at("one.png", &png(0, 0)), &["one.png", "single image", "folder"]);
    expect(&at("text.txt", b"hello"), &["text.txt", "expected a .npy file"]);
    expect(&at("dirs.csv", b"a,b\n1,2"), &["dirs.csv", "no column file"]);
    expect(&error(&folder.path().join("absent")), &["absent"]);
    let overrides = Overrides {
        color: Some(Color::Srgb),
        ..Overrides::default()
    };
    let error = Btf::open_with(&folder.path().join("one.npy"), &overrides).unwrap_err();
    expect(&error.to_string(), &["one.npy"]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any damage to a zip or to an image in it is an error or other samples: no panic, no endless work.
    #[test]
    fn damage_never_panics(at in 0usize..10_000, value in any::<u8>(), cut in any::<bool>(), kind in 0usize..3) {
        let picture = float_picture(1, 1, 5, 3);
        let (name, image) = match kind {
            0 => ("tl0_pl0.exr", encode(&picture, ImageFormat::OpenExr)),
            1 => ("tl0_pl0.hdr", encode(&picture, ImageFormat::Hdr)),
            _ => ("tl0_pl0.jpg", encode(&fixtures::picture(1, 1, 5, 3), ImageFormat::Jpeg)),
        };
        let damage = |mut bytes: Vec<u8>| {
            let at = at % bytes.len();
            if cut { bytes.truncate(at) } else { bytes[at] = value }
            bytes
        };
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("image.zip"), zip(&[(name.to_owned(), damage(image.clone()))])).unwrap();
        std::fs::write(folder.path().join("zip.zip"), damage(zip(&[(name.to_owned(), image)]))).unwrap();
        for set in ["image.zip", "zip.zip"] {
            if let Ok(btf) = Btf::open(&folder.path().join(set)) {
                let _ = btf.samples(0..btf.image_count(), &mut Vec::new());
            }
        }
    }
}
