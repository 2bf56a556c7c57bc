//! `eigentile scene` on tiny materials: what it makes can be used, and what is there is used again.

mod program;

use std::fs;

use program::{fail, run, succeed, succeed_json};

const TINY: [&str; 8] = [
    "--quick",
    "--material-size",
    "16",
    "--components",
    "8",
    "--json",
    "-o",
    "scenes",
];

#[test]
fn a_scene_is_made_once_and_again_only_where_parameters_change() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let arguments = [&["scene", "figure"][..], &TINY].concat();
    let first = succeed_json(at, &arguments);
    let material = &first[0]["materials"][0];
    assert!(material["seconds"].as_f64().unwrap() > 0.0 && first[0]["triangles"] == 50_000);
    assert!(at.join("scenes/figure/scene.bin").exists() && !at.join("scenes/work").exists());
    let scene = scenes::gltf::load(&at.join("scenes/figure/scene.gltf")).unwrap();
    let archive = at
        .join("scenes/tiles")
        .join(format!("{}.bsvtf", scene.archives()[0]));
    let inspected = succeed(at, &["inspect", archive.to_str().unwrap()]);
    assert!(inspected.contains("16"), "{inspected}");
    scenes::CameraPath::load(&at.join("scenes/figure/camera.json")).unwrap();

    let before = fs::read(&archive).unwrap();
    let second = succeed_json(at, &arguments);
    assert_eq!(second[0]["materials"][0]["seconds"], 0.0, "it is there");
    // A damaged archive, and other parameters, are made again.
    fs::write(&archive, &before[..before.len() / 2]).unwrap();
    let third = succeed_json(at, &arguments);
    assert!(third[0]["materials"][0]["seconds"].as_f64().unwrap() > 0.0);
    assert_eq!(fs::read(&archive).unwrap(), before, "the same bytes");
    // Noted with other parameters, it is made again.
    let note = archive.with_extension("recipe.json");
    let noted = fs::read_to_string(&note).unwrap();
    fs::write(&note, noted.replace("\"seed\":93", "\"seed\":1")).unwrap();
    let fourth = succeed_json(at, &arguments);
    assert!(fourth[0]["materials"][0]["seconds"].as_f64().unwrap() > 0.0);
    assert_eq!(fs::read_to_string(&note).unwrap(), noted);
}

#[test]
fn other_sizes_and_settings_stand_beside_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let made = |size: &str, components: &str| {
        let arguments = [&["scene", "figure", "--triangles", "0.01"][..], &TINY].concat();
        let arguments: Vec<&str> = arguments
            .into_iter()
            .map(|argument| match argument {
                "16" => size,
                "8" => components,
                other => other,
            })
            .collect();
        let report = succeed_json(at, &arguments);
        let scene = scenes::gltf::load(&at.join("scenes/figure/scene.gltf")).unwrap();
        let name = scene.archives()[0].to_owned();
        assert_eq!(report[0]["materials"][0]["archive"], name.as_str());
        let archive = fs::read(at.join("scenes/tiles").join(format!("{name}.bsvtf"))).unwrap();
        (name, archive, report[0]["materials"][0]["seconds"] != 0.0)
    };
    let first = made("16", "8");
    let others = [made("8", "8"), made("16", "7")];
    assert!(others.iter().all(|other| other.2 && other.0 != first.0));
    assert!(others[0].0 != others[1].0);
    let again = made("16", "8");
    assert!(
        (&again.0, &again.1) == (&first.0, &first.1) && !again.2,
        "it is still there"
    );
}

#[test]
fn small_materials_are_traced_whole_and_scenes_share_archives() {
    let folder = tempfile::tempdir().unwrap();
    let made = succeed_json(folder.path(), &[&["scene", "cylinders"][..], &TINY].concat());
    assert_eq!(made[0]["materials"].as_array().unwrap().len(), 5);
    assert_eq!(
        fs::read_dir(folder.path().join("scenes/tiles")).unwrap().count(),
        10,
        "archives and notes"
    );
}

#[test]
fn scenes_are_listed_and_nonsense_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let list = succeed(at, &["scene"]);
    for scene in scenes::paper::PaperScene::ALL {
        assert!(
            list.contains(scene.name()) && list.contains(scene.description()),
            "{list}"
        );
    }
    assert!(fail(at, &["scene", "teapot"]).contains("tori, objects"));
    assert!(fail(at, &["scene", "tori", "--triangles", "2"]).contains("0.001 to 1"));
    assert!(fail(at, &["scene", "tori", "--triangles", "nan"]).contains("0.001 to 1"));
    assert!(fail(at, &["scene", "tori", "--material-size", "3"]).contains("4 to 512"));
    assert!(fail(at, &["scene", "tori", "--components", "0"]).contains("--components is 0"));
    let output = run(
        at,
        &[
            "scene",
            "dense",
            "--no-materials",
            "--triangles",
            "0.01",
            "-o",
            "s",
        ],
    );
    assert!(output.status.success() && !at.join("s/tiles").exists());
}
