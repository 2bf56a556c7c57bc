//! Pages and columns: round trips, error bounds, borders, and what must be refused.

mod common;

use common::{encode_group, image, manifest, mips};
use half::f16;
use proptest::prelude::*;
use tileset::{
    BORDER_TEXELS, Codec, Column, Error, PAGE_TEXELS, Page, PageId, Pyramid, SLOT_AREA, SLOT_TEXELS, Tile,
    codec::{MAX_PAGE_BYTES, MipImage, decode_column, decode_page, encode_column, encode_page},
};

const CODEC: Codec = Codec::DctDeltaZstd { step: 0.02 };

fn at(page: &Page, x: u32, y: u32) -> [f32; 4] {
    page.texels[(y * SLOT_TEXELS + x) as usize].map(f16::to_f32)
}

/// What filtering must find at any whole position of a mip.
fn seen(mip: &MipImage, wrap: bool, x: i64, y: i64) -> [f32; 4] {
    let place = |position: i64, size: u32| {
        let size = i64::from(size);
        if wrap {
            position.rem_euclid(size)
        } else {
            position.clamp(0, size - 1)
        }
    };
    mip.texels[(place(y, mip.height) * i64::from(mip.width) + place(x, mip.width)) as usize]
}

/// Calls `visit` with the mip, the position in it and the texel of everything a page shows, borders included.
fn for_each_texel(pyramid: &Pyramid, tile: Tile, page: &Page, mut visit: impl FnMut(u8, [i64; 2], [f32; 4])) {
    let last = if tile == pyramid.root() {
        pyramid.mip_count() - 1
    } else {
        tile.mip
    };
    let border = i64::from(BORDER_TEXELS);
    let mut expected_zeros = vec![true; SLOT_AREA];
    for mip in tile.mip..=last {
        let (left, top) = pyramid.payload_origin(tile, mip);
        let (width, height) = if tile == pyramid.root() {
            pyramid.mip_size(mip)
        } else {
            pyramid.payload(tile)
        };
        for y in -border..i64::from(height) + border {
            for x in -border..i64::from(width) + border {
                let slot = [(i64::from(left) + x) as u32, (i64::from(top) + y) as u32];
                expected_zeros[(slot[1] * SLOT_TEXELS + slot[0]) as usize] = false;
                let page_texels = i64::from(PAGE_TEXELS);
                let position = [
                    x + i64::from(tile.x) * page_texels,
                    y + i64::from(tile.y) * page_texels,
                ];
                visit(mip, position, at(page, slot[0], slot[1]));
            }
        }
    }
    for (texel, _) in page.texels.iter().zip(expected_zeros).filter(|(_, zero)| *zero) {
        assert_eq!(
            *texel,
            [f16::ZERO; 4],
            "texels outside payload and border are zero"
        );
    }
}

/// Codes and decodes all pages of a group and holds every texel against the wanted mips.
fn check(finest: MipImage, wrap: bool, step: f64) {
    let codec = Codec::DctDeltaZstd { step };
    let pyramid = Pyramid::new(finest.width, finest.height, wrap).unwrap();
    let mips = mips(finest, &pyramid);
    let pages = encode_group(codec, &pyramid, &mips);
    // Half floats below 2 are off by at most 2^-11 when rounded, and the tail rounds mip after mip.
    let rounding = 6.0 * 2f64.powi(-11);
    for (tile, page) in pyramid.tiles().zip(&pages) {
        let parent = pyramid
            .parent(tile)
            .map(|parent| &pages[pyramid.tile_index(parent).unwrap() as usize].decoded);
        let decoded = decode_page(codec, &pyramid, PageId { group: 0, tile }, &page.bytes, parent).unwrap();
        assert_eq!(decoded, page.decoded);
        assert!(page.bytes.len() as u64 <= MAX_PAGE_BYTES.into());

        // A coefficient is less than a step off. The transform keeps the sum of squares, so the mean square
        // over whole blocks is less than step² a component, and one texel is less than 8 steps off.
        let mut squares = 0.0;
        let mut texels = 0.0;
        for_each_texel(&pyramid, tile, &decoded, |mip, [x, y], found| {
            let wanted = seen(&mips[usize::from(mip)], wrap, x, y);
            for (found, wanted) in found.into_iter().zip(wanted) {
                assert!(
                    wanted.abs() < 2.0,
                    "the bound on rounding holds for small values only"
                );
                let error = f64::from((found - wanted).abs());
                assert!(
                    error < 8.0 * step + rounding,
                    "{tile:?} is {error} off at {x}, {y}"
                );
                squares += error * error;
            }
            texels += 1.0;
        });
        if pyramid.payload(tile) == (PAGE_TEXELS, PAGE_TEXELS) {
            assert!(
                squares / texels < 4.0 * (step + rounding).powi(2),
                "{tile:?}: {}",
                squares / texels
            );
            assert!(page.error <= squares / texels * (72.0f64 * 72.0) / (64.0 * 64.0));
        }
        assert_eq!(page.bytes.is_empty(), page.weight == 0.0);
    }
}

