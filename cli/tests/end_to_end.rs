//! From nothing to a picture with the real program: synthesize, factorize, inspect, export, serve, render.

mod program;

use std::fs;
use std::path::Path;

use preprocess::npy::NpyBtf;
use program::{Server, succeed_json};
use serde_json::Value;

/// Texels along a side, and rank: small, but with two tiles along a side and mips.
const SIZE: u32 = 80;
const RANK: usize = 24;

fn number(value: &Value, pointer: &str) -> f64 {
    value
        .pointer(pointer)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("{pointer} in {value}"))
}

/// Shape and numbers of a `.npy` file of f32 in C order.
fn read_npy(path: &Path) -> (Vec<usize>, Vec<f32>) {
    let bytes = fs::read(path).unwrap();
    assert_eq!(&bytes[..7], b"\x93NUMPY\x01");
    let header_bytes = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = std::str::from_utf8(&bytes[10..10 + header_bytes]).unwrap();
    assert!(
        header.contains("'<f4'") && header.contains("'fortran_order': False"),
        "{header}"
    );
    let shape = header.split_once('(').unwrap().1.split_once(')').unwrap().0;
    let shape: Vec<usize> = shape
        .split(',')
        .filter_map(|side| side.trim().parse().ok())
        .collect();
    let values = bytes[10 + header_bytes..].chunks_exact(4);
    let values: Vec<f32> = values
        .map(|value| f32::from_le_bytes(value.try_into().unwrap()))
        .collect();
    assert_eq!(values.len(), shape.iter().product::<usize>());
    (shape, values)
}

/// ‖B − u·v‖ / ‖B‖ over every `step`-th row of the matrix.
fn relative_error(folder: &Path, btf: &NpyBtf, step: usize) -> f64 {
    let (u_shape, u) = read_npy(&folder.join("u.npy"));
    let (v_shape, v) = read_npy(&folder.join("v.npy"));
    let (rows, columns) = (btf.rows(), btf.columns());
    assert_eq!(u_shape, [RANK, btf.views().len(), btf.lights().len(), 3]);
    assert_eq!(v_shape, [RANK, SIZE as usize, SIZE as usize]);
    let (mut error, mut norm) = (0.0, 0.0);
    let mut row = vec![0.0f32; columns];
    for at in (0..rows).step_by(step) {
        btf.row_block(at..at + 1).to_f32(&mut row);
        norm += row.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>();
        for component in 0..RANK {
            let weight = u[component * rows + at];
            let texture = &v[component * columns..][..columns];
            row.iter_mut()
                .zip(texture)
                .for_each(|(value, texture)| *value -= weight * texture);
        }
        error += row.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>();
    }
    (error / norm).sqrt()
}

