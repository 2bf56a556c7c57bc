//! A scene for residency, and what is right about it worked out the slow and obvious way.

use engine::residency::{Item, Limits, MaterialId, MaterialInfo, SLOTS_PER_PIN, SWAP_MARGIN, Vote};
use proptest::prelude::*;
use tileset::{PageId, Pyramid, Tile};

/// Materials and the votes of the moment.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    pub(crate) materials: Vec<MaterialInfo>,
    pub(crate) votes: Vec<Vote>,
}

/// Up to three small materials with weights of all magnitudes, many of them zero.
pub(crate) fn scene() -> impl Strategy<Value = Scene> {
    let size = prop::sample::select(vec![
        (20, 30),
        (64, 64),
        (100, 65),
        (200, 130),
        (300, 70),
        (256, 256),
    ]);
    // Multiples of a power of two: sums are exact in any order.
    let small = (0u32..4096).prop_map(|n| n as f32 / 65536.0);
    let weight = prop_oneof![2 => Just(0.0f32), 3 => (0u32..20).prop_map(|n| n as f32), 2 => small];
    let material = (size, any::<bool>(), 0u16..4).prop_flat_map(move |((width, height), wrap, groups)| {
        let pyramid = Pyramid::new(width, height, wrap).unwrap();
        let pages = usize::from(groups) * pyramid.tile_count() as usize;
        let bytes = |items| prop::collection::vec(0u32..200, items);
        (
            prop::collection::vec(weight.clone(), pages),
            bytes(pages),
            bytes(groups.into()),
        )
            .prop_map(move |(weights, page_bytes, column_bytes)| MaterialInfo {
                pyramid,
                groups,
                weights,
                visibility: Vec::new(),
                page_bytes,
                column_bytes,
            })
    });
    prop::collection::vec(material, 1..4).prop_map(|materials| Scene {
        materials,
        votes: Vec::new(),
    })
}

/// The same where errors are seen more in some places than in others.
pub(crate) fn scene_seen() -> impl Strategy<Value = Scene> {
    // Powers of two, so that sums stay exact.
    let visibility = prop::collection::vec((-3i32..4).prop_map(|n| 2f32.powi(n)), 30);
    (scene(), prop::collection::vec(visibility, 3)).prop_map(|(mut scene, visibility)| {
        for (material, visibility) in scene.materials.iter_mut().zip(visibility) {
            material.visibility = visibility;
        }
        scene
    })
}

/// Votes, some of them for what there is not.
pub(crate) fn votes() -> impl Strategy<Value = Vec<Vote>> {
    let vote = (0u16..4, 0u32..30, 0u32..50).prop_map(|(material, tile, pixels)| Vote {
        material: MaterialId(material),
        tile,
        pixels,
    });
    prop::collection::vec(vote, 0..12)
}

impl Scene {
    /// The same with weights that never grow from a page to its children.
    pub(crate) fn falling(mut self) -> Self {
        for MaterialInfo {
            pyramid,
            groups,
            weights,
            ..
        } in &mut self.materials
        {
            let tiles = pyramid.tile_count() as usize;
            for group in 0..usize::from(*groups) {
                for (at, tile) in pyramid.tiles().enumerate() {
                    if let Some(parent) = pyramid.parent(tile).and_then(|parent| pyramid.tile_index(parent)) {
                        let above = weights[group * tiles + parent as usize];
                        weights[group * tiles + at] = weights[group * tiles + at].min(above);
                    }
                }
            }
        }
        self
    }

    /// Pages and columns.
    pub(crate) fn items(&self) -> usize {
        let items = |info: &MaterialInfo| usize::from(info.groups) * (info.pyramid.tile_count() as usize + 1);
        self.materials.iter().map(items).sum()
    }

    /// Bytes of an item's record.
    pub(crate) fn bytes(&self, item: Item) -> u64 {
        let bytes = match item {
            Item::Page(material, page) => {
                let info = &self.materials[usize::from(material.0)];
                let tile = info.pyramid.tile_index(page.tile).unwrap();
                info.page_bytes[(u32::from(page.group) * info.pyramid.tile_count() + tile) as usize]
            }
            Item::Column(material, group) => {
                self.materials[usize::from(material.0)].column_bytes[usize::from(group)]
            }
        };
        bytes.into()
    }

