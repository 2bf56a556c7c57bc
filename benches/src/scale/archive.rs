//! Archives whose pages are all the same record.

use half::f16;
use tileset::codec::{MipImage, encode_column, encode_page};
use tileset::{
    ArchiveWriter, Codec, Column, Direction, Factorization, Ledger, Manifest, Page, PageId, Pyramid, Tile,
};

/// The smallest material that has a page beside its root: what is coded.
const CODED_SIDE: u32 = 128;
/// Views, and lights.
const DIRECTIONS: u32 = 7;

fn manifest(side: u32) -> Manifest {
    let direction = |step: u32| Direction {
        theta: if step == 0 { 0.0 } else { 1.2 },
        phi: std::f64::consts::TAU * f64::from(step) / f64::from(DIRECTIONS - 1),
    };
    let directions: Vec<Direction> = (0..DIRECTIONS).map(direction).collect();
    Manifest {
        name: "virtual".into(),
        generator: "eigentile bench".into(),
        width: side,
        height: side,
        wrap: true,
        cosine: false,
        views: directions.clone(),
        lights: directions,
        components: 4,
        factorization: Factorization::Fmf,
        codec: Codec::DctDeltaZstd { step: 0.02 },
        texture_scale: 1.0,
        mean_rgb: [0.4, 0.3, 0.2],
        singular_values: vec![1.0, 0.5, 0.25, 0.125],
        errors: Ledger::default(),
    }
}

/// A texture that repeats in every page.
fn texture(pyramid: &Pyramid) -> Vec<MipImage> {
    let turn = std::f32::consts::TAU / 64.0;
    let texel = |at: u32| {
        let (x, y) = ((at % CODED_SIDE) as f32, (at / CODED_SIDE) as f32);
        std::array::from_fn(|c| {
            let k = (1 + 3 * c) as f32;
            0.5 / (1 + c) as f32 * (1.0 + (k * turn * x).sin() * (k * turn * y).cos())
        })
    };
    let mut mips = vec![MipImage {
        width: CODED_SIDE,
        height: CODED_SIDE,
        texels: (0..CODED_SIDE * CODED_SIDE).map(texel).collect(),
    }];
    for mip in 0..usize::from(pyramid.tail_mip()) {
        mips.push(mips[mip].downsample());
    }
    mips
}

/// A material of so many texels a side, a power of two, with one component group.
///
/// # Errors
/// Of the codec; there are none with what is made here.
pub(super) fn make(side: u32) -> tileset::Result<Vec<u8>> {
    let coded = manifest(CODED_SIDE);
    let small = coded.pyramid()?;
    let mips = texture(&small);
    let encode = |tile: Tile, parent: Option<&Page>| {
        encode_page(coded.codec, &small, tile, &mips[usize::from(tile.mip)], parent)
    };
    let root = encode(small.root(), None)?;
    let mut above = root.decoded.clone();
    let mut page = None;
    for mip in (0..small.tail_mip()).rev() {
        let coded = encode(Tile { mip, x: 0, y: 0 }, Some(&above))?;
        above = coded.decoded.clone();
        page = Some(coded);
    }
    let page = page.unwrap_or_else(|| root.clone());

    let manifest = manifest(side);
    let pyramid = manifest.pyramid()?;
    let texels = vec![[0.7, 0.2, -0.1, 0.05].map(f16::from_f32); manifest.column_texels()];
    let mut writer = ArchiveWriter::new(manifest)?;
    writer.add_column(0, encode_column(&Column { texels })?, 1.0)?;
    for tile in pyramid.tiles() {
        let (bytes, weight) = if tile == pyramid.root() {
            (&root.bytes, root.weight)
        } else {
            (&page.bytes, page.weight)
        };
        writer.add_page(PageId { group: 0, tile }, bytes.clone(), weight)?;
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use engine::reference::{FactorReflectance, Reflectance};
    use tileset::Archive;

    use super::*;

    #[test]
    fn all_pages_can_be_decoded() {
        for side in [32, 256] {
            let archive = Archive::open(make(side).unwrap()).unwrap();
            let factors = FactorReflectance::new(&archive).unwrap();
            assert_eq!(factors.size(), (side, side));
            let values = (0..side).map(|x| factors.texel(0, x, 5, 0, 0)[0]);
            assert!(values.clone().all(f64::is_finite) && values.clone().any(|value| value > 0.1));
        }
    }
}
