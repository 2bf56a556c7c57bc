//! Pages into the page cache by both ways: decoded to texels here, or entropy decoded here and the rest on the GPU.
//!
//!     cargo bench -p benches --bench decode
//!
//! The finest pages of a synthetic cloth at a relative error of about 0.05, records in memory. "to" is one core alone;
//! "into the cache" adds uploading, the GPU and stitching, and waits for it. With a software adapter both share the
//! processor.

use std::hint::black_box;

use benches::small_cloth;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use engine::gpu::{Caches, Context, Renderer, materials::Btf as Known, page_cache::SLOT_BYTES};
use engine::residency::Slot;
use preprocess::{Settings, build::build, factorize::factorize};
use scenes::Scene;
use tileset::{Archive, Page, PageId};

const SIDE: u32 = 128;

/// An archive of [`SIDE`]² texels, 81 × 4 directions and 32 components.
fn archive(folder: &std::path::Path) -> Vec<u8> {
    let coded = folder.join("cloth.bsvtf");
    let btf = small_cloth(folder, SIDE).expect("a cloth");
    let settings = Settings {
        components: 32,
        memory_bytes: 1 << 30,
        ..Settings::default()
    };
    let factors = factorize(&btf, &settings, &|_| ()).expect("a factorization");
    // A relative error of 0.05 in benches/results/codec.json.
    build(&btf, &factors, 0.0165, &coded, &|_| ()).expect("an archive");
    std::fs::read(&coded).expect("the archive was written")
}

/// A page of the finest mip, its record and its decoded parent.
struct Finest {
    id: PageId,
    record: Vec<u8>,
    parent: Page,
}

fn benchmark(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("the folder for temporary files is writable");
    let bytes = archive(folder.path());
    let archive = Archive::open(&bytes[..]).expect("an archive");
    let index = &archive.index;
    let (pyramid, decoder) = (&index.pyramid, &index.decoder);
    let known = Known::new("cloth".into(), index.clone());

    let mut renderer = Renderer::new(
        Context::headless().expect("a graphics adapter"),
        &Scene::default(),
        (8, 8),
    )
    .expect("an empty scene");
    renderer.add_btf(&known).expect("room for the tables");
    let pages = u64::from(pyramid.tile_count()) * u64::from(known.groups());
    let caches = Caches {
        angular: Default::default(),
        page_format: Default::default(),
        page_bytes: pages * SLOT_BYTES,
        column_bytes: 64 << 20,
    };
    let layout = renderer
        .layout(caches, known.column_quads())
        .expect("room for the caches");
    renderer
        .resize_caches(layout, &[], &[])
        .expect("room for the caches");
    renderer.show_btfs(&[]).expect("a working device");

    // All coarser pages are resident, in the last slots.
    let mut finest = Vec::new();
    let mut slots = (0..pages as u32).rev().map(Slot);
    for group in 0..known.groups() {
        let mut decoded: std::collections::HashMap<_, Page> = std::collections::HashMap::new();
        for tile in pyramid.tiles() {
            let id = PageId { group, tile };
            let record = archive.read_page(id).expect("a record");
            let parent = pyramid.parent(tile).map(|parent| decoded[&parent].clone());
            if tile.mip > 0 {
                let page = decoder.page(id, &record, parent.as_ref()).expect("a page");
                renderer.place_page(0, id, slots.next().expect("a slot for each page"), &page);
                decoded.insert(tile, page);
            } else if let Some(parent) = parent {
                finest.push(Finest { id, record, parent });
            }
        }
    }
    let strips = renderer.flush();
    renderer.stitch(&strips);
    renderer.wait().expect("a working device");

    let count = finest.len();
    let mean = |bytes: &dyn Fn(&Finest) -> usize| finest.iter().map(bytes).sum::<usize>() / count;
    println!(
        "{}: {count} pages, records of {} bytes; uploaded are {SLOT_BYTES} bytes as texels, {} as coefficients",
        renderer.adapter(),
        mean(&|page| page.record.len()),
        mean(&|page| 4 * decoder
            .coefficients(page.id, &page.record)
            .expect("a page")
            .words
            .len()),
    );
    let texels = |page: &Finest| {
        decoder
            .page(page.id, &page.record, Some(&page.parent))
            .expect("a page")
    };
    let coefficients = |page: &Finest| decoder.coefficients(page.id, &page.record).expect("a page");
    let mut group = criterion.benchmark_group("decode");
    group
        .sample_size(20)
        .throughput(Throughput::Elements(count as u64));
    group.bench_function("to texels", |bencher| {
        bencher.iter(|| finest.iter().for_each(|page| drop(black_box(texels(page)))));
    });
    group.bench_function("to coefficients", |bencher| {
        bencher.iter(|| finest.iter().for_each(|page| drop(black_box(coefficients(page)))));
    });
    group.bench_function("into the cache as texels", |bencher| {
        bencher.iter(|| {
            for (slot, page) in (0..).zip(&finest) {
                renderer.place_page(0, page.id, Slot(slot), &texels(page));
            }
            let strips = renderer.flush();
            renderer.stitch(&strips);
            renderer.wait().expect("a working device");
        });
    });
    group.bench_function("into the cache as coefficients", |bencher| {
        bencher.iter(|| {
            for (slot, page) in (0..).zip(&finest) {
                renderer
                    .place_coefficients(0, page.id, Slot(slot), coefficients(page))
                    .expect("a working device");
            }
            let strips = renderer.flush();
            renderer.stitch(&strips);
            renderer.wait().expect("a working device");
        });
    });
    group.finish();
}

criterion_group!(benches, benchmark);
criterion_main!(benches);
