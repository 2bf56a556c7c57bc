use proptest::prelude::*;

use super::*;

fn record(contents: u32, weight: f32) -> Record {
    Record {
        offset: 0,
        length: if contents > 0 {
            contents + CHECKSUM_BYTES
        } else {
            0
        },
        weight: stored_weight(weight),
    }
}

/// The bytes of a directory that comes back as it was.
fn round_trip(pyramid: &Pyramid, columns: &[Record], pages: &[Record]) -> Vec<u8> {
    let bytes = encode(pyramid, columns, pages).unwrap();
    let (found, found_pages) = decode(&bytes, pyramid, columns.len(), 0).unwrap();
    assert!(found == columns && found_pages == pages);
    bytes
}

/// Numbers that are the same everywhere.
struct Noise(u32);

impl Noise {
    /// In -1/2..1/2.
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / (1 << 24) as f32 - 0.5
    }

    fn bell(&mut self) -> f32 {
        (0..6).map(|_| self.next()).sum()
    }
}

/// Columns and pages as archives have them: what a group has at a tile is like what the group before has there, and
/// changes are alike for tiles beside each other.
fn realistic(pyramid: &Pyramid, groups: usize) -> [Vec<Record>; 2] {
    let mut noise = Noise(1);
    let tiles = pyramid.tile_count() as usize;
    let place: Vec<f32> = (0..tiles).map(|_| 0.3 * noise.bell()).collect();
    let columns = (0..groups)
        .map(|group| record(4000 - 50 * group as u32, (-(group as f32)).exp2()))
        .collect();
    let mut pages = Vec::new();
    for group in 0..groups {
        for place in &place {
            let weight = place - 12.0 - 0.6 * group as f32 + 0.05 * noise.bell();
            let length = 12.0 + 0.3 * place - 0.1 * group as f32 + 0.05 * noise.bell();
            pages.push(record(length.exp2() as u32, weight.exp2()));
        }
    }
    [columns, pages]
}

#[test]
fn directories_take_less_than_two_bytes_for_an_entry() {
    let pyramid = Pyramid::new(1024, 1024, true).unwrap();
    let [columns, pages] = realistic(&pyramid, 16);
    let bytes = round_trip(&pyramid, &columns, &pages).len();
    let entries = columns.len() + pages.len();
    assert!(8 * bytes < 14 * entries, "{bytes} bytes for {entries} entries");
    // A small one has little to learn from.
    let pyramid = Pyramid::new(256, 256, true).unwrap();
    let [columns, pages] = realistic(&pyramid, 8);
    let bytes = round_trip(&pyramid, &columns, &pages).len();
    let entries = columns.len() + pages.len();
    assert!(8 * bytes < 17 * entries, "{bytes} bytes for {entries} entries");
}

#[test]
fn extreme_directories_come_back() {
    let pyramid = Pyramid::new(700, 260, false).unwrap();
    let tiles = pyramid.tile_count() as usize;
    let rows = |column: Record, page: Record| (vec![column; 3], vec![page; 3 * tiles]);
    let least = record(1, f32::MIN_POSITIVE);
    let most = record(MAX_PAGE_BYTES, f32::MAX);
    for (column, page) in [
        (record(1, 0.0), record(0, 0.0)),
        (record(MAX_COLUMN_BYTES, f32::MAX), most),
        (least, least),
        (least, record(0, 1.0)),
    ] {
        let (columns, pages) = rows(column, page);
        let bytes = round_trip(&pyramid, &columns, &pages).len();
        assert!(bytes < 120, "{bytes} bytes for entries that are all the same");
    }
    // From the least to the most and back.
    let (columns, mut pages) = rows(least, least);
    pages.iter_mut().step_by(2).for_each(|page| *page = most);
    let bytes = round_trip(&pyramid, &columns, &pages).len();
    assert!(bytes < 8 * (columns.len() + pages.len()), "{bytes}");
}

