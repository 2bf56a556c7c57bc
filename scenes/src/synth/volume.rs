//! A solid that repeats in x and y, as a grid of signed distances.
//!
//! Grid coordinates count voxels; sample (i, j, k) lies at integer coordinates, x grows with i, y (up in the image)
//! with j, z with k. Solids overhang as they like. Materials write any function that is negative inside and
//! changes sign at the surface; [`Volume::build`] turns it into distances.

use super::distances::{CLEAR_UNITS, CUBE, UNITS, clearances, closed, distances};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Free voxels kept between the solid and the top of the grid.
const MARGIN: usize = 3;
/// Largest number of voxels: up to 8 bytes each while building, 4 after.
const MAX_VOXELS: usize = 1 << 26;

/// The solid of a material.
pub(super) trait Solid: Sync {
    /// Lowest and highest z that the solid may reach, in patch widths. Below the lowest all is solid.
    fn extent(&self) -> Range<f32>;
    /// Writes one slice of the field.
    fn fill(&self, row: &mut Row<'_>);
}

/// Signed distances on a periodic grid, and which part of the material is nearest.
pub(super) struct Volume {
    /// Voxels along x and along y.
    pub(super) side: usize,
    /// Voxels along z.
    pub(super) depth: usize,
    /// Height in grid coordinates above which there is only air.
    pub(super) top: f32,
    /// Height of the plane z = 0 in grid coordinates: the mean height seen from straight above.
    pub(super) reference: f32,
    /// z of sample k = 0 in the material's own coordinates, patch widths.
    bottom: f32,
    /// Distances, `[y][x][z]`; the first column and row come once more behind the last, so that interpolation
    /// does not wrap.
    pub(super) distance: Vec<i16>,
    /// Least distance in each cube of [`CUBE`] voxels, in [`CLEAR_UNITS`], `[y][x][z]`: small enough for a cache. Three bytes more at
    /// the end.
    pub(super) clear: Vec<u8>,
    /// Cubes along z.
    pub(super) cube_levels: usize,
    /// Parts, `[y][x][z]`.
    part: Vec<u16>,
}

/// One slice of constant y of the field while it is being written: `[x][z]`, all coordinates in patch widths.
pub(super) struct Row<'a> {
    /// This slice's y.
    pub(super) y: f32,
    side: usize,
    depth: usize,
    bottom: f32,
    /// Heights in the material's own numbers are this many times as high in the grid.
    pub(super) relief: f32,
    field: &'a mut [i16],
    part: &'a mut [u16],
}

impl Row<'_> {
    /// Length of a voxel's side in patch widths.
    pub(super) fn voxel(&self) -> f32 {
        1.0 / self.side as f32
    }

    /// Distance from `y` to this slice, the short way around the patch.
    pub(super) fn offset(&self, y: f32) -> f32 {
        let d = self.y - y;
        d - d.round()
    }

    /// Adds everything under a height field; `height` gives height and part at x.
    pub(super) fn add_below(&mut self, height: impl Fn(f32) -> (f32, u16)) {
        let side = self.side;
        for i in 0..side {
            let (h, part) = height((i as f32 + 0.5) / side as f32);
            self.each(i as isize, f32::MIN..f32::MAX, |z, field, id| {
                let value = units(z - h, side);
                if value < *field {
                    (*field, *id) = (value, part);
                }
            });
        }
    }

    /// Adds what is inside `f(x)(z) < 0`, asked within the ranges only. `x` may leave [0, 1): it wraps.
    pub(super) fn add<F: Fn(f32) -> f32>(
        &mut self,
        x: Range<f32>,
        z: Range<f32>,
        part: u16,
        f: impl Fn(f32) -> F,
    ) {
        let side = self.side;
        for i in self.columns(&x) {
            let f = f((i as f32 + 0.5) / side as f32);
            self.each(i, z.clone(), |z, field, id| {
                let value = units(f(z), side);
                if value < *field {
                    (*field, *id) = (value, part);
                }
            });
        }
    }

    /// Removes what is inside `f(x)(z) < 0`; the surface left behind belongs to `part`.
    pub(super) fn remove<F: Fn(f32) -> f32>(
        &mut self,
        x: Range<f32>,
        z: Range<f32>,
        part: u16,
        f: impl Fn(f32) -> F,
    ) {
        let side = self.side;
        for i in self.columns(&x) {
            let f = f((i as f32 + 0.5) / side as f32);
            self.each(i, z.clone(), |z, field, id| {
                let value = -units(f(z), side);
                if value > *field {
                    (*field, *id) = (value, part);
                }
            });
        }
    }

    fn columns(&self, x: &Range<f32>) -> Range<isize> {
        let side = self.side as f32;
        let low = (x.start * side).floor() as isize;
        low..((x.end * side).ceil() as isize).min(low + self.side as isize)
    }

    fn each(&mut self, column: isize, z: Range<f32>, mut visit: impl FnMut(f32, &mut i16, &mut u16)) {
        let side = self.side as f32;
        let level = |z: f32| ((z * self.relief - self.bottom) * side).clamp(0.0, self.depth as f32);
        let (low, high) = (level(z.start).floor() as usize, level(z.end).ceil() as usize);
        let start = column.rem_euclid(self.side as isize) as usize * self.depth;
        let field = &mut self.field[start + low..start + high];
        let part = &mut self.part[start + low..start + high];
        for (k, (field, part)) in field.iter_mut().zip(part).enumerate() {
            visit((self.bottom + (low + k) as f32 / side) / self.relief, field, part);
        }
    }
}

