//! All samples, plain, with bzip2 and sparse.

use preprocess::Btf;
use std::io::Write;

use crate::common::{Bytes, META, SMALL, Shape, compare, kept, number};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Bdi {
    pub(crate) shape: Shape,
    pub(crate) scan_lines: usize,
    pub(crate) compression: u8,
    pub(crate) holes: bool,
    /// Whether the last chunk is filled up.
    pub(crate) full: bool,
}

impl Bdi {
    pub(crate) fn held(self, texel: usize) -> bool {
        !self.holes || texel % 5 != 1
    }

    pub(crate) fn value(self, image: usize, rgb: usize, texel: usize) -> f64 {
        if self.compression == 2 && !self.held(texel) {
            return 0.0;
        }
        kept(2, number(90 + rgb, image, texel))
    }

    pub(crate) fn bytes(self) -> Bytes {
        let shape = self.shape;
        let mut bytes = Bytes::common("!BDIF06R2!", META, shape);
        bytes.u32(self.scan_lines);
        bytes.0.push(self.compression);
        (0..shape.texels()).for_each(|texel| bytes.0.push(u8::from(self.held(texel))));
        bytes.frames(0);
        let stored: Vec<usize> = (0..shape.texels())
            .filter(|&texel| self.compression != 2 || self.held(texel))
            .collect();
        let chunk_texels = shape.width * self.scan_lines;
        for texels in stored.chunks(chunk_texels) {
            let mut chunk = Bytes::default();
            for &texel in texels {
                for row in 0..3 * shape.images() {
                    chunk.scalar(2, self.value(row / 3, row % 3, texel));
                }
            }
            if self.full {
                chunk.0.resize(chunk_texels * 3 * shape.images() * 2, 0);
            }
            if self.compression == 1 {
                let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
                encoder.write_all(&chunk.0).unwrap();
                chunk.0 = encoder.finish().unwrap();
            }
            bytes.u32(chunk.0.len());
            bytes.0.extend(chunk.0);
        }
        bytes
    }
}

#[test]
fn all_samples_plain_bzip2_and_sparse() {
    let wide = Shape {
        views: 2,
        lights: 5,
        width: 9,
        height: 7,
    };
    for compression in 0..3 {
        for (shape, scan_lines, holes, full) in [
            (SMALL, 1, false, false),
            (SMALL, 2, true, true),
            (wide, 4, true, false),
            (wide, 100, false, true),
        ] {
            let bdi = Bdi {
                shape,
                scan_lines,
                compression,
                holes,
                full,
            };
            let btf = bdi.bytes().open().unwrap();
            compare(&btf, shape, &|image, rgb, texel| bdi.value(image, rgb, texel));
            assert!(btf.low_rank().unwrap().is_none());
            assert_eq!(
                btf.notes().join("\n").contains("texels are"),
                holes,
                "{:?}",
                btf.notes()
            );
        }
    }
}

#[test]
fn the_scratch_file_is_made_once_and_leaves_nothing() {
    let bdi = Bdi {
        shape: SMALL,
        scan_lines: 1,
        compression: 1,
        holes: false,
        full: false,
    };
    let (folder, path) = bdi.bytes().write();
    let btf = Btf::open(&path).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| compare(&btf, SMALL, &|image, rgb, texel| bdi.value(image, rgb, texel)));
        }
    });
    drop(btf);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn damaged_chunks_are_named() {
    let bdi = Bdi {
        shape: SMALL,
        scan_lines: 1,
        compression: 1,
        holes: false,
        full: false,
    };
    let bytes = bdi.bytes();
    let begin = bytes.0.windows(4).rposition(|window| window == b"BZh9").unwrap();
    let read = |bytes: &Bytes| {
        let (_folder, path) = bytes.write();
        let mut buffer = Vec::new();
        let btf = Btf::open(&path).unwrap();
        let error = btf.samples(0..1, &mut buffer).unwrap_err();
        error.to_string()
    };
    let mut damaged = bytes.clone();
    damaged.0[begin] = b'X';
    let error = read(&damaged);
    assert!(
        error.contains("chunk 2 of") && error.contains(&format!("byte {begin}")),
        "{error}"
    );
    // The chunks in another order, with one that holds too much in the middle.
    let large = Bdi { scan_lines: 3, ..bdi }.bytes();
    let chunk = large.0[large.0.windows(4).rposition(|window| window == b"BZh9").unwrap() - 4..].to_vec();
    let first = bytes.0.windows(4).position(|window| window == b"BZh9").unwrap() - 4;
    let size = u32::from_le_bytes(bytes.0[first..first + 4].try_into().unwrap()) as usize;
    let mut swollen = bytes.clone();
    swollen.0.splice(first..first + 4 + size, chunk);
    let error = read(&swollen);
    assert!(
        error.contains("chunk 0") && error.contains("more than the 72 samples"),
        "{error}"
    );
}
