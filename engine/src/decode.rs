//! From records to pages and columns, with what the host keeps for it.
//!
//! A page is decoded against its decoded parent. [`HostStore`] keeps records and the pages that have children, least
//! recently used first to go, in a budget of bytes. A parent that is gone is decoded again from its record, and a
//! record that is gone is asked for again: [`Pending`] climbs to the nearest ancestor that is left and holds the records
//! that it meets on the way itself, so that it gets there however small the budget. What it then needs is a [`Job`],
//! which any thread can run.
//!
//! Where the GPU decodes, a page is entropy decoded alone: its parent is in the page cache, and the host keeps none.
//!
//! Source: Schwartz, Ruiters, Klein 2013, section 6 (the client keeps received tiles for their children).

use std::sync::Arc;

use bytes::Bytes;
use half::f16;
use lru::LruCache;
use tileset::{Page, PageId, SLOT_AREA, archive::Index, codec::pyramid_dct::Coefficients};

use crate::{
    Result,
    gpu::materials::Btf,
    residency::{Item, MaterialId},
};

/// Bytes of a decoded page.
pub const PAGE_BYTES: u64 = SLOT_AREA as u64 * 8;
/// Most bytes of a page's coefficients.
const COEFFICIENTS_BYTES: u64 = Coefficients::MAX_WORDS as u64 * 4;
/// Bytes that an entry of the store takes beside its contents.
const ENTRY_BYTES: u64 = 128;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Key {
    Record(Item),
    Page(MaterialId, PageId),
}

enum Held {
    Record(Bytes),
    Page(Arc<Page>),
}

impl Held {
    fn bytes(&self) -> u64 {
        ENTRY_BYTES
            + match self {
                Held::Record(bytes) => bytes.len() as u64,
                Held::Page(_) => PAGE_BYTES,
            }
    }
}

/// Records and decoded pages on the host.
pub struct HostStore {
    held: LruCache<Key, Held>,
    bytes: u64,
    reserved_bytes: u64,
    budget_bytes: u64,
}

