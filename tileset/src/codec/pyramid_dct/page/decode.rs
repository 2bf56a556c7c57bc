//! Records to pages.

use half::f16;

use super::source::Before;
use super::{Blocks, Place, low_scale, parent_origin, scan_of, step_at};
use crate::codec::pyramid_dct::border;
use crate::codec::pyramid_dct::context::Expected;
use crate::codec::pyramid_dct::dispatch::{self, Eight, Processor};
use crate::codec::pyramid_dct::full;
use crate::codec::pyramid_dct::levels::Reader;
use crate::codec::pyramid_dct::tables::PageTables;
use crate::codec::pyramid_dct::transform::{AREA, Block, SIDE, forward_here, inverse_here};
use crate::codec::{page::check_step, region::HALF_MAX, texel::Texel};
use crate::error::corrupt;
use crate::{BORDER_TEXELS, Error, PAGE_TEXELS, Page, PageId, Pyramid, Result, SLOT_AREA, SLOT_TEXELS, Tile};

/// Decodes a page's record into `decoded`; see [`crate::codec::Decoder::page_into`].
pub(crate) fn decode_into(
    step: f64,
    pyramid: &Pyramid,
    page: PageId,
    bytes: &[u8],
    parent: Option<&Page>,
    tables: &PageTables,
    decoded: &mut Page,
) -> Result<()> {
    let parent = parent_of(pyramid, page.tile, parent)?;
    if decoded.texels.len() != SLOT_AREA {
        decoded.texels = vec![[f16::ZERO; 4]; SLOT_AREA];
    } else if pyramid.payload(page.tile) != (PAGE_TEXELS, PAGE_TEXELS) {
        // A full page has a payload or a border everywhere.
        decoded.texels.fill([f16::ZERO; 4]);
    }
    let payload = Payload::new(step, pyramid, page, bytes, parent, tables, &mut decoded.texels)?;
    dispatch::run(payload).map_err(|detail| corrupt(page.to_string(), 0, detail))?;
    border::fill(pyramid, page.tile, decoded, parent.map(|(parent, _)| parent));
    Ok(())
}

/// A page to decode, but for its border.
pub(super) struct Payload<'a> {
    blocks: Blocks,
    step: f32,
    /// `None` if the page says nothing that its parent does not.
    reader: Option<Reader<'a>>,
    /// The parent and where in its slot the first texel under this page lies.
    parent: Option<(&'a Page, (usize, usize))>,
    slot: &'a mut [[f16; 4]],
}

impl<'a> Payload<'a> {
    pub(super) fn new(
        step: f64,
        pyramid: &Pyramid,
        page: PageId,
        bytes: &'a [u8],
        parent: Option<(&'a Page, (usize, usize))>,
        tables: &'a PageTables,
        slot: &'a mut [[f16; 4]],
    ) -> Result<Self> {
        let means = tables.means(page.tile.mip, page.group);
        let reader = match bytes {
            [] => None,
            _ => {
                let reader = Reader::new(bytes, tables, means);
                Some(reader.map_err(|detail| corrupt(page.to_string(), 0, detail))?)
            }
        };
        Ok(Self {
            blocks: Blocks::new(pyramid, page.tile),
            step: step_at(check_step(step)?, page.tile.mip),
            reader,
            parent,
            slot,
        })
    }
}

impl dispatch::Work for Payload<'_> {
    type Output = std::result::Result<(), String>;

    #[inline(always)]
    fn run(mut self, processor: impl Processor) -> Self::Output {
        let mut spare = None;
        let mut block: Block = [Texel::default(); AREA];
        let mut expected = Expected::new();
        let mut before = Before::new();
        let mut lines = full::lines(processor);
        for corner in self.blocks.corners() {
            let place = self.blocks.place(corner);
            let scan = scan_of(&place, &mut spare);
            let mut end = 0;
            if let Some(reader) = &mut self.reader {
                end = before.read(
                    processor,
                    reader,
                    &place,
                    scan,
                    self.step,
                    &mut block,
                    &mut expected,
                )?;
            }
            match (self.parent, over(self.slot, &place)) {
                (Some((parent, origin)), Some(over)) if let Some(under) = under(parent, origin, &place) => {
                    full::texels(processor, under, &block, end, &mut lines, over);
                }
                (parent, _) => {
                    let mut block = block;
                    if let Some((parent, origin)) = parent {
                        low_coefficients(processor, &mut block, parent, origin, &place);
                    }
                    inverse_here(&mut block, place.size, end.max(place.low.0).max(place.low.1));
                    put(processor, &block, &place, self.slot);
                }
            }
            for place in scan.places(end) {
                block[usize::from(place.at)] = Texel::default();
            }
        }
        self.reader.map_or(Ok(()), Reader::finish)
    }
}

