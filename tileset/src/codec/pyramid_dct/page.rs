//! Whole pages: blocks, parents, steps.

use std::sync::LazyLock;

use half::{f16, slice::HalfFloatSliceExt};

use super::context::Context;
use super::levels::{self, Coder, MAX_LEVEL, Reader, Sink};
use super::scan::Scan;
use super::tables::{Counter, PageTables, Statistics};
use super::transform::{AREA, Block, SIDE, forward, forward_here, inverse_here};
use super::{border, dispatch};
use crate::codec::rans::Encoder;
use crate::codec::{MipImage, page::check_step, region::HALF_MAX, texel::Texel};
use crate::error::corrupt;
use crate::{BORDER_TEXELS, Error, PAGE_TEXELS, Page, PageId, Pyramid, Result, SLOT_AREA, SLOT_TEXELS, Tile};

/// Squared error, in squared steps, that one bit may save: at high rates the error is step²/12 and falls to a
/// quarter with each bit, so its slope is 2·ln 2 / 12.
const ERROR_PER_BIT: f32 = std::f32::consts::LN_2 / 6.0;
/// Rounding before anything is known of the distribution.
const FIRST_ROUNDING: f32 = 0.4;

/// One page's record.
#[derive(Clone, Debug, PartialEq)]
pub struct CodedPage {
    /// Where.
    pub tile: Tile,
    /// The record; empty if the page says nothing that its parent does not.
    pub bytes: Vec<u8>,
    /// Mean squared difference of the decoded page to its parent as the transform up-samples it, over the payload,
    /// summed over the group's components (paper, equation 8); for the root the mean square of the page itself.
    pub weight: f64,
}

/// The blocks of a page, row by row.
struct Blocks {
    width: usize,
    height: usize,
    root: bool,
}

/// A block: place in the payload, size, and what the parent gives.
#[derive(Clone, Copy)]
struct Place {
    x: usize,
    y: usize,
    size: (usize, usize),
    /// Columns and rows of coefficients that come from the parent.
    low: (usize, usize),
}

impl Blocks {
    fn new(pyramid: &Pyramid, tile: Tile) -> Self {
        let (width, height) = pyramid.payload(tile);
        Self {
            width: width as usize,
            height: height as usize,
            root: tile == pyramid.root(),
        }
    }

    /// Upper left corners of the blocks.
    fn corners(&self) -> impl Iterator<Item = (usize, usize)> {
        let (across, down) = (self.width.div_ceil(SIDE), self.height.div_ceil(SIDE));
        (0..across * down).map(move |i| (i % across * SIDE, i / across * SIDE))
    }

    /// The block at a corner.
    #[inline(always)]
    fn place(&self, (x, y): (usize, usize)) -> Place {
        let size = (SIDE.min(self.width - x), SIDE.min(self.height - y));
        let low = if self.root {
            (0, 0)
        } else {
            (size.0.div_ceil(2), size.1.div_ceil(2))
        };
        Place { x, y, size, low }
    }
}

/// The order of a block's coefficients: made once for full blocks, into `spare` for others.
fn scan_of<'a>(place: &Place, spare: &'a mut Option<Scan>) -> &'a Scan {
    static FULL: LazyLock<[Scan; 2]> =
        LazyLock::new(|| [(0, 0), (SIDE / 2, SIDE / 2)].map(|low| Scan::new((SIDE, SIDE), low)));
    match (place.size, place.low) {
        ((SIDE, SIDE), (0, 0)) => &FULL[0],
        ((SIDE, SIDE), _) => &FULL[1],
        (size, low) => spare.insert(Scan::new(size, low)),
    }
}

/// The step at a mip, in units of its texels: there a coefficient of the same error stands for 4^mip times as many of
/// the finest.
fn step_at(step: f32, mip: u8) -> f32 {
    step / (1u64 << mip.min(32)) as f32
}