impl HostStore {
    /// An empty store that keeps at most `budget_bytes`.
    pub fn new(budget_bytes: u64) -> Self {
        Self {
            held: LruCache::unbounded(),
            bytes: 0,
            reserved_bytes: 0,
            budget_bytes,
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// A record that has been received, checked.
    pub fn record(&mut self, item: Item) -> Option<Bytes> {
        match self.held.get(&Key::Record(item))? {
            Held::Record(bytes) => Some(bytes.clone()),
            Held::Page(_) => None,
        }
    }

    /// A decoded page.
    pub fn page(&mut self, material: MaterialId, page: PageId) -> Option<Arc<Page>> {
        match self.held.get(&Key::Page(material, page))? {
            Held::Page(page) => Some(page.clone()),
            Held::Record(_) => None,
        }
    }

    /// Keeps a record. It must have been checked.
    pub fn put_record(&mut self, item: Item, bytes: Bytes) {
        self.put(Key::Record(item), Held::Record(bytes));
    }

    /// Keeps a page.
    pub fn put_page(&mut self, material: MaterialId, page: PageId, decoded: Arc<Page>) {
        self.put(Key::Page(material, page), Held::Page(decoded));
    }

    fn put(&mut self, key: Key, held: Held) {
        self.bytes += held.bytes();
        self.bytes -= self.held.put(key, held).map_or(0, |old| old.bytes());
        self.shrink();
    }

    /// Changes the budget.
    pub fn set_budget(&mut self, budget_bytes: u64) {
        self.budget_bytes = budget_bytes;
        self.shrink();
    }

    /// Leaves this much of the budget to others.
    pub fn reserve(&mut self, bytes: u64) {
        self.reserved_bytes = bytes;
        self.shrink();
    }

    fn shrink(&mut self) {
        while self.bytes.saturating_add(self.reserved_bytes) > self.budget_bytes {
            let Some((_, oldest)) = self.held.pop_lru() else {
                break;
            };
            self.bytes -= oldest.bytes();
        }
    }
}

/// A record that is here and waits to be decoded.
pub struct Pending {
    /// What it is.
    pub item: Item,
    /// Its bytes, checked.
    pub record: Bytes,
    /// Records of ancestors without decoded texels, from the parent upwards.
    above: Vec<(PageId, Bytes)>,
    on_gpu: bool,
}

/// Whether a page is decoded without its parent, to coefficients: with `on_gpu`, where the codec has them.
pub fn alone(index: &Index, page: PageId, on_gpu: bool) -> bool {
    on_gpu && index.decoder.has_coefficients(page)
}

/// What a [`Pending`] can do next.
pub enum Step {
    /// Be decoded, from this ancestor down: [`Pending::job`].
    Ready(Option<Arc<Page>>),
    /// Wait for the record of an ancestor.
    Needs(PageId),
    /// Wait for an ancestor that is being decoded.
    Later,
}

impl Pending {
    /// A record that has arrived; with `on_gpu` only what is serial of decoding it is done here, where that can be split.
    pub fn new(item: Item, record: Bytes, on_gpu: bool) -> Self {
        Self {
            item,
            record,
            above: Vec::new(),
            on_gpu,
        }
    }

    /// Bytes held outside the store.
    pub fn bytes(&self) -> u64 {
        let above: usize = self.above.iter().map(|(_, record)| record.len()).sum();
        (self.record.len() + above) as u64
    }

    /// Finds what decoding takes: the decoded parent, or records of ancestors up to one that is decoded.
    /// `busy` tells which pages are being decoded elsewhere.
    ///
    /// # Errors
    /// [`tileset::Error::NotFound`] for a page that the archive does not have.
    pub fn step(
        &mut self,
        index: &Index,
        store: &mut HostStore,
        busy: impl Fn(Item) -> bool,
    ) -> Result<Step> {
        let mut parent = None;
        if let Item::Page(material, page) = self.item
            && !alone(index, page, self.on_gpu)
        {
            let mut above = 0;
            let mut next = parent_of(index, page);
            while let Some(ancestor) = next {
                parent = store.page(material, ancestor);
                if parent.is_some() {
                    break;
                }
                if busy(Item::Page(material, ancestor)) {
                    return Ok(Step::Later);
                }
                if above == self.above.len() {
                    let Some(record) = local_record(index, store, material, ancestor)? else {
                        return Ok(Step::Needs(ancestor));
                    };
                    self.above.push((ancestor, record));
                }
                above += 1;
                next = parent_of(index, ancestor);
            }
            // Ancestors may have been decoded since their records were found.
            self.above.truncate(above);
        }
        Ok(Step::Ready(parent))
    }

    /// Pages that will be decoded on the way.
    pub fn ancestors(&self) -> impl Iterator<Item = PageId> + '_ {
        self.above.iter().map(|&(page, _)| page)
    }

    /// Most bytes that decoding it takes, with all results, and with a decoded parent or not.
    pub fn decoding_bytes(&self, btf: &Btf, parent: bool) -> u64 {
        let decoded = match self.item {
            Item::Page(_, page) if alone(&btf.index, page, self.on_gpu) => COEFFICIENTS_BYTES,
            Item::Page(..) => (1 + self.above.len() as u64 + u64::from(parent)) * PAGE_BYTES,
            Item::Column(..) => btf.column_quads() * 8,
        };
        self.bytes() + decoded
    }

    /// The work, once it is [ready](Step::Ready).
    pub fn job(self, btf: Arc<Btf>, parent: Option<Arc<Page>>) -> Job {
        Job {
            item: self.item,
            record: self.record,
            above: self.above,
            parent,
            btf,
            on_gpu: self.on_gpu,
        }
    }
}

/// The page that a page is decoded against.
fn parent_of(index: &Index, page: PageId) -> Option<PageId> {
    Some(PageId {
        tile: index.pyramid.parent(page.tile)?,
        ..page
    })
}

fn local_record(
    index: &Index,
    store: &mut HostStore,
    material: MaterialId,
    page: PageId,
) -> Result<Option<Bytes>> {
    if index.page(page)?.length == 0 {
        return Ok(Some(Bytes::new()));
    }
    Ok(store.record(Item::Page(material, page)))
}

/// All that it takes to decode an item.
pub struct Job {
    /// What it is.
    pub item: Item,
    record: Bytes,
    above: Vec<(PageId, Bytes)>,
    parent: Option<Arc<Page>>,
    btf: Arc<Btf>,
    on_gpu: bool,
}

/// A decoded record, as the caches take it.
pub enum Decoded {
    /// A page.
    Page(Arc<Page>),
    /// A page that is added to its parent on the GPU.
    Coefficients(Coefficients),
    /// A column, see [`Btf::cached_column`].
    Column(Vec<[f16; 4]>),
}

/// What came of a [`Job`].
pub struct Done {
    /// What it is.
    pub item: Item,
    /// The ancestors that had to be decoded on the way …
    pub above: Vec<PageId>,
    /// … and their texels, as far as that went.
    pub ancestors: Vec<(PageId, Arc<Page>)>,
    /// The item itself.
    pub decoded: Result<Decoded>,
}

impl Job {
    /// Decodes. Pure: any thread can do it, and many at once.
    pub fn run(mut self) -> Done {
        let above: Vec<PageId> = self.above.iter().map(|&(page, _)| page).collect();
        let mut ancestors = Vec::with_capacity(above.len());
        let decoded = self.decode(&mut ancestors);
        Done {
            item: self.item,
            above,
            ancestors,
            decoded,
        }
    }

