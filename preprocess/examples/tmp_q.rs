//! Temporary.
use preprocess::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let btf = Btf::open(a[1].as_ref()).unwrap();
    let t = std::time::Instant::now();
    let f = factorize::factorize(&btf, &Settings::default(), &|_| ()).unwrap();
    println!("factorize {:.2} s rank {:.5} {:?}", t.elapsed().as_secs_f64(), f.relative_error(), f.statistics);
    for q in [0.01, 0.02, 0.03, 0.04, 0.05, 0.07, 0.1] {
        let b = build::build(&btf, &f, q, "/tmp/preprocess/out/q.bsvtf".as_ref(), &|_| ()).unwrap();
        let e = b.manifest.errors;
        println!("q {q}: codec {:.5} total {:.5} pages {} columns {} empty {} sec {:?}", e.codec_rms / e.btf_rms, e.total_relative(), b.bytes.page_bytes, b.bytes.column_bytes, b.bytes.empty_pages, b.seconds);
    }
}
