//! Scenes that show one material on a simple shape: what a viewer opens when it is given an archive alone.

use std::f32::consts::{PI, TAU};

use glam::{Affine3A, Vec2, Vec3};

use crate::builder::{Builder, direction};
use crate::shapes::{grid, revolved};
use crate::{Camera, Light, Mesh, Scene};

/// What a material is shown on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shape {
    /// An upright square, which shows the material once.
    #[default]
    Plane,
    /// A ball.
    Sphere,
    /// A standing roll.
    Cylinder,
    /// A square sheet that hangs over a ball in folds.
    Cloth,
}

impl Shape {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Plane, Self::Sphere, Self::Cylinder, Self::Cloth];

    /// Name, in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plane => "plane",
            Self::Sphere => "sphere",
            Self::Cylinder => "cylinder",
            Self::Cloth => "cloth",
        }
    }

    /// The shape of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|shape| shape.name() == name)
    }

    /// The shape, about a metre large and around the origin, front towards +z.
    pub fn mesh(self) -> Mesh {
        match self {
            Self::Plane => grid(1, 1, Vec2::ONE, |s, t| Vec3::new(s - 0.5, t - 0.5, 0.0)),
            Self::Sphere => grid(96, 48, Vec2::new(4.0, 2.0), |s, t| {
                // Turned so that the seam is behind.
                let (around, up) = ((s - 0.25) * TAU, (t - 0.5) * PI * 0.9995);
                Vec3::new(up.cos() * around.cos(), up.sin(), -up.cos() * around.sin()) * 0.5
            }),
            Self::Cylinder => revolved(
                96,
                4,
                Vec2::new(2.0, 1.0),
                &[[RADIUS, -PI * RADIUS / 2.0], [RADIUS, PI * RADIUS / 2.0]],
            ),
            Self::Cloth => grid(160, 160, Vec2::splat(3.0), |s, t| draped(Vec2::new(s, t) - 0.5)),
        }
    }
}

/// Radius of the roll; its height is half its circumference.
const RADIUS: f32 = 0.32;

/// Radius of the ball under the cloth, the angle from its top at which the cloth leaves it, and the cloth's side.
const BALL: f32 = 0.3;
const LEAVES: f32 = 1.35;
const SIDE: f32 = 1.25;
/// Folds around.
const FOLDS: f32 = 8.0;
/// Where the cloth is flat against the ball, it has no folds; so far below they are whole.
const FOLDED: f32 = 0.3;

/// A point of the cloth, by its place on the flat cloth from -1/2 to 1/2. Lengths along rays from the middle are kept: over
/// the ball, then down beside it. Around, what is too much for the circumference goes into folds: a ripple of amplitude a and n
/// periods on a circle of radius d is 1 + (n·a/d)²/4 times as long, to first order.
fn draped(flat: Vec2) -> Vec3 {
    let flat = flat * SIDE;
    let (along, around) = (flat.length(), flat.y.atan2(flat.x));
    let angle = (along / BALL).min(LEAVES);
    let below = (along - BALL * LEAVES).max(0.0);
    // Leaves the ball along its slope, and turns downwards.
    let (slope_out, slope_down) = (LEAVES.cos(), LEAVES.sin());
    let out = BALL * angle.sin() + below * slope_out;
    let surplus = (along / out.max(1e-6) - 1.0).max(0.0);
    let share = (below / FOLDED).min(1.0);
    let amplitude = 2.0 * out / FOLDS * surplus.sqrt() * share * share * (3.0 - 2.0 * share);
    // Corners are fold crests, a little uneven, as cloth is.
    let ripple = (FOLDS * around + PI).cos() + 0.18 * (3.0 * around + 0.7).sin();
    let out = out + amplitude * ripple;
    let height = BALL * angle.cos() - below * slope_down;
    Vec3::new(out * around.cos(), height + 0.1, -out * around.sin())
}

/// One material on a shape, with a warm light from the left and a cool one behind.
pub fn lone(archive: &str, shape: Shape) -> Scene {
    let mut builder = Builder::default();
    let material = builder.material(archive, 1.0);
    builder.place(shape.mesh(), material, Affine3A::IDENTITY);
    let mut scene = builder.scene;
    scene.lights = vec![
        Light::Directional {
            to_light: direction(40.0, 45.0),
            irradiance: Vec3::new(3.2, 3.0, 2.7),
        },
        Light::Point {
            position: Vec3::new(1.2, 1.0, -1.1),
            intensity: Vec3::new(1.6, 2.0, 2.6),
        },
    ];
    scene.ambient = Vec3::splat(0.12);
    scene.background = Vec3::splat(0.02);
    scene.cameras = vec![camera(shape)];
    scene
}

/// From the front, and from above what is round.
fn camera(shape: Shape) -> Camera {
    let eye = match shape {
        Shape::Plane => Vec3::new(0.35, 0.15, 1.5),
        Shape::Sphere => Vec3::new(0.3, 0.35, 1.7),
        Shape::Cylinder => Vec3::new(0.3, 0.3, 1.75),
        Shape::Cloth => Vec3::new(0.35, 0.75, 1.6),
    };
    Camera {
        eye,
        target: Vec3::ZERO,
        up: Vec3::Y,
        fov_y: 40f32.to_radians(),
        near: 0.02,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_complete_and_face_outwards() {
        for shape in Shape::ALL {
            assert_eq!(Shape::named(shape.name()), Some(shape));
            let scene = lone("cloth", shape);
            let mesh = &scene.meshes[0];
            let count = mesh.positions.len();
            assert_eq!(
                [mesh.normals.len(), mesh.tangents.len(), mesh.uvs.len()],
                [count; 3]
            );
            let (min, max) = scene.bounds().unwrap();
            let side = (max - min).max_element();
            assert!((0.8..1.4).contains(&side), "{shape:?}: {side}");
            assert_eq!(scene.cameras[0].problem(), None);
            let mirrored = mesh.tangents.iter().filter(|tangent| tangent.w != 1.0).count();
            assert!(mirrored * 200 <= count, "{shape:?}: {mirrored} of {count}");
            let wrong = mesh.indices.chunks_exact(3).filter(|corners| {
                let [a, b, c] = [0, 1, 2].map(|corner| mesh.positions[corners[corner] as usize]);
                let shading: Vec3 = corners.iter().map(|corner| mesh.normals[*corner as usize]).sum();
                (b - a).cross(c - a).dot(shading) < 0.0
            });
            assert!(wrong.count() * 200 <= mesh.indices.len() / 3, "{shape:?}");
        }
        assert_eq!(Shape::named("cube"), None);
    }

    #[test]
    fn the_cloth_is_hardly_stretched() {
        let (mesh, count) = (Shape::Cloth.mesh(), 161);
        let rest = SIDE / 160.0;
        let stretch = |a: usize, b: usize| mesh.positions[a].distance(mesh.positions[b]) / rest;
        let across: Vec<f32> = (0..160 * count)
            .filter(|at| at % count < 160)
            .map(|at| stretch(at, at + 1))
            .collect();
        let mean = across.iter().sum::<f32>() / across.len() as f32;
        assert!((0.85..1.15).contains(&mean), "mean stretch {mean}");
    }
}
