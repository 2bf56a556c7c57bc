//! Rays through a [`Volume`].
//!
//! Long steps where the grid says that nothing is near, short ones near the surface (Hart, Sphere Tracing, 1996), and
//! linear interpolation of the crossing.
//!
//! A step is little arithmetic that waits for memory: grids are larger than caches. So parallel rays go in packets, a step of all of
//! them before the next step of any ([`Volume::march_all`]), and the processor waits for many of them at once. A ray does not notice:
//! it does what it would do alone.

#[cfg(target_arch = "x86_64")]
mod avx2;

use super::volume::Volume;
use glam::Vec3;

/// Steps after which a ray counts as arrived; only rays that graze along a surface come near it.
const MAX_STEPS: u32 = 2000;
/// Voxels that a step may go beyond what is surely free: finer detail than this is missed by some rays, and saves half
/// of the steps along surfaces.
const SLACK: f32 = 0.5;
/// Clearance in voxels above which the coarse grid gives the step.
const CLEAR: f32 = 1.2;

/// Rays of a packet at most.
pub(super) const PACKET: usize = 256;

/// A ray on its way.
#[derive(Clone, Copy)]
struct Ray {
    /// Where it is, x and y in [0, side).
    p: Vec3,
    /// The last step and the distance that was found before it; zeros unless that was near the surface.
    before: (f32, f32),
    /// Which one of the packet.
    number: u32,
}

/// What a step came to.
enum Step {
    On(Ray),
    Hit(Vec3),
}

impl Volume {
    /// Where the ray from `origin` first enters the solid, in grid coordinates with x and y in [0, side); none if it
    /// leaves through the top. `direction` is a unit vector.
    pub(super) fn march(&self, origin: Vec3, direction: Vec3) -> Option<Vec3> {
        let mut ray = self.ray(origin, 0);
        for _ in 0..MAX_STEPS {
            if let Some(end) = self.end(&ray, direction) {
                return end;
            }
            let clear = self.clearance(ray.p);
            if clear > CLEAR {
                ray = self.leap(ray, clear, direction);
                continue;
            }
            match self.step(ray, direction) {
                Step::On(on) => ray = on,
                Step::Hit(p) => return Some(p),
            }
        }
        Some(ray.p)
    }

    /// [`Volume::march`] for rays of one direction, at most [`PACKET`]; `arrived` hears of each once, by its place in `origins`.
    pub(super) fn march_all(
        &self,
        origins: &[Vec3],
        direction: Vec3,
        arrived: impl FnMut(usize, Option<Vec3>),
    ) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has the feature.
            return unsafe { avx2::march_all(self, origins, direction, arrived) };
        }
        self.march_by_turns(origins, direction, arrived);
    }

    /// The same on any processor.
    fn march_by_turns(
        &self,
        origins: &[Vec3],
        direction: Vec3,
        mut arrived: impl FnMut(usize, Option<Vec3>),
    ) {
        let none = Ray {
            p: Vec3::ZERO,
            before: (0.0, 0.0),
            number: 0,
        };
        let (mut rays, mut near) = ([none; PACKET], [none; PACKET]);
        let mut count = origins.len();
        for (number, (ray, &origin)) in rays.iter_mut().zip(origins).enumerate() {
            *ray = self.ray(origin, number as u32);
        }
        for _ in 0..MAX_STEPS {
            // Which way a ray goes cannot be predicted: it is written to both lists, and one of them becomes longer.
            let (mut far_count, mut near_count) = (0, 0);
            for n in 0..count {
                let ray = rays[n];
                if let Some(end) = self.end(&ray, direction) {
                    arrived(ray.number as usize, end);
                    continue;
                }
                let clear = self.clearance(ray.p);
                near[near_count] = ray;
                rays[far_count] = self.leap(ray, clear, direction);
                near_count += usize::from(clear <= CLEAR);
                far_count += usize::from(clear > CLEAR);
            }
            count = far_count;
            for ray in &near[..near_count] {
                match self.step(*ray, direction) {
                    Step::On(on) => {
                        rays[count] = on;
                        count += 1;
                    }
                    Step::Hit(p) => arrived(ray.number as usize, Some(p)),
                }
            }
            if count == 0 {
                return;
            }
        }
        for ray in &rays[..count] {
            arrived(ray.number as usize, Some(ray.p));
        }
    }

    #[inline(always)]
    fn ray(&self, origin: Vec3, number: u32) -> Ray {
        Ray {
            p: self.wrap(origin),
            before: (0.0, 0.0),
            number,
        }
    }

    /// Whether the ray has left through the top, or reached the floor.
    #[inline(always)]
    fn end(&self, ray: &Ray, direction: Vec3) -> Option<Option<Vec3>> {
        if ray.p.z > self.top && direction.z >= 0.0 {
            return Some(None);
        }
        (ray.p.z <= 0.0).then_some(Some(ray.p))
    }

    /// A step where nothing is near.
    #[inline(always)]
    fn leap(&self, ray: Ray, clear: f32, direction: Vec3) -> Ray {
        Ray {
            p: self.wrap(ray.p + (clear + SLACK) * direction),
            before: (0.0, 0.0),
            ..ray
        }
    }

    /// A step near the surface.
    #[inline(always)]
    fn step(&self, ray: Ray, direction: Vec3) -> Step {
        let distance = self.distance(ray.p);
        if distance <= 0.0 {
            let (step, last) = ray.before;
            let back = if last > 0.0 {
                step * distance / (last - distance)
            } else {
                0.0
            };
            return Step::Hit(self.wrap(ray.p + back * direction));
        }
        let step = distance + SLACK;
        Step::On(Ray {
            p: self.wrap(ray.p + step * direction),
            before: (step, distance),
            ..ray
        })
    }

    /// Where a ray that goes down through `point` of the reference plane (grid coordinates) against `view` starts:
    /// above everything.
    pub(super) fn above(&self, point: Vec3, view: Vec3) -> Vec3 {
        point + view * ((self.top - self.reference).max(0.0) / view.z)
    }
}

