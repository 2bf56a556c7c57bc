//! Pages to bytes and back, a full page of 64² texels against its decoded parent.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use tileset::codec::{EncodedPage, MipImage, decode_page, encode_page};
use tileset::{Codec, PageId, Pyramid, SLOT_AREA, Tile};

/// The chain from the root to a page of the finest mip, coded.
fn chain(codec: Codec, pyramid: &Pyramid, mips: &[MipImage]) -> Vec<(Tile, EncodedPage)> {
    let mut pages: Vec<(Tile, EncodedPage)> = Vec::new();
    for mip in (0..=pyramid.tail_mip()).rev() {
        let tile = Tile { mip, x: 0, y: 0 };
        let parent = pages.last().map(|(_, page)| &page.decoded);
        let page =
            encode_page(codec, pyramid, tile, &mips[usize::from(mip)], parent).expect("a page is coded");
        pages.push((tile, page));
    }
    pages
}

fn codec(criterion: &mut Criterion) {
    let pyramid = Pyramid::new(256, 256, true).expect("a valid size");
    let mut mips = vec![benches::eigen_textures(256)];
    for _ in 0..pyramid.tail_mip() {
        let coarser = mips[mips.len() - 1].downsample();
        mips.push(coarser);
    }
    let mut group = criterion.benchmark_group("page");
    group.throughput(Throughput::Bytes((SLOT_AREA * 4 * size_of::<f32>()) as u64));
    for step in [0.1, 0.02, 0.004] {
        let codec = Codec::DctDeltaZstd { step };
        let pages = chain(codec, &pyramid, &mips);
        let [.., (_, parent), (tile, page)] = &pages[..] else {
            panic!("256 texels have several mips")
        };
        let label = format!("step {step}, {} bytes", page.bytes.len());
        group.bench_function(BenchmarkId::new("encode", &label), |bencher| {
            bencher.iter(|| encode_page(codec, &pyramid, *tile, &mips[0], Some(&parent.decoded)));
        });
        let id = PageId {
            group: 0,
            tile: *tile,
        };
        group.bench_function(BenchmarkId::new("decode", &label), |bencher| {
            bencher.iter(|| decode_page(codec, &pyramid, id, &page.bytes, Some(&parent.decoded)));
        });
    }
    group.finish();
}

criterion_group!(benches, codec);
criterion_main!(benches);
