//! The cells of a surface: what is computed once for each small piece of it and shared by all views.
//!
//! A cell is a cube of the grid (half a texel wide at full resolution) through which the surface passes. Its
//! content (reflectance, visible lights) belongs to the point of the surface nearest to the cube's centre, so it
//! does not depend on which ray found it first, and results do not depend on the order of work. Where the surface only
//! cuts a cube's corner, that point lies in a neighbour, whose content serves both: this halves the work.

use super::bounce::Bounce;
use super::ceiling::Ceilings;
use super::march::PACKET;
use super::materials::Material;
use super::reflectance::{Attributes, LANES, Lights, Point};
use super::volume::Volume;
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Marks a cell that has no content yet.
const NONE: u32 = u32::MAX;
/// Side of a brick of the index, in cells.
const BRICK: usize = 4;
/// Cells that are computed together, and the side of the square in which they lie.
const BLOCK: usize = 256;
const TILE: usize = 16;
/// Voxels that a shadow ray starts above the surface, so that it does not end where it starts.
pub(super) const LIFT: f32 = 1.0;

/// Number of a cell of the grid.
pub(super) type CellKey = u32;

/// The surface of a solid as far as rays have found it.
pub(super) struct Surface<'a> {
    pub(super) volume: &'a Volume,
    pub(super) material: &'a dyn Material,
    /// All lights, for which there is room in what cells hold.
    lights: &'a Lights,
    ceilings: &'a Ceilings,
    /// Those that are asked for.
    pub(super) active: Lights,
    bounce: Option<Bounce>,
    index: Index,
    points: Vec<Point>,
    /// One bit per light, `[point][byte]`.
    lit: Vec<u8>,
    shadow_rays: AtomicU64,
}

/// Where the content of a cell is: a table of bricks, of which those near the surface exist.
struct Index {
    bricks_per_side: usize,
    brick_levels: usize,
    bricks: Vec<u32>,
    cells: Vec<[u32; BRICK * BRICK * BRICK]>,
}

impl Index {
    fn new(volume: &Volume) -> Index {
        let (bricks_per_side, brick_levels) = (volume.side.div_ceil(BRICK), volume.depth.div_ceil(BRICK));
        let bricks = vec![NONE; bricks_per_side * bricks_per_side * brick_levels];
        Index {
            bricks_per_side,
            brick_levels,
            bricks,
            cells: Vec::new(),
        }
    }

    fn locate(&self, [i, j, k]: [usize; 3]) -> (usize, usize) {
        let brick = (j / BRICK * self.bricks_per_side + i / BRICK) * self.brick_levels + k / BRICK;
        (brick, ((j % BRICK) * BRICK + i % BRICK) * BRICK + k % BRICK)
    }

    fn get(&self, cell: [usize; 3]) -> u32 {
        let (brick, inside) = self.locate(cell);
        match self.bricks[brick] {
            NONE => NONE,
            found => self.cells[found as usize][inside],
        }
    }

    fn set(&mut self, cell: [usize; 3], value: u32) {
        let (brick, inside) = self.locate(cell);
        if self.bricks[brick] == NONE {
            self.bricks[brick] = self.cells.len() as u32;
            self.cells.push([NONE; BRICK * BRICK * BRICK]);
        }
        self.cells[self.bricks[brick] as usize][inside] = value;
    }
}

