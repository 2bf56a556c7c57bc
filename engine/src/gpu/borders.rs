//! Borders from neighbours: which payload texels of which pages belong into which border texels.
//!
//! Pure geometry; [`super::stitch`] copies. A border shows what the wrapped or clamped mip has there, so it is cut
//! along each axis into runs that lie in one page each: two for most borders, more where a last page is narrower than
//! the border. What a clamped page repeats of its own edge is the decoder's, and so is the whole root, whose packed
//! mips have borders of their own.
//!
//! Source of the border itself: Schwartz, Ruiters, Klein 2013, sections 3 and 7.

use std::collections::HashMap;

use tileset::{BORDER_TEXELS, PAGE_TEXELS, Pyramid, SLOT_TEXELS, Tile};

/// Most texels that [`into`] names: the border of a whole page.
pub const MOST_INTO: u32 = SLOT_TEXELS * SLOT_TEXELS - PAGE_TEXELS * PAGE_TEXELS;
/// Most texels that [`out_of`] names: beside a narrow last page a column is seen up to twice more than elsewhere.
pub const MOST_OUT: u32 = (PAGE_TEXELS + 4 * BORDER_TEXELS).pow(2) - PAGE_TEXELS * PAGE_TEXELS;

/// A rectangle of a page's border, and where its texels stand in a payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Strip {
    /// The tile whose payload is read.
    pub source: Tile,
    /// The tile whose border is filled; the same as the source where a mip that wraps is one page wide.
    pub destination: Tile,
    /// First texel in the source's slot.
    pub from: (u32, u32),
    /// First texel in the destination's slot.
    pub to: (u32, u32),
    /// Texels.
    pub size: (u32, u32),
    /// Along each axis 1 where the source goes on, 0 where the edge of a clamped mip repeats.
    pub step: (u32, u32),
}

/// Tiles whose strips are kept: a megabyte of them.
const MOST_KNOWN: usize = 1 << 10;

/// The strips of tiles that came up lately. All groups, and all materials of one size, have the same, and finding them takes
/// some microseconds.
#[derive(Debug, Default)]
pub struct Known {
    tiles: HashMap<((u32, u32), bool, Tile), Around>,
}

/// The strips of a tile.
#[derive(Debug)]
pub struct Around {
    /// Those of [`into`].
    pub into: Vec<Strip>,
    /// Those of [`out_of`].
    pub out_of: Vec<Strip>,
}

impl Known {
    /// The strips of a tile.
    pub fn around(&mut self, pyramid: &Pyramid, tile: Tile) -> &Around {
        let key = (pyramid.mip_size(0), pyramid.wrap(), tile);
        if self.tiles.len() >= MOST_KNOWN && !self.tiles.contains_key(&key) {
            self.tiles.clear();
        }
        self.tiles.entry(key).or_insert_with(|| Around {
            into: into(pyramid, tile),
            out_of: out_of(pyramid, tile),
        })
    }
}

/// The strips that fill the border of a tile's page, each texel at most once.
///
/// None for the root and for tiles outside the pyramid.
pub fn into(pyramid: &Pyramid, tile: Tile) -> Vec<Strip> {
    let Some((x, y)) = axes(pyramid, tile) else {
        return Vec::new();
    };
    let (across, down) = (x.runs(tile.x.into()), y.runs(tile.y.into()));
    product(tile.mip, &across, &down)
        // A clamped page cannot be beside itself: that is its own edge, repeated.
        .filter(|strip| pyramid.wrap() || strip.source != tile)
        .collect()
}

/// The strips of the borders of other pages that show a tile's payload: those of [`into`] with this source.
pub fn out_of(pyramid: &Pyramid, tile: Tile) -> Vec<Strip> {
    let Some((x, y)) = axes(pyramid, tile) else {
        return Vec::new();
    };
    let (across, down) = (x.runs_out_of(tile.x.into()), y.runs_out_of(tile.y.into()));
    product(tile.mip, &across, &down)
        .filter(|strip| strip.destination != tile)
        .collect()
}

