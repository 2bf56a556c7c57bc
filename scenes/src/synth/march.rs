//! Rays through a [`Volume`].
//!
//! Long steps where the grid says that nothing is near, short ones near the surface (Hart, Sphere Tracing, 1996), and
//! linear interpolation of the crossing.

use super::volume::Volume;
use glam::Vec3;

/// Steps after which a ray counts as arrived; only rays that graze along a surface come near it.
const MAX_STEPS: u32 = 2000;
/// Voxels that a step may go beyond what is surely free: finer detail than this is missed by some rays, and saves half
/// of the steps along surfaces.
const SLACK: f32 = 0.5;
/// Clearance in voxels above which the coarse grid gives the step.
const CLEAR: f32 = 1.2;

impl Volume {
    /// Where the ray from `origin` first enters the solid, in grid coordinates with x and y in [0, side); none if it
    /// leaves through the top. `direction` is a unit vector.
    #[inline(always)]
    pub(super) fn march(&self, origin: Vec3, direction: Vec3) -> Option<Vec3> {
        let mut p = self.wrap(origin);
        let mut before = (0.0, 0.0);
        for _ in 0..MAX_STEPS {
            if p.z > self.top && direction.z >= 0.0 {
                return None;
            }
            if p.z <= 0.0 {
                return Some(p);
            }
            let clear = self.clearance(p);
            let step = if clear > CLEAR {
                before = (0.0, 0.0);
                clear + SLACK
            } else {
                let distance = self.distance(p);
                if distance <= 0.0 {
                    let (step, last) = before;
                    let back = if last > 0.0 {
                        step * distance / (last - distance)
                    } else {
                        0.0
                    };
                    return Some(self.wrap(p + back * direction));
                }
                let step = distance + SLACK;
                before = (step, distance);
                step
            };
            p = self.wrap(p + step * direction);
        }
        Some(p)
    }

    /// Whether the ray from `origin` leaves through the top.
    #[inline(always)]
    pub(super) fn escapes(&self, origin: Vec3, direction: Vec3) -> bool {
        self.march(origin, direction).is_none()
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
        assert!(volume.escapes(floor, Vec3::Z));
        assert!(
            !volume.escapes(floor, Vec3::new(1.0, 0.0, 0.2).normalize()),
            "wraps to the wall"
        );
        assert!(
            volume.escapes(floor, Vec3::new(0.0, 1.0, 0.2).normalize()),
            "along the wall"
        );
    }
}
