//! What a user can bring: `inspect`, `convert` and `preprocess` on every kind of input, and on broken ones.

mod program;

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

use image::{Rgb, RgbImage};
use program::{fail, run, succeed, succeed_json};
use serde_json::Value;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

const VIEWS: [[u32; 2]; 2] = [[0, 0], [40, 90]];
const LIGHTS: [[u32; 2]; 3] = [[0, 0], [30, 0], [30, 180]];

/// Images of 6 x 4 texels below a folder, named as UTIA names them.
fn write_images(folder: &Path) {
    fs::create_dir_all(folder).unwrap();
    for (v, [tv, pv]) in VIEWS.into_iter().enumerate() {
        for (l, [tl, pl]) in LIGHTS.into_iter().enumerate() {
            let picture = RgbImage::from_fn(6, 4, |x, y| {
                Rgb([(60 * v + 40 * l) as u8 + 9, 40 * x as u8, 60 * y as u8])
            });
            let name = format!("tl{tl:03}_pl{pl:03}_tv{tv:03}_pv{pv:03}.png");
            picture.save(folder.join(name)).unwrap();
        }
    }
}

/// The files of a folder as a zip.
fn write_zip(folder: &Path, path: &Path) {
    let mut zip = ZipWriter::new(File::create(path).unwrap());
    for entry in fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let name = format!("wool/{}", entry.file_name().to_str().unwrap());
        zip.start_file(name, SimpleFileOptions::default()).unwrap();
        zip.write_all(&fs::read(entry.path()).unwrap()).unwrap();
    }
    zip.finish().unwrap();
}

/// A factorization of one term, 2 views x 2 lights, 3 x 2 texels, as Bonn's `.btf` files store it.
fn btf_file() -> Vec<u8> {
    let word = |value: u32| value.to_le_bytes();
    let mut header = Vec::from(word(1)); // version
    header.extend([b' '; 240]); // names
    for size in [10f32, 1.0, 1.0, 1.0] {
        header.extend(size.to_le_bytes());
    }
    let mut bytes = Vec::from(*b"!FMF06FC");
    bytes.extend(word(4 + header.len() as u32));
    bytes.extend(header);
    let direction = |bytes: &mut Vec<u8>, theta: f32| {
        bytes.extend(theta.to_le_bytes());
        bytes.extend(0f32.to_le_bytes());
    };
    bytes.extend(word(2));
    for view in [0.0, 0.5] {
        direction(&mut bytes, view);
        bytes.extend(word(2));
        for light in [0.0, 0.7] {
            direction(&mut bytes, light);
        }
    }
    for value in [3, 2, 1] {
        bytes.extend(word(value)); // width, height, terms
    }
    bytes.push(4); // bytes of a scalar
    for value in [1, 12, 6] {
        bytes.extend(word(value)); // terms, rows, texels
    }
    for value in (0..1 + 12 + 6).map(|index| 0.25 + 0.01 * index as f32) {
        bytes.extend(value.to_le_bytes());
    }
    bytes
}

/// All kinds of input that are good.
fn write_inputs(at: &Path) {
    write_images(&at.join("wool"));
    write_zip(&at.join("wool"), &at.join("wool.zip"));
    fs::write(at.join("cloth.btf"), btf_file()).unwrap();
    let mut table = String::from("file,theta_light,phi_light\n");
    for (light, [theta, phi]) in LIGHTS.into_iter().enumerate() {
        table += &format!("wool/tl{theta:03}_pl{phi:03}_tv000_pv000.png,{},0\n", 20 * light);
    }
    fs::write(at.join("lights.csv"), table).unwrap();
}

