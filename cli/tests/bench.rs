//! `eigentile bench` on tiny inputs: what it prints is complete and adds up.

mod program;

use std::fs;
use std::path::Path;

use preprocess::npy::{BtfWriter, Dtype, Sampling};
use program::{fail, run, succeed, succeed_json};
use serde_json::Value;
use tileset::Direction;

/// A BTF of 3 × 3 directions and 40 × 24 texels that has five terms.
fn write_btf(path: &Path) {
    let directions: Vec<Direction> = (0..3)
        .map(|i| Direction {
            theta: 0.4 * f64::from(i),
            phi: 1.3 * f64::from(i),
        })
        .collect();
    let sampling = Sampling {
        views: directions.clone(),
        lights: directions,
        wrap: true,
        cosine: false,
    };
    let mut writer = BtfWriter::create(path, sampling, 40, 24, Dtype::F32).unwrap();
    for row in 0..27 {
        let sample = |texel: i32| {
            let (x, y) = ((texel % 40) as f32, (texel / 40) as f32);
            let wave = |k: i32| (0.16 * (x * k as f32 + y * (row * k % 5) as f32)).sin() / k as f32;
            0.5 + 0.2 * (1..7).map(wave).sum::<f32>()
        };
        writer
            .write_f32(&(0..960).map(sample).collect::<Vec<f32>>())
            .unwrap();
    }
    writer.finish().unwrap();
}

fn number(value: &Value, at: &str) -> f64 {
    let found = value.pointer(at).and_then(Value::as_f64);
    found.unwrap_or_else(|| panic!("no number at {at} in {value}"))
}

#[test]
fn codec_meets_targets_and_keeps_factors() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_btf(&at.join("waves.npy"));
    let codec = ["bench", "codec", "--keep", "kept", "--runs", "1", "--json"];
    let first = succeed_json(
        at,
        &[
            &codec[..],
            &["waves.npy", "--components", "5", "--targets", "0.1,0.03"],
        ]
        .concat(),
    );
    assert_eq!(number(&first, "/materials/0/components"), 5.0);
    assert!(number(&first, "/materials/0/factorized/seconds") > 0.0);
    for (i, target) in [0.1, 0.03].into_iter().enumerate() {
        let point = &first["materials"][0]["points"][i];
        assert_eq!(number(point, "/target"), target);
        let error = number(point, "/relative_error");
        assert!(error <= target && error > 0.9 * target, "{error} for {target}");
        let kinds = ["/page_bytes", "/column_bytes", "/table_bytes"].map(|kind| number(point, kind));
        let archive = at.join(point["archive"].as_str().unwrap());
        let file = fs::metadata(&archive).unwrap().len() as f64;
        assert_eq!(
            (kinds.iter().sum::<f64>(), number(point, "/archive_bytes")),
            (file, file)
        );
    }

    // From what was kept: the same bytes, without the BTF.
    fs::remove_file(at.join("waves.npy")).unwrap();
    let quality = number(&first, "/materials/0/points/1/quality").to_string();
    let again = succeed_json(at, &[&codec[..], &["kept/waves", "--steps", &quality]].concat());
    for member in ["page_bytes", "column_bytes", "relative_error", "quality", "codec"] {
        assert_eq!(
            again["materials"][0]["points"][0][member], first["materials"][0]["points"][1][member],
            "{member}"
        );
    }

    let decoded = succeed_json(
        at,
        &[
            "bench",
            "decode",
            "kept/waves/target-0.1.bsvtf",
            "--runs",
            "2",
            "--json",
        ],
    );
    assert_eq!(number(&decoded, "/0/decode/runs"), 2.0);
    assert_eq!(number(&decoded, "/0/decode/finest_samples"), 5.0 * 960.0);
    assert!(number(&decoded, "/0/decode/mb_per_s") > 0.0);
}

#[test]
fn factorize_says_what_it_took() {
    let folder = tempfile::tempdir().unwrap();
    write_btf(&folder.path().join("waves.npy"));
    let factorized = succeed_json(
        folder.path(),
        &["bench", "factorize", "waves.npy", "--components", "4", "--json"],
    );
    assert_eq!(
        (
            number(&factorized, "/rows"),
            number(&factorized, "/columns"),
            number(&factorized, "/components")
        ),
        (27.0, 960.0, 4.0)
    );
    let error = number(&factorized, "/relative_error");
    assert!(error > 1e-4 && error < 0.5, "{error}");
    assert!(number(&factorized, "/seconds") >= number(&factorized, "/product_seconds"));
}

#[test]
fn stability_bounds_hold() {
    let folder = tempfile::tempdir().unwrap();
    let table = succeed(folder.path(), &["bench", "stability"]);
    let verdicts: Vec<&str> = table
        .lines()
        .skip(1)
        .filter_map(|line| line.split_whitespace().last())
        .collect();
    assert!(
        verdicts.len() > 20 && verdicts.iter().all(|&verdict| verdict == "ok"),
        "{table}"
    );
    let rows = succeed_json(folder.path(), &["bench", "stability", "--json"]);
    assert_eq!(rows["cases"].as_array().map(Vec::len), Some(verdicts.len()));
    assert!(number(&rows, "/cases/1/measured/total_stated") > 0.0);
}