#[cfg(test)]
mod tests {
    use super::super::volume::{Row, Solid};
    use super::*;
    use std::ops::Range;

    /// A wall along y, 0.1 wide, 0.3 above the floor.
    struct Wall;

    impl Solid for Wall {
        fn extent(&self) -> Range<f32> {
            0.0..0.4
        }

        fn fill(&self, row: &mut Row<'_>) {
            row.add_below(|x| (if (x - 0.5).abs() < 0.05 { 0.3 } else { 0.0 }, 1));
        }
    }

    #[test]
    fn hits_the_wall_and_the_floor() {
        let volume = Volume::build(&Wall, 128);
        let down = |x: f32| {
            volume
                .march(Vec3::new(x * 128.0, 20.0, volume.top), Vec3::NEG_Z)
                .map(|p| volume.material_from_grid(p).z)
        };
        assert!((down(0.5).unwrap() - 0.3).abs() < 0.01);
        assert!(down(0.8).unwrap().abs() < 0.01);
    }

    #[test]
    fn the_wall_blocks_around_the_patch() {
        let volume = Volume::build(&Wall, 128);
        let floor = Vec3::new(0.9 * 128.0, 3.0, 4.0);
        let escapes = |direction: Vec3| volume.march(floor, direction.normalize()).is_none();
        assert!(escapes(Vec3::Z));
        assert!(!escapes(Vec3::new(1.0, 0.0, 0.2)), "wraps to the wall");
        assert!(escapes(Vec3::new(0.0, 1.0, 0.2)), "along the wall");
    }

    #[test]
    fn packets_do_what_rays_do_alone() {
        let volume = Volume::build(&Wall, 128);
        let origin = |n: usize| Vec3::new((n * 37 % 128) as f32 + 0.3, n as f32 * 0.4, 2.0 + (n % 40) as f32);
        let origins: Vec<Vec3> = (0..PACKET).map(origin).collect();
        for direction in [Vec3::new(0.6, 0.1, 0.3), Vec3::new(-0.3, 0.5, -0.2), Vec3::X] {
            let direction = direction.normalize();
            for packet in [&origins[..], &origins[..3], &[]] {
                let mut found = [vec![None; packet.len()], vec![None; packet.len()]];
                let [best, portable] = &mut found;
                volume.march_all(packet, direction, |n, end| {
                    assert_eq!(best[n].replace(end), None, "once");
                });
                volume.march_by_turns(packet, direction, |n, end| {
                    assert_eq!(portable[n].replace(end), None, "once");
                });
                for found in found {
                    for (origin, found) in packet.iter().zip(found) {
                        assert_eq!(found, Some(volume.march(*origin, direction)));
                    }
                }
            }
        }
    }
}
