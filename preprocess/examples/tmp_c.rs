//! Temporary.
use preprocess::*;
fn main() {
    let btf = Btf::open("/tmp/preprocess/data/cloth.npy".as_ref()).unwrap();
    let s = btf.row_block(0..1024);
    let n = btf.columns();
    for round in 0..3 {
        let mut scratch = vec![0f32; 512 * 528];
        let mut best = f64::MAX; let mut tot = 0.0;
        for p in 0..128 {
            let t = std::time::Instant::now();
            for r in 0..512 { s.slice(r * n + p * 512..r * n + p * 512 + 512).to_f32(&mut scratch[r * 528..r * 528 + 512]); }
            let e = t.elapsed().as_secs_f64() / (512.0 * 512.0) * 1e9;
            best = best.min(e); tot += e;
        }
        println!("{round}: best {best:.3} mean {:.3} ns/sample", tot / 128.0);
        let mut best = f64::MAX; let mut tot = 0.0;
        let mut row = vec![0f32; 65536];
        for r in 0..512 {
            let t = std::time::Instant::now();
            s.slice(r * n..r * n + n).to_f32(&mut row);
            let e = t.elapsed().as_secs_f64() / 65536.0 * 1e9;
            best = best.min(e); tot += e;
        }
        println!("{round}: whole rows best {best:.3} mean {:.3} ns/sample", tot / 512.0);
    }
}
