//! Lights that are turned by dragging.

use glam::{Quat, Vec2, Vec3};
use scenes::{Camera, Light};

/// Most lights.
pub const MOST_LIGHTS: usize = 16;
/// A drag over the height of the picture turns the light by so much, radians.
const TURN: f32 = 3.0;
/// Irradiance of a light that is added.
const ADDED: f32 = 2.5;
/// Brightest and darkest that a light becomes by [`Lights::scale`].
const BRIGHTEST: f32 = 1e6;

/// The lights of a scene, one of them chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Lights {
    lights: Vec<Light>,
    chosen: usize,
}

impl Lights {
    /// Those of a scene; beyond [`MOST_LIGHTS`], which drags and links can follow, they are left out.
    pub fn new(lights: &[Light]) -> Self {
        let lights = lights.iter().copied().map(mended).take(MOST_LIGHTS).collect();
        Self { lights, chosen: 0 }
    }

    /// All of them.
    pub fn all(&self) -> &[Light] {
        &self.lights
    }

    /// Which one is chosen; `None` if there is none.
    pub fn chosen(&self) -> Option<usize> {
        (self.chosen < self.lights.len()).then_some(self.chosen)
    }

    /// Chooses one.
    pub fn choose(&mut self, light: usize) {
        self.chosen = light.min(self.lights.len().saturating_sub(1));
    }

    /// Chooses the next one.
    pub fn choose_next(&mut self) {
        self.chosen = (self.chosen + 1) % self.lights.len().max(1);
    }

    /// Adds a light that shines from where the camera is, from far away, and chooses it. Returns whether there was room.
    pub fn add(&mut self, camera: &Camera) -> bool {
        if self.lights.len() >= MOST_LIGHTS {
            return false;
        }
        self.lights.push(Light::Directional {
            to_light: -camera.basis().forward,
            irradiance: Vec3::splat(ADDED),
        });
        self.chosen = self.lights.len() - 1;
        true
    }

    /// Removes the chosen one. Returns whether there was one.
    pub fn remove(&mut self) -> bool {
        let Some(chosen) = self.chosen() else { return false };
        self.lights.remove(chosen);
        self.choose(chosen);
        true
    }

    /// Turns the chosen light about `centre` by a drag of so many heights of the picture, to the right and down: what it
    /// lights most follows the pointer, as on a ball.
    pub fn drag(&mut self, by: Vec2, camera: &Camera, centre: Vec3) {
        let Some(light) = self.lights.get_mut(self.chosen).filter(|_| by.is_finite()) else {
            return;
        };
        let basis = camera.basis();
        let by = by.clamp_length_max(1.0) * TURN;
        let turn = Quat::from_axis_angle(basis.up, by.x) * Quat::from_axis_angle(basis.right, by.y);
        match light {
            Light::Directional { to_light, .. } => {
                *to_light = (turn * *to_light).try_normalize().unwrap_or(Vec3::Y);
            }
            Light::Point { position, .. } => {
                let from_centre = *position - centre;
                let turned = turn * from_centre;
                // As far as before: rounding would let it drift.
                let length = from_centre.length();
                *position = centre + turned.try_normalize().unwrap_or(Vec3::Y) * length;
            }
        }
    }

    /// Makes the chosen light so many times as bright.
    pub fn scale(&mut self, factor: f32) {
        if let Some(light) = self.lights.get_mut(self.chosen).filter(|_| factor.is_finite()) {
            let (Light::Directional {
                irradiance: color, ..
            }
            | Light::Point { intensity: color, .. }) = light;
            *color = (*color * factor.max(0.0)).clamp(Vec3::ZERO, Vec3::splat(BRIGHTEST));
        }
    }

    /// Replaces the chosen light's colour.
    pub fn set_color(&mut self, to: Vec3) {
        if let Some(light) = self.lights.get_mut(self.chosen) {
            let (Light::Directional {
                irradiance: color, ..
            }
            | Light::Point { intensity: color, .. }) = light;
            *color = to.clamp(Vec3::ZERO, Vec3::splat(BRIGHTEST));
        }
    }
}

/// Unit vectors, and nothing that is not finite.
fn mended(light: Light) -> Light {
    let finite = |vector: Vec3| if vector.is_finite() { vector } else { Vec3::ZERO };
    match light {
        Light::Directional { to_light, irradiance } => Light::Directional {
            to_light: finite(to_light).try_normalize().unwrap_or(Vec3::Y),
            irradiance: finite(irradiance),
        },
        Light::Point { position, intensity } => Light::Point {
            position: finite(position),
            intensity: finite(intensity),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera {
            eye: Vec3::new(0.0, 0.0, 2.0),
            target: Vec3::ZERO,
            up: Vec3::Y,
            fov_y: 0.7,
            near: 0.01,
        }
    }

    fn lights() -> Lights {
        Lights::new(&[
            Light::Directional {
                to_light: Vec3::Z,
                irradiance: Vec3::ONE,
            },
            Light::Point {
                position: Vec3::new(1.0, 2.0, 4.0),
                intensity: Vec3::ONE,
            },
        ])
    }

    #[test]
    fn a_dragged_light_follows_the_pointer_and_keeps_its_length() {
        let mut lights = lights();
        for _ in 0..1000 {
            lights.drag(Vec2::new(0.013, 0.021), &camera(), Vec3::ONE);
        }
        let Light::Directional { to_light, .. } = lights.all()[0] else {
            panic!()
        };
        assert!((to_light.length() - 1.0).abs() < 1e-5);
        let mut lights = self::lights();
        lights.drag(Vec2::new(0.1, 0.0), &camera(), Vec3::ZERO);
        let Light::Directional { to_light, .. } = lights.all()[0] else {
            panic!()
        };
        assert!(to_light.x > 0.1, "to the right: {to_light}");
        lights.drag(Vec2::new(0.0, 0.1), &camera(), Vec3::ZERO);
        let Light::Directional { to_light, .. } = lights.all()[0] else {
            panic!()
        };
        assert!(to_light.y < -0.1, "and down: {to_light}");
        lights.choose_next();
        for _ in 0..1000 {
            lights.drag(Vec2::new(-0.3, 0.2), &camera(), Vec3::ONE);
        }
        let Light::Point { position, .. } = lights.all()[1] else {
            panic!()
        };
        assert!((position.distance(Vec3::ONE) - 10f32.sqrt()).abs() < 1e-3);
    }

    #[test]
    fn lights_come_and_go_within_bounds() {
        let mut lights = lights();
        while lights.add(&camera()) {}
        assert_eq!(
            (lights.all().len(), lights.chosen()),
            (MOST_LIGHTS, Some(MOST_LIGHTS - 1))
        );
        lights.scale(1e30);
        lights.scale(f32::NAN);
        let Light::Directional { irradiance, .. } = lights.all()[MOST_LIGHTS - 1] else {
            panic!()
        };
        assert_eq!(irradiance, Vec3::splat(BRIGHTEST));
        while lights.remove() {}
        assert_eq!((lights.all().len(), lights.chosen()), (0, None));
        lights.drag(Vec2::ONE, &camera(), Vec3::ZERO);
        lights.choose_next();
    }
}
