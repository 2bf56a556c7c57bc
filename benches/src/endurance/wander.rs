//! A camera that goes anywhere over a scene.

use glam::Vec3;
use rand_chacha::ChaCha8Rng;
use scenes::Camera;

use super::weather::unit;

/// Flies from view to view, and stays a while at each.
pub(super) struct Wander {
    /// The box around the scene, and a camera to begin with.
    corners: [Vec3; 2],
    from: Camera,
    to: Camera,
    /// Seconds since it left, those of the way, and those until it leaves again.
    time: f64,
    way: f64,
    stay: f64,
}

impl Wander {
    pub(super) fn new(corners: [Vec3; 2], start: Camera) -> Self {
        Self {
            corners,
            from: start,
            to: start,
            time: 0.0,
            way: 0.0,
            stay: 2.0,
        }
    }

    /// The camera so many seconds later.
    pub(super) fn after(&mut self, seconds: f64, random: &mut ChaCha8Rng) -> Camera {
        self.time += seconds;
        if self.time > self.way + self.stay {
            let camera = self.anywhere(random);
            self.from = std::mem::replace(&mut self.to, camera);
            self.time = 0.0;
            // One in five jumps.
            self.way = if unit(random) < 0.2 {
                0.0
            } else {
                1.0 + 4.0 * unit(random)
            };
            self.stay = 3.0 * unit(random);
        }
        let s = if self.way > 0.0 {
            (self.time / self.way).min(1.0) as f32
        } else {
            1.0
        };
        let s = s * s * (3.0 - 2.0 * s);
        Camera {
            eye: self.from.eye.lerp(self.to.eye, s),
            target: self.from.target.lerp(self.to.target, s),
            ..self.to
        }
    }

    /// A look at a place of the scene from above: from far away, or so near that it fills the picture.
    fn anywhere(&self, random: &mut ChaCha8Rng) -> Camera {
        let [low, high] = self.corners;
        let mut place = || unit(random) as f32;
        let target = low + (high - low) * Vec3::new(place(), 0.3 * place(), place());
        let size = (high - low).max_element();
        // Distances as often between a hundredth and a tenth of the scene as between a tenth and all of it.
        let distance = size * 10f32.powf(-2.0 * place());
        let (turn, up) = (std::f32::consts::TAU * place(), 0.2 + 1.1 * place());
        let away = Vec3::new(turn.cos() * up.cos(), up.sin(), turn.sin() * up.cos());
        Camera {
            eye: target + distance * away,
            target,
            ..self.from
        }
    }
}
