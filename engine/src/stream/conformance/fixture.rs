//! Two archives, and what can be asked of them.

use std::{
    collections::BTreeMap,
    sync::{Arc, OnceLock},
};

use tileset::{Archive, ArchiveWriter, Codec, Direction, Factorization, Ledger, Manifest, PageId};

use super::super::{MemorySource, Request};

/// Two archives, of opaque records.
pub(in crate::stream) struct Fixture {
    pub(in crate::stream) archives: BTreeMap<Arc<str>, Vec<u8>>,
}

impl Fixture {
    pub(in crate::stream) fn get() -> &'static Self {
        static FIXTURE: OnceLock<Fixture> = OnceLock::new();
        FIXTURE.get_or_init(|| Self {
            archives: BTreeMap::from([("cloth".into(), archive(1)), ("größe 2".into(), archive(2))]),
        })
    }

    /// Everything that can be asked for.
    pub(in crate::stream) fn requests(&self) -> Vec<Request> {
        let mut requests = Vec::new();
        for (archive, bytes) in &self.archives {
            let index = Archive::open(bytes.clone()).unwrap().index;
            let archive = || Arc::clone(archive);
            requests.push(Request::Index { archive: archive() });
            for group in 0..index.manifest.groups() as u16 {
                requests.push(Request::Column {
                    archive: archive(),
                    group,
                });
                let tiles = index.pyramid.tiles();
                requests.extend(tiles.map(|tile| Request::Page {
                    archive: archive(),
                    page: PageId { group, tile },
                }));
            }
        }
        requests
    }

    pub(in crate::stream) fn expected(&self, request: &Request) -> Vec<u8> {
        let archive = Archive::open(self.archives[request.archive()].clone()).unwrap();
        match request {
            Request::Index { .. } => archive.prefix(),
            Request::Page { page, .. } => archive.page_record(*page),
            Request::Column { group, .. } => archive.column_record(*group),
        }
        .unwrap()
    }

    /// The archives as files of a folder.
    pub(in crate::stream) fn folder(&self) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in &self.archives {
            std::fs::write(folder.path().join(format!("{name}.bsvtf")), bytes).unwrap();
        }
        folder
    }

    pub(in crate::stream) fn memory(&self) -> MemorySource {
        let mut memory = MemorySource::new();
        for (name, bytes) in &self.archives {
            memory.insert(name, bytes.clone()).unwrap();
        }
        memory
    }
}

/// 200×100 texels in two groups; every fifth page is empty.
pub(in crate::stream) fn archive(seed: u64) -> Vec<u8> {
    let direction = Direction { theta: 0.0, phi: 0.0 };
    let manifest = Manifest {
        name: format!("test {seed}"),
        generator: "test".into(),
        width: 200,
        height: 100,
        wrap: true,
        cosine: false,
        views: vec![direction],
        lights: vec![direction],
        components: 8,
        factorization: Factorization::Fmf,
        codec: Codec::DctDeltaZstd { step: 0.01 },
        texture_scale: 1.0,
        mean_rgb: [0.5; 3],
        singular_values: vec![0.1; 8],
        errors: Ledger::default(),
    };
    let pyramid = manifest.pyramid().unwrap();
    let mut writer = ArchiveWriter::new(manifest).unwrap();
    let noise = |i: u64, length: u64| {
        (0..length)
            .map(|at| (((at + 3) * (i + 5) * (seed + 7)) >> 3) as u8)
            .collect()
    };
    for group in 0..2 {
        writer.add_column(group, noise(group.into(), 30), 1.0).unwrap();
        for (i, tile) in (1..).zip(pyramid.tiles()) {
            let length = if i % 5 == 0 { 0 } else { 100 + 37 * i };
            writer
                .add_page(PageId { group, tile }, noise(i, length), 1.0 / i as f64)
                .unwrap();
        }
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    bytes
}
