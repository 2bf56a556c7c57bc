use tileset::{*, codec::*};
fn cpu() -> f64 { std::fs::read_to_string("/proc/thread-self/schedstat").unwrap().split(' ').next().unwrap().parse::<f64>().unwrap() * 1e-9 }
#[test]
fn measure() {
    let bytes = std::fs::read("/tmp/tileset/v.f32").unwrap();
    let v: &[[f32; 4]] = bytemuck::cast_slice(&bytes);
    let groups: Vec<_> = v.chunks(65536).map(|c| MipImage { width: 256, height: 256, texels: c.to_vec() }).collect();
    for step in [0.0035, 0.0095, 0.027] {
        let codec = Codec::DctDeltaZstd { step };
        let pyr = Pyramid::new(256, 256, true).unwrap();
        let (mut nbytes, mut err, mut total, mut enc, mut dec, mut fin, mut empty) = (0, 0.0, 0.0, 0.0, f64::MAX, 0, 0);
        let mut all = vec![];
        for g in &groups {
            let mut mips = vec![g.clone()];
            for _ in 1..pyr.mip_count() { mips.push(mips.last().unwrap().downsample(true)); }
            let mut pages: Vec<EncodedPage> = vec![];
            for tile in pyr.tiles() {
                let parent = pyr.parent(tile).map(|p| &pages[pyr.tile_index(p).unwrap() as usize].decoded);
                let t = cpu();
                let p = encode_page(codec, &pyr, tile, &mips[tile.mip as usize], parent).unwrap();
                enc += cpu() - t;
                nbytes += p.bytes.len();
                if p.bytes.is_empty() { empty += 1 }
                if tile.mip == 0 { err += p.error / 16.0; fin += p.bytes.len(); }
                pages.push(p);
            }
            total += g.texels.iter().flatten().map(|v| f64::from(*v).powi(2)).sum::<f64>() / 65536.0;
            all.push(pages);
        }
        for _ in 0..5 {
            let t = cpu();
            for pages in &all { for (i, tile) in pyr.tiles().enumerate() {
                let parent = pyr.parent(tile).map(|p| &pages[pyr.tile_index(p).unwrap() as usize].decoded);
                assert!(decode_page(codec, &pyr, PageId { group: 0, tile }, &pages[i].bytes, parent).unwrap().texels.len() == SLOT_AREA);
            } }
            dec = dec.min(cpu() - t);
        }
        let n = groups.len() as f64 * 65536.0 * 4.0;
        let np = groups.len() as f64 * 21.0;
        println!("step {step} rel {:.4} bits/sample all {:.3} finest {:.3} bytes/page {:.0} empty {empty}; encode {:.2} ms/page; decode {:.0} us/page, {:.0} MB/s f32 of slots, {:.0} MB/s f16 slots", (err / total).sqrt(), nbytes as f64 * 8.0 / n, fin as f64 * 8.0 / n, nbytes as f64 / np, enc / np * 1e3, dec / np * 1e6, np * 82944.0 / dec / 1e6, np * 41472.0 / dec / 1e6);
    }
}
