//! Temporary.
use preprocess::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let btf = Btf::open(a[1].as_ref()).unwrap();
    let mut s = Settings::default();
    if let Some(m) = a.get(2) { s.memory_bytes = m.parse().unwrap(); }
    let t = std::time::Instant::now();
    let f = factorize::factorize(&btf, &s, &|_| ()).unwrap();
    println!("factorize {:.2} s rank {:.6} {:?} peak rss {:?}", t.elapsed().as_secs_f64(), f.relative_error(), f.statistics, memory::peak_resident_bytes().map(|x| x >> 20));
}
