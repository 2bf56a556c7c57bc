//! Packets of rays in the registers of AVX2: eight rays a register, four registers by turns, and who arrives gives way to the next.
//!
//! The same operations as [`Volume::march`] in the same order, without fused multiplication, so that the result is the same.

use std::arch::x86_64::*;

use glam::Vec3;

use super::{CLEAR, MAX_STEPS, SLACK};
use crate::synth::distances::{CLEAR_UNITS, CUBE, UNITS};
use crate::synth::volume::Volume;

/// Rays of a register.
const LANES: usize = 8;
/// Registers by turns: while one waits for memory, others go on.
const TURNS: usize = 4;

/// Rays on their way.
#[derive(Clone, Copy)]
struct Rays {
    x: __m256,
    y: __m256,
    z: __m256,
    /// The last step and the distance that was found before it; zeros unless that was near the surface.
    step: __m256,
    distance: __m256,
    steps: __m256i,
    /// Which lanes hold a ray, a bit each, and which ones of the packet they are.
    alive: u32,
    numbers: [u32; LANES],
}

/// What does not change along a packet.
struct Grid<'a> {
    volume: &'a Volume,
    direction: Vec3,
}

/// [`Volume::march_all`].
#[target_feature(enable = "avx2")]
pub(super) fn march_all(
    volume: &Volume,
    origins: &[Vec3],
    direction: Vec3,
    mut arrived: impl FnMut(usize, Option<Vec3>),
) {
    let grid = Grid { volume, direction };
    let mut waiting = origins.iter().map(|&origin| volume.wrap(origin)).enumerate();
    let zero = _mm256_setzero_ps();
    let mut turns = [Rays {
        x: zero,
        y: zero,
        z: zero,
        step: zero,
        distance: zero,
        steps: _mm256_setzero_si256(),
        alive: 0,
        numbers: [0; LANES],
    }; TURNS];
    for rays in &mut turns {
        rays.replace(0xff, &mut waiting);
    }
    while turns.iter().any(|rays| rays.alive != 0) {
        for rays in turns.iter_mut().filter(|rays| rays.alive != 0) {
            let (ended, hit) = grid.advance(rays);
            let finished = (ended | hit) & rays.alive;
            if finished != 0 {
                let [x, y, z] = floats([rays.x, rays.y, rays.z]);
                for lane in (0..LANES).filter(|lane| finished >> lane & 1 == 1) {
                    let p = Vec3::new(x[lane], y[lane], z[lane]);
                    let left = hit >> lane & 1 == 0 && p.z > volume.top && direction.z >= 0.0;
                    arrived(rays.numbers[lane] as usize, (!left).then_some(p));
                }
                rays.replace(finished, &mut waiting);
            }
        }
    }
}

fn floats(v: [__m256; 3]) -> [[f32; LANES]; 3] {
    // SAFETY: both are arrays of the same number of floats, and any bits are floats.
    unsafe { std::mem::transmute(v) }
}

impl Rays {
    /// Gives the lanes of the mask to rays that wait.
    #[target_feature(enable = "avx2")]
    fn replace(&mut self, mask: u32, waiting: &mut impl Iterator<Item = (usize, Vec3)>) {
        let [mut x, mut y, mut z] = floats([self.x, self.y, self.z]);
        let mut kept = [-1i32; LANES];
        for lane in (0..LANES).filter(|lane| mask >> lane & 1 == 1) {
            kept[lane] = 0;
            self.alive &= !(1 << lane);
            if let Some((number, p)) = waiting.next() {
                self.alive |= 1 << lane;
                self.numbers[lane] = number as u32;
                [x[lane], y[lane], z[lane]] = p.to_array();
            }
        }
        // SAFETY: arrays of eight numbers.
        let kept = unsafe {
            self.x = _mm256_loadu_ps(x.as_ptr());
            self.y = _mm256_loadu_ps(y.as_ptr());
            self.z = _mm256_loadu_ps(z.as_ptr());
            _mm256_loadu_si256(kept.as_ptr().cast())
        };
        self.step = _mm256_and_ps(self.step, _mm256_castsi256_ps(kept));
        self.distance = _mm256_and_ps(self.distance, _mm256_castsi256_ps(kept));
        self.steps = _mm256_and_si256(self.steps, kept);
    }
}