/// What a coefficient of a parent's block of `low` is in a block of `size`: the square root of their areas' ratio.
fn low_scale(size: (usize, usize), low: (usize, usize)) -> f32 {
    ((size.0 * size.1) as f32 / (low.0 * low.1) as f32).sqrt()
}

/// Codes all pages of a group; `mips` are those of the pyramid down to the tail, the finest first. `step` is in units
/// of texels of the finest mip.
///
/// # Errors
/// [`Error::Invalid`] for mips of other sizes, values that half floats cannot hold, a step that is too small for the
/// values, and tables without models.
pub fn code_group(
    step: f64,
    pyramid: &Pyramid,
    group: u16,
    mips: &[MipImage],
    tables: &PageTables,
) -> Result<Vec<CodedPage>> {
    if !tables.is_trained() {
        return Err(Error::Invalid {
            what: "tables of the page codec".into(),
            detail: "they have no models yet".into(),
        });
    }
    check(pyramid, mips)?;
    let mut pages = Vec::with_capacity(pyramid.tile_count() as usize);
    for tile in pyramid.tiles() {
        let mut coder = Coder {
            tables,
            encoder: Encoder::default(),
            energy: 0.0,
        };
        let page = PageId { group, tile };
        let coded = walk(
            step,
            pyramid,
            page,
            &mips[usize::from(tile.mip)],
            tables,
            &mut coder,
        )?;
        let (width, height) = pyramid.payload(tile);
        let mip_step = f64::from(step_at(step as f32, tile.mip));
        pages.push(CodedPage {
            tile,
            bytes: if coded { coder.encoder.finish() } else { Vec::new() },
            weight: coder.energy * mip_step * mip_step / f64::from(width * height),
        });
    }
    Ok(pages)
}

/// Counts what the levels of a group would be. The first round knows no tables, the second those of the sums of the
/// first, which have no models yet; from then on each round comes closer to what will be coded.
///
/// # Errors
/// As [`code_group`].
pub fn count_group(
    step: f64,
    pyramid: &Pyramid,
    (group, groups): (u16, u32),
    mips: &[MipImage],
    tables: Option<&PageTables>,
) -> Result<Statistics> {
    check(pyramid, mips)?;
    let mut statistics = Statistics::new(pyramid, groups, tables.is_some());
    let none = Statistics::new(pyramid, groups, false).tables();
    for tile in pyramid.tiles() {
        let mut counter = Counter {
            statistics: &mut statistics,
            mip: tile.mip,
            group,
        };
        let page = PageId { group, tile };
        walk(
            step,
            pyramid,
            page,
            &mips[usize::from(tile.mip)],
            tables.unwrap_or(&none),
            &mut counter,
        )?;
    }
    Ok(statistics)
}

/// Transforms a page and gives its levels to `sink`; says whether there is one that is not zero.
fn walk(
    step: f64,
    pyramid: &Pyramid,
    page: PageId,
    mip: &MipImage,
    tables: &PageTables,
    sink: &mut impl Sink,
) -> Result<bool> {
    let step = step_at(check_step(step)?, page.tile.mip);
    let means = tables.means(page.tile.mip, page.group);
    let (left, top) = (
        usize::from(page.tile.x) * PAGE_TEXELS as usize,
        usize::from(page.tile.y) * PAGE_TEXELS as usize,
    );
    let (mut last_end, mut coded) = (0, false);
    let mut spare = None;
    let blocks = Blocks::new(pyramid, page.tile);
    for place in blocks.corners().map(|corner| blocks.place(corner)) {
        let mut block: Block = [Texel::default(); AREA];
        for y in 0..place.size.1 {
            let from = (top + place.y + y) * mip.width as usize + left + place.x;
            for (to, from) in block[y * SIDE..]
                .iter_mut()
                .zip(&mip.texels[from..from + place.size.0])
            {
                *to = Texel(*from);
            }
        }
        forward(&mut block, place.size);
        let mut largest = 0f32;
        for texel in &mut block {
            *texel = *texel * (1.0 / step);
            largest = texel
                .0
                .iter()
                .fold(largest, |largest, value| largest.max(value.abs()));
        }
        if largest > MAX_LEVEL as f32 - 1.0 {
            return Err(Error::Invalid {
                what: "quantizer step".into(),
                detail: format!(
                    "{step} is too small for the values, which need {largest} steps of {MAX_LEVEL}"
                ),
            });
        }
        let scan = scan_of(&place, &mut spare);
        last_end = levels::write(sink, scan, means, last_end, &block, |coefficient, context| {
            choose(tables, coefficient, context)
        });
        coded |= last_end > 0;
    }
    Ok(coded)
}

