//! One page: prediction, transform, quantizer, and the loop closed around them.

use half::{f16, slice::HalfFloatSliceExt};

use super::{
    MipImage,
    dct::BLOCK_AREA,
    quantize::{quantize, reconstruct},
    region::{HALF_MAX, Region},
    symbols, tail,
    texel::Texel,
    upsample::upsample,
};
use crate::{Codec, Error, PageId, Pyramid, Result, SLOT_AREA, SLOT_TEXELS, Tile, error::corrupt, frame};

/// Most bytes of a page's record.
pub const MAX_PAGE_BYTES: u32 = frame::bound(symbols::packed_bound(SLOT_AREA / BLOCK_AREA)) as u32;

/// A decoded page: one slot of half floats, `[y][x][component of the group]`, rows of
/// [`crate::SLOT_TEXELS`]; texels outside payload and border are zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Page {
    /// [`crate::SLOT_AREA`] texels.
    pub texels: Vec<[f16; 4]>,
}

/// A page as the encoder leaves it.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodedPage {
    /// The record; empty if the page equals its up-sampled parent.
    pub bytes: Vec<u8>,
    /// What a decoder will see: the parent of the next finer pages.
    pub decoded: Page,
    /// Mean squared difference of the decoded page to its up-sampled parent over the payload, summed over the
    /// group's components (paper, equation 8); for the root the mean square of the page itself.
    pub weight: f64,
    /// Mean squared error of the decoded against the wanted payload, summed over the group's components.
    pub error: f64,
}

/// Codes one page of `mip`, closed loop: against the parent as the decoder will have it.
///
/// The mip must be the tile's, of `pyramid`'s size; for the root the finest of the tail. `parent` is the
/// [`EncodedPage::decoded`] of the tile's parent, `None` exactly for the root.
///
/// # Errors
/// [`Error::Invalid`] for a step that is out of range or too small for the values, values that half floats
/// cannot hold, a mip or parent of the wrong size; [`Error::NotFound`] if the pyramid has no such tile.
pub fn encode_page(
    codec: Codec,
    pyramid: &Pyramid,
    tile: Tile,
    mip: &MipImage,
    parent: Option<&Page>,
) -> Result<EncodedPage> {
    let step = step(codec)?;
    let region = Region::new(pyramid, tile)?;
    let (width, height) = pyramid.mip_size(tile.mip);
    if (mip.width, mip.height) != (width, height)
        || mip.texels.len() as u64 != u64::from(width) * u64::from(height)
    {
        return Err(Error::Invalid {
            what: format!(
                "mip {} of {}x{}, {} texels",
                tile.mip,
                mip.width,
                mip.height,
                mip.texels.len()
            ),
            detail: format!("the pyramid has {width}x{height} there"),
        });
    }
    let prediction = predict(pyramid, tile, &region, parent)?;
    let wanted = region.cut(mip, pyramid.wrap())?;
    let residual: Vec<Texel> = wanted.iter().zip(&prediction).map(|(&a, &b)| a - b).collect();
    let levels = quantize(&region, &residual, step)?;
    let coded = levels.iter().flatten().flatten().any(|&level| level != 0);
    let bytes = if coded {
        frame::compress(&symbols::pack(&levels))?
    } else {
        Vec::new()
    };

    let parent_view = finish(pyramid, tile, &region, prediction.clone());
    let decoded = if coded {
        let mut texels = prediction;
        reconstruct(&region, &mut texels, &levels, step);
        finish(pyramid, tile, &region, texels)
    } else {
        parent_view.clone()
    };
    Ok(EncodedPage {
        weight: mean_square(&region, |slot, _| {
            difference(decoded.texels[slot], parent_view.texels[slot])
        }),
        error: mean_square(&region, |slot, texel| {
            let decoded = decoded.texels[slot];
            std::array::from_fn(|c| f64::from(decoded[c].to_f32()) - f64::from(wanted[texel].0[c]))
        }),
        bytes,
        decoded,
    })
}