impl Grid<'_> {
    /// A step; which rays had arrived before it, at the top, the floor, or the end of their steps, and which ones hit the surface.
    #[target_feature(enable = "avx2")]
    fn advance(&self, rays: &mut Rays) -> (u32, u32) {
        let (volume, set) = (self.volume, |value: f32| _mm256_set1_ps(value));
        let zero = _mm256_setzero_ps();
        let mut ended = _mm256_cmp_ps::<_CMP_LE_OQ>(rays.z, zero);
        if self.direction.z >= 0.0 {
            ended = _mm256_or_ps(ended, _mm256_cmp_ps::<_CMP_GT_OQ>(rays.z, set(volume.top)));
        }
        let most = _mm256_set1_epi32(MAX_STEPS as i32 - 1);
        let many = _mm256_cmpgt_epi32(rays.steps, most);
        ended = _mm256_or_ps(ended, _mm256_castsi256_ps(many));
        rays.steps = _mm256_add_epi32(rays.steps, _mm256_set1_epi32(1));

        let clear = self.clearances(rays);
        let far = _mm256_cmp_ps::<_CMP_GT_OQ>(clear, set(CLEAR));
        let mut step = _mm256_add_ps(clear, set(SLACK));
        let near = _mm256_andnot_ps(_mm256_or_ps(far, ended), set(f32::from_bits(u32::MAX)));
        let mut hit = zero;
        let (mut last_step, mut last_distance) = (zero, zero);
        if _mm256_movemask_ps(near) as u32 & rays.alive != 0 {
            let distance = self.distances(rays);
            hit = _mm256_and_ps(near, _mm256_cmp_ps::<_CMP_LE_OQ>(distance, zero));
            let back = _mm256_div_ps(
                _mm256_mul_ps(rays.step, distance),
                _mm256_sub_ps(rays.distance, distance),
            );
            let back = _mm256_and_ps(back, _mm256_cmp_ps::<_CMP_GT_OQ>(rays.distance, zero));
            let on = _mm256_add_ps(distance, set(SLACK));
            step = _mm256_blendv_ps(step, _mm256_blendv_ps(on, back, hit), near);
            (last_step, last_distance) = (_mm256_and_ps(on, near), _mm256_and_ps(distance, near));
        }
        (rays.step, rays.distance) = (last_step, last_distance);
        step = _mm256_andnot_ps(ended, step);
        rays.x = self.moved(rays.x, step, self.direction.x);
        rays.y = self.moved(rays.y, step, self.direction.y);
        rays.z = _mm256_add_ps(rays.z, _mm256_mul_ps(step, set(self.direction.z)));
        (_mm256_movemask_ps(ended) as u32, _mm256_movemask_ps(hit) as u32)
    }

    /// Moves a coordinate, and wraps it into [0, side).
    #[target_feature(enable = "avx2")]
    fn moved(&self, v: __m256, step: __m256, along: f32) -> __m256 {
        let side = _mm256_set1_ps(self.volume.side as f32);
        let v = _mm256_add_ps(v, _mm256_mul_ps(step, _mm256_set1_ps(along)));
        let periods = _mm256_floor_ps(_mm256_div_ps(v, side));
        let v = _mm256_sub_ps(v, _mm256_mul_ps(periods, side));
        _mm256_andnot_ps(_mm256_cmp_ps::<_CMP_GE_OQ>(v, side), v)
    }

    /// [`Volume::clearance`].
    #[target_feature(enable = "avx2")]
    fn clearances(&self, rays: &Rays) -> __m256 {
        const { assert!(CUBE == 2) }
        let volume = self.volume;
        let side = volume.side - 1;
        let (i, j) = (whole(rays.x, side), whole(rays.y, side));
        let (i, j) = (_mm256_srli_epi32::<1>(i), _mm256_srli_epi32::<1>(j));
        let k = _mm256_srli_epi32::<1>(whole(rays.z, 2 * volume.cube_levels - 1));
        let column = _mm256_add_epi32(
            _mm256_mullo_epi32(j, _mm256_set1_epi32((volume.side / CUBE) as i32)),
            i,
        );
        let at = _mm256_add_epi32(
            _mm256_mullo_epi32(column, _mm256_set1_epi32(volume.cube_levels as i32)),
            k,
        );
        // SAFETY: cubes of the grid, behind which there are three more bytes.
        let bytes = unsafe { _mm256_i32gather_epi32::<1>(volume.clear.as_ptr().cast(), at) };
        let bytes = _mm256_and_si256(bytes, _mm256_set1_epi32(0xff));
        _mm256_mul_ps(_mm256_cvtepi32_ps(bytes), _mm256_set1_ps(1.0 / CLEAR_UNITS))
    }

    /// [`Volume::distance`].
    #[target_feature(enable = "avx2")]
    fn distances(&self, rays: &Rays) -> __m256 {
        let volume = self.volume;
        let (next_x, next_y) = (volume.depth, (volume.side + 1) * volume.depth);
        let z = _mm256_max_ps(rays.z, _mm256_setzero_ps());
        let z = _mm256_min_ps(z, _mm256_set1_ps((volume.depth - 2) as f32));
        let (i, j, k) = (
            whole(rays.x, volume.side - 1),
            whole(rays.y, volume.side - 1),
            whole(z, volume.depth - 2),
        );
        let fraction = |v, whole| _mm256_sub_ps(v, _mm256_cvtepi32_ps(whole));
        let (fx, fy, fz) = (fraction(rays.x, i), fraction(rays.y, j), fraction(z, k));
        let row = _mm256_mullo_epi32(j, _mm256_set1_epi32(next_y as i32));
        let column = _mm256_mullo_epi32(i, _mm256_set1_epi32(next_x as i32));
        let first = _mm256_add_epi32(_mm256_add_epi32(row, column), k);
        let along_z = |offset: usize| {
            let at = _mm256_add_epi32(first, _mm256_set1_epi32(offset as i32));
            // SAFETY: two neighbours along z in a column of the grid, whose first row and column are there again behind the last.
            let pair = unsafe { _mm256_i32gather_epi32::<2>(volume.distance.as_ptr().cast(), at) };
            let low = _mm256_cvtepi32_ps(_mm256_srai_epi32::<16>(_mm256_slli_epi32::<16>(pair)));
            let high = _mm256_cvtepi32_ps(_mm256_srai_epi32::<16>(pair));
            mix(low, high, fz)
        };
        let (a, b) = (along_z(0), along_z(next_x));
        let (c, d) = (along_z(next_y), along_z(next_y + next_x));
        let distance = mix(mix(a, b, fx), mix(c, d, fx), fy);
        _mm256_mul_ps(distance, _mm256_set1_ps(1.0 / UNITS))
    }
}

/// Whole numbers within [0, most].
#[target_feature(enable = "avx2")]
fn whole(v: __m256, most: usize) -> __m256i {
    let v = _mm256_max_epi32(_mm256_cvttps_epi32(v), _mm256_setzero_si256());
    _mm256_min_epi32(v, _mm256_set1_epi32(most as i32))
}

/// From a to b.
#[target_feature(enable = "avx2")]
fn mix(a: __m256, b: __m256, t: __m256) -> __m256 {
    _mm256_add_ps(a, _mm256_mul_ps(t, _mm256_sub_ps(b, a)))
}
