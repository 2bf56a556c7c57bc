//! The directory: how long each record is and what it weighs. Where it lies follows from these.
//!
//! Both are told well by what is known before: the same page in the group before, and what changed there beside it. So
//! each is predicted, and the difference is coded by a range coder that learns. Reading and writing are the same code.

mod quantity;
mod range;

use quantity::{Lengths, OCTAVE, Quantity, Track, Weights};
use range::{Coder, Decoder, Encoder, Odds};

use super::{Record, index::CHECKSUM_BYTES};
use crate::{
    Error, GROUP_COMPONENTS, MAX_COMPONENTS, Pyramid, Result,
    codec::{MAX_COLUMN_BYTES, MAX_PAGE_BYTES},
    manifest::MAX_PAGES,
};

/// Largest accepted directory as it is stored: eight bytes for each entry.
pub(super) const MAX_DIRECTORY_BYTES: u32 = (MAX_PAGES + MAX_COMPONENTS / GROUP_COMPONENTS as u32) * 8;

const WEIGHT_SHIFT: u32 = f32::MANTISSA_DIGITS - 1 - Weights::MANTISSA;

/// A weight as the directory has it: the nearest float of four bits of mantissa, which is within 3.2 %.
pub(super) fn stored_weight(weight: f32) -> f32 {
    let code = weight.to_bits().saturating_add(1 << (WEIGHT_SHIFT - 1)) >> WEIGHT_SHIFT;
    // Not up to infinity.
    f32::from_bits(code.min(Weights::LARGEST) << WEIGHT_SHIFT)
}

/// The directory of these columns and pages, whose weights are those of [`stored_weight`].
pub(super) fn encode(pyramid: &Pyramid, columns: &[Record], pages: &[Record]) -> Result<Vec<u8>> {
    let mut encoder = Encoder::new();
    let (mut columns, mut pages) = (columns.to_vec(), pages.to_vec());
    code(&mut encoder, pyramid, &mut columns, &mut pages, |_| Ok(())).map_err(|detail| Error::Invalid {
        what: "record".into(),
        detail,
    })?;
    let bytes = encoder.finish();
    match u32::try_from(bytes.len()) {
        Ok(length) if length <= MAX_DIRECTORY_BYTES => Ok(bytes),
        _ => Err(Error::OverLimit {
            what: "bytes of the directory",
            found: bytes.len() as u64,
            limit: MAX_DIRECTORY_BYTES.into(),
        }),
    }
}

/// The inverse of [`encode`] for an archive of so many groups; all records get this offset. The message says what is wrong.
pub(super) fn decode(
    stored: &[u8],
    pyramid: &Pyramid,
    groups: usize,
    offset: u64,
) -> std::result::Result<(Vec<Record>, Vec<Record>), String> {
    let empty = Record {
        offset,
        length: 0,
        weight: 0.0,
    };
    let mut columns = vec![empty; groups];
    let mut pages = vec![empty; groups * pyramid.tile_count() as usize];
    let mut decoder = Decoder::new(stored);
    let missing = |decoder: &Decoder<'_>| match decoder.left() {
        0.. => Ok(()),
        _ => Err(format!("it ends after {} bytes, more are needed", stored.len())),
    };
    code(&mut decoder, pyramid, &mut columns, &mut pages, missing)?;
    match decoder.left() {
        0 => Ok((columns, pages)),
        left => Err(format!("{left} bytes follow its last entry")),
    }
}

/// Codes all entries: those of the columns by group, then those of the pages, group by group. After each, `sound` says
/// whether to go on.
fn code<C: Coder>(
    coder: &mut C,
    pyramid: &Pyramid,
    columns: &mut [Record],
    pages: &mut [Record],
    sound: impl Fn(&C) -> std::result::Result<(), String>,
) -> std::result::Result<(), String> {
    let mut models = Models::new(MAX_COLUMN_BYTES);
    let mut last = Seen::START;
    for (group, record) in columns.iter_mut().enumerate() {
        last = models
            .code(coder, last, [last; 3], record)
            .map_err(|detail| format!("column {group}: {detail}"))?;
        sound(coder)?;
    }

    let mut models = Models::new(MAX_PAGE_BYTES);
    let near = neighbours(pyramid);
    // Of each tile the latest page: of this group if it came already, else of the group before.
    let mut seen = vec![Seen::START; near.len()];
    for (group, pages) in pages.chunks_mut(near.len()).enumerate() {
        for (tile, (record, near)) in pages.iter_mut().zip(&near).enumerate() {
            let near = near.map(|tile| seen[tile as usize]);
            let before = if group == 0 { near[2] } else { seen[tile] };
            seen[tile] = models
                .code(coder, before, near, record)
                .map_err(|detail| format!("page {tile} of group {group}: {detail}"))?;
            sound(coder)?;
        }
    }
    Ok(())
}