fn units(value: f32, side: usize) -> i16 {
    // The cast saturates.
    (value * (side as f32 * UNITS)) as i16
}

impl Volume {
    /// Samples `solid` on a grid of `side` voxels, rounded up to a multiple of 32 (fewer if the solid is so deep that it would
    /// exceed the limit).
    pub(super) fn build(solid: &dyn Solid, side: usize) -> Volume {
        let extent = solid.extent();
        let levels = |side: usize| ((extent.end - extent.start) * side as f32).ceil() as usize + 2 * MARGIN;
        let side = (32..=side.next_multiple_of(32))
            .rev()
            .step_by(32)
            .find(|&s| s * s * levels(s) <= MAX_VOXELS)
            .unwrap_or(32);
        let depth = levels(side);
        let bottom = extent.start - 1.0 / side as f32;
        let mut field = vec![i16::MAX; side * side * depth];
        let mut part = vec![0; side * side * depth];
        let slice = side * depth;
        field
            .par_chunks_mut(slice)
            .zip(part.par_chunks_mut(slice))
            .enumerate()
            .for_each(|(j, (field, part))| {
                for column in field.chunks_mut(depth) {
                    column[0] = i16::MIN; // the floor
                    column[1] = column[1].min(0);
                }
                let y = (j as f32 + 0.5) / side as f32;
                solid.fill(&mut Row {
                    y,
                    side,
                    depth,
                    bottom,
                    relief: 1.0,
                    field,
                    part,
                });
                for column in field.chunks_mut(depth) {
                    column[depth - MARGIN + 1..].fill(i16::MAX);
                }
            });
        let distance = closed(&distances(field, side, depth), side, depth);
        let highest = |column: &[i16]| column.iter().rposition(|&d| d < 0).unwrap_or(0);
        let top = distance.par_chunks(depth).map(highest).max().unwrap_or(0) as f32 + 1.0;
        let mut clear = clearances(&distance, side, depth);
        clear.extend([0; 3]); // one can be read with the three behind it
        let cube_levels = depth.div_ceil(CUBE);
        let mut volume = Volume {
            side,
            depth,
            top,
            reference: 0.0,
            bottom,
            distance,
            clear,
            cube_levels,
            part,
        };
        volume.reference = volume.mean_height();
        volume
    }

    /// The material's own coordinates (patch widths) of a point of the grid.
    pub(super) fn material_from_grid(&self, p: Vec3) -> Vec3 {
        let side = self.side as f32;
        Vec3::new((p.x + 0.5) / side, (p.y + 0.5) / side, self.bottom + p.z / side)
    }

    /// A length in voxels that is free around `p`, whose x and y lie in [0, side).
    #[inline(always)]
    pub(super) fn clearance(&self, p: Vec3) -> f32 {
        let cube = |v: f32| v as i32 as usize / CUBE;
        let k = cube(p.z).min(self.cube_levels - 1);
        let column = cube(p.y) * (self.side / CUBE) + cube(p.x);
        f32::from(self.clear[column * self.cube_levels + k]) * (1.0 / CLEAR_UNITS)
    }

    /// Distance in voxels at the sample nearest to `p`, whose x and y lie in [0, side).
    #[inline(always)]
    pub(super) fn nearest(&self, p: Vec3) -> f32 {
        let (i, j) = ((p.x + 0.5) as i32 as usize, (p.y + 0.5) as i32 as usize);
        let k = ((p.z + 0.5) as i32 as usize).min(self.depth - 1);
        f32::from(self.distance[(j * (self.side + 1) + i) * self.depth + k]) * (1.0 / UNITS)
    }

    /// Distance in voxels at `p`, whose x and y lie in [0, side), by trilinear interpolation.
    #[inline(always)]
    pub(super) fn distance(&self, p: Vec3) -> f32 {
        let z = p.z.max(0.0).min((self.depth - 2) as f32);
        let (i, j, k) = (p.x as i32, p.y as i32, z as i32);
        let (fx, fy, fz) = (p.x - i as f32, p.y - j as f32, z - k as f32);
        let (next_x, next_y) = (self.depth, (self.side + 1) * self.depth);
        let first = j as usize * next_y + i as usize * next_x + k as usize;
        let corner = &self.distance[first..first + next_y + next_x + 2];
        let along_z = |at: usize| {
            let low = f32::from(corner[at]);
            low + fz * (f32::from(corner[at + 1]) - low)
        };
        let (a, b) = (along_z(0), along_z(next_x));
        let (c, d) = (along_z(next_y), along_z(next_y + next_x));
        let (low, high) = (a + fx * (b - a), c + fx * (d - c));
        (low + fy * (high - low)) * (1.0 / UNITS)
    }