#[test]
fn missing_and_superfluous_bytes_are_found() {
    let pyramid = Pyramid::new(256, 256, true).unwrap();
    let [columns, pages] = realistic(&pyramid, 2);
    let mut bytes = round_trip(&pyramid, &columns, &pages);
    for length in 0..bytes.len() {
        assert!(
            decode(&bytes[..length], &pyramid, 2, 0).is_err(),
            "cut at {length}"
        );
    }
    bytes.push(0);
    let error = decode(&bytes, &pyramid, 2, 0).unwrap_err();
    assert!(error.contains("1 bytes follow"), "{error}");
}

#[test]
fn weights_are_rounded_to_the_nearest_of_four_bits() {
    for weight in [1e-30, 3.3e-5, 0.999, 1.0, 1.03, 7e20] {
        let stored = stored_weight(weight);
        assert!((stored / weight - 1.0).abs() <= 1.0 / 31.0, "{weight} {stored}");
        assert_eq!(stored_weight(stored), stored);
    }
    assert_eq!(stored_weight(0.0), 0.0);
    assert!(stored_weight(f32::MAX).is_finite());
}

/// The logarithm of a number, and the number again: no more than half a step of the logarithm apart.
#[test]
fn logarithms_are_the_inverse_of_numbers() {
    use quantity::Scale;
    for code in 1..=Weights::LARGEST {
        assert_eq!(Weights.number(Weights.log(code)), code);
    }
    let lengths = Lengths(MAX_COLUMN_BYTES);
    for number in (1..5000).chain([MAX_COLUMN_BYTES / 3, MAX_COLUMN_BYTES]) {
        let again = lengths.number(lengths.log(number));
        assert!(number - again <= number >> 11, "{number} {again}");
    }
}

fn entries(groups: usize, tiles: usize) -> impl Strategy<Value = [Vec<Record>; 2]> {
    let weight = || {
        prop_oneof![
            Just(0.0f32),
            0.0f32..1.0,
            any::<u32>().prop_map(|bits| f32::from_bits(bits >> 1).min(f32::MAX))
        ]
    };
    let column = (1..=MAX_COLUMN_BYTES, weight());
    let page = (prop_oneof![Just(0), 1..=2000u32, 1..=MAX_PAGE_BYTES], weight());
    let row = |(contents, weight)| record(contents, weight);
    [
        prop::collection::vec(column.prop_map(row), groups).boxed(),
        prop::collection::vec(page.prop_map(row), groups * tiles).boxed(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_directory_comes_back(
        (pyramid, records) in (1u32..500, 1u32..500, 1usize..6).prop_flat_map(|(width, height, groups)| {
            let pyramid = Pyramid::new(width, height, true).unwrap();
            (Just(pyramid), entries(groups, pyramid.tile_count() as usize))
        }),
    ) {
        let [columns, pages] = records;
        let bytes = round_trip(&pyramid, &columns, &pages).len();
        prop_assert!(bytes <= 8 + 8 * (columns.len() + pages.len()));
    }

    #[test]
    fn any_bytes_are_a_directory_or_an_error(
        bytes in prop::collection::vec(any::<u8>(), 0..300), groups in 1usize..5,
    ) {
        let pyramid = Pyramid::new(300, 200, true).unwrap();
        if let Ok((columns, pages)) = decode(&bytes, &pyramid, groups, 7) {
            prop_assert_eq!(columns.len(), groups);
            for record in columns.iter().chain(&pages) {
                prop_assert!(record.weight.is_finite() && record.length <= MAX_COLUMN_BYTES + CHECKSUM_BYTES);
            }
        }
    }

    #[test]
    fn damaged_directories_never_panic(at: prop::sample::Index, flip in 1u8..=255) {
        let pyramid = Pyramid::new(256, 256, true).unwrap();
        let [columns, pages] = realistic(&pyramid, 2);
        let mut bytes = encode(&pyramid, &columns, &pages).unwrap();
        *at.get_mut(&mut bytes) ^= flip;
        if let Ok(found) = decode(&bytes, &pyramid, 2, 0) {
            prop_assert_ne!(found, (columns, pages));
        }
    }
}