#[test]
fn from_nothing_to_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (size, rank) = (SIZE.to_string(), RANK.to_string());

    let synthesis = succeed_json(
        at,
        &[
            "synth",
            "leather",
            "-o",
            "npy/leather.npy",
            "--size",
            &size,
            "--rays",
            "2",
            "--json",
        ],
    );
    assert_eq!(
        (number(&synthesis, "/views"), number(&synthesis, "/width")),
        (81.0, f64::from(SIZE))
    );
    let report = succeed_json(
        at,
        &[
            "preprocess",
            "npy/leather.npy",
            "-o",
            "tiles/leather.bsvtf",
            "--components",
            &rank,
            "--memory",
            "1GiB",
            "--report",
            "r.json",
            "--json",
        ],
    );
    assert_eq!(
        report,
        serde_json::from_slice::<Value>(&fs::read(at.join("r.json")).unwrap()).unwrap()
    );

    // The bytes by kind add up, and the errors are those of the report.
    let contents = succeed_json(at, &["inspect", "tiles/leather.bsvtf", "--json"]);
    let bytes = ["/page_bytes", "/column_bytes", "/manifest_bytes"].map(|kind| number(&contents, kind));
    let file_bytes = fs::metadata(at.join("tiles/leather.bsvtf")).unwrap().len() as f64;
    assert_eq!(
        (bytes.iter().sum::<f64>(), number(&contents, "/file_bytes")),
        (file_bytes, file_bytes)
    );
    assert_eq!(number(&contents, "/components"), RANK as f64);
    let mip_bytes = contents["pages_by_mip"]
        .as_array()
        .unwrap()
        .iter()
        .map(|mip| number(mip, "/bytes"));
    assert_eq!(mip_bytes.sum::<f64>(), bytes[0]);
    let stated = number(&report, "/relative_error");
    assert!((number(&contents, "/errors/total_relative") / stated - 1.0).abs() < 1e-9);
    let text = program::succeed(at, &["inspect", "tiles/leather.bsvtf"]);
    assert!(
        text.contains("leather") && text.contains("24 components"),
        "{text}"
    );

    // The exported factors multiply to the BTF with the stated error.
    succeed_json(at, &["export", "tiles/leather.bsvtf", "-o", "factors", "--json"]);
    let btf = NpyBtf::open(&at.join("npy/leather.npy")).unwrap();
    let measured = relative_error(&at.join("factors"), &btf, 7);
    assert!(
        (measured / stated - 1.0).abs() < 0.05,
        "measured {measured}, stated {stated}"
    );

    // Served and rendered, twice.
    scenes::gltf::save(&scenes::showcase::swatch("leather"), &at.join("swatch.gltf")).unwrap();
    let server = Server::start(&at.join("tiles"));
    let render = |output: &str| {
        let address = server.address.as_str();
        succeed_json(
            at,
            &[
                "render",
                "swatch.gltf",
                "--tiles",
                address,
                "--size",
                "160x120",
                "-o",
                output,
                "--reference",
                "npy",
                "--overlay",
                "mip,skipped",
                "--json",
            ],
        )
    };
    let (first, second) = (render("first"), render("second"));
    // Over HTTP records arrive in any order and lie in other slots of the cache, where filters round otherwise:
    // by less than one step of a PNG.
    let [a, b] =
        ["first", "second"].map(|run| image::open(at.join(run).join("settled.png")).unwrap().to_rgb8());
    let difference = a
        .as_raw()
        .iter()
        .zip(b.as_raw())
        .map(|(a, b)| a.abs_diff(*b))
        .max();
    assert!(difference <= Some(1), "the second run differs by {difference:?}");
    let [a, b] = ["first", "second"].map(|run| image::open(at.join(run).join("reference.exr")).unwrap());
    assert!(a == b, "the reference differs from run to run");
    assert!(at.join("first/frame_0000.png").exists() && at.join("first/error.png").exists());
    let (rmse, predicted) = (
        number(&first, "/quality/rmse"),
        number(&first, "/quality/predicted_rmse"),
    );
    assert!(
        rmse > 0.0 && rmse <= predicted,
        "RMSE {rmse}, predicted {predicted}"
    );
    assert!(number(&first, "/quality/ssim") > 0.8, "{}", first["quality"]);
    let flip = number(&first, "/quality/flip");
    assert!(flip > 0.0 && flip < 0.2, "{}", first["quality"]);
    assert_eq!(first["problems"], serde_json::json!([]));
    let settled = image::open(at.join("first/settled.png")).unwrap();
    // The archive alone, from its file and by its name.
    for (subject, tiles) in [
        ("tiles/leather.bsvtf", None),
        ("leather", Some(server.address.as_str())),
    ] {
        let mut words = vec![
            "render", subject, "--shape", "sphere", "--size", "80x60", "-o", "lone", "--json",
        ];
        words.extend(tiles.into_iter().flat_map(|tiles| ["--tiles", tiles]));
        let lone = succeed_json(at, &words);
        assert_eq!(lone["problems"], serde_json::json!([]));
        let picture = image::open(at.join("lone/settled.png")).unwrap().to_rgb8();
        let colors: std::collections::HashSet<_> = picture.pixels().collect();
        assert!(colors.len() > 100, "{subject}: {} colours", colors.len());
    }
    for (overlay, name) in ["mip", "skipped"].into_iter().enumerate() {
        let overlaid = &first["overlays"][overlay];
        assert_eq!(overlaid["file"], format!("overlay_{name}.png"));
        assert!(
            overlaid["legend"]
                .as_array()
                .is_some_and(|legend| legend.len() >= 4),
            "{overlaid}"
        );
        let picture = image::open(at.join("first").join(format!("overlay_{name}.png"))).unwrap();
        assert!(picture.width() == 160 && picture != settled);
    }
    // The same records end in the caches. Nearly the same bytes come; how many heads of answers and early records are among them
    // depends on what had come when a request left.
    let last = |statistics: &Value| statistics["settling"].as_array().unwrap().last().unwrap().clone();
    let (first, second) = (last(&first), last(&second));
    for resident in ["pages_resident", "columns_resident"] {
        assert_eq!(first[resident], second[resident], "{resident}");
    }
    let bytes = [&first, &second].map(|last| number(last, "/wire_bytes_total"));
    assert!(
        (0.8..1.25).contains(&(bytes[0] / bytes[1])),
        "{bytes:?} bytes over the wire"
    );

    let log = server.stop();
    assert!(
        log.contains("listening") && !log.contains("WARN") && !log.contains("ERROR"),
        "{log}"
    );
}
