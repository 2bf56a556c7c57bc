//! From records to pages and columns, with what the host keeps for it.
//!
//! A page is decoded against its decoded parent. [`HostStore`] keeps records and the pages that have children, least
//! recently used first to go, in a budget of bytes. A parent that is gone is decoded again from its record, and a
//! record that is gone is asked for again: [`Pending`] climbs down from the nearest ancestor that is left, one record
//! at a time, and holds what it has reached itself, so that it gets there however small the budget.
//!
//! Source: Schwartz, Ruiters, Klein 2013, section 6 (the client keeps received tiles for their children).

use std::sync::Arc;

use bytes::Bytes;
use lru::LruCache;
use tileset::{Column, Page, PageId, SLOT_AREA, archive::Index};

use crate::{
    Result,
    residency::{Item, MaterialId},
};

/// Bytes of a decoded page.
pub const PAGE_BYTES: u64 = SLOT_AREA as u64 * 8;
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
    /// The finest ancestor that is decoded, where one had to be decoded again.
    reached: Option<(PageId, Arc<Page>)>,
}

/// What a [`Pending`] can do next.
pub enum Step {
    /// Be decoded against this parent.
    Ready(Option<Arc<Page>>),
    /// Wait for the record of an ancestor.
    Needs(PageId),
}

impl Pending {
    /// A record that has arrived.
    pub fn new(item: Item, record: Bytes) -> Self {
        Self {
            item,
            record,
            reached: None,
        }
    }

    /// Bytes held outside the store.
    pub fn bytes(&self) -> u64 {
        self.record.len() as u64 + if self.reached.is_some() { PAGE_BYTES } else { 0 }
    }

    /// Finds the decoded parent, decoding ancestors again as far as their records are there.
    ///
    /// # Errors
    /// Those of [`tileset::codec::Decoder::page`], of an ancestor.
    pub fn step(&mut self, index: &Index, store: &mut HostStore) -> Result<Step> {
        let Item::Page(material, page) = self.item else {
            return Ok(Step::Ready(None));
        };
        let Some(parent) = parent_of(index, page) else {
            return Ok(Step::Ready(None));
        };
        // Up to the nearest ancestor that is decoded …
        let mut missing = Vec::new();
        let mut next = Some(parent);
        let mut decoded = None;
        while let Some(ancestor) = next {
            decoded = match &self.reached {
                Some((reached, page)) if *reached == ancestor => Some(page.clone()),
                _ => store.page(material, ancestor),
            };
            if decoded.is_some() {
                break;
            }
            missing.push(ancestor);
            next = parent_of(index, ancestor);
        }
        // … and down again.
        while let Some(ancestor) = missing.pop() {
            let Some(record) = local_record(index, store, material, ancestor)? else {
                return Ok(Step::Needs(ancestor));
            };
            let page = index.decoder.page(ancestor, &record, decoded.as_deref())?;
            let page = Arc::new(page);
            store.put_page(material, ancestor, page.clone());
            self.reached = Some((ancestor, page.clone()));
            decoded = Some(page);
        }
        Ok(Step::Ready(decoded))
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

/// A decoded record.
pub enum Decoded {
    /// A page.
    Page(Arc<Page>),
    /// A column.
    Column(Column),
}

/// Decodes a record against its parent. Pure: many can be decoded at once.
///
/// # Errors
/// Those of the codec.
pub fn decode(index: &Index, pending: &Pending, parent: Option<&Page>) -> Result<Decoded> {
    Ok(match pending.item {
        Item::Page(_, page) => Decoded::Page(Arc::new(index.decoder.page(page, &pending.record, parent)?)),
        Item::Column(_, group) => Decoded::Column(index.decoder.column(group, &pending.record)?),
    })
}

#[cfg(test)]
mod tests {
    use half::f16;
    use tileset::{ArchiveWriter, Codec, Factorization, Ledger, Manifest, Tile, codec, codec::MipImage};

    use super::*;

    const MATERIAL: MaterialId = MaterialId(0);

    /// An archive of one group and 256² texels, and all pages as the encoder left them.
    fn archive() -> (Index, Vec<(PageId, Bytes, Page)>) {
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
        (
            Index::parse(&bytes[..Index::prefix_bytes(&bytes).unwrap() as usize]).unwrap(),
            pages,
        )
    }

    #[test]
    fn any_page_is_decoded_from_nothing_with_little_room() {
        let (index, pages) = archive();
        for budget in [PAGE_BYTES / 2, 3 * PAGE_BYTES, 1 << 30] {
            let mut store = HostStore::new(budget);
            for (id, record, wanted) in &pages {
                let mut pending = Pending::new(Item::Page(MATERIAL, *id), record.clone());
                let mut asked = 0;
                let parent = loop {
                    match pending.step(&index, &mut store).unwrap() {
                        Step::Ready(parent) => break parent,
                        // The record comes, and is used before it is forgotten.
                        Step::Needs(ancestor) => {
                            let (_, record, _) = pages.iter().find(|(id, ..)| *id == ancestor).unwrap();
                            store.put_record(Item::Page(MATERIAL, ancestor), record.clone());
                            asked += 1;
                        }
                    }
                };
                assert!(asked <= u32::from(index.pyramid.tail_mip() - id.tile.mip));
                assert!(store.bytes() <= budget);
                let Decoded::Page(page) = decode(&index, &pending, parent.as_deref()).unwrap() else {
                    panic!("{id} is no page")
                };
                assert!(*page == *wanted, "{id}");
            }
        }
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