/// The level next to a coefficient, given in steps, that has the least sum of squared error and bits.
fn choose(tables: &PageTables, coefficient: f32, context: Context) -> i32 {
    let magnitude = coefficient.abs();
    if !tables.is_trained() {
        let level = (magnitude + FIRST_ROUNDING) as i32;
        return if coefficient < 0.0 { -level } else { level };
    }
    let signed = |level: i32| if coefficient < 0.0 { -level } else { level };
    let nearest = (magnitude + 0.5) as i32;
    let cost = |level: i32| {
        let error = tables.value(context, level).abs() - magnitude;
        error * error + ERROR_PER_BIT * tables.bits(context, signed(level))
    };
    match nearest {
        0 => 0,
        _ => signed(if cost(nearest - 1) < cost(nearest) {
            nearest - 1
        } else {
            nearest
        }),
    }
}

/// Checks sizes and values.
fn check(pyramid: &Pyramid, mips: &[MipImage]) -> Result<()> {
    for level in 0..=pyramid.tail_mip() {
        let (width, height) = pyramid.mip_size(level);
        let found = mips
            .get(usize::from(level))
            .map_or((0, 0, 0), |mip| (mip.width, mip.height, mip.texels.len()));
        if found != (width, height, width as usize * height as usize) {
            return Err(Error::Invalid {
                what: format!("mip {level} of {}x{}, {} texels", found.0, found.1, found.2),
                detail: format!("the pyramid has {width}x{height} there"),
            });
        }
    }
    let values = mips[0].texels.as_flattened();
    match values
        .iter()
        .find(|value| !(-HALF_MAX..=HALF_MAX).contains(*value))
    {
        None => Ok(()),
        Some(bad) => Err(Error::Invalid {
            what: "value of an eigen-texture".into(),
            detail: format!("{bad} is not a number within ±{HALF_MAX}, scale the textures down"),
        }),
    }
}

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
struct Payload<'a> {
    blocks: Blocks,
    step: f32,
    /// `None` if the page says nothing that its parent does not.
    reader: Option<Reader<'a>>,
    /// The parent and where in its slot the first texel under this page lies.
    parent: Option<(&'a Page, (usize, usize))>,
    slot: &'a mut [[f16; 4]],
}