    /// Votes that name a tile that there is.
    fn valid_votes(&self) -> impl Iterator<Item = (usize, Tile, f64)> + '_ {
        self.votes.iter().filter_map(|vote| {
            let info = self.materials.get(usize::from(vote.material.0))?;
            let tile = info.pyramid.tile_at(vote.tile)?;
            (vote.pixels > 0).then_some((usize::from(vote.material.0), tile, f64::from(vote.pixels)))
        })
    }

    fn pixels(&self) -> f64 {
        self.valid_votes().map(|(_, _, pixels)| pixels).sum()
    }

    /// w·v.
    fn gain(&self, material: usize, group: u16, tile: Tile) -> f64 {
        let MaterialInfo { pyramid, weights, .. } = &self.materials[material];
        let at =
            usize::from(group) * pyramid.tile_count() as usize + pyramid.tile_index(tile).unwrap() as usize;
        let wants = |wanted: Tile| {
            let mut wanted = Some(wanted);
            while wanted.is_some_and(|wanted| wanted != tile) {
                wanted = pyramid.parent(wanted.unwrap());
            }
            wanted.is_some()
        };
        let votes = self
            .valid_votes()
            .filter(|(of, wanted, _)| *of == material && wants(*wanted));
        f64::from(weights[at]) * votes.map(|(_, _, pixels)| pixels).sum::<f64>()
    }

    /// Whether an item, or anything that needs it, lowers the error.
    pub(crate) fn is_useful(&self, item: Item) -> bool {
        match item {
            Item::Page(MaterialId(material), page) => {
                let pyramid = self.materials[usize::from(material)].pyramid;
                self.gain(material.into(), page.group, page.tile) > 0.0
                    || pyramid
                        .children(page.tile)
                        .any(|tile| self.is_useful(Item::Page(MaterialId(material), PageId { tile, ..page })))
            }
            Item::Column(material, group) => {
                let tile = self.materials[usize::from(material.0)].pyramid.root();
                self.is_useful(Item::Page(material, PageId { group, tile }))
            }
        }
    }

    /// The definition, pixel by pixel: the weights of what is missing on the way from the wanted tile to
    /// the root, or of the whole way if root or column are.
    pub(crate) fn predicted_mse(&self, resident: impl Fn(Item) -> bool) -> f64 {
        let mut sum = 0.0;
        for (material, wanted, pixels) in self.valid_votes() {
            let MaterialInfo {
                pyramid,
                groups,
                weights,
                ..
            } = &self.materials[material];
            let id = MaterialId(material as u16);
            for group in 0..*groups {
                let there = |tile| resident(Item::Page(id, PageId { group, tile }));
                let shown = there(pyramid.root()) && resident(Item::Column(id, group));
                let mut tile = Some(wanted);
                while let Some(at) = tile {
                    let index = usize::from(group) * pyramid.tile_count() as usize
                        + pyramid.tile_index(at).unwrap() as usize;
                    if !shown || !there(at) {
                        sum += pixels * f64::from(weights[index]);
                    }
                    tile = pyramid.parent(at);
                }
            }
        }
        if self.pixels() > 0.0 {
            sum / self.pixels()
        } else {
            0.0
        }
    }

    fn visible(&self) -> std::collections::BTreeSet<usize> {
        self.valid_votes().map(|(material, ..)| material).collect()
    }

    /// Roots of group 0 that must be resident when nothing moves any more.
    pub(crate) fn roots_to_expect(&self, page_slots: u32) -> Vec<Item> {
        let visible = self.visible();
        if visible.len() > (page_slots / SLOTS_PER_PIN) as usize {
            return Vec::new();
        }
        let roots = visible
            .into_iter()
            .filter(|&material| self.materials[material].groups > 0)
            .map(|material| {
                let tile = self.materials[material].pyramid.root();
                Item::Page(MaterialId(material as u16), PageId { group: 0, tile })
            });
        roots.filter(|root| self.is_useful(*root)).collect()
    }

    /// Whether there is room for everything that lowers the error.
    pub(crate) fn fits(&self, limits: Limits) -> bool {
        let groups = self.trees().count();
        let pages: usize = self.trees().map(|tree| tree.pages_of_use()).sum();
        pages <= limits.page_slots as usize && groups <= limits.column_slots as usize && limits.in_flight > 0
    }

    /// The gains of each group of each material.
    fn trees(&self) -> impl Iterator<Item = Tree> + '_ {
        (0..self.materials.len()).flat_map(move |material| {
            (0..self.materials[material].groups).map(move |group| {
                let root = Item::Page(
                    MaterialId(material as u16),
                    PageId {
                        group,
                        tile: self.materials[material].pyramid.root(),
                    },
                );
                let tree = self.tree(material, group, self.materials[material].pyramid.root());
                Tree {
                    useful: self.is_useful(root),
                    ..tree
                }
            })
        })
    }

    fn tree(&self, material: usize, group: u16, tile: Tile) -> Tree {
        let children = self.materials[material].pyramid.children(tile);
        let children: Vec<Tree> = children.map(|child| self.tree(material, group, child)).collect();
        let gain = self.gain(material, group, tile);
        Tree {
            gain,
            useful: gain > 0.0 || children.iter().any(|child| child.useful),
            children,
        }
    }

    /// Sum of all gains.
    fn whole(&self) -> f64 {
        self.trees().map(|tree| tree.sum()).sum()
    }

    /// The least predicted error that any closed set of `slots` pages has, pinned roots included, with all
    /// columns.
    pub(crate) fn best_mse(&self, slots: usize) -> f64 {
        if self.pixels() == 0.0 {
            return 0.0;
        }
        let pinned = self.visible().len() <= slots / SLOTS_PER_PIN as usize;
        let mut best = vec![0.0; slots + 1];
        for material in 0..self.materials.len() {
            let root = self.materials[material].pyramid.root();
            for group in 0..self.materials[material].groups {
                let tree = self.tree(material, group, root);
                let mut gains = tree.best(slots);
                if pinned && group == 0 && tree.useful {
                    gains[0] = f64::NEG_INFINITY;
                }
                best = join(&best, &gains, slots);
            }
        }
        let most = best.into_iter().fold(0.0, f64::max);
        (self.whole() - most) / self.pixels()
    }

    /// What settling may forgo: the margin on everything resident, and one set of pages that share a value,
    /// which the budget may cut.
    pub(crate) fn slack(&self, mse: f64) -> (f64, f64) {
        if self.pixels() == 0.0 {
            return (0.0, 0.0);
        }
        let gained = self.whole() / self.pixels() - mse;
        let block = self.trees().map(|tree| tree.largest_block()).fold(0.0, f64::max);
        (gained * SWAP_MARGIN, block / self.pixels())
    }
}