impl<'a> Surface<'a> {
    pub(super) fn new(
        volume: &'a Volume,
        material: &'a dyn Material,
        lights: &'a Lights,
        ceilings: &'a Ceilings,
        bounce: Option<Bounce>,
    ) -> Surface<'a> {
        let index = Index::new(volume);
        let shadow_rays = AtomicU64::new(0);
        Surface {
            volume,
            material,
            lights,
            ceilings,
            active: lights.first(lights.count),
            bounce,
            index,
            points: Vec::new(),
            lit: Vec::new(),
            shadow_rays,
        }
    }

    /// Cells that are found from now on know of the first lights only.
    pub(super) fn narrow(&mut self, lights: usize) {
        self.active = self.active.first(lights);
    }

    /// The cell around a point of the grid.
    #[inline(always)]
    pub(super) fn key(&self, p: Vec3) -> CellKey {
        let (side, depth) = (self.volume.side, self.volume.depth);
        let (i, j) = ((p.x as usize).min(side - 1), (p.y as usize).min(side - 1));
        ((j * side + i) * depth + (p.z.max(0.0) as usize).min(depth - 1)) as CellKey
    }

    fn cell(&self, key: CellKey) -> [usize; 3] {
        let (column, k) = (key as usize / self.volume.depth, key as usize % self.volume.depth);
        [column % self.volume.side, column / self.volume.side, k]
    }

    /// Whether the cell has its content.
    pub(super) fn knows(&self, key: CellKey) -> bool {
        self.index.get(self.cell(key)) != NONE
    }

    /// Computes the content of new cells; `keys` ascending and each once.
    pub(super) fn extend(&mut self, keys: &[CellKey]) {
        let owners: Vec<CellKey> = keys
            .par_iter()
            .with_min_len(256)
            .map(|&key| self.owner(key))
            .collect();
        let mut new: Vec<CellKey> = owners
            .iter()
            .copied()
            .filter(|&owner| !self.knows(owner))
            .collect();
        // Neighbours in all directions come together, so that their shadow rays meet the same part of the volume.
        new.sort_unstable_by_key(|&key| {
            let [i, j, _] = self.cell(key);
            (j / TILE, i / TILE, key)
        });
        new.dedup();
        self.compute(&new);
        for (&key, &owner) in keys.iter().zip(&owners) {
            let content = self.index.get(self.cell(owner));
            self.index.set(self.cell(key), content);
        }
    }

    /// The cell whose content serves this cell: the one in which its point of the surface lies, if that one's lies there
    /// too.
    fn owner(&self, key: CellKey) -> CellKey {
        let of = |key| self.key(project(self.volume, self.center(key)).position);
        let other = of(key);
        if other == key || of(other) == other {
            other
        } else {
            key
        }
    }

    fn center(&self, key: CellKey) -> Vec3 {
        let [i, j, k] = self.cell(key);
        Vec3::new(i as f32 + 0.5, j as f32 + 0.5, k as f32 + 0.5)
    }

    fn compute(&mut self, keys: &[CellKey]) {
        let (first, bytes) = (self.points.len(), self.lights.mask_bytes());
        for (n, &key) in keys.iter().enumerate() {
            self.index.set(self.cell(key), (first + n) as u32);
        }
        let mut points = std::mem::take(&mut self.points);
        let mut lit = std::mem::take(&mut self.lit);
        points.resize(first + keys.len(), Point::default());
        lit.resize(points.len() * bytes, 0);
        let work = points[first..]
            .par_chunks_mut(BLOCK)
            .zip(lit[first * bytes..].par_chunks_mut(BLOCK * bytes));
        work.zip(keys.par_chunks(BLOCK))
            .for_each(|((points, lit), keys)| {
                let places: Vec<Place> = keys
                    .iter()
                    .map(|&key| project(self.volume, self.center(key)))
                    .collect();
                for ((point, place), &key) in points.iter_mut().zip(&places).zip(keys) {
                    *point = attributes(self.volume, self.material, place).prepare();
                    if let Some(bounce) = &self.bounce {
                        point.patch = bounce.patch_near(self.volume, place, key);
                    }
                }
                let rays = visible(self.volume, &self.active, self.ceilings, &places, lit);
                self.shadow_rays.fetch_add(rays, Ordering::Relaxed);
            });
        (self.points, self.lit) = (points, lit);
    }

    /// Where the content of a cell is that is known.
    #[inline(always)]
    pub(super) fn place(&self, key: CellKey) -> u32 {
        self.index.get(self.cell(key))
    }

    /// Content of the cell at a [`Surface::place`]: reflectance, visible lights, bounced light.
    #[inline(always)]
    pub(super) fn content(&self, place: u32) -> (&Point, &[u8], &[u16]) {
        let index = place as usize;
        let point = &self.points[index];
        let bytes = self.lights.mask_bytes();
        let bounced = self.bounce.as_ref().map_or(&[][..], |b| b.light(point.patch));
        (point, &self.lit[index * bytes..][..bytes], bounced)
    }

    /// Number of cells with content.
    pub(super) fn cells(&self) -> usize {
        self.points.len()
    }

    /// Rays traced towards lights so far.
    pub(super) fn shadow_rays(&self) -> u64 {
        self.shadow_rays.load(Ordering::Relaxed)
    }
}