impl<'a> Payload<'a> {
    fn new(
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
    fn run(mut self) -> Self::Output {
        let mut spare = None;
        let mut block: Block = [Texel::default(); AREA];
        for corner in self.blocks.corners() {
            let place = self.blocks.place(corner);
            let mut end = 0;
            block.fill(Texel::default());
            if let Some(reader) = &mut self.reader {
                end = reader.read(scan_of(&place, &mut spare), &mut block);
                scale(&mut block[..(end * SIDE).min(AREA)], self.step);
            }
            if let Some((parent, origin)) = self.parent {
                low_coefficients(&mut block, parent, origin, &place);
            }
            inverse_here(&mut block, place.size, end.max(place.low.0).max(place.low.1));
            put(&mut block, &place, self.slot);
        }
        self.reader.map_or(Ok(()), Reader::finish)
    }
}

#[inline(always)]
fn scale(texels: &mut [Texel], factor: f32) {
    let values: &mut [f32] = bytemuck::cast_slice_mut(texels);
    for value in values {
        *value *= factor;
    }
}

/// Puts a block's texels into the slot.
#[inline(always)]
fn put(block: &mut Block, place: &Place, slot: &mut [[f16; 4]]) {
    let values: &mut [f32; 4 * AREA] = bytemuck::cast_mut(block);
    for value in values.iter_mut() {
        // What lies above the range of half floats, or is no number, which only a damaged record asks for, must become
        // neither infinite nor different from processor to processor. (`clamp` keeps what is no number.)
        *value = if *value > -HALF_MAX { *value } else { -HALF_MAX };
        *value = if *value < HALF_MAX { *value } else { HALF_MAX };
    }
    let mut halves = [f16::ZERO; 4 * AREA];
    halves.convert_from_f32_slice(values);
    let (rows, _) = halves.as_chunks::<4>().0.as_chunks::<SIDE>();
    let border = BORDER_TEXELS as usize;
    for (y, row) in rows.iter().enumerate().take(place.size.1) {
        let start = (place.y + y + border) * SLOT_TEXELS as usize + place.x + border;
        slot[start..start + place.size.0].copy_from_slice(&row[..place.size.0]);
    }
}

/// The parent and where in its slot the first texel under this page lies.
fn parent_of<'a>(
    pyramid: &Pyramid,
    tile: Tile,
    parent: Option<&'a Page>,
) -> Result<Option<(&'a Page, (usize, usize))>> {
    if pyramid.tile_index(tile).is_none() {
        return Err(Error::NotFound {
            what: format!("page mip {} x {} y {}", tile.mip, tile.x, tile.y),
            detail: format!("the coarsest page is in mip {}", pyramid.tail_mip()),
        });
    }
    let invalid = |detail: &str| Error::Invalid {
        what: format!("parent of the page at mip {} x {} y {}", tile.mip, tile.x, tile.y),
        detail: detail.into(),
    };
    match (pyramid.parent(tile), parent) {
        (None, None) => Ok(None),
        (None, Some(_)) => Err(invalid("the root has none")),
        (Some(_), None) => Err(invalid("it is needed to decode the page, decode it first")),
        (Some(_), Some(page)) if page.texels.len() != SLOT_AREA => Err(invalid("it is not one slot")),
        (Some(place), Some(page)) => {
            let origin = pyramid.payload_origin(place, place.mip);
            let half = |position: u16| usize::from(position % 2) * PAGE_TEXELS as usize / 2;
            let origin = (origin.0 as usize + half(tile.x), origin.1 as usize + half(tile.y));
            Ok(Some((page, origin)))
        }
    }
}

/// Puts the transform of what the parent has under a block into its lowest coefficients.
#[inline(always)]
fn low_coefficients(block: &mut Block, parent: &Page, origin: (usize, usize), place: &Place) {
    const HALF_SIDE: usize = SIDE / 2;
    let (width, height) = place.low;
    let mut halves = [[[f16::ZERO; 4]; HALF_SIDE]; HALF_SIDE];
    for (y, row) in halves.iter_mut().enumerate().take(height) {
        let start = (origin.1 + place.y / 2 + y) * SLOT_TEXELS as usize + origin.0 + place.x / 2;
        row[..width].copy_from_slice(&parent.texels[start..start + width]);
    }
    let mut texels = [[Texel::default(); HALF_SIDE]; HALF_SIDE];
    let halves: &[f16] = bytemuck::cast_slice(&halves);
    halves.convert_to_f32_slice(bytemuck::cast_slice_mut(&mut texels));
    let mut low: Block = [Texel::default(); AREA];
    for (to, from) in low.as_chunks_mut::<SIDE>().0.iter_mut().zip(&texels) {
        to[..HALF_SIDE].copy_from_slice(from);
    }
    forward_here(&mut low, place.low);
    let factor = low_scale(place.size, place.low);
    for u in 0..width {
        let column = &mut low[u * SIDE..][..height];
        scale(column, factor);
        block[u * SIDE..][..height].copy_from_slice(column);
    }
}

#[cfg(test)]
mod tests;