/// Decodes a page; `bytes` is empty for a page that equals its up-sampled parent. `parent` is `None` exactly
/// for the root. Never panics and allocates no more than a few slots, whatever the bytes.
///
/// # Errors
/// [`Error::Corrupt`] if the bytes are no record of this page, [`Error::NotFound`] if the pyramid has no such
/// tile, [`Error::Invalid`] for a step out of range or a parent that is missing, unwanted, or no slot.
pub fn decode_page(
    codec: Codec,
    pyramid: &Pyramid,
    page: PageId,
    bytes: &[u8],
    parent: Option<&Page>,
) -> Result<Page> {
    let step = step(codec)?;
    let region = Region::new(pyramid, page.tile)?;
    let mut texels = predict(pyramid, page.tile, &region, parent)?;
    if !bytes.is_empty() {
        let (columns, rows) = region.blocks();
        let blocks = columns * rows;
        let levels = frame::decompress(bytes, symbols::packed_bound(blocks))
            .and_then(|symbols| symbols::unpack(&symbols, blocks))
            .map_err(|detail| corrupt(page.to_string(), 0, detail))?;
        reconstruct(&region, &mut texels, &levels, step);
    }
    Ok(finish(pyramid, page.tile, &region, texels))
}

/// The quantizer step, as the transform uses it.
pub(crate) fn step(codec: Codec) -> Result<f32> {
    match codec {
        Codec::DctDeltaZstd { step } => check_step(step),
        other => Err(Error::Invalid {
            what: format!("codec {other:?}"),
            detail: "its pages are coded together, not one by one".into(),
        }),
    }
}

/// A quantizer step in the accepted range.
pub(crate) fn check_step(step: f64) -> Result<f32> {
    // With steps up to this no product of the decoder can overflow, so nothing is ever infinite or not a
    // number.
    let range = 1e-6..=1e6;
    if !range.contains(&step) {
        return Err(Error::Invalid {
            what: "quantizer step".into(),
            detail: format!("{step} is not between {} and {}", range.start(), range.end()),
        });
    }
    Ok(step as f32)
}

/// The up-sampled parent; zero for the root.
fn predict(pyramid: &Pyramid, tile: Tile, region: &Region, parent: Option<&Page>) -> Result<Vec<Texel>> {
    let invalid = |detail: &str| Error::Invalid {
        what: format!("parent of the page at mip {} x {} y {}", tile.mip, tile.x, tile.y),
        detail: detail.into(),
    };
    match parent {
        None if tile == pyramid.root() => Ok(vec![Texel::default(); region.width * region.height]),
        None => Err(invalid("it is needed to decode the page, decode it first")),
        Some(_) if tile == pyramid.root() => Err(invalid("the root has none")),
        Some(parent) if parent.texels.len() != SLOT_AREA => Err(invalid("it is not one slot")),
        Some(parent) => Ok(upsample(pyramid, tile, region, parent)),
    }
}

/// Rounds the region into a slot; for the tail fills in the rest of it.
fn finish(pyramid: &Pyramid, tile: Tile, region: &Region, mut texels: Vec<Texel>) -> Page {
    let mut page = Page {
        texels: vec![[f16::ZERO; 4]; SLOT_AREA],
    };
    for (y, row) in texels.chunks_exact_mut(region.width).enumerate() {
        // What lies above the range of half floats, which only a damaged record asks for, must not become
        // infinite.
        for texel in row.iter_mut() {
            texel.0 = texel.0.map(|value| value.clamp(-HALF_MAX, HALF_MAX));
        }
        let start = slot_index(region, 0, y);
        let slot: &mut [f16] = bytemuck::cast_slice_mut(&mut page.texels[start..start + region.width]);
        slot.convert_from_f32_slice(bytemuck::cast_slice(row));
    }
    if tile == pyramid.root() {
        tail::assemble(pyramid, &mut page);
    }
    page
}

fn slot_index(region: &Region, x: usize, y: usize) -> usize {
    (y + region.slot_origin) * SLOT_TEXELS as usize + x + region.slot_origin
}

fn difference(a: [f16; 4], b: [f16; 4]) -> [f64; 4] {
    std::array::from_fn(|c| f64::from(a[c].to_f32()) - f64::from(b[c].to_f32()))
}

/// Mean over the payload's texels of the squares summed over the components; `values` gets the index in the
/// slot and the index in the region.
fn mean_square(region: &Region, values: impl Fn(usize, usize) -> [f64; 4]) -> f64 {
    let (columns, rows) = region.payload();
    let mut sum = 0.0;
    for y in rows.clone() {
        for x in columns.clone() {
            let values = values(slot_index(region, x, y), y * region.width + x);
            sum += values.iter().map(|value| value * value).sum::<f64>();
        }
    }
    sum / (columns.len() * rows.len()) as f64
}