#[test]
fn awkward_sizes_round_trip() {
    for (width, height) in [
        (1, 1),
        (1, 200),
        (200, 1),
        (31, 33),
        (32, 32),
        (64, 64),
        (65, 129),
        (346, 335),
    ] {
        for wrap in [false, true] {
            check(image(width, height, width ^ height), wrap, 0.05);
        }
    }
}

#[test]
fn reported_weight_and_error_are_those_of_the_payload() {
    let pyramid = Pyramid::new(100, 70, true).unwrap();
    let mips = mips(image(100, 70, 1), &pyramid);
    let pages = encode_group(CODEC, &pyramid, &mips);
    for (tile, page) in pyramid.tiles().zip(&pages) {
        let parent = pyramid
            .parent(tile)
            .map(|parent| &pages[pyramid.tile_index(parent).unwrap() as usize].decoded);
        let predicted = decode_page(CODEC, &pyramid, PageId { group: 0, tile }, &[], parent).unwrap();
        let (width, height) = pyramid.payload(tile);
        let (mut weight, mut error) = (0.0, 0.0);
        for y in 0..height {
            for x in 0..width {
                let decoded = at(&page.decoded, x + BORDER_TEXELS, y + BORDER_TEXELS);
                let predicted = at(&predicted, x + BORDER_TEXELS, y + BORDER_TEXELS);
                let (x, y) = (
                    u32::from(tile.x) * PAGE_TEXELS + x,
                    u32::from(tile.y) * PAGE_TEXELS + y,
                );
                let mip = &mips[usize::from(tile.mip)];
                let wanted = mip.texels[(y * mip.width + x) as usize];
                for c in 0..4 {
                    weight += f64::from(decoded[c] - predicted[c]).powi(2);
                    error += f64::from(decoded[c] - wanted[c]).powi(2);
                }
            }
        }
        let texels = f64::from(width * height);
        assert!(
            (page.weight - weight / texels).abs() <= 1e-6 * page.weight,
            "{} {}",
            page.weight,
            weight / texels
        );
        assert!(
            (page.error - error / texels).abs() <= 1e-6 * page.error,
            "{} {}",
            page.error,
            error / texels
        );
    }
    assert!(pages[0].weight > 0.1, "the root weighs its own mean square");
}

#[test]
fn what_the_parent_says_already_costs_nothing() {
    let pyramid = Pyramid::new(256, 128, true).unwrap();
    let flat = MipImage {
        width: 256,
        height: 128,
        texels: vec![[0.5, -1.0, 0.25, 0.0]; 256 * 128],
    };
    let pages = encode_group(CODEC, &pyramid, &mips(flat, &pyramid));
    assert!(!pages[0].bytes.is_empty());
    for page in &pages[1..] {
        assert!(page.bytes.is_empty());
        assert!(page.weight == 0.0 && page.error < 1e-3);
    }
    let black = MipImage {
        width: 256,
        height: 128,
        texels: vec![[0.0; 4]; 256 * 128],
    };
    assert!(
        encode_group(CODEC, &pyramid, &mips(black, &pyramid))
            .iter()
            .all(|page| page.bytes.is_empty())
    );
}

