//! Factorization of a synthetic BTF, from its memory-mapped file to scaled factors: samples per second.
//!
//!     cargo bench -p benches --bench factorize
//!
//! 81 × 4 directions and 64² texels, so that a run takes well under a second; the full size, 81 × 81 directions and 256²
//! texels, is timed by `eigentile preprocess --report` beside benches/peers/factorize_numpy.py.

use std::hint::black_box;

use benches::small_cloth;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use preprocess::{Settings, factorize::factorize};

fn benchmark(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("the folder for temporary files is writable");
    let btf = small_cloth(folder.path(), 64).expect("a cloth");
    let mut group = criterion.benchmark_group("factorize");
    group
        .sample_size(10)
        .throughput(Throughput::Elements((btf.rows() * btf.columns()) as u64));
    for components in [16, 100] {
        let settings = Settings {
            components,
            memory_bytes: 1 << 30,
            ..Settings::default()
        };
        group.bench_function(format!("{components} components"), |bencher| {
            bencher.iter(|| black_box(factorize(&btf, &settings, &|_| ())).map(|factors| factors.components));
        });
    }
    group.finish();
}

criterion_group!(benches, benchmark);
criterion_main!(benches);