#[test]
fn pictures_are_measured_under_a_network() {
    let folder = tempfile::tempdir().unwrap();
    let stream = [
        "bench",
        "stream",
        "--materials",
        "1",
        "--seconds",
        "0",
        "--stands",
        "1",
        "--size",
        "64x36",
    ];
    let networks = ["--network", "200,20", "--plot", "stream.svg", "--json"];
    let results = succeed_json(folder.path(), &[&stream[..], &networks[..]].concat());
    assert_eq!(number(&results, "/plan/networks/0/network/bits_per_second"), 2e8);
    assert_eq!(results["replays"].as_array().map(Vec::len), Some(5));
    assert!(number(&results, "/replays/0/settled/bytes") > 0.0);
    let plot = fs::read_to_string(folder.path().join("stream.svg")).unwrap();
    assert!(plot.contains("breadth first"), "{plot}");
    let wrong = program::run(folder.path(), &["bench", "stream", "--network", "5g"]);
    assert_eq!(wrong.status.code(), Some(1));
    let wrong = String::from_utf8(wrong.stderr).unwrap();
    assert!(wrong.contains("dsl"), "{wrong}");
}

#[test]
fn failures_say_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_btf(&at.join("waves.npy"));
    let codec = [
        "bench",
        "codec",
        "waves.npy",
        "--keep",
        "kept",
        "--components",
        "4",
    ];
    let unreachable = fail(at, &[&codec[..], &["--targets", "1e-7"]].concat());
    assert!(unreachable.contains("larger target"), "{unreachable}");
    let negative = fail(at, &[&codec[..], &["--targets=-1"]].concat());
    assert!(negative.contains("above 0"), "{negative}");

    fs::remove_file(at.join("kept/waves/v.npy")).unwrap();
    let missing = fail(at, &["bench", "codec", "kept/waves", "--keep", "kept"]);
    assert!(missing.contains("v.npy"), "{missing}");
    assert!(fail(at, &["bench", "decode", "waves.npy"]).contains("waves.npy"));
}

#[test]
fn memory_quality_gets_better_with_memory_up_to_full_residency() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let command = "bench memory-quality --materials 2 --size 96x54 --steps 3 --ranks 0.5,1 --report a.html --csv a.csv --plot a.svg --pictures shots --json";
    let found = succeed_json(at, &command.split(' ').collect::<Vec<_>>());
    let points = found["points"].as_array().unwrap();
    assert_eq!(points.len(), 2 * 2 * 3);
    let flip = |point: &Value| number(point, "/full/flip");
    for (curve, points) in points.chunks(3).enumerate() {
        let (format, share) = (["half", "byte"][curve / 2], [1.0, 0.5][curve % 2]);
        assert!(
            points
                .iter()
                .all(|point| point["format"] == format && number(point, "/share") == share)
        );
        let slots: Vec<_> = points.iter().map(|point| number(point, "/page_slots")).collect();
        assert!(slots[0] <= 3.0 && slots.is_sorted(), "{slots:?}");
        assert!(flip(&points[2]) < flip(&points[0]), "{points:?}");
        assert!(points.iter().all(|point| point["reference"].is_null()));
    }
    // All that the view wants, in half floats and with all components, is full residency; anything less is not.
    assert!(
        number(&points[2], "/full/rmse") < 1e-4 && flip(&points[2]) < 1e-3,
        "{}",
        points[2]
    );
    assert!(number(&points[5], "/full/rmse") > 1e-4 && flip(&points[5]) > flip(&points[2]));
    assert!(number(&points[8], "/page_bytes") < 0.6 * number(&points[2], "/page_bytes"));
    assert!(number(&points[5], "/column_bytes") <= 0.5 * number(&points[2], "/column_bytes"));

    let csv = fs::read_to_string(at.join("a.csv")).unwrap();
    let columns: Vec<_> = csv.lines().map(|line| line.split(',').count()).collect();
    assert!(
        columns.len() == 13 && columns.iter().all(|count| *count == columns[0]),
        "{csv}"
    );
    assert!(csv.lines().next().unwrap().contains("full.flip"));
    let page = fs::read_to_string(at.join("a.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("data:image/png;base64,") && !page.contains("<script"));
    assert!(page.ends_with("</html>\n") && !csv.contains("NaN"));
    assert!(
        page.contains("eigentile bench memory-quality --materials 2"),
        "the command is in the report"
    );
    assert!(
        found["command"]
            .as_str()
            .unwrap()
            .starts_with("eigentile bench memory-quality")
    );
    assert!(found["device"].is_string());
    assert!(
        fs::read_to_string(at.join("a.svg"))
            .unwrap()
            .ends_with("</svg>\n")
    );
    assert!(at.join("shots/0.png").is_file());
}

#[test]
fn kept_results_become_tables_and_plots_of_a_document() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let policy = [
        "bench", "policy", "--frames", "6", "--pages", "25,100", "--stops", "1", "--json",
    ];
    fs::create_dir(at.join("kept")).unwrap();
    fs::write(at.join("kept/policy.json"), succeed(at, &policy)).unwrap();
    let before = "# Kept\n\n![Error](images/policy.svg)\n\n<!-- table: policy -->\n<!-- end -->\n\nby hand\n";
    fs::write(at.join("a.md"), before).unwrap();
    let tables = ["bench", "tables", "a.md", "--results", "kept"];
    let check = [&tables[..], &["--check"]].concat();
    assert!(fail(at, &check).contains("a.md is not what the results"));
    succeed(at, &tables);
    let document = fs::read_to_string(at.join("a.md")).unwrap();
    assert!(
        document.contains("\n| 100 | ") && document.ends_with("<!-- end -->\n\nby hand\n"),
        "{document}"
    );
    assert!(
        document.contains("`eigentile bench policy --frames 6"),
        "the command is told: {document}"
    );
    assert!(
        fs::read_to_string(at.join("images/policy.svg"))
            .unwrap()
            .ends_with("</svg>\n")
    );
    succeed(at, &check);

    fs::write(at.join("a.md"), "<!-- table: serve-races -->\n<!-- end -->\n").unwrap();
    assert!(fail(at, &tables).contains("serve-races"));
    fs::write(at.join("kept/serve.json"), "{}").unwrap();
    assert!(fail(at, &tables).contains("serve.json"));
}