#[test]
fn smaller_steps_cost_more_and_err_less() {
    let pyramid = Pyramid::new(256, 256, true).unwrap();
    let mips = mips(image(256, 256, 3), &pyramid);
    let measured = [0.1, 0.03, 0.01, 0.003].map(|step| {
        let pages = encode_group(Codec::DctDeltaZstd { step }, &pyramid, &mips);
        let finest = &pages[pyramid.mip_base(0) as usize..];
        let error = finest.iter().map(|page| page.error).sum::<f64>() / finest.len() as f64;
        (
            pages.iter().map(|page| page.bytes.len()).sum::<usize>(),
            error,
            step,
        )
    });
    assert!(measured.is_sorted_by(|(bytes, error, _), (more, less, _)| bytes < more && error > less));
    for (_, error, step) in measured {
        // Uniform quantization errs by step²/12 a component; choosing by rate errs up to twice as much.
        assert!(
            error < 4.0 * 2.0 * step * step / 12.0 + 1e-6,
            "{error} at step {step}"
        );
    }
}

#[test]
fn values_and_arguments_that_cannot_be_coded_are_refused() {
    let pyramid = Pyramid::new(40, 40, true).unwrap();
    let root = pyramid.root();
    let fine = Tile { mip: 0, x: 0, y: 0 };
    let mip = |side: u32, value: f32| MipImage {
        width: side,
        height: side,
        texels: vec![[value; 4]; (side * side) as usize],
    };
    let encode = |codec, tile, mip: &MipImage, parent| encode_page(codec, &pyramid, tile, mip, parent);
    let good = encode(CODEC, root, &mip(20, 1.0), None).unwrap().decoded;

    for value in [f32::NAN, f32::INFINITY, 65505.0, -1e9] {
        assert!(matches!(
            encode(CODEC, root, &mip(20, value), None),
            Err(Error::Invalid { .. })
        ));
    }
    let coarse = Codec::DctDeltaZstd { step: 1.0 };
    let largest = encode(coarse, root, &mip(20, 65504.0), None).unwrap().decoded;
    assert_eq!(largest.texels[0], [f16::MAX; 4]);
    // A step from one end of the range to the other swings beyond it when it is halved.
    let mut edge = mip(20, 65504.0);
    edge.texels
        .chunks_exact_mut(20)
        .for_each(|row| row[..9].fill([-65504.0; 4]));
    let edge = encode(coarse, root, &edge, None).unwrap().decoded;
    assert!(edge.texels.iter().flatten().all(|value| value.is_finite()));
    for step in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300, 1e300] {
        let codec = Codec::DctDeltaZstd { step };
        assert!(matches!(
            encode(codec, root, &mip(20, 1.0), None),
            Err(Error::Invalid { .. })
        ));
        let page = PageId { group: 0, tile: root };
        assert!(matches!(
            decode_page(codec, &pyramid, page, &[], None),
            Err(Error::Invalid { .. })
        ));
    }
    let small = Codec::DctDeltaZstd { step: 1e-6 };
    assert!(matches!(
        encode(small, root, &mip(20, 60000.0), None),
        Err(Error::Invalid { .. })
    ));
    assert!(matches!(
        encode(CODEC, root, &mip(21, 1.0), None),
        Err(Error::Invalid { .. })
    ));
    assert!(matches!(
        encode(CODEC, root, &mip(20, 1.0), Some(&good)),
        Err(Error::Invalid { .. })
    ));
    assert!(matches!(
        encode(CODEC, fine, &mip(40, 1.0), None),
        Err(Error::Invalid { .. })
    ));
    let short = Page {
        texels: good.texels[1..].to_vec(),
    };
    assert!(matches!(
        encode(CODEC, fine, &mip(40, 1.0), Some(&short)),
        Err(Error::Invalid { .. })
    ));
    assert!(encode(CODEC, fine, &mip(40, 1.0), Some(&good)).is_ok());
    let nowhere = Tile { mip: 0, x: 1, y: 0 };
    assert!(matches!(
        encode(CODEC, nowhere, &mip(40, 1.0), Some(&good)),
        Err(Error::NotFound { .. })
    ));
}

