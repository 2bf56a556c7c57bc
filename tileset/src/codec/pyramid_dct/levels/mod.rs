//! The levels of a block to symbols and back.
//!
//! A block opens with the number of diagonals that hold a level other than zero, for all four components together, and,
//! unless there are none, says which block before it in the page it goes on from; then come the levels of these
//! diagonals, four at each place. A level in units of 2^shift is one symbol up to
//! ±[`LARGEST_SYMBOL`]; beyond that, or where the model has never seen it, an escape and an Elias gamma code. The
//! shifted bits follow as they are.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod read;
mod write;

pub(super) use read::Reader;
pub(super) use write::{Chosen, Coder, Found, Sink, choose_levels};

/// Largest level, in units of 2^shift, that is a symbol of its own.
pub(super) const LARGEST_SYMBOL: u32 = 30;
/// The symbol that stands for any other level.
pub(super) const ESCAPE: usize = 2 * LARGEST_SYMBOL as usize + 1;
/// Symbols of a level.
pub(super) const SYMBOLS: usize = ESCAPE + 1;
/// Largest accepted level.
pub(super) const MAX_LEVEL: i32 = 1 << 28;
/// Models of the number of diagonals: by that of the block before.
pub(super) const END_MODELS: usize = 8;
/// Symbols that say to which block before a block adds: 0 for none, else how many blocks back, in the order of the page.
pub(super) const SOURCES: usize = 16;
/// Models of sources: by whether the last block that was asked had one.
pub(super) const SOURCE_MODELS: usize = 2;

/// The model of a block's source, from that of the last block that has levels.
pub(super) fn source_model(last: usize) -> usize {
    usize::from(last > 0)
}

/// The model of a block's number of diagonals, from that of the block before.
pub(super) fn end_model(last: usize) -> usize {
    // 0 stands for an empty block.
    (last.div_ceil(4)).min(END_MODELS - 1)
}

/// The symbol of a level in units of 2^shift, if it has one: 0, 1, -1, 2, …
pub(super) fn symbol_of(level: i32, shift: u8) -> Option<usize> {
    let magnitude = level.unsigned_abs() >> shift;
    match magnitude {
        0 => Some(0),
        1..=LARGEST_SYMBOL => Some(2 * magnitude as usize - usize::from(level > 0)),
        _ => None,
    }
}
