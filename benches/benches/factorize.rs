//! Factorization of a synthetic BTF, from its memory-mapped file to scaled factors: samples per second.
//!
//!     cargo bench -p benches --bench factorize
//!
//! 81 × 4 directions and 64² texels, so that a run takes well under a second; the full size, 81 × 81 directions and 256²
//! texels, is timed by `eigentile preprocess --report` beside benches/peers/factorize_numpy.py.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use preprocess::npy::{BtfWriter, Dtype, Sampling};
use preprocess::{Btf, Settings, factorize::factorize};
use scenes::synth::{SynthOptions, synthesize};

fn benchmark(criterion: &mut Criterion) {
    let folder = std::env::temp_dir().join(format!("eigentile-bench-factorize-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("the folder for temporary files is writable");
    let path = folder.join("cloth.npy");
    let mut options = SynthOptions {
        size: 64,
        samples_per_texel: 1,
        ..SynthOptions::default()
    };
    options.lights.truncate(4);
    let sampling = Sampling {
        views: options.views.clone(),
        lights: options.lights.clone(),
        wrap: true,
        cosine: true,
    };
    let mut writer = BtfWriter::create(&path, sampling, 64, 64, Dtype::F16).expect("the sizes are accepted");
    let mut sink = |_, view: &[_]| writer.write_f16(view).map_err(std::io::Error::other);
    synthesize("cloth", &options, &mut sink, &|_, _| ()).expect("the material exists");
    writer.finish().expect("all views were written");

    let btf = Btf::open(&path).expect("what was written is read");
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
    drop(btf);
    std::fs::remove_dir_all(&folder).expect("the temporary folder is ours");
}

criterion_group!(benches, benchmark);
criterion_main!(benches);