#[test]
fn damaged_pages_are_refused_or_decoded_within_range() {
    let pyramid = Pyramid::new(70, 50, false).unwrap();
    let mips = mips(image(70, 50, 5), &pyramid);
    let pages = encode_group(CODEC, &pyramid, &mips);
    let (tile, parent) = (Tile { mip: 0, x: 1, y: 0 }, &pages[0].decoded);
    let page = PageId { group: 0, tile };
    let bytes = &pages[pyramid.tile_index(tile).unwrap() as usize].bytes;
    let decode = |bytes: &[u8]| decode_page(CODEC, &pyramid, page, bytes, Some(parent));
    for length in 1..bytes.len() {
        assert!(
            matches!(decode(&bytes[..length]), Err(Error::Corrupt { .. })),
            "cut at {length}"
        );
    }
    assert!(matches!(
        decode(&[bytes, &[0][..]].concat()),
        Err(Error::Corrupt { .. })
    ));
    assert!(matches!(
        decode(&[&bytes[..], bytes].concat()),
        Err(Error::Corrupt { .. })
    ));
    for i in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[i] ^= 0x55;
        if let Ok(page) = decode(&damaged) {
            assert!(page.texels.iter().flatten().all(|value| value.is_finite()));
        }
    }
    // A record of another page has another number of blocks.
    assert!(matches!(decode(&pages[0].bytes), Err(Error::Corrupt { .. })));
    for length in [0, 1, 1000, 100_000, 10_000_000] {
        let zeros = zstd::bulk::compress(&vec![0; length], 1).unwrap();
        assert!(
            matches!(decode(&zeros), Err(Error::Corrupt { .. })),
            "{length} zeros"
        );
    }
}

#[test]
fn columns_come_back_bit_by_bit() {
    let manifest = manifest(8, 8, 4, 0.01);
    let count = manifest.column_texels();
    let mut column = common::column(&manifest, 0);
    column.texels[1] = [f16::NEG_ZERO, f16::MIN_POSITIVE_SUBNORMAL, f16::MAX, f16::MIN];
    let bytes = encode_column(&column).unwrap();
    let decoded = decode_column(&manifest, 0, &bytes).unwrap();
    let bits = |column: &Column| {
        column
            .texels
            .iter()
            .flatten()
            .map(|value| value.to_bits())
            .collect::<Vec<_>>()
    };
    assert_eq!(bits(&decoded), bits(&column));

    for length in 0..bytes.len() {
        assert!(matches!(
            decode_column(&manifest, 0, &bytes[..length]),
            Err(Error::Corrupt { .. })
        ));
    }
    assert!(decode_column(&manifest, 0, &[&bytes[..], &[0]].concat()).is_err());
    let more = encode_column(&Column {
        texels: vec![[f16::ONE; 4]; count + 3],
    })
    .unwrap();
    assert!(matches!(
        decode_column(&manifest, 0, &more),
        Err(Error::Corrupt { .. })
    ));
    for value in [f16::NAN, f16::INFINITY] {
        column.texels[0][3] = value;
        assert!(matches!(encode_column(&column), Err(Error::Invalid { .. })));
    }
    let infinite = zstd::bulk::compress(&vec![0x7c; count * 8], 1).unwrap();
    assert!(matches!(
        decode_column(&manifest, 0, &infinite),
        Err(Error::Corrupt { .. })
    ));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_size_round_trips(width in 1u32..180, height in 1u32..180, wrap: bool, seed: u32, step in 0.002f64..0.3) {
        check(image(width, height, seed), wrap, step);
    }

    #[test]
    fn any_column_round_trips(bits in prop::collection::vec(any::<[u16; 4]>(), 60)) {
        let texels = bits.iter().map(|texel| texel.map(|bits| {
            let value = f16::from_bits(bits);
            if value.is_finite() { value } else { f16::ZERO }
        }));
        let column = Column { texels: texels.collect() };
        let manifest = manifest(8, 8, 4, 0.01);
        let decoded = decode_column(&manifest, 0, &encode_column(&column).unwrap()).unwrap();
        for (a, b) in decoded.texels.iter().flatten().zip(column.texels.iter().flatten()) {
            prop_assert_eq!(a.to_bits(), b.to_bits());
        }
    }

    #[test]
    fn any_symbols_decode_or_are_refused(symbols in prop::collection::vec(any::<u8>(), 256..400), parent: u16) {
        let pyramid = Pyramid::new(8, 8, true).unwrap();
        let record = zstd::bulk::compress(&symbols, 1).unwrap();
        let page = PageId { group: parent, tile: pyramid.root() };
        match decode_page(CODEC, &pyramid, page, &record, None) {
            Ok(page) => prop_assert!(page.texels.iter().flatten().all(|value| value.is_finite())),
            Err(error) => {
                let refused = matches!(error, Error::Corrupt { .. });
                prop_assert!(refused, "{}", error);
            }
        }
    }
}