/// The place of a full block in the slot.
#[inline(always)]
fn over<'a>(slot: &'a mut [[f16; 4]], place: &Place) -> Option<&'a mut full::Over> {
    let at = (place.y + BORDER) * SLOT_TEXELS as usize + place.x + BORDER;
    match place.size {
        (SIDE, SIDE) => slot.get_mut(at..)?.first_chunk_mut(),
        _ => None,
    }
}

/// What the parent has under a full block.
#[inline(always)]
fn under<'a>(parent: &'a Page, origin: (usize, usize), place: &Place) -> Option<&'a full::Under> {
    let at = (origin.1 + place.y / 2) * SLOT_TEXELS as usize + origin.0 + place.x / 2;
    parent.texels.get(at..)?.first_chunk()
}

const BORDER: usize = BORDER_TEXELS as usize;

/// Puts a block's texels into the slot.
#[inline(always)]
fn put(processor: impl Processor, block: &Block, place: &Place, slot: &mut [[f16; 4]]) {
    let rows: &[[f32; 4 * SIDE]; SIDE] = bytemuck::cast_ref(block);
    let slot = slot.chunks_exact_mut(SLOT_TEXELS as usize).skip(place.y + BORDER);
    for (to, row) in slot.zip(rows).take(place.size.1) {
        let to = &mut to[place.x + BORDER..][..place.size.0];
        for (to, floats) in to.chunks_mut(2).zip(row.as_chunks().0) {
            // What lies above the range of half floats, or is no number, which only a damaged record asks for, must
            // become neither infinite nor different from processor to processor.
            let halves = processor.eight(*floats).within(HALF_MAX).halves();
            let halves: [[f16; 4]; 2] = bytemuck::cast(halves);
            to.copy_from_slice(&halves[..to.len()]);
        }
    }
}

/// The parent and where in its slot the first texel under this page lies.
pub(super) fn parent_of<'a>(
    pyramid: &Pyramid,
    tile: Tile,
    parent: Option<&'a Page>,
) -> Result<Option<(&'a Page, (usize, usize))>> {
    let origin = parent_origin(pyramid, tile)?;
    let invalid = |detail: &str| Error::Invalid {
        what: format!("parent of the page at mip {} x {} y {}", tile.mip, tile.x, tile.y),
        detail: detail.into(),
    };
    match (origin, parent) {
        (None, None) => Ok(None),
        (None, Some(_)) => Err(invalid("the root has none")),
        (Some(_), None) => Err(invalid("it is needed to decode the page, decode it first")),
        (Some(_), Some(page)) if page.texels.len() != SLOT_AREA => Err(invalid("it is not one slot")),
        (Some(origin), Some(page)) => Ok(Some((page, origin))),
    }
}

/// Puts the transform of what the parent has under a block into its lowest coefficients.
#[inline(always)]
fn low_coefficients(
    processor: impl Processor,
    block: &mut Block,
    parent: &Page,
    origin: (usize, usize),
    place: &Place,
) {
    let (width, height) = place.low;
    let mut low: Block = [Texel::default(); AREA];
    let rows = parent
        .texels
        .chunks_exact(SLOT_TEXELS as usize)
        .skip(origin.1 + place.y / 2);
    for (to, row) in low.as_chunks_mut::<SIDE>().0.iter_mut().zip(rows).take(height) {
        let row = &row[origin.0 + place.x / 2..][..width];
        for (to, from) in to.chunks_mut(2).zip(row.chunks(2)) {
            let mut halves = [[f16::ZERO; 4]; 2];
            halves[..from.len()].copy_from_slice(from);
            let floats = processor.eight_halves(bytemuck::cast(halves)).floats();
            to[..from.len()].copy_from_slice(&bytemuck::cast::<_, [Texel; 2]>(floats)[..from.len()]);
        }
    }
    forward_here(&mut low, place.low);
    let factor = low_scale(place.size, place.low);
    for u in 0..width {
        for (to, low) in block[u * SIDE..].iter_mut().zip(&low[u * SIDE..]).take(height) {
            *to = *low * factor;
        }
    }
}
