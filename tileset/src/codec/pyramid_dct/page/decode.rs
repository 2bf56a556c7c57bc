//! Records to pages.

use half::f16;

use super::{Blocks, Place, low_scale, parent_origin, scan_of, step_at};
use crate::codec::pyramid_dct::border;
use crate::codec::pyramid_dct::dispatch::{self, Processor};
use crate::codec::pyramid_dct::levels::Reader;
use crate::codec::pyramid_dct::tables::PageTables;
use crate::codec::pyramid_dct::transform::{AREA, Block, SIDE, forward_here, inverse_here};
use crate::codec::{page::check_step, region::HALF_MAX, texel::Texel};
use crate::error::corrupt;
use crate::{BORDER_TEXELS, Error, Page, PageId, Pyramid, Result, SLOT_AREA, SLOT_TEXELS, Tile};

/// Decodes a page's record; see [`crate::codec::Decoder::page`].
pub(crate) fn decode(
    step: f64,
    pyramid: &Pyramid,
    page: PageId,
    bytes: &[u8],
    parent: Option<&Page>,
    tables: &PageTables,
) -> Result<Page> {
    let parent = parent_of(pyramid, page.tile, parent)?;
    let mut decoded = Page {
        texels: vec![[f16::ZERO; 4]; SLOT_AREA],
    };
    let payload = Payload::new(step, pyramid, page, bytes, parent, tables, &mut decoded.texels)?;
    dispatch::run(payload).map_err(|detail| corrupt(page.to_string(), 0, detail))?;
    border::fill(pyramid, page.tile, &mut decoded, parent.map(|(parent, _)| parent));
    Ok(decoded)
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
        for corner in self.blocks.corners() {
            let place = self.blocks.place(corner);
            let mut end = 0;
            block.fill(Texel::default());
            if let Some(reader) = &mut self.reader {
                end = processor.read(reader, scan_of(&place, &mut spare), self.step, &mut block);
            }
            if let Some((parent, origin)) = self.parent {
                low_coefficients(processor, &mut block, parent, origin, &place);
            }
            inverse_here(&mut block, place.size, end.max(place.low.0).max(place.low.1));
            put(processor, &block, &place, self.slot);
        }
        self.reader.map_or(Ok(()), Reader::finish)
    }
}

/// Puts a block's texels into the slot.
#[inline(always)]
fn put(processor: impl Processor, block: &Block, place: &Place, slot: &mut [[f16; 4]]) {
    const BORDER: usize = BORDER_TEXELS as usize;
    let rows: &[[f32; 4 * SIDE]; SIDE] = bytemuck::cast_ref(block);
    let slot = slot.chunks_exact_mut(SLOT_TEXELS as usize).skip(place.y + BORDER);
    for (to, row) in slot.zip(rows).take(place.size.1) {
        // What lies above the range of half floats, or is no number, which only a damaged record asks for, must become
        // neither infinite nor different from processor to processor. (`clamp` keeps what is no number.)
        let row = row.map(|value| if value > -HALF_MAX { value } else { -HALF_MAX });
        let row = row.map(|value| if value < HALF_MAX { value } else { HALF_MAX });
        let halves: [[f16; 4]; SIDE] = bytemuck::cast(processor.halves(&row));
        let to = &mut to[place.x + BORDER..];
        match to.first_chunk_mut() {
            // All at once, which is no call.
            Some(to) if place.size.0 == SIDE => *to = halves,
            _ => to[..place.size.0].copy_from_slice(&halves[..place.size.0]),
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
    const HALF_SIDE: usize = SIDE / 2;
    let (width, height) = place.low;
    let mut low: Block = [Texel::default(); AREA];
    let rows = parent
        .texels
        .chunks_exact(SLOT_TEXELS as usize)
        .skip(origin.1 + place.y / 2);
    for (to, row) in low.as_chunks_mut::<SIDE>().0.iter_mut().zip(rows).take(height) {
        let row = &row[origin.0 + place.x / 2..];
        let mut halves = [[f16::ZERO; 4]; HALF_SIDE];
        match row.first_chunk() {
            Some(row) if width == HALF_SIDE => halves = *row,
            _ => halves[..width].copy_from_slice(&row[..width]),
        }
        let floats: [Texel; HALF_SIDE] = bytemuck::cast(processor.floats(&bytemuck::cast(halves)));
        to[..HALF_SIDE].copy_from_slice(&floats);
    }
    forward_here(&mut low, place.low);
    let factor = low_scale(place.size, place.low);
    for u in 0..width {
        for (to, low) in block[u * SIDE..].iter_mut().zip(&low[u * SIDE..]).take(height) {
            *to = *low * factor;
        }
    }
}
