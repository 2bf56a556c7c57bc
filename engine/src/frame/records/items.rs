//! What an item is to an archive: its record, its request, its name.

use std::sync::Arc;

use tileset::{PageId, Record};

use crate::{
    Result,
    decode::alone,
    gpu::materials::Btf,
    residency::{Item, MaterialId},
    stream::Request,
};

pub(super) fn material_of(item: Item) -> MaterialId {
    let (Item::Page(material, _) | Item::Column(material, _)) = item;
    material
}

pub(super) fn btf_of(item: Item, btfs: &[Arc<Btf>]) -> &Arc<Btf> {
    &btfs[usize::from(material_of(item).0)]
}

/// Whether a page has children that the host decodes.
pub(super) fn has_children_here(btf: &Btf, page: PageId, on_gpu: bool) -> bool {
    let mut children = btf.pyramid().children(page.tile);
    children.any(|tile| !alone(&btf.index, PageId { tile, ..page }, on_gpu))
}

pub(super) fn record_of(item: Item, btfs: &[Arc<Btf>]) -> Result<Record> {
    Ok(match item {
        Item::Page(_, page) => btf_of(item, btfs).index.page(page)?,
        Item::Column(_, group) => btf_of(item, btfs).index.column(group)?,
    })
}

/// Bytes of the record.
pub(super) fn length(item: Item, btfs: &[Arc<Btf>]) -> u64 {
    record_of(item, btfs).map_or(0, |record| record.length.into())
}

pub(super) fn request(item: Item, btfs: &[Arc<Btf>]) -> Request {
    let archive = btf_of(item, btfs).archive.clone();
    match item {
        Item::Page(_, page) => Request::Page { archive, page },
        Item::Column(_, group) => Request::Column { archive, group },
    }
}

pub(super) fn name(item: Item, btfs: &[Arc<Btf>]) -> String {
    let archive = &btf_of(item, btfs).archive;
    match item {
        Item::Page(_, page) => format!("{archive} {page}"),
        Item::Column(_, group) => format!("{archive} column of group {group}"),
    }
}