#[test]
fn everything_goes_into_one_folder() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    succeed(
        at,
        &["bench", "all", "--quick", "--only", "stability", "-o", "all"],
    );
    for name in [
        "index.html",
        "results.md",
        "stability.json",
        "stability.html",
        "stability.csv",
        "stability.md",
        "inputs/quick/scene.gltf",
    ] {
        assert!(at.join("all").join(name).is_file(), "{name}");
    }
    let page = fs::read_to_string(at.join("all/stability.html")).unwrap();
    assert!(page.contains("bench stability --json --report") && page.contains("half"));
    assert!(fail(at, &["bench", "all", "--only", "weather"]).contains("time-error"));
}

#[test]
fn traces_are_replayed_and_reports_compared() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let record = [
        "bench",
        "replay",
        "way.json",
        "--record",
        "--materials",
        "2",
        "--seconds",
        "0.2",
        "--size",
        "96x54",
        "--json",
    ];
    let recorded = succeed_json(at, &record);
    assert!(number(&recorded, "/counts/pages") > 0.0);
    let again = succeed_json(at, &["bench", "replay", "way.json", "--json"]);
    assert_eq!(again["counts"], recorded["counts"]);
    assert_eq!(again["differences"].as_array().map(Vec::len), Some(0));

    // A trace that says that something else came of it.
    let text = fs::read_to_string(at.join("way.json")).unwrap();
    let changed = text.replace("\"line_bytes\":", "\"line_bytes\":1");
    fs::write(at.join("way.json"), changed).unwrap();
    // What was found is printed all the same.
    let refuse = |arguments: &[&str]| {
        let output = run(at, arguments);
        assert!(!output.status.success() && !output.stdout.is_empty());
        String::from_utf8(output.stderr).unwrap()
    };
    let error = refuse(&["bench", "replay", "way.json"]);
    assert!(error.contains("not as it was recorded: line_bytes"), "{error}");
    let said = succeed(at, &["bench", "replay", "way.json", "--changed"]);
    assert!(said.contains("| differs | line_bytes"), "{said}");

    fs::write(at.join("a.json"), recorded.to_string()).unwrap();
    let mut slower = recorded.clone();
    slower["counts"]["line_bytes"] = (2.0 * number(&recorded, "/counts/line_bytes")).into();
    fs::write(at.join("b.json"), slower.to_string()).unwrap();
    let said = succeed(at, &["bench", "compare", "a.json", "b.json"]);
    assert!(
        said.contains("| counts.line_bytes |") && said.contains("2.000"),
        "{said}"
    );
    let error = refuse(&["bench", "compare", "a.json", "b.json", "--fail-over", "5%"]);
    assert!(
        error.contains("1 figures became worse by more than 5 %: counts.line_bytes"),
        "{error}"
    );
    // The other way round it is better.
    succeed(at, &["bench", "compare", "b.json", "a.json", "--fail-over", "5%"]);
    fs::write(at.join("other.json"), "[{\"name\":\"x\"}]").unwrap();
    let error = fail(at, &["bench", "compare", "a.json", "other.json"]);
    assert!(error.contains("no figure in common"), "{error}");
}
