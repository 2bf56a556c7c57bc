//! Bent strands as chains of round cones: yarns, plies, stray fibres.

use super::noise::Noise;
use super::random::Random;
use super::volume::Row;
use glam::{Vec2, Vec3, vec3};

/// Slices of the patch for which the segments that touch them are listed.
const BUCKETS: usize = 64;

/// A straight piece of a strand.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    pub(super) from: Vec3,
    pub(super) to: Vec3,
    pub(super) radius: f32,
    /// Length of the strand up to `from`.
    pub(super) start: f32,
    /// Which strand this is a piece of.
    pub(super) strand: u32,
}

/// Where a point of the surface lies on its segment.
#[derive(Clone, Copy, Debug)]
pub(super) struct OnStrand {
    /// Unit vector along the strand.
    pub(super) tangent: Vec3,
    /// Distance along the strand.
    pub(super) along: f32,
    /// Unit vector on the cross-section: sideways, then up.
    pub(super) around: Vec2,
}

/// Segments sorted so that a slice finds its own.
#[derive(Default)]
pub(super) struct Strands {
    pub(super) segments: Vec<Segment>,
    buckets: Vec<Vec<u16>>,
}

impl Strands {
    /// Adds a strand through `points`; more than 65,000 segments in all are left out.
    pub(super) fn add(&mut self, strand: u32, radius: f32, points: impl IntoIterator<Item = Vec3>) {
        let mut points = points.into_iter();
        let Some(mut from) = points.next() else { return };
        let mut start = 0.0;
        for to in points {
            if self.segments.len() < 65_000 {
                self.segments.push(Segment {
                    from,
                    to,
                    radius,
                    start,
                    strand,
                });
            }
            start += from.distance(to);
            from = to;
        }
    }

    /// Lists the segments per slice; to be called after the last [`Strands::add`].
    pub(super) fn finish(&mut self) {
        self.buckets = vec![Vec::new(); BUCKETS];
        for (n, segment) in self.segments.iter().enumerate() {
            let reach = segment.radius * 1.5 + 1.0 / BUCKETS as f32;
            let bucket = |y: f32| (y * BUCKETS as f32).floor() as i32;
            let low = bucket(segment.from.y.min(segment.to.y) - reach);
            let high = bucket(segment.from.y.max(segment.to.y) + reach);
            for b in low..=high.min(low + BUCKETS as i32 - 1) {
                self.buckets[b.rem_euclid(BUCKETS as i32) as usize].push(n as u16);
            }
        }
    }

    /// Adds the strands to the solid; segment n is part `first + n`.
    pub(super) fn fill(&self, row: &mut Row<'_>, first: u16) {
        let bucket = ((row.y * BUCKETS as f32) as usize).min(BUCKETS - 1);
        for &n in &self.buckets[bucket] {
            let segment = &self.segments[usize::from(n)];
            // A margin of a few voxels, so that distances near the surface are known.
            let reach = segment.radius + 3.0 * row.voxel();
            let offset = row.offset(segment.from.y);
            let axis = segment.to - segment.from;
            if offset < axis.y.min(0.0) - reach || offset > axis.y.max(0.0) + reach {
                continue;
            }
            let inverse = 1.0 / axis.length_squared().max(1e-12);
            let from = segment.from;
            let x = from.x + axis.x.min(0.0) - reach..from.x + axis.x.max(0.0) + reach;
            let z = from.z + axis.z.min(0.0) - reach..from.z + axis.z.max(0.0) + reach;
            row.add(x, z, first + n, |x| {
                move |z| {
                    let p = vec3(x - from.x, offset, z - from.z);
                    let t = (p.dot(axis) * inverse).clamp(0.0, 1.0);
                    (p - t * axis).length() - segment.radius
                }
            });
        }
    }

