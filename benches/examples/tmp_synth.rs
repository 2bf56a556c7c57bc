//! Temporary.
use scenes::synth::{synthesize, SynthOptions};
use preprocess::npy::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let o = SynthOptions { size: a[3].parse().unwrap(), ..Default::default() };
    let s = Sampling { views: o.views.clone(), lights: o.lights.clone(), wrap: true, cosine: true };
    let mut w = BtfWriter::create(a[2].as_ref(), s, o.size, o.size, Dtype::F16).unwrap();
    let r = synthesize(&a[1], &o, &mut |_, b| w.write_f16(b).map_err(std::io::Error::other), &|_, _| ()).unwrap();
    w.finish().unwrap();
    println!("{r:?}");
}
