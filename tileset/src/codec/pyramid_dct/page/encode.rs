//! Pages to records.

use super::source::Coded;
use super::{Blocks, Place, scan_of, step_at};
use crate::codec::pyramid_dct::context::{Context, Means};
use crate::codec::pyramid_dct::levels::{
    Chosen, Coder, MAX_LEVEL, Sink, choose_levels, end_model, source_model,
};
use crate::codec::pyramid_dct::scan::{DIAGONALS, Scan};
use crate::codec::pyramid_dct::tables::{Counter, PageTables, Statistics};
use crate::codec::pyramid_dct::transform::{AREA, Block, SIDE, forward};
use crate::codec::rans::Encoder;
use crate::codec::{MipImage, page::check_step, region::HALF_MAX, texel::Texel};
use crate::{Error, PAGE_TEXELS, PageId, Pyramid, Result, Tile};

/// Squared error, in squared steps, that one bit may save: at high rates the error is step²/12 and falls to a
/// quarter with each bit, so its slope is 2·ln 2 / 12.
const ERROR_PER_BIT: f32 = std::f32::consts::LN_2 / 6.0;
/// Rounding before anything is known of the distribution.
const FIRST_ROUNDING: f32 = 0.4;
/// Largest coefficient in steps that has a level.
const LARGEST: f32 = MAX_LEVEL as f32 - 1.0;
/// Bits of a record beside its symbols: states, checksum, length and weight.
const RECORD_BITS: f32 = 90.0;

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
            bytes: coded.map_or_else(Vec::new, |_| coder.encoder.finish()),
            weight: coded.unwrap_or(0.0) * mip_step * mip_step / f64::from(width * height),
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
            means: tables.unwrap_or(&none).means(tile.mip, group),
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

/// Transforms a page and gives its levels to `sink`; the sum of the squares of what they stand for, in steps: `None` if the
/// page is better left out.
fn walk(
    step: f64,
    pyramid: &Pyramid,
    page: PageId,
    mip: &MipImage,
    tables: &PageTables,
    sink: &mut impl Sink,
) -> Result<Option<f64>> {
    let step = step_at(check_step(step)?, page.tile.mip);
    let blocks = Blocks::new(pyramid, page.tile);
    let mut chooser = Chooser {
        tables,
        means: tables.means(page.tile.mip, page.group),
        coded: Coded::default(),
        last_end: 0,
        last_source: 0,
    };
    let mut chosen = Vec::new();
    let mut spare = None;
    // In squared steps: of what is coded, if anything is; of what it costs; and of what is lost if nothing is.
    let (mut energy, mut cost, mut lost) = (0.0, 0.0, 0.0);
    for place in blocks.corners().map(|corner| blocks.place(corner)) {
        let block = transformed(step, &place, page.tile, mip)?;
        let scan = scan_of(&place, &mut spare);
        let found = chooser.next(scan, place.size, &block);
        let coefficients = scan
            .places(DIAGONALS)
            .iter()
            .flat_map(|place| block[usize::from(place.at)].0);
        lost += coefficients.map(|value| value * value).sum::<f32>();
        cost += found.levels.cost;
        energy += found.energy;
        chosen.push(found);
    }
    if lost <= cost + ERROR_PER_BIT * RECORD_BITS || chosen.iter().all(|block| block.levels.end == 0) {
        return Ok(None);
    }
    let (mut last_end, mut last_source) = (0, 0);
    for Found { source, levels, .. } in &chosen {
        sink.end(end_model(last_end), levels.end);
        last_end = levels.end;
        if levels.end > 0 {
            sink.source(source_model(last_source), *source);
            last_source = *source;
        }
        levels.levels.iter().for_each(|four| sink.levels(four));
    }
    Ok(Some(energy))
}

/// The coefficients of a block, in steps.
fn transformed(step: f32, place: &Place, tile: Tile, mip: &MipImage) -> Result<Block> {
    let (left, top) = (
        usize::from(tile.x) * PAGE_TEXELS as usize,
        usize::from(tile.y) * PAGE_TEXELS as usize,
    );
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
    for (at, texel) in block.iter_mut().enumerate() {
        *texel = *texel * (1.0 / step);
        largest = texel
            .0
            .iter()
            .fold(largest, |largest, value| largest.max(value.abs()));
        // What the parent gives.
        if at / SIDE < place.low.0 && at % SIDE < place.low.1 {
            *texel = Texel::default();
        }
    }
    if largest > LARGEST {
        return Err(Error::Invalid {
            what: "quantizer step".into(),
            detail: format!("{step} is too small for the values, which need {largest} steps of {MAX_LEVEL}"),
        });
    }
    Ok(block)
}

