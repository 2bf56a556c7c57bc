//! `engine::residency` as a policy.

use engine::residency::{Item, Limits, MaterialId, MaterialInfo, Residency, Vote};
use tileset::PageId;

use super::run::Replay;

pub(super) struct Ours {
    residency: Residency,
    materials: Vec<MaterialInfo>,
    loads: u64,
}

impl Ours {
    pub(super) fn new(materials: &[MaterialInfo], pages: usize, loads_per_frame: usize) -> Self {
        let columns: u32 = materials.iter().map(|info| u32::from(info.groups)).sum();
        let mut residency = Residency::new(Limits {
            page_slots: pages as u32,
            column_slots: columns,
            in_flight: loads_per_frame,
            bytes_in_flight: u64::MAX,
        });
        for info in materials {
            residency.add_material(info.clone());
        }
        Self {
            residency,
            materials: materials.to_vec(),
            loads: 0,
        }
    }
}

impl Replay for Ours {
    fn frame(&mut self, votes: &[Vote], loads: usize) -> usize {
        let mut pages = Vec::new();
        // Columns are given: they arrive at once, as often as some are asked for.
        loop {
            let plan = self.residency.update(votes, &[]);
            pages.retain(|page| !plan.cancel.contains(page));
            let columns = plan
                .request
                .iter()
                .filter(|item| matches!(item, Item::Column(..)));
            let columns: Vec<Item> = columns.copied().collect();
            pages.extend(
                plan.request
                    .into_iter()
                    .filter(|item| matches!(item, Item::Page(..))),
            );
            if columns.is_empty() {
                break;
            }
            for column in columns {
                self.residency.arrived(column);
            }
        }
        for &page in pages.iter().take(loads) {
            self.residency.arrived(page);
        }
        self.loads += pages.len() as u64;
        pages.len()
    }

    fn resident(&self, material: usize, group: usize, tile: usize) -> bool {
        let Some(tile) = self.materials[material].pyramid.tile_at(tile as u32) else {
            return false;
        };
        let group = group as u16;
        self.residency
            .slot(Item::Page(MaterialId(material as u16), PageId { group, tile }))
            .is_some()
    }

    fn loads(&self) -> u64 {
        self.loads
    }
}