#[test]
fn every_kind_of_input_is_inspected_and_converted() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_inputs(at);
    for (input, format, [views, lights, width, height], terms) in [
        ("wool", "folder of PNG images", [2, 3, 6, 4], None),
        ("wool.zip", "zip of PNG images", [2, 3, 6, 4], None),
        ("lights.csv", "folder of PNG images", [1, 3, 6, 4], None),
        ("cloth.btf", "full matrix factorization", [2, 2, 3, 2], Some(1)),
    ] {
        let text = succeed(at, &["inspect", input]);
        assert!(
            text.contains(format) && text.contains(&format!("{width} x {height}")),
            "{text}"
        );
        let found = succeed_json(at, &["inspect", input, "--json"]);
        let shape = |found: &Value| {
            ["/views/count", "/lights/count", "/width", "/height"]
                .map(|member| found.pointer(member).cloned())
        };
        assert_eq!(
            shape(&found),
            [views, lights, width, height].map(|size| Some(size.into())),
            "{found}"
        );
        assert_eq!(found["usable"], true, "{found}");
        assert_eq!(
            found["stored_terms"],
            terms.map_or(Value::Null, Value::from),
            "{found}"
        );

        // To numpy, and that once more: the same samples.
        let converted = succeed_json(
            at,
            &[
                "convert",
                input,
                "-o",
                "npy/a.npy",
                "--float",
                "--cosine",
                "--json",
            ],
        );
        assert_eq!(
            (&converted["views"], &converted["lights"], &converted["cosine"]),
            (&views.into(), &lights.into(), &true.into())
        );
        let again = succeed_json(at, &["inspect", "npy/a.npy", "--json"]);
        assert_eq!((shape(&again), &again["cosine"]), (shape(&found), &true.into()));
        for member in ["min", "max", "mean_rgb"] {
            assert_eq!(
                again["sample"][member], found["sample"][member],
                "{input}: {member}"
            );
        }
        succeed_json(at, &["convert", "npy/a.npy", "-o", "b.npy", "--float", "--json"]);
        assert!(fs::read(at.join("npy/a.npy")).unwrap() == fs::read(at.join("b.npy")).unwrap());
    }
    let one = succeed_json(
        at,
        &[
            "convert", "wool.zip", "-o", "one.npy", "--view", "1", "--light", "2", "--json",
        ],
    );
    assert_eq!((&one["views"], &one["lights"]), (&1.into(), &1.into()));
    assert_eq!(one["dtype"], "<f2");
    assert!(fail(at, &["convert", "wool.zip", "-o", "one.npy", "--view", "2"]).contains("view"));
    assert!(fail(at, &["convert", "one.npy", "-o", "one.npy"]).contains("input itself"));
}

#[test]
fn image_sets_become_archives() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_inputs(at);
    let from_zip = succeed_json(at, &["preprocess", "wool.zip", "-o", "zip.bsvtf", "--json"]);
    succeed_json(at, &["convert", "wool", "-o", "wool.npy", "--float", "--json"]);
    let from_npy = succeed_json(at, &["preprocess", "wool.npy", "-o", "npy.bsvtf", "--json"]);
    for member in [
        "views",
        "lights",
        "width",
        "height",
        "components",
        "btf_rms",
        "singular_values",
    ] {
        assert_eq!(from_zip[member], from_npy[member], "{member}");
    }
    let archive = succeed_json(at, &["inspect", "zip.bsvtf", "--json"]);
    assert_eq!(
        (&archive["cosine"], &archive["wrap"]),
        (&true.into(), &false.into())
    );
}

#[test]
fn what_is_broken_is_named_and_the_exit_status_is_1() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_inputs(at);
    let bytes = fs::read(at.join("wool.zip")).unwrap();
    fs::write(at.join("short.zip"), &bytes[..bytes.len() / 2]).unwrap();
    let bytes = btf_file();
    fs::write(at.join("short.btf"), &bytes[..bytes.len() - 1]).unwrap();
    fs::write(at.join("text.txt"), "no BTF").unwrap();
    fs::create_dir(at.join("empty")).unwrap();
    write_images(&at.join("holes"));
    fs::remove_file(at.join("holes/tl030_pl180_tv040_pv090.png")).unwrap();
    write_images(&at.join("damaged"));
    fs::write(at.join("damaged/tl030_pl180_tv040_pv090.png"), "no PNG").unwrap();
    for (input, expected) in [
        ("short.zip", "cut short"),
        ("short.btf", "bytes"),
        ("text.txt", ".btf"),
        ("empty", "0 files"),
        ("absent", "absent"),
        ("holes", "tv40 pv90 tl30 pl180"),
        ("damaged", "tl030_pl180_tv040_pv090.png"),
    ] {
        for arguments in [&["inspect", input][..], &["inspect", input, "--json"]] {
            let output = run(at, arguments);
            let errors = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(1), "{arguments:?}: {errors}");
            assert!(
                errors.starts_with("error: ") && errors.lines().count() == 1,
                "{errors}"
            );
            assert!(
                errors.contains(input) && errors.contains(expected),
                "{arguments:?}: {errors}"
            );
            if arguments.len() > 2 {
                let found: Value = serde_json::from_slice(&output.stdout).unwrap();
                assert_eq!(found["usable"], false);
                assert!(!found["problems"].as_array().unwrap().is_empty(), "{found}");
            }
        }
        assert!(
            fail(at, &["preprocess", input, "-o", "a.bsvtf", "--json"]).contains(expected),
            "{input}"
        );
        assert!(
            fail(at, &["convert", input, "-o", "a.npy", "--json"]).contains(expected),
            "{input}"
        );
        assert!(
            !at.join("a.bsvtf").exists() && !at.join("a.npy").exists(),
            "{input}"
        );
    }
}