/// Gains of a page and all below it.
struct Tree {
    gain: f64,
    useful: bool,
    children: Vec<Tree>,
}

impl Tree {
    fn sum(&self) -> f64 {
        self.gain + self.children.iter().map(Tree::sum).sum::<f64>()
    }

    fn pages_of_use(&self) -> usize {
        usize::from(self.useful) + self.children.iter().map(Tree::pages_of_use).sum::<usize>()
    }

    /// The largest gain of any closed set of 0, 1, … `slots` pages.
    fn best(&self, slots: usize) -> Vec<f64> {
        let below = self.children.iter().fold(vec![0.0; slots + 1], |best, child| {
            join(&best, &child.best(slots), slots)
        });
        let with = |pages: usize| {
            if pages == 0 {
                0.0
            } else {
                self.gain + below[pages - 1]
            }
        };
        (0..=slots).map(with).collect()
    }

    /// The largest sum over a set of largest mean with any page at its top.
    fn largest_block(&self) -> f64 {
        let below = self.children.iter().map(Tree::largest_block).fold(0.0, f64::max);
        // Dinkelbach 1967: the mean of the best set for one price is a better price.
        let mut price = self.gain;
        for _ in 0..100 {
            let (sum, pages) = self.set_at(price);
            price = sum / pages;
        }
        below.max(self.set_at(price - 1e-12).0)
    }

    /// Sum and number of pages of the set that gains most when a page costs `price`, this one included.
    fn set_at(&self, price: f64) -> (f64, f64) {
        let sets = self.children.iter().map(|child| child.set_at(price));
        let worth_it = sets.filter(|(sum, pages)| sum - price * pages > 0.0);
        worth_it.fold((self.gain, 1.0), |(sum, pages), (more, of)| {
            (sum + more, pages + of)
        })
    }
}

/// The best split of each number of pages between two sets of trees.
fn join(a: &[f64], b: &[f64], slots: usize) -> Vec<f64> {
    let split = |pages: usize| {
        (0..=pages)
            .map(|first| a[first] + b[pages - first])
            .fold(f64::NEG_INFINITY, f64::max)
    };
    (0..=slots).map(split).collect()
}
