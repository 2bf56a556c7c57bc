//! Files that contradict themselves, or end too early.

use preprocess::Btf;
use proptest::prelude::*;

use crate::bdi::Bdi;
use crate::common::{Bytes, SMALL};
use crate::dfmf::dfmf;
use crate::fmf::fmf;
use crate::pvf::{pvf, pvf_start};

pub(crate) fn find(bytes: &Bytes, needle: &[u8]) -> usize {
    bytes
        .0
        .windows(needle.len())
        .position(|window| window == needle)
        .unwrap()
}

/// Where the size of the small file's pictures stands.
pub(crate) fn size_at(bytes: &Bytes) -> usize {
    find(bytes, &[4, 0, 0, 0, 3, 0, 0, 0])
}

pub(crate) fn put(bytes: &Bytes, at: usize, value: &[u8]) -> Bytes {
    let mut bytes = bytes.clone();
    bytes.0[at..at + value.len()].copy_from_slice(value);
    bytes
}

pub(crate) fn named(bytes: &Bytes, parts: &[&str]) {
    let error = bytes.error();
    for part in parts.iter().chain(&["cloth.btf"]) {
        assert!(error.contains(part), "{part:?} is not in {error:?}");
    }
}

pub(crate) const META_BYTES: usize = 4 + 4 + 240 + 4 + 12 + 4 + 4 + 7 + 4 + 3 * 5;
/// Where the directions of an `!FMF06FC` begin.
pub(crate) const DIRECTIONS: usize = 8 + META_BYTES;

#[test]
fn contradictions_are_named() {
    let good = fmf("!FMF06FC", SMALL, 2, 3, false, None);
    good.open().unwrap();
    named(
        &put(&good, 0, b"?"),
        &["\"?FMF06FC", "no signature", "!DFMF08FCR"],
    );
    named(&Bytes::default(), &["no signature"]);
    named(&put(&good, 8, &[1]), &["version 4", "claims"]);
    // The count of channels follows the XML text.
    let channels = DIRECTIONS - 19;
    named(
        &put(&good, channels, &[2]),
        &["2 channels", &format!("byte {channels}"), "expected 3"],
    );
    named(
        &put(&good, channels - 11, &[0, 0, 0, 0x7f]),
        &["XML text", "the file ends at"],
    );
    let nan = f32::NAN.to_le_bytes();
    let view = DIRECTIONS + 4;
    named(
        &put(&good, view, &nan),
        &["view 0 at [NaN", &format!("byte {view}")],
    );
    named(
        &put(&good, view + 12, &30f32.to_le_bytes()),
        &["light 0 of view 0 at [30", "radians"],
    );
    named(
        &put(&good, view + 16, &f32::INFINITY.to_le_bytes()),
        &["light 0 of view 0", "inf"],
    );
    named(&put(&good, DIRECTIONS, &[0; 4]), &["0 views"]);
    named(&put(&good, DIRECTIONS, &[0xff; 4]), &["4294967295 views"]);
    named(&put(&good, view + 8, &[0; 4]), &["0 lights of view 0"]);
    // A view and its two lights take 28 bytes.
    named(
        &put(&good, view + 28 + 8, &[1]),
        &["1 lights for view 1 and 2 for view 0"],
    );
    let moved = put(&good, view + 56 + 20, &0.5f32.to_le_bytes());
    named(
        &moved,
        &[
            "light 1 of view 2 at [0.5",
            "light 1 of view 0 is at [0.2",
            "same lights",
        ],
    );
    named(&put(&good, size_at(&good), &[0]), &["0x3 texels"]);
    named(&put(&good, size_at(&good), &[0, 0, 2]), &["131072x3 texels"]);
    let factors = size_at(&good) + 12;
    named(
        &put(&good, factors, &[3]),
        &["scalars of 3 bytes", &format!("byte {factors}"), "2, 4 or 8"],
    );
    named(&put(&good, factors + 1, &[0]), &["0 components"]);
    named(&put(&good, factors + 1, &[0xff; 4]), &["4294967295 components"]);
    named(
        &put(&good, factors + 5, &[7]),
        &["factors of 7 x 12", "expected 18 x 12", "36 x 6"],
    );
    named(
        &put(&good, factors + 1, &[4]),
        &["cut short", "S*V of 12 x 4 f16"],
    );
    named(&put(&good, factors + 1, &[2]), &["goes on for", "after S*V"]);
    let mut longer = good.clone();
    longer.0.push(0);
    named(&longer, &["goes on for 1 bytes"]);
}

