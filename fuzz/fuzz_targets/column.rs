//! Any bytes as the record of a column, plain and as the content of a zstd frame: refused, or decoded to
//! finite values.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tileset::{Codec, Direction, Factorization, Ledger, Manifest, codec::decode_column};

fuzz_target!(|input: (u8, u8, &[u8])| {
    let (views, lights, bytes) = input;
    let directions = |count: u8| vec![Direction { theta: 0.0, phi: 0.0 }; count.into()];
    let manifest = Manifest {
        name: String::new(),
        generator: String::new(),
        width: 1,
        height: 1,
        wrap: true,
        cosine: false,
        views: directions(views),
        lights: directions(lights),
        components: 1,
        factorization: Factorization::Fmf,
        codec: Codec::DctDeltaZstd { step: 1.0 },
        texture_scale: 1.0,
        mean_rgb: [0.0; 3],
        singular_values: vec![1.0],
        errors: Ledger::default(),
    };
    let Ok(frame) = zstd::bulk::compress(bytes, 1) else {
        return;
    };
    for record in [bytes, &frame] {
        if let Ok(column) = decode_column(&manifest, 0, record) {
            assert_eq!(column.texels.len(), manifest.column_texels());
            assert!(column.texels.iter().flatten().all(|value| value.is_finite()));
        }
    }
});
