//! Tables of what `peers/codec_run.py` and `peers/factorize_run.py` have measured by turns with other programs.

use serde::Deserialize;

/// `codec.json`.
#[derive(Deserialize)]
pub(super) struct Codec {
    materials: Vec<Material>,
}

#[derive(Deserialize)]
struct Material {
    name: String,
    machine: Machine,
    points: Vec<Point>,
}

#[derive(Deserialize)]
struct Machine {
    processor: String,
    cores: usize,
    commit: String,
}

#[derive(Deserialize)]
struct Point {
    relative_error: f64,
    bits_per_sample: f64,
    archive_bits_per_sample: f64,
    archive_seconds: f64,
    decode: Decode,
    peers: Peers,
}

#[derive(Deserialize)]
struct Decode {
    mb_per_s: f64,
    ratio_to_jpeg2000: Option<f64>,
    finest_ratio_to_jpeg2000: Option<f64>,
}

#[derive(Deserialize)]
struct Peers {
    jpeg2000: Option<Peer>,
    jpegxl: Option<Peer>,
}

#[derive(Deserialize)]
struct Peer {
    mode: String,
    bits_per_sample: f64,
    bytes_ratio: f64,
    archive_bytes_ratio: f64,
}

/// A row for each material and error.
pub(super) fn codec(codec: &Codec) -> String {
    let mut text = String::from(
        "| material | relative RMSE | bits: pages and tables | with columns | JPEG 2000 | JPEG XL | bytes to JPEG 2000 | with columns \
         | to JPEG XL | archive s | decode MB/s | to OpenJPEG | finest mip only |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for material in &codec.materials {
        for point in &material.points {
            let Peers { jpeg2000, jpegxl } = &point.peers;
            let cells = [
                material.name.clone(),
                format!("{:.4}", point.relative_error),
                format!("{:.3}", point.bits_per_sample),
                format!("{:.3}", point.archive_bits_per_sample),
                known(jpeg2000, |peer| format!("{:.3}", peer.bits_per_sample)),
                known(jpegxl, |peer| {
                    format!("{:.3} ({})", peer.bits_per_sample, peer.mode)
                }),
                known(jpeg2000, |peer| format!("**{:.2}**", peer.bytes_ratio)),
                known(jpeg2000, |peer| format!("{:.2}", peer.archive_bytes_ratio)),
                known(jpegxl, |peer| format!("{:.2}", peer.bytes_ratio)),
                format!("{:.1}", point.archive_seconds),
                format!("{:.0}", point.decode.mb_per_s),
                known(&point.decode.ratio_to_jpeg2000, |ratio| format!("**{ratio:.1}**")),
                known(&point.decode.finest_ratio_to_jpeg2000, |ratio| {
                    format!("{ratio:.1}")
                }),
            ];
            text += &format!("| {} |\n", cells.join(" | "));
        }
    }
    match codec.materials.last() {
        Some(last) => format!("{text}\n{}\n", measured_on(&last.machine)),
        None => text,
    }
}

/// `factorize.json`.
#[derive(Deserialize)]
pub(super) struct Factorizations {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    case: String,
    rows: u64,
    columns: u64,
    machine: Machine,
    seconds_ratio: f64,
    seconds: Pair<f64>,
    relative_error: Pair<f64>,
    gflops: Pair<f64>,
    peak_anonymous_bytes: Pair<Option<u64>>,
    peak_rss_bytes: Pair<Option<u64>>,
}

#[derive(Deserialize)]
struct Pair<T> {
    eigentile: T,
    numpy: T,
}

impl<T> Pair<T> {
    fn cells(&self, of: impl Fn(&T) -> String) -> [String; 2] {
        [of(&self.eigentile), of(&self.numpy)]
    }
}

/// A row for each BTF.
pub(super) fn factorize(all: &Factorizations) -> String {
    let mut text = String::from(
        "| BTF | matrix | Eigentile | numpy | ratio | error | numpy's | GFLOP/s | numpy's | peak memory, no file behind it | numpy's \
         | peak RSS with mapped pages | numpy's |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for case in &all.cases {
        let mib = |bytes: &Option<u64>| known(bytes, |bytes| format!("{:.0} MiB", *bytes as f64 / 1048576.0));
        let mut cells = vec![case.case.clone(), format!("{} × {}", case.rows, case.columns)];
        cells.extend(case.seconds.cells(|seconds| format!("{seconds:.1} s")));
        cells.push(format!("**{:.2}**", case.seconds_ratio));
        cells.extend(
            case.relative_error
                .cells(|error| format!("{:.3} %", 100.0 * error)),
        );
        cells.extend(case.gflops.cells(|gflops| format!("{gflops:.0}")));
        cells.extend(case.peak_anonymous_bytes.cells(mib));
        cells.extend(case.peak_rss_bytes.cells(mib));
        text += &format!("| {} |\n", cells.join(" | "));
    }
    match all.cases.last() {
        Some(last) => format!("{text}\n{}\n", measured_on(&last.machine)),
        None => text,
    }
}

fn known<T>(value: &Option<T>, of: impl Fn(&T) -> String) -> String {
    value.as_ref().map_or("–".into(), of)
}

fn measured_on(machine: &Machine) -> String {
    let Machine {
        processor,
        cores,
        commit,
    } = machine;
    format!("Measured on {cores} cores of {processor}, commit {commit}.")
}