/// Of each tile three that come before it: the one beside it, left or else above; the one above it or else at its left; and its parent.
/// At the upper left corner all are the parent; of the root the root itself.
fn neighbours(pyramid: &Pyramid) -> Vec<[u32; 3]> {
    let mut near = Vec::with_capacity(pyramid.tile_count() as usize);
    let mut parents = (0, 1);
    for mip in (0..=pyramid.tail_mip()).rev() {
        let base = near.len() as u32;
        let (columns, rows) = pyramid.grid(mip);
        for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
            let this = base + y * columns + x;
            let parent = parents.0 + y / 2 * parents.1 + x / 2;
            let left = (x > 0).then(|| this - 1);
            let above = (y > 0).then(|| this - columns);
            near.push([
                left.or(above).unwrap_or(parent),
                above.or(left).unwrap_or(parent),
                parent,
            ]);
        }
        parents = (base, columns);
    }
    near
}

/// What is kept of an entry for those that follow.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// Whether there is a record.
    stored: bool,
    /// Whether its weight is not zero.
    weighs: bool,
    weight: Track,
    length: Track,
}

impl Seen {
    /// What stands for entries before the first: a weight of 1, and 4096 bytes, give or take an octave.
    const START: Self = Self {
        stored: true,
        weighs: true,
        weight: Track {
            value: 127 * OCTAVE,
            step: 0,
            error: OCTAVE,
        },
        length: Track {
            value: 12 * OCTAVE,
            step: 0,
            error: OCTAVE,
        },
    };
}

/// What is learnt of columns, or of pages.
struct Models {
    lengths: Lengths,
    /// Is there a record? By whether there is one before, beside and of the parent.
    stored: [Odds; 8],
    /// Does it weigh anything? By whether there is a record, and whether the one before weighs anything.
    weighs: [Odds; 4],
    weight: Quantity<2>,
    length: Quantity<5>,
}

impl Models {
    fn new(longest: u32) -> Self {
        Self {
            lengths: Lengths(longest),
            stored: [Odds::EVEN; 8],
            weighs: [Odds::EVEN; 4],
            weight: Quantity::new([28_672, 20_480], 6),
            length: Quantity::new([20_480, 20_480, 20_480, -8192, -8192], 3),
        }
    }

    /// Codes an entry; `near` are [`neighbours`].
    fn code(
        &mut self,
        coder: &mut impl Coder,
        before: Seen,
        near: [Seen; 3],
        record: &mut Record,
    ) -> std::result::Result<Seen, String> {
        let [beside, above, parent] = near;
        let which = |bits: &[bool]| bits.iter().fold(0, |sum, &bit| 2 * sum + usize::from(bit));
        let code = record.weight.to_bits() >> WEIGHT_SHIFT;
        let stored = &mut self.stored[which(&[before.stored, beside.stored, parent.stored])];
        let stored = coder.bit(stored, record.length > 0);
        let weighs = coder.bit(&mut self.weighs[which(&[stored, before.weighs])], code > 0);

        let inputs = [beside.weight.step, above.weight.step];
        let tracks = (before.weight, near.map(|seen| seen.weight));
        let (code, weight) = self
            .weight
            .code(coder, &Weights, tracks, inputs, weighs.then_some(code))
            .map_err(|detail| format!("its weight is number {detail}"))?;

        let inputs = [
            weight.step,
            beside.length.step,
            above.length.step,
            beside.weight.step,
            above.weight.step,
        ];
        let tracks = (before.length, near.map(|seen| seen.length));
        let contents = record.length.saturating_sub(CHECKSUM_BYTES);
        let (contents, length) = self
            .length
            .code(coder, &self.lengths, tracks, inputs, stored.then_some(contents))
            .map_err(|detail| format!("its contents have {detail} bytes"))?;
        record.length = if stored { contents + CHECKSUM_BYTES } else { 0 };
        record.weight = f32::from_bits(code << WEIGHT_SHIFT);
        Ok(Seen {
            stored,
            weighs,
            weight,
            length,
        })
    }
}

#[cfg(test)]
mod tests;