/// A point of the surface in grid coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) position: Vec3,
    pub(super) normal: Vec3,
}

/// The point of the surface near `p`.
pub(super) fn project(volume: &Volume, p: Vec3) -> Place {
    let mut p = p;
    for _ in 0..2 {
        p -= volume.normal(p) * volume.distance(volume.wrap(p));
    }
    let position = volume.wrap(p);
    Place {
        position,
        normal: volume.normal(position),
    }
}

/// What the material is at a point of the surface.
pub(super) fn attributes(volume: &Volume, material: &dyn Material, place: &Place) -> Attributes {
    // Half a voxel inside, so that the part is the one whose surface this is.
    let part = volume.part(place.position - 0.5 * place.normal);
    material.attributes(volume.material_from_grid(place.position), place.normal, part)
}

/// Sets the bits of the lights that reach points, `[point][byte]` with bytes for these lights or more, and counts the rays
/// that this took.
///
/// Light by light: rays from neighbours in the same direction meet the same part of the volume while it is in the
/// cache.
pub(super) fn visible(
    volume: &Volume,
    lights: &Lights,
    ceilings: &Ceilings,
    places: &[Place],
    lit: &mut [u8],
) -> u64 {
    let (mut rays, bytes) = (0, lit.len() / places.len().max(1));
    let (mut origins, mut facing) = (Vec::with_capacity(PACKET), Vec::with_capacity(PACKET));
    for light in 0..lights.count {
        let direction = lights.direction(light);
        if direction.z <= 0.0 {
            continue;
        }
        for (packet, places) in places.chunks(PACKET).enumerate() {
            origins.clear();
            facing.clear();
            for (n, place) in places.iter().enumerate() {
                if place.normal.dot(direction) > 0.0 {
                    let (origin, n) = (
                        volume.wrap(place.position + LIFT * place.normal),
                        packet * PACKET + n,
                    );
                    if ceilings.clear(light, origin) {
                        lit[n * bytes + light / LANES] |= 1 << (light % LANES);
                    } else {
                        origins.push(origin);
                        facing.push(n);
                    }
                }
            }
            rays += origins.len() as u64;
            volume.march_all(&origins, direction, |n, end| {
                if end.is_none() {
                    lit[facing[n] * bytes + light / LANES] |= 1 << (light % LANES);
                }
            });
        }
    }
    rays
}

#[cfg(test)]
mod tests {
    use super::super::materials::find;
    use super::*;

    #[test]
    fn content_does_not_depend_on_the_order_of_discovery() {
        let material = find("gravel")
            .unwrap()
            .make(5, 1.0 / 128.0, &crate::synth::Style::default());
        let volume = Volume::build(material.as_solid(), 128);
        let lights = Lights::new(&[Vec3::Z, Vec3::new(0.6, 0.0, 0.8)]);
        let ceilings = Ceilings::new(&volume, &lights);
        let surface = || Surface::new(&volume, &*material, &lights, &ceilings, None);
        let hit = |n: u32| {
            volume.march(
                Vec3::new((n % 100) as f32, (n / 100) as f32, volume.top),
                Vec3::NEG_Z,
            )
        };
        let mut keys: Vec<CellKey> = (0..3000).map(|n| surface().key(hit(n).unwrap())).collect();
        keys.sort_unstable();
        keys.dedup();
        let (mut once, mut twice) = (surface(), surface());
        once.extend(&keys);
        let (even, odd): (Vec<_>, Vec<_>) = keys.iter().partition(|key| *key % 2 == 0);
        assert!(keys.iter().all(|&key| once.knows(key) && !twice.knows(key)));
        twice.extend(&odd);
        twice.extend(&even);
        assert!(
            keys.iter()
                .all(|&key| once.content(once.place(key)) == twice.content(twice.place(key)))
        );
        assert!(once.cells() <= keys.len() && once.cells() == twice.cells());
        assert_eq!(once.shadow_rays(), twice.shadow_rays());
    }
}
