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

mod store;

use std::sync::Arc;

use bytes::Bytes;
use half::f16;
use tileset::{Page, PageId, SLOT_AREA, archive::Index, codec::pyramid_dct::Coefficients};

use crate::{
    Result,
    gpu::{PageFormat, Rounded, materials::Btf},
    residency::{Item, MaterialId},
};

pub use store::HostStore;

/// Bytes of a decoded page.
pub const PAGE_BYTES: u64 = SLOT_AREA as u64 * 8;
/// Most bytes of a page's coefficients.
const COEFFICIENTS_BYTES: u64 = Coefficients::MAX_WORDS as u64 * 4;
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

    /// Changes where it is decoded; see [`Pending::new`].
    pub fn set_on_gpu(&mut self, on_gpu: bool) {
        self.on_gpu = on_gpu;
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
            Item::Page(..) => {
                let rounded = match btf.page_format {
                    PageFormat::Half => 0,
                    PageFormat::Byte => Rounded::BYTES,
                };
                (1 + self.above.len() as u64 + u64::from(parent)) * PAGE_BYTES + rounded
            }
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
    /// A page for a cache of bytes.
    Rounded(Rounded),
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
    /// … and their texels, as far as that went; with them those of a page with children that comes rounded.
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
        let decoded = Arc::new(decoded);
        if self.btf.page_format == PageFormat::Half {
            return Ok(Decoded::Page(decoded));
        }
        let pyramid = self.btf.pyramid();
        if pyramid.children(page.tile).next().is_some() {
            ancestors.push((page, decoded.clone()));
        }
        Ok(Decoded::Rounded(Rounded::new(
            decoded,
            pyramid.payload(page.tile),
        )))
    }
}

#[cfg(test)]
mod tests;