    /// Where `p`, a point near segment `index`, lies on it.
    pub(super) fn locate(&self, index: u16, p: Vec3) -> OnStrand {
        let segment = &self.segments[usize::from(index).min(self.segments.len() - 1)];
        let axis = segment.to - segment.from;
        let length = axis.length().max(1e-9);
        let tangent = axis / length;
        let mut d = p - segment.from;
        d.x -= d.x.round();
        d.y -= d.y.round();
        let side = tangent.cross(Vec3::Z).try_normalize().unwrap_or(Vec3::X);
        let around = Vec2::new(d.dot(side), d.dot(side.cross(tangent)));
        OnStrand {
            tangent,
            along: segment.start + d.dot(tangent).clamp(0.0, length),
            around: around.try_normalize().unwrap_or(Vec2::Y),
        }
    }
}

impl OnStrand {
    /// Noise that is long along fibres which wind around the strand: `twist` turns per length, `fibres` around it,
    /// each about `length` long.
    pub(super) fn fibres(&self, noise: Noise, twist: f32, fibres: f32, length: f32) -> f32 {
        let turned = Vec2::from_angle(self.along * twist * std::f32::consts::TAU).rotate(self.around);
        let radius = fibres / std::f32::consts::TAU;
        noise.space(
            vec3(self.along / length, turned.x * radius, turned.y * radius),
            [1 << 24, 1 << 24],
        )
    }

    /// Direction of these fibres on a strand of this radius.
    pub(super) fn fibre_direction(&self, normal: Vec3, twist: f32, radius: f32) -> Vec3 {
        self.tangent - normal.cross(self.tangent) * (twist * radius * std::f32::consts::TAU)
    }
}

/// Points of a stray fibre that starts at `p` towards `direction` and bends at random while it rises or falls.
pub(super) fn stray_fibre(random: &mut Random, p: Vec3, direction: Vec3, length: f32) -> Vec<Vec3> {
    const POINTS: usize = 8;
    let mut points = vec![p];
    let (mut p, mut direction) = (p, direction);
    let bend = vec3(
        random.range(-1.0, 1.0),
        random.range(-1.0, 1.0),
        random.range(-0.9, 0.2),
    ) * 0.35;
    for _ in 1..POINTS {
        let jitter = vec3(
            random.range(-1.0, 1.0),
            random.range(-1.0, 1.0),
            random.range(-0.5, 0.5),
        ) * 0.15;
        direction = (direction + bend + jitter).normalize_or(Vec3::X);
        p += direction * (length / (POINTS - 1) as f32);
        points.push(p);
    }
    points
}

#[cfg(test)]
mod tests {
    use super::super::volume::{Solid, Volume};
    use super::*;
    use std::ops::Range;

    struct Bar(Strands);

    impl Solid for Bar {
        fn extent(&self) -> Range<f32> {
            0.0..0.3
        }

        fn fill(&self, row: &mut Row<'_>) {
            self.0.fill(row, 1);
        }
    }

    #[test]
    fn a_strand_across_the_seam_is_whole() {
        let mut strands = Strands::default();
        strands.add(0, 0.05, [vec3(0.8, 0.9, 0.15), vec3(1.2, 1.1, 0.15)]);
        strands.finish();
        let volume = Volume::build(&Bar(strands), 128);
        for t in [0.1, 0.3, 0.5, 0.7, 0.9] {
            let p = vec3(0.8, 0.9, 0.15).lerp(vec3(1.2, 1.1, 0.15), t);
            let grid = volume.wrap(vec3(p.x * 128.0 - 0.5, p.y * 128.0 - 0.5, p.z * 128.0 + 1.0));
            assert!(
                volume.distance(grid) < -2.0,
                "inside at {t}: {}",
                volume.distance(grid)
            );
        }
    }

    #[test]
    fn located_on_the_strand() {
        let mut strands = Strands::default();
        strands.add(
            0,
            0.05,
            [vec3(0.8, 0.5, 0.1), vec3(0.9, 0.5, 0.1), vec3(1.1, 0.5, 0.1)],
        );
        let found = strands.locate(1, vec3(0.0, 0.5, 0.15));
        assert!((found.along - 0.2).abs() < 1e-5);
        assert!(found.around.distance(Vec2::Y) < 1e-4 && found.tangent.distance(Vec3::X) < 1e-5);
    }
}
