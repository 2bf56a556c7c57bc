//! From any field that changes sign at a surface to distances on a periodic grid.
//!
//! Near the surface the field is divided by its gradient's length; further out an exact transform (Felzenszwalb,
//! Huttenlocher, Distance Transforms of Sampled Functions, 2012, here by brute force in a window, which the compiler
//! turns into byte-wide vector minima) bounds the result on both sides, so that rays take long steps through the
//! air and never step over the surface.

use rayon::prelude::*;

/// Stored units per voxel; 16 bits reach ±32 voxels.
pub(super) const UNITS: f32 = 1024.0;
/// Side of a cube of the coarse grid, in voxels.
pub(super) const CUBE: usize = 2;
/// Coarse units per voxel; 8 bits reach 16 voxels.
pub(super) const CLEAR_UNITS: f32 = 16.0;
/// Radius of the distance transform in voxels; its square must be below 255.
const REACH: usize = 15;

/// Turns the field that materials wrote into distances.
pub(super) fn distances(field: Vec<i16>, side: usize, depth: usize) -> Vec<i16> {
    let slice = side * depth;
    let mut near = near_distances(&field, side, depth);
    drop(field);
    let squared = squared_distances(&near, side, depth);
    near.par_chunks_mut(slice)
        .zip(squared.par_chunks(slice))
        .for_each(|(near, squared)| {
            for (near, &squared) in near.iter_mut().zip(squared) {
                let value = f32::from(*near);
                let value = if value < 0.0 {
                    value.max(-2.5 * UNITS)
                } else {
                    // A sample within one voxel of the surface is so far away: that bounds the distance on both sides.
                    let distance = f32::from(squared).sqrt();
                    value.clamp((distance - 1.0) * UNITS, (distance + 0.5) * UNITS)
                };
                *near = value as i16;
            }
        });
    near
}

/// The field over the length of its gradient: the distance to first order, right near the surface. Of two one-sided
/// differences the larger counts, so that a crease does not look flat and further away than it is.
fn near_distances(field: &[i16], side: usize, depth: usize) -> Vec<i16> {
    let slice = side * depth;
    let mut near = vec![0i16; field.len()];
    near.par_chunks_mut(slice).enumerate().for_each(|(j, near)| {
        let row = |j: usize| &field[j % side * slice..][..slice];
        let (here, up, down) = (row(j), row(j + 1), row(j + side - 1));
        for i in 0..side {
            let column = |i: usize| i % side * depth..i % side * depth + depth;
            let (left, right) = (&here[column(i + side - 1)], &here[column(i + 1)]);
            let (up, down, here) = (&up[column(i)], &down[column(i)], &here[column(i)]);
            for (k, near) in near[column(i)].iter_mut().enumerate() {
                let value = f32::from(here[k]);
                let slope = |a: i16, b: i16| (f32::from(a) - value).abs().max((f32::from(b) - value).abs());
                let x = slope(left[k], right[k]);
                let y = slope(up[k], down[k]);
                let z = slope(here[(k + 1).min(depth - 1)], here[k.saturating_sub(1)]);
                let length = (x * x + y * y + z * z).sqrt().max(0.2 * UNITS);
                *near = (value * (UNITS / length)) as i16;
            }
        }
    });
    near
}

/// Squared distance in voxels to the nearest sample within one voxel of the surface; 255 stands for all beyond.
fn squared_distances(near: &[i16], side: usize, depth: usize) -> Vec<u8> {
    let slice = side * depth;
    let mut along_z = vec![255u8; near.len()];
    along_z
        .par_chunks_mut(slice)
        .zip(near.par_chunks(slice))
        .for_each(|(squared, near)| {
            for (squared, near) in squared.chunks_mut(depth).zip(near.chunks(depth)) {
                let mut last = None;
                for k in (0..depth).chain((0..depth).rev()) {
                    if i32::from(near[k]).abs() <= UNITS as i32 {
                        last = Some(k);
                    }
                    if let Some(d) = last.map(|last| k.abs_diff(last)).filter(|&d| d <= REACH) {
                        squared[k] = squared[k].min((d * d) as u8);
                    }
                }
            }
        });
    let offsets = || (1..=REACH).flat_map(|d| [(d, (d * d) as u8), (side - d, (d * d) as u8)]);
    let lower = |to: &mut [u8], from: &[u8], square: u8| {
        to.iter_mut()
            .zip(from)
            .for_each(|(to, from)| *to = (*to).min(from.saturating_add(square)));
    };
    let mut along_xz = along_z.clone();
    along_xz
        .par_chunks_mut(slice)
        .zip(along_z.par_chunks(slice))
        .for_each(|(to, from)| {
            for i in 0..side {
                for (offset, square) in offsets() {
                    let other = (i + offset) % side * depth;
                    lower(&mut to[i * depth..][..depth], &from[other..][..depth], square);
                }
            }
        });
    let mut squared = along_z;
    squared.par_chunks_mut(slice).enumerate().for_each(|(j, to)| {
        to.copy_from_slice(&along_xz[j * slice..][..slice]);
        for (offset, square) in offsets() {
            lower(to, &along_xz[(j + offset) % side * slice..][..slice], square);
        }
    });
    squared
}

/// Repeats the first column behind the last of each row, and the first row behind the last.
pub(super) fn closed(distance: &[i16], side: usize, depth: usize) -> Vec<i16> {
    let (slice, wider) = (side * depth, (side + 1) * depth);
    let mut closed = vec![0; wider * (side + 1)];
    closed.par_chunks_mut(wider).enumerate().for_each(|(j, row)| {
        let from = &distance[j % side * slice..][..slice];
        row[..slice].copy_from_slice(from);
        row[slice..].copy_from_slice(&from[..depth]);
    });
    closed
}

/// Least distance in each cube, with the samples on its far faces; negative ones count as 0.
pub(super) fn clearances(distance: &[i16], side: usize, depth: usize) -> Vec<u8> {
    let (cubes, levels) = (side / CUBE, depth.div_ceil(CUBE));
    let mut clear = vec![0; cubes * cubes * levels];
    clear
        .par_chunks_mut(levels)
        .enumerate()
        .for_each(|(column, clear)| {
            let (i, j) = (column % cubes * CUBE, column / cubes * CUBE);
            let mut least = vec![i16::MAX; depth];
            for y in j..=j + CUBE {
                for x in i..=i + CUBE {
                    let samples = &distance[(y * (side + 1) + x) * depth..][..depth];
                    least
                        .iter_mut()
                        .zip(samples)
                        .for_each(|(least, sample)| *least = (*least).min(*sample));
                }
            }
            for (k, clear) in clear.iter_mut().enumerate() {
                let span = &least[k * CUBE..(k * CUBE + CUBE + 1).min(depth)];
                let least = span.iter().copied().min().unwrap_or(0).max(0);
                *clear = (f32::from(least) * (CLEAR_UNITS / UNITS)) as u8;
            }
        });
    clear
}