    fn decode(&mut self, ancestors: &mut Vec<(PageId, Arc<Page>)>) -> Result<Decoded> {
        let decoder = &self.btf.index.decoder;
        let page = match self.item {
            Item::Page(_, page) => page,
            Item::Column(_, group) => {
                let column = decoder.column(group, &self.record)?;
                return Ok(Decoded::Column(self.btf.cached_column(&column)));
            }
        };
        if alone(&self.btf.index, page, self.on_gpu) {
            return Ok(Decoded::Coefficients(decoder.coefficients(page, &self.record)?));
        }
        while let Some((ancestor, record)) = self.above.pop() {
            let decoded = Arc::new(decoder.page(ancestor, &record, self.parent.as_deref())?);
            self.parent = Some(decoded.clone());
            ancestors.push((ancestor, decoded));
        }
        let decoded = decoder.page(page, &self.record, self.parent.as_deref())?;
        Ok(Decoded::Page(Arc::new(decoded)))
    }
}

#[cfg(test)]
mod tests {
    use tileset::{
        ArchiveWriter, Codec, Column, Factorization, Ledger, Manifest, Tile, codec, codec::MipImage,
    };

    use super::*;

    const MATERIAL: MaterialId = MaterialId(0);

    /// An archive of one group and 256² texels, and all pages as the encoder left them.
    fn archive() -> (Arc<Btf>, Vec<(PageId, Bytes, Page)>) {
        let up = tileset::Direction { theta: 0.0, phi: 0.0 };
        let manifest = Manifest {
            name: "noise".into(),
            generator: "test".into(),
            width: 256,
            height: 256,
            wrap: true,
            cosine: false,
            views: vec![up],
            lights: vec![up],
            components: 4,
            factorization: Factorization::Fmf,
            codec: Codec::DctDeltaZstd { step: 0.01 },
            texture_scale: 1.0,
            mean_rgb: [0.5; 3],
            singular_values: vec![1.0; 4],
            errors: Ledger::default(),
        };
        let pyramid = manifest.pyramid().unwrap();
        let noise = |at: u32| (at.wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
        let texels = (0..256 * 256)
            .map(|at| std::array::from_fn(|c| noise(at * 4 + c as u32)))
            .collect();
        let mut mips = vec![MipImage {
            width: 256,
            height: 256,
            texels,
        }];
        for _ in 0..pyramid.tail_mip() {
            mips.push(mips[mips.len() - 1].downsample());
        }
        let mut writer = ArchiveWriter::new(manifest.clone()).unwrap();
        let mut pages: Vec<(PageId, Bytes, Page)> = Vec::new();
        for tile in pyramid.tiles() {
            let parent = pyramid.parent(tile).and_then(|parent| pyramid.tile_index(parent));
            let parent = parent.map(|parent| &pages[parent as usize].2);
            let mip = &mips[usize::from(tile.mip)];
            let page = codec::encode_page(manifest.codec, &pyramid, tile, mip, parent).unwrap();
            let id = PageId { group: 0, tile };
            writer.add_page(id, page.bytes.clone(), page.weight).unwrap();
            pages.push((id, page.bytes.into(), page.decoded));
        }
        let column = Column {
            texels: vec![[f16::ONE; 4]; 3],
        };
        writer
            .add_column(0, codec::encode_column(&column).unwrap(), 1.0)
            .unwrap();
        let mut bytes = Vec::new();
        writer.write(&mut bytes).unwrap();
        let index = Index::parse(&bytes[..Index::prefix_bytes(&bytes).unwrap() as usize]).unwrap();
        (Arc::new(Btf::new("noise".into(), index)), pages)
    }

    #[test]
    fn any_page_is_decoded_from_nothing_with_little_room() {
        let (btf, pages) = archive();
        for budget in [PAGE_BYTES / 2, 3 * PAGE_BYTES, 1 << 30] {
            let mut store = HostStore::new(budget);
            for (id, record, wanted) in &pages {
                let mut pending = Pending::new(Item::Page(MATERIAL, *id), record.clone(), false);
                let mut asked = 0;
                let parent = loop {
                    match pending.step(&btf.index, &mut store, |_| false).unwrap() {
                        Step::Ready(parent) => break parent,
                        // The record comes, and is used before it is forgotten.
                        Step::Needs(ancestor) => {
                            let (_, record, _) = pages.iter().find(|(id, ..)| *id == ancestor).unwrap();
                            store.put_record(Item::Page(MATERIAL, ancestor), record.clone());
                            asked += 1;
                        }
                        Step::Later => panic!("nobody else decodes"),
                    }
                };
                let most = u32::from(btf.pyramid().tail_mip() - id.tile.mip);
                assert!(asked <= most);
                assert!(store.bytes() <= budget);
                let bytes = pending.decoding_bytes(&btf, parent.is_some());
                let above = pending.ancestors().count() as u64;
                assert!(above <= u64::from(most) && bytes >= (1 + above) * PAGE_BYTES);
                let done = pending.job(btf.clone(), parent).run();
                assert_eq!(done.ancestors.len() as u64, above);
                for (ancestor, page) in done.ancestors {
                    store.put_page(MATERIAL, ancestor, page);
                }
                let Ok(Decoded::Page(page)) = done.decoded else {
                    panic!("{id} is no page")
                };
                assert!(*page == *wanted, "{id}");
            }
        }
    }

    #[test]
    fn what_is_being_decoded_is_waited_for() {
        let (btf, pages) = archive();
        let mut store = HostStore::new(1 << 30);
        for (id, record, _) in &pages {
            store.put_record(Item::Page(MATERIAL, *id), record.clone());
        }
        let root = pages[0].0;
        let (last, record, _) = &pages[pages.len() - 1];
        let mut pending = Pending::new(Item::Page(MATERIAL, *last), record.clone(), false);
        let busy = |item| item == Item::Page(MATERIAL, root);
        assert!(matches!(
            pending.step(&btf.index, &mut store, busy).unwrap(),
            Step::Later
        ));
        store.put_page(MATERIAL, root, Arc::new(pages[0].2.clone()));
        let Step::Ready(parent) = pending.step(&btf.index, &mut store, |_| false).unwrap() else {
            panic!("all records are here")
        };
        assert!(pending.ancestors().all(|page| page != root));
        assert!(pending.job(btf, parent).run().decoded.is_ok());
    }

    #[test]
    fn the_least_recently_used_goes_first_and_reserved_bytes_count() {
        let item = |x| {
            Item::Page(
                MATERIAL,
                PageId {
                    group: 0,
                    tile: Tile { mip: 0, x, y: 0 },
                },
            )
        };
        let mut store = HostStore::new(3 * (100 + ENTRY_BYTES));
        for x in 0..3 {
            store.put_record(item(x), vec![x as u8; 100].into());
        }
        assert_eq!(store.bytes(), 3 * (100 + ENTRY_BYTES));
        assert!(store.record(item(0)).is_some());
        store.put_record(item(3), vec![3; 100].into());
        assert!(store.record(item(1)).is_none() && store.record(item(0)).is_some());
        // The same again takes no more room.
        store.put_record(item(3), vec![3; 100].into());
        assert_eq!(store.bytes(), 3 * (100 + ENTRY_BYTES));
        store.reserve(100 + ENTRY_BYTES);
        assert!(store.record(item(2)).is_none() && store.record(item(3)).is_some());
        store.reserve(u64::MAX);
        assert_eq!(store.bytes(), 0);
    }
}