#[test]
fn contradictions_of_each_layout_are_named() {
    let good = fmf("!FMF12FCER", SMALL, 2, 3, false, Some(0));
    let frames = size_at(&good) + 8;
    named(
        &put(&good, frames, &[0xff; 4]),
        &["4294967295 local frames", "cut short"],
    );
    let extended = frames + 4 + 36 * 12;
    named(&put(&good, extended, &[3]), &["FMF header of version 3"]);
    named(
        &put(&good, extended + 5, &[0xff; 8]),
        &["height map of 4294967295 x 4294967295"],
    );

    let good = dfmf(0, 2, false);
    let model = size_at(&good) + 8 + 4 + 36 * 12 + 4;
    for (number, text) in [
        (6u8, "linear spectral"),
        (7, "colour model 7"),
        (8, "known are"),
        (13, "colour model 13"),
    ] {
        named(&put(&good, model, &[number]), &[text, &format!("byte {model}")]);
    }
    named(
        &put(&put(&good, model, &[3]), model + 4, &f32::NAN.to_le_bytes()),
        &["PCA", "NaN"],
    );

    let good = pvf(pvf_start(0, SMALL), SMALL, 2, false);
    named(
        &put(&good, size_at(&good) + 12, &[2]),
        &["2 view slots and 3 views"],
    );

    let bdi = Bdi {
        shape: SMALL,
        scan_lines: 2,
        compression: 2,
        holes: true,
        full: false,
    };
    let good = bdi.bytes();
    let lines = size_at(&good) + 8;
    named(&put(&good, lines, &[0]), &["0 scan lines"]);
    named(&put(&good, lines + 4, &[3]), &["compression 3", "2 sparse"]);
    named(&put(&good, lines + 5, &[0; 12]), &["masks out every texel"]);
    let chunk = lines + 5 + 12 + 4;
    named(
        &put(&good, chunk, &[1]),
        &[
            "chunk 0 of",
            &format!("byte {chunk}"),
            "expected 288 for 8 texels",
        ],
    );
    let mut bomb = put(&good, lines + 4, &[1]);
    bomb.0.truncate(chunk);
    (0..2).for_each(|_| bomb.u32(0));
    named(
        &bomb,
        &["432 bytes of samples in 0 bytes of bzip2", "not believed"],
    );
}

/// One file of every layout.
fn samples_of_files() -> Vec<Bytes> {
    let bdi = |compression| {
        Bdi {
            shape: SMALL,
            scan_lines: 2,
            compression,
            holes: true,
            full: false,
        }
        .bytes()
    };
    vec![
        fmf("!FMF06FC", SMALL, 2, 3, false, None),
        fmf("!FMF12FCER", SMALL, 4, 2, true, Some(1)),
        dfmf(3, 2, false),
        dfmf(11, 8, true),
        pvf(pvf_start(0, SMALL), SMALL, 2, false),
        pvf(pvf_start(2, SMALL), SMALL, 4, true),
        bdi(0),
        bdi(1),
        bdi(2),
    ]
}

#[test]
fn every_truncation_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cloth.btf");
    for good in samples_of_files() {
        std::fs::write(&path, &good.0).unwrap();
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        for length in (0..good.0.len()).rev() {
            file.set_len(length as u64).unwrap();
            let error = Btf::open(&path).unwrap_err().to_string();
            let about = error.contains("cut short") || error.contains("signature");
            assert!(about, "{length} of {} bytes: {error}", good.0.len());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, ..ProptestConfig::default() })]

    /// Whatever is in the file: an error or samples, never a panic.
    #[test]
    fn no_bytes_panic(
        file in 0usize..9,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        header in any::<bool>(),
    ) {
        let mut bytes = samples_of_files().swap_remove(file);
        for (index, value) in edits {
            // Half of the runs change the counts behind the directions only, which matter most.
            let range = if header { 290..bytes.0.len().min(900) } else { 0..bytes.0.len() };
            let at = range.start + index.index(range.len());
            bytes.0[at] = value;
        }
        let (_folder, path) = bytes.write();
        if let Ok(btf) = Btf::open(&path) {
            let mut buffer = Vec::new();
            for image in 0..btf.image_count().min(9) {
                if let Ok(samples) = btf.samples(image..image + 1, &mut buffer) {
                    prop_assert_eq!(samples.len(), 3 * btf.columns());
                }
                prop_assert!(!btf.place(image).is_empty());
            }
            let _ = btf.low_rank();
        }
    }
}