/// A stretch of one axis of a slot that shows texels of one page.
#[derive(Clone, Copy, Debug)]
struct Run {
    source: u32,
    destination: u32,
    from: u32,
    to: u32,
    length: u32,
    step: u32,
    border: bool,
}

/// All rectangles of runs across and down that lie in a border.
fn product<'a>(mip: u8, across: &'a [Run], down: &'a [Run]) -> impl Iterator<Item = Strip> + 'a {
    let tile = move |x: u32, y: u32| Tile {
        mip,
        x: x as u16,
        y: y as u16,
    };
    let pairs = down.iter().flat_map(move |y| across.iter().map(move |x| (x, y)));
    pairs
        .filter(|(x, y)| x.border || y.border)
        .map(move |(x, y)| Strip {
            source: tile(x.source, y.source),
            destination: tile(x.destination, y.destination),
            from: (x.from, y.from),
            to: (x.to, y.to),
            size: (x.length, y.length),
            step: (x.step, y.step),
        })
}

/// One side of a mip.
#[derive(Clone, Copy)]
struct Axis {
    texels: u32,
    wrap: bool,
}

/// The axes of an ordinary tile's mip.
fn axes(pyramid: &Pyramid, tile: Tile) -> Option<(Axis, Axis)> {
    let ordinary = tile.mip < pyramid.tail_mip() && pyramid.tile_index(tile).is_some();
    let (width, height) = pyramid.mip_size(tile.mip);
    let axis = |texels| Axis {
        texels,
        wrap: pyramid.wrap(),
    };
    ordinary.then(|| (axis(width), axis(height)))
}

impl Axis {
    fn pages(self) -> u32 {
        self.texels.div_ceil(PAGE_TEXELS)
    }

    /// Page, and texel in its slot, of what is seen at a position of the mip.
    fn address(self, position: i64) -> (u32, u32) {
        let texels = i64::from(self.texels);
        let texel = if self.wrap {
            position.rem_euclid(texels)
        } else {
            position.clamp(0, texels - 1)
        } as u32;
        (texel / PAGE_TEXELS, texel % PAGE_TEXELS + BORDER_TEXELS)
    }

    /// The runs of a page: its border, its payload, its border.
    fn runs(self, page: u32) -> Vec<Run> {
        let payload = (self.texels - page * PAGE_TEXELS).min(PAGE_TEXELS);
        let mut runs = Vec::with_capacity(4);
        self.border_runs(page, 0, &mut runs);
        runs.push(Run {
            source: page,
            destination: page,
            from: BORDER_TEXELS,
            to: BORDER_TEXELS,
            length: payload,
            step: 1,
            border: false,
        });
        self.border_runs(page, BORDER_TEXELS + payload, &mut runs);
        runs
    }

    /// The runs of the border that begins at a texel of a page's slot.
    fn border_runs(self, page: u32, begin: u32, runs: &mut Vec<Run>) {
        let first = runs.len();
        for to in begin..begin + BORDER_TEXELS {
            let position = i64::from(page * PAGE_TEXELS + to) - i64::from(BORDER_TEXELS);
            let (source, from) = self.address(position);
            if let Some(run) = runs[first..].last_mut().filter(|run| run.source == source) {
                let step = from.wrapping_sub(run.from + (run.length - 1) * run.step);
                if (run.length == 1 && step <= 1) || (run.length > 1 && step == run.step) {
                    (run.length, run.step) = (run.length + 1, step);
                    continue;
                }
            }
            runs.push(Run {
                source,
                destination: page,
                from,
                to,
                length: 1,
                step: 1,
                border: true,
            });
        }
    }