    /// Height above column (i, j), at most the grid's side, over which there is only air.
    pub(super) fn height(&self, i: usize, j: usize) -> f32 {
        let column = &self.distance[(j * (self.side + 1) + i) * self.depth..][..self.depth];
        column.iter().rposition(|&d| d <= 0).unwrap_or(0) as f32 + 1.0
    }

    /// Direction in which the distance grows at `p`: the surface's normal, unit length; any `p`.
    pub(super) fn normal(&self, p: Vec3) -> Vec3 {
        const STEP: f32 = 0.8;
        let along = |axis: Vec3| {
            self.distance(self.wrap(p + STEP * axis)) - self.distance(self.wrap(p - STEP * axis))
        };
        Vec3::new(along(Vec3::X), along(Vec3::Y), along(Vec3::Z))
            .try_normalize()
            .unwrap_or(Vec3::Z)
    }

    /// Part of the material at the sample nearest to `p`.
    pub(super) fn part(&self, p: Vec3) -> u16 {
        let p = self.wrap(p).round();
        let (i, j) = (p.x as usize % self.side, p.y as usize % self.side);
        self.part[(j * self.side + i) * self.depth + (p.z.max(0.0) as usize).min(self.depth - 1)]
    }

    /// Moves x and y into [0, side).
    #[inline(always)]
    pub(super) fn wrap(&self, mut p: Vec3) -> Vec3 {
        let side = self.side as f32;
        for v in [&mut p.x, &mut p.y] {
            if *v < 0.0 || *v >= side {
                *v -= (*v / side).floor() * side;
                if *v >= side {
                    *v = 0.0; // −ε rounds up to a whole period
                }
            }
        }
        p
    }

    fn mean_height(&self) -> f32 {
        let column = |column: &[i16]| {
            let k = column.iter().rposition(|&d| d < 0).unwrap_or(0);
            let (below, above) = (
                f64::from(column[k]),
                f64::from(column[(k + 1).min(self.depth - 1)]),
            );
            k as f64
                + if above > below {
                    -below / (above - below)
                } else {
                    0.0
                }
        };
        let rows = self.distance.chunks(self.depth * (self.side + 1)).take(self.side);
        let sum: f64 = rows
            .flat_map(|row| row.chunks(self.depth).take(self.side))
            .map(column)
            .sum();
        (sum / (self.side * self.side) as f64) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball above a floor, touching nothing: its underside overhangs.
    struct Ball;

    impl Solid for Ball {
        fn extent(&self) -> Range<f32> {
            0.0..0.5
        }

        fn fill(&self, row: &mut Row<'_>) {
            row.add_below(|_| (0.05, 1));
            let dy = row.offset(0.95);
            row.add(0.7..1.3, 0.0..0.5, 2, |x| {
                move |z| Vec3::new(x - 1.0, dy, z - 0.28).length() - 0.2
            });
        }
    }

    #[test]
    fn distances_are_distances() {
        let volume = Volume::build(&Ball, 128);
        assert_eq!(volume.side, 128);
        let exact = |p: Vec3| {
            let q = volume.material_from_grid(p);
            let wrapped = Vec3::new(q.x - q.x.round(), q.y - 0.95 - (q.y - 0.95).round(), q.z - 0.28);
            (wrapped.length() - 0.2).min(q.z - 0.05) * 128.0
        };
        let mut seen = 0;
        for n in 0..20_000 {
            let p = Vec3::new(
                (n * 37 % 128) as f32 + 0.3,
                (n * 53 % 1280) as f32 * 0.1,
                (n % 60) as f32 + 0.7,
            );
            let (value, exact) = (volume.distance(p), exact(p));
            if exact.abs() < 1.5 {
                assert!((value - exact).abs() < 0.35, "{p}: {value} for {exact}");
                seen += 1;
            } else if exact > 0.0 {
                assert!(value > 0.3 && value < exact + 0.6, "{p}: {value} for {exact}");
            }
        }
        assert!(seen > 500);
    }

    #[test]
    fn parts_and_normals() {
        let volume = Volume::build(&Ball, 128);
        let at = |x: f32, y: f32, z: f32| Vec3::new(x * 128.0 - 0.5, y * 128.0 - 0.5, (z * 128.0) + 1.0);
        let side = at(0.2, 0.95, 0.28);
        assert_eq!(volume.part(side), 2);
        assert!(volume.normal(side).dot(Vec3::X) > 0.99);
        assert_eq!(volume.part(at(0.5, 0.45, 0.05)), 1);
        assert!(
            volume.normal(at(0.0, 0.95, 0.08)).z < -0.99,
            "the underside faces down"
        );
        assert!(volume.reference > 0.05 * 128.0 && volume.reference < 0.15 * 128.0);
    }
}