/// Chooses the levels of a page's blocks, one after the other.
struct Chooser<'a> {
    tables: &'a PageTables,
    means: Means<'a>,
    coded: Coded,
    last_end: usize,
    last_source: usize,
}

/// What was chosen for a block.
struct Found {
    /// How many blocks back its source lies; 0 for none.
    source: usize,
    levels: Chosen,
    /// Sum of the squares of its coefficients as they are decoded, in steps.
    energy: f64,
}

impl Chooser<'_> {
    /// For the next block of coefficients.
    fn next(&mut self, scan: &Scan, size: (usize, usize), block: &Block) -> Found {
        let (mut source, mut levels) = (0, self.levels(scan, block, 0));
        let tables = self.tables;
        if levels.end > 0
            && tables.may_have_sources()
            && let Some(back) = self.coded.best_source(size, block)
            && let Some(from) = self.coded.block(back)
        {
            let rest: Block = std::array::from_fn(|at| block[at] - from[at]);
            let fits = rest
                .iter()
                .flat_map(|texel| texel.0)
                .all(|value| value.abs() <= LARGEST);
            let with_source = self.levels(scan, &rest, back);
            if fits && (!tables.is_trained() || with_source.cost < levels.cost) {
                (source, levels) = (back, with_source);
            }
        }
        let decoded = self.decoded(scan, source, &levels);
        let squares = decoded
            .iter()
            .flat_map(|block| block.iter())
            .flat_map(|texel| texel.0);
        let energy = squares.map(|value| f64::from(value).powi(2)).sum();
        self.coded.push(size, decoded);
        self.last_end = levels.end;
        if levels.end > 0 {
            self.last_source = source;
        }
        Found {
            source,
            levels,
            energy,
        }
    }

    fn levels(&self, scan: &Scan, block: &Block, source: usize) -> Chosen {
        let tables = self.tables;
        let source_bits = tables.source_bits(self.last_source, source);
        choose_levels(
            scan,
            self.means,
            block,
            // Without a diagonal a block has no source.
            usize::from(source > 0),
            |coefficient, context| choose(tables, coefficient, context),
            |end| {
                let source_bits = if end > 0 { source_bits } else { 0.0 };
                ERROR_PER_BIT * (tables.end_bits(self.last_end, end) + source_bits)
            },
        )
    }

    /// A block as decoders will have it, in steps; `None` if all of it is zero.
    fn decoded(&self, scan: &Scan, source: usize, levels: &Chosen) -> Option<Box<Block>> {
        if levels.end == 0 {
            return None;
        }
        let mut block = match self.coded.block(source) {
            Some(from) if source > 0 => Box::new(*from),
            _ => Box::new([Texel::default(); AREA]),
        };
        for (place, four) in scan.places(levels.end).iter().zip(&levels.levels) {
            let values = four.map(|found| self.tables.value(found.context, found.level));
            let sum = &mut block[usize::from(place.at)];
            *sum = *sum + Texel(values);
        }
        Some(block)
    }
}

/// The level for a coefficient, given in steps, that has the least sum of squared error and bits, and this sum.
fn choose(tables: &PageTables, coefficient: f32, context: Context) -> (i32, f32) {
    let magnitude = coefficient.abs();
    let signed = |level: i32| if coefficient < 0.0 { -level } else { level };
    if !tables.is_trained() {
        let level = (magnitude + FIRST_ROUNDING) as i32;
        return (signed(level), (magnitude - level as f32).powi(2));
    }
    let nearest = (magnitude + 0.5) as i32;
    let cost = |level: i32| {
        let error = tables.value(context, level).abs() - magnitude;
        error * error + ERROR_PER_BIT * tables.bits(context, signed(level))
    };
    let mut best = (nearest, cost(nearest));
    for level in [nearest - 1, 0] {
        if level >= 0 && level < best.0 {
            let cost = cost(level);
            if cost < best.1 {
                best = (level, cost);
            }
        }
    }
    (signed(best.0), best.1)
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