    /// The runs of all pages that show this one. A border reaches beyond the next page where that is narrower than
    /// the border, which only a last page is: so two pages on.
    fn runs_out_of(self, page: u32) -> Vec<Run> {
        let pages = i64::from(self.pages());
        let near = (-2..=2).map(|distance| i64::from(page) + distance);
        let mut near: Vec<_> = if self.wrap {
            near.map(|near| near.rem_euclid(pages)).collect()
        } else {
            near.filter(|near| (0..pages).contains(near)).collect()
        };
        near.sort_unstable();
        near.dedup();
        near.into_iter()
            .flat_map(|near| self.runs(near as u32))
            .filter(|run| run.source == page)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use proptest::prelude::*;

    use super::*;

    /// The texel of a side that is seen at a position, by walking there.
    fn seen(mut position: i64, side: u32, wrap: bool) -> u32 {
        let side = i64::from(side);
        while position < 0 {
            position = if wrap { position + side } else { 0 };
        }
        while position >= side {
            position = if wrap { position - side } else { side - 1 };
        }
        position as u32
    }

    /// Texel of the mip by texel of the slot, for every border texel of a page but those that repeat its own edge.
    fn naive(pyramid: &Pyramid, tile: Tile) -> BTreeMap<(u32, u32), (u32, u32)> {
        let mut texels = BTreeMap::new();
        if tile == pyramid.root() {
            return texels;
        }
        let ((width, height), size) = (pyramid.payload(tile), pyramid.mip_size(tile.mip));
        let own =
            |x: u32, y: u32| x / PAGE_TEXELS == u32::from(tile.x) && y / PAGE_TEXELS == u32::from(tile.y);
        for y in 0..height + 2 * BORDER_TEXELS {
            for x in 0..width + 2 * BORDER_TEXELS {
                let inside = |at: u32, side: u32| (BORDER_TEXELS..BORDER_TEXELS + side).contains(&at);
                if inside(x, width) && inside(y, height) {
                    continue;
                }
                let position = |page: u16, at: u32| i64::from(page) * 64 + i64::from(at) - 4;
                let from = (
                    seen(position(tile.x, x), size.0, pyramid.wrap()),
                    seen(position(tile.y, y), size.1, pyramid.wrap()),
                );
                if pyramid.wrap() || !own(from.0, from.1) {
                    texels.insert((x, y), from);
                }
            }
        }
        texels
    }

    /// The same from strips.
    fn texels(pyramid: &Pyramid, tile: Tile, strips: &[Strip]) -> BTreeMap<(u32, u32), (u32, u32)> {
        let mut texels = BTreeMap::new();
        for strip in strips {
            assert_eq!((strip.destination, strip.source.mip), (tile, tile.mip));
            let (width, height) = pyramid.payload(strip.source);
            for y in 0..strip.size.1 {
                for x in 0..strip.size.0 {
                    let from = (
                        strip.from.0 + x * strip.step.0 - BORDER_TEXELS,
                        strip.from.1 + y * strip.step.1 - BORDER_TEXELS,
                    );
                    assert!(from.0 < width && from.1 < height, "{strip:?} leaves the payload");
                    let from = (
                        u32::from(strip.source.x) * PAGE_TEXELS + from.0,
                        u32::from(strip.source.y) * PAGE_TEXELS + from.1,
                    );
                    let before = texels.insert((strip.to.0 + x, strip.to.1 + y), from);
                    assert_eq!(before, None, "{strip:?} fills a texel again");
                }
            }
        }
        texels
    }

    fn area(strips: &[Strip]) -> u32 {
        strips.iter().map(|strip| strip.size.0 * strip.size.1).sum()
    }

    fn check(width: u32, height: u32, wrap: bool) {
        let pyramid = Pyramid::new(width, height, wrap).unwrap();
        let (mut all_into, mut all_out) = (BTreeSet::new(), BTreeSet::new());
        for tile in pyramid.tiles() {
            let strips = into(&pyramid, tile);
            assert!(
                texels(&pyramid, tile, &strips) == naive(&pyramid, tile),
                "{width}x{height} wrap {wrap} {tile:?}"
            );
            assert!(area(&strips) <= MOST_INTO);
            all_into.extend(strips.into_iter().filter(|strip| strip.source != tile));
            let strips = out_of(&pyramid, tile);
            assert!(strips.iter().all(|strip| strip.source == tile));
            assert!(
                area(&strips) <= MOST_OUT,
                "{width}x{height} {tile:?} {}",
                area(&strips)
            );
            let count = all_out.len() + strips.len();
            all_out.extend(strips);
            assert_eq!(all_out.len(), count, "no strip twice");
        }
        assert!(all_into == all_out, "{width}x{height} wrap {wrap}");
    }

    #[test]
    fn awkward_sizes_have_whole_borders() {
        let sides = [1, 2, 3, 4, 5, 33, 63, 64, 65, 66, 67, 68, 128, 129, 130, 131, 193];
        for wrap in [false, true] {
            for width in sides {
                for height in [1, 64, 65, 66, 129] {
                    check(width, height, wrap);
                }
            }
            for (width, height) in [(346, 335), (1, 4096), (4096, 1), (2, 1025)] {
                check(width, height, wrap);
            }
        }
    }

    #[test]
    fn a_whole_page_among_whole_pages_takes_and_gives_eight_strips() {
        let pyramid = Pyramid::new(256, 256, true).unwrap();
        let tile = Tile { mip: 0, x: 0, y: 3 };
        for strips in [into(&pyramid, tile), out_of(&pyramid, tile)] {
            assert_eq!((strips.len(), area(&strips)), (8, MOST_INTO));
        }
    }

    #[test]
    fn a_border_goes_on_behind_a_narrow_page() {
        let pyramid = Pyramid::new(65, 64, true).unwrap();
        let tile = Tile { mip: 0, x: 0, y: 0 };
        // At the left the second page's one column, and before it the page's own last three.
        let left: Vec<_> = into(&pyramid, tile)
            .into_iter()
            .filter(|strip| strip.to.0 < BORDER_TEXELS && strip.to.1 == BORDER_TEXELS)
            .map(|strip| (strip.source.x, strip.from.0, strip.to.0, strip.size.0))
            .collect();
        assert_eq!(left, [(0, 65, 0, 3), (1, 4, 3, 1)]);
    }

    #[test]
    fn strips_that_are_known_are_those_of_the_tile() {
        let mut known = Known::default();
        // More tiles than are kept, and pyramids that share them.
        for _ in 0..2 {
            for (width, wrap) in [(2500, true), (2500, false), (2436, true)] {
                let pyramid = Pyramid::new(width, 900, wrap).unwrap();
                for tile in pyramid.tiles().filter(|tile| tile.x % 7 < 2) {
                    let around = known.around(&pyramid, tile);
                    assert_eq!(around.into, into(&pyramid, tile));
                    assert_eq!(around.out_of, out_of(&pyramid, tile));
                }
                assert!(known.tiles.len() <= MOST_KNOWN);
            }
        }
        for x in 0..3000 {
            known.around(&Pyramid::new(100, 100, true).unwrap(), Tile { mip: 0, x, y: 0 });
        }
        assert!(known.tiles.len() <= MOST_KNOWN);
    }

    #[test]
    fn root_and_strangers_have_no_strips() {
        let pyramid = Pyramid::new(256, 256, true).unwrap();
        let strangers = [(0, 4, 0), (3, 0, 0), (9, 0, 0), (255, u16::MAX, u16::MAX)];
        for (mip, x, y) in strangers {
            let tile = Tile { mip, x, y };
            assert!(into(&pyramid, tile).is_empty() && out_of(&pyramid, tile).is_empty());
        }
        assert!(into(&pyramid, pyramid.root()).is_empty() && out_of(&pyramid, pyramid.root()).is_empty());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn borders_are_those_of_the_mip(width in 1u32..300, height in 1u32..300, wrap: bool) {
            check(width, height, wrap);
        }
    }
}
