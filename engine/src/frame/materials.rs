//! What has become of each material.

use std::sync::Arc;

use tileset::PageId;

use super::{Engine, archives::Progress};
use crate::residency::{Item, MaterialId};

/// How far a material is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MaterialState {
    /// Its archive's index is not here yet: it is grey.
    Unknown,
    /// It shows its mean colour; pages and columns are on their way, or nothing of it is in view.
    Loading,
    /// Some of its component groups show.
    Shown,
    /// It is as good as this view and the budgets let it be.
    Settled,
    /// Its archive was given up, and why.
    Failed(String),
}

/// A material that is streamed: an archive, which several materials of the scene may name.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialStatus {
    /// Name of the archive.
    pub name: Arc<str>,
    /// How far it is.
    pub state: MaterialState,
    /// Bytes that crossed the wire for it since the start.
    pub wire_bytes: u64,
    /// Component groups; 0 while it is unknown.
    pub groups: u16,
    /// Columns in the cache.
    pub columns_resident: u32,
    /// Pages in the cache.
    pub pages_resident: u32,
    /// Of the squared error that the view would have without any page of it, the part that is gone: from 0 to 1, where 1 is full
    /// residency. `None` where nothing of it has been seen in view.
    pub progress: Option<f64>,
}

impl Engine {
    /// The streamed materials of the scene, each archive once. Costs nothing but the call.
    pub fn materials(&self) -> Vec<MaterialStatus> {
        let of_btf = self.archives_of_btfs();
        let mut resident = vec![[0u32; 2]; self.archives.count()];
        for (item, _) in self.residency.resident() {
            let (material, column) = match item {
                Item::Page(material, _) => (material, false),
                Item::Column(material, _) => (material, true),
            };
            resident[of_btf[usize::from(material.0)]][usize::from(column)] += 1;
        }
        let statuses = resident
            .into_iter()
            .enumerate()
            .map(|(archive, [pages, columns])| {
                let (name, wire_bytes, progress) = self.archives.progress(archive);
                let btf = self.archives.shown_of(archive);
                MaterialStatus {
                    name: name.clone(),
                    state: match progress {
                        Progress::Failed(detail) => MaterialState::Failed(detail.to_owned()),
                        Progress::Pending if btf.is_none() => MaterialState::Unknown,
                        Progress::Pending => MaterialState::Shown,
                        Progress::Known => btf.map_or(MaterialState::Unknown, |btf| self.state_of(btf)),
                    },
                    wire_bytes,
                    groups: btf.map_or(0, |btf| self.btfs[btf].groups()),
                    columns_resident: columns,
                    pages_resident: pages,
                    progress: btf.and_then(|btf| self.progress_of(btf)),
                }
            });
        statuses.collect()
    }

    /// Of each BTF the archive, by index.
    pub(super) fn archives_of_btfs(&self) -> Vec<usize> {
        let of = |name: &str| self.archives.index_of(name).unwrap_or_default();
        self.btfs.iter().map(|btf| of(&btf.archive)).collect()
    }

    fn state_of(&self, btf: usize) -> MaterialState {
        let material = MaterialId(btf as u16);
        let tile = self.btfs[btf].pyramid().root();
        let is_here = |item| self.residency.slot(item).is_some();
        let shows = |group| {
            is_here(Item::Column(material, group)) && is_here(Item::Page(material, PageId { group, tile }))
        };
        if self.was_settled || (self.window.complete(self.view) && self.progress_of(btf) == Some(1.0)) {
            MaterialState::Settled
        } else if (0..self.btfs[btf].groups()).any(shows) {
            MaterialState::Shown
        } else {
            MaterialState::Loading
        }
    }

    fn progress_of(&self, btf: usize) -> Option<f64> {
        let [missing, all] = self.residency.errors(MaterialId(btf as u16));
        (all > 0.0).then(|| (1.0 - missing / all).clamp(0.0, 1.0))
    }
}
