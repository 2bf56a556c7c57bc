//! Quantized coefficients to bytes and back.
//!
//! A coefficient becomes one byte: 0, -1, 1, -2, 2 … are 0, 1, 2, 3, 4 …, and what does not fit is marked
//! by 255 and follows behind all bytes in four. The bytes lie component by component, in it position by
//! position from low to high frequency, and there block by block, so that zstd finds neighbours that are
//! alike. Packing four small values into a byte where they are rare was measured, too: it saves 2 % at
//! most.

use super::dct::{BLOCK, BLOCK_AREA};

/// Largest magnitude of a coefficient in steps. A product with the step is then still exact to one rounding.
pub(crate) const MAX_LEVEL: i32 = (1 << 23) - 1;
const ESCAPE: u8 = u8::MAX;

/// The quantized coefficients of one block, `[v][u][component]`.
pub(crate) type Levels = [[i32; 4]; BLOCK_AREA];

/// Positions in a block from low to high frequency.
const SCAN: [usize; BLOCK_AREA] = scan();

const fn scan() -> [usize; BLOCK_AREA] {
    let mut order = [0; BLOCK_AREA];
    let (mut i, mut diagonal) = (0, 0);
    while diagonal < 2 * BLOCK - 1 {
        let mut step = 0;
        while step <= diagonal {
            let (u, v) = if diagonal % 2 == 0 {
                (step, diagonal - step)
            } else {
                (diagonal - step, step)
            };
            if u < BLOCK && v < BLOCK {
                order[i] = v * BLOCK + u;
                i += 1;
            }
            step += 1;
        }
        diagonal += 1;
    }
    order
}

/// Most bytes that [`pack`] makes of so many blocks.
pub(crate) const fn packed_bound(blocks: usize) -> usize {
    blocks * BLOCK_AREA * 4 * 5
}

/// 0, -1, 1, -2, 2 … to 0, 1, 2, 3, 4 …
pub(crate) fn code_from_level(level: i32) -> u32 {
    ((level << 1) ^ (level >> 31)) as u32
}

fn level_from_code(code: u32) -> i32 {
    (code >> 1) as i32 ^ -((code & 1) as i32)
}

/// Blocks row by row to bytes.
pub(crate) fn pack(blocks: &[Levels]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(blocks.len() * BLOCK_AREA * 4);
    let mut escapes = Vec::new();
    for component in 0..4 {
        for position in SCAN {
            for block in blocks {
                let level = block[position][component];
                let code = code_from_level(level);
                bytes.push(code.min(ESCAPE.into()) as u8);
                if code >= u32::from(ESCAPE) {
                    escapes.extend(code.to_le_bytes());
                }
            }
        }
    }
    bytes.extend(escapes);
    bytes
}

/// The inverse of [`pack`] for so many blocks; the message says why it fails.
pub(crate) fn unpack(bytes: &[u8], blocks: usize) -> Result<Vec<Levels>, String> {
    let count = blocks * BLOCK_AREA * 4;
    let Some((codes, escapes)) = bytes.split_at_checked(count) else {
        return Err(format!("{} bytes hold no {count} coefficients", bytes.len()));
    };
    let mut levels = vec![[[0; 4]; BLOCK_AREA]; blocks];
    for (index, block) in levels.iter_mut().enumerate() {
        for (i, &position) in SCAN.iter().enumerate() {
            block[position] = std::array::from_fn(|component| {
                level_from_code(codes[(component * BLOCK_AREA + i) * blocks + index].into())
            });
        }
    }
    let (escapes, rest) = escapes.as_chunks::<4>();
    let mut escapes = escapes.iter();
    for (at, _) in codes.iter().enumerate().filter(|(_, code)| **code == ESCAPE) {
        let Some(escape) = escapes.next() else {
            return Err("a large coefficient is missing".into());
        };
        let code = u32::from_le_bytes(*escape);
        if code < u32::from(ESCAPE) || code > 2 * MAX_LEVEL as u32 {
            return Err(format!("{code} is no code of a large coefficient"));
        }
        let (plane, block) = (at / blocks, at % blocks);
        levels[block][SCAN[plane % BLOCK_AREA]][plane / BLOCK_AREA] = level_from_code(code);
    }
    if escapes.len() > 0 || !rest.is_empty() {
        return Err("bytes follow the last coefficient".into());
    }
    Ok(levels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_scan_is_jpegs() {
        assert_eq!(SCAN[..12], [0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25]);
        assert_eq!(SCAN[58..], [53, 60, 61, 54, 47, 55, 62, 63][2..]);
        let mut all = SCAN;
        all.sort_unstable();
        assert!(all.into_iter().eq(0..BLOCK_AREA));
    }

    #[test]
    fn bytes_lie_component_by_component_and_large_values_behind() {
        let mut blocks = [[[0; 4]; BLOCK_AREA]; 2];
        blocks[0][0][0] = -1;
        blocks[1][0][0] = 1;
        blocks[1][8][3] = 200;
        let bytes = pack(&blocks);
        let codes = 2 * 64 * 4;
        assert_eq!(bytes.len(), codes + 4);
        assert_eq!(bytes[..2], [1, 2]);
        assert_eq!(bytes[3 * 128 + 2 * 2 + 1], 255);
        assert_eq!(bytes[codes..], 400u32.to_le_bytes());
        assert_eq!(unpack(&bytes, 2).unwrap(), blocks);
        assert!(unpack(&bytes[..bytes.len() - 1], 2).is_err());
        assert!(unpack(&bytes[..codes], 2).is_err());
        assert!(unpack(&[&bytes[..], &[0; 4]].concat(), 2).is_err());
        assert!(unpack(&[], 2).is_err());
        for code in [0u32, 254, 2 * MAX_LEVEL as u32 + 1, u32::MAX] {
            let mut bad = bytes.clone();
            bad[codes..].copy_from_slice(&code.to_le_bytes());
            assert!(unpack(&bad, 2).is_err(), "{code} must not be escaped");
        }
    }

    proptest! {
        #[test]
        fn levels_round_trip(
            values in prop::collection::vec((0usize..64, 0usize..4, -MAX_LEVEL..=MAX_LEVEL), 0..40),
        ) {
            let mut blocks = [[[0; 4]; BLOCK_AREA]; 3];
            for (i, (position, component, level)) in values.into_iter().enumerate() {
                blocks[i % 3][position][component] = level;
            }
            let bytes = pack(&blocks);
            prop_assert!(bytes.len() <= packed_bound(3));
            prop_assert_eq!(unpack(&bytes, 3).unwrap(), blocks);
        }
    }
}
