//! The CPU reference against closed forms: everything that a pixel goes through has one here.

mod reference_scene;

use std::f64::consts::PI;

use engine::{
    metrics::Picture,
    reference::{Reflectance, shade},
};
use glam::{DVec3, Vec2, Vec3};
use reference_scene::{HEIGHT, WIDTH, camera, closed_form, quad_scene, see_all, spread};
use scenes::{Light, Surface};
use tileset::Direction;

/// A BTF by formula: mip, texel, view and light to linear RGB.
struct Formula<F> {
    size: (u32, u32),
    wrap: bool,
    cosine: bool,
    directions: Vec<Direction>,
    formula: F,
}

impl<F: Fn(u8, u32, u32, Direction, Direction) -> [f64; 3]> Formula<F> {
    fn new(size: (u32, u32), formula: F) -> Self {
        Self {
            size,
            wrap: true,
            cosine: false,
            directions: spread(),
            formula,
        }
    }
}

impl<F: Fn(u8, u32, u32, Direction, Direction) -> [f64; 3] + Sync> Reflectance for Formula<F> {
    fn size(&self) -> (u32, u32) {
        self.size
    }

    fn wrap(&self) -> bool {
        self.wrap
    }

    fn cosine(&self) -> bool {
        self.cosine
    }

    fn views(&self) -> &[Direction] {
        &self.directions
    }

    fn lights(&self) -> &[Direction] {
        &self.directions
    }

    fn texel(&self, mip: u8, x: u32, y: u32, view: u32, light: u32) -> [f64; 3] {
        (self.formula)(
            mip,
            x,
            y,
            self.directions[view as usize],
            self.directions[light as usize],
        )
    }
}

fn parabolic(direction: DVec3) -> [f64; 2] {
    [
        direction.x / (1.0 + direction.z),
        direction.y / (1.0 + direction.z),
    ]
}

/// A product of functions that are linear in parabolic coordinates: interpolation of any of it is exact.
fn linear(view: [f64; 2], light: [f64; 2]) -> [f64; 3] {
    let side = |p: [f64; 2], x: f64, y: f64| 1.0 + x * p[0] + y * p[1];
    [
        side(view, 0.3, -0.2) * side(light, 0.5, 0.1),
        side(view, 0.0, 0.7) * side(light, -0.4, 0.0),
        side(view, -0.6, 0.1) * side(light, 0.2, 0.8),
    ]
}

fn linear_btf() -> impl Reflectance {
    Formula::new((4, 4), |_, _, _, view: Direction, light: Direction| {
        let of = |direction: Direction| parabolic(DVec3::from(direction.to_vector()));
        linear(of(view), of(light))
    })
}

fn assert_close(picture: &Picture, expected: impl Fn(u32, u32) -> DVec3) {
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let found = Vec3::from(picture.pixels[(y * WIDTH + x) as usize]).as_dvec3();
            let expected = expected(x, y);
            let error = (found - expected).abs().max_element();
            assert!(
                error <= 1e-6 * expected.abs().max_element().max(1.0),
                "({x}, {y}): {found} for {expected}"
            );
        }
    }
}

fn sun(to_light: Vec3) -> Light {
    Light::Directional {
        to_light: to_light.normalize(),
        irradiance: Vec3::new(3.0, 2.0, 1.0),
    }
}

/// Ray, hit, tangent frame, parabolic coordinates, triangulation, light and 1/π, of every pixel.
#[test]
fn a_btf_that_is_linear_in_its_directions_is_exact() {
    let to_light = Vec3::new(0.3, 0.5, 0.8);
    let mut scene = quad_scene();
    scene.lights = vec![sun(to_light)];
    let btf = linear_btf();
    let picture = shade(&scene, &camera(), (WIDTH, HEIGHT), &see_all(), &[Some(&btf)]);
    let light = to_light.normalize().as_dvec3();
    assert_close(&picture, |x, y| {
        let (_, view) = closed_form(x, y);
        let reflectance = DVec3::from(linear(parabolic(view), parabolic(light)));
        DVec3::new(3.0, 2.0, 1.0) * reflectance * light.z / PI
    });
}

#[test]
fn samples_that_include_the_cosine_are_not_multiplied_with_it_again() {
    let mut scene = quad_scene();
    scene.lights = vec![sun(Vec3::new(0.3, 0.5, 0.8))];
    let white = |cosine: bool| Formula {
        cosine,
        ..Formula::new((4, 4), move |_, _, _, _, light: Direction| {
            [if cosine { light.theta.cos() } else { 1.0 }; 3]
        })
    };
    let shade = |scene: &scenes::Scene, btf: &dyn Reflectance| {
        shade(scene, &camera(), (WIDTH, HEIGHT), &see_all(), &[Some(btf)])
    };
    let (without, with) = (shade(&scene, &white(false)), shade(&scene, &white(true)));
    let close = |a: &Picture, b: &Picture, tolerance: f32| {
        let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
        pairs.for_each(|(a, b)| assert!((a - b).abs() < tolerance * b, "{a} {b}"));
    };
    // Up to the interpolation of the cosine.
    close(&with, &without, 0.02);
    // Beyond the hull the cosine goes on: outermost samples are at 75°, the light is at 85°.
    let grazing = 85f32.to_radians();
    scene.lights = vec![sun(Vec3::new(grazing.sin(), 0.0, grazing.cos()))];
    close(&shade(&scene, &white(true)), &shade(&scene, &white(false)), 0.02);
}

#[test]
fn a_diffuse_surface_and_a_white_btf_look_the_same() {
    let mut scene = quad_scene();
    let point = Light::Point {
        position: Vec3::new(0.5, -0.3, 2.0),
        intensity: Vec3::new(5.0, 6.0, 7.0),
    };
    let below = sun(Vec3::new(0.2, 0.1, -0.5));
    scene.lights = vec![sun(Vec3::new(0.3, 0.5, 0.8)), point, below];
    scene.ambient = Vec3::new(0.1, 0.2, 0.3);
    let grey = Formula::new((8, 8), |_, _, _, _, _| [0.5, 0.4, 0.3]);
    let btf = shade(&scene, &camera(), (WIDTH, HEIGHT), &see_all(), &[Some(&grey)]);
    scene.materials[0].surface = Surface::Diffuse {
        albedo: Vec3::new(0.5, 0.4, 0.3),
    };
    let diffuse = shade(&scene, &camera(), (WIDTH, HEIGHT), &see_all(), &[None]);
    let expected = |x, y| {
        let (position, _) = closed_form(x, y);
        let sun = DVec3::new(3.0, 2.0, 1.0) * Vec3::new(0.3, 0.5, 0.8).normalize().as_dvec3().z;
        let to_point = Vec3::new(0.5, -0.3, 2.0).as_dvec3() - position;
        let point = DVec3::new(5.0, 6.0, 7.0) * to_point.z / to_point.length().powi(3);
        let albedo = Vec3::new(0.5, 0.4, 0.3).as_dvec3();
        albedo * (Vec3::new(0.1, 0.2, 0.3).as_dvec3() + (sun + point) / PI)
    };
    assert_close(&diffuse, expected);
    assert_close(&btf, expected);
}

/// Row 0 of a material is at v = 0, the top of the quad; texel (x, y) has its middle at ((x + ½)/W, (y +
/// ½)/H).
#[test]
fn texels_lie_where_they_belong() {
    let size = (64, 32);
    let mut scene = quad_scene();
    scene.lights = vec![Light::Directional {
        to_light: Vec3::Z,
        irradiance: Vec3::ONE,
    }];
    for (scale, offset, wrap) in [
        (Vec2::ONE, Vec2::ZERO, true),
        (Vec2::new(0.7, 0.6), Vec2::new(0.2, 0.3), false),
    ] {
        scene.materials[0].surface = Surface::Btf {
            archive: "x".into(),
            uv_scale: scale,
            uv_offset: offset,
        };
        // The middle of the texel, counted in texels of the finest mip, as the mean over them would be.
        let middle = |mip: u8, at: u32| (f64::from(at) + 0.5) * f64::from(1u32 << mip) - 0.5;
        let ramp = |mip, x, y, _: Direction, _: Direction| [middle(mip, x), middle(mip, y), 1.0];
        let btf = Formula {
            wrap,
            ..Formula::new(size, ramp)
        };
        let picture = shade(&scene, &camera(), (WIDTH, HEIGHT), &see_all(), &[Some(&btf)]);
        let mut inside = 0;
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let (position, _) = closed_form(x, y);
                // The quad spans [-1, 1]², v grows downwards.
                let s = (position.x + 1.0) / 2.0 * f64::from(scale.x) + f64::from(offset.x);
                let t = (1.0 - position.y) / 2.0 * f64::from(scale.y) + f64::from(offset.y);
                let (column, row) = (s * 64.0 - 0.5, t * 32.0 - 0.5);
                if !(1.0..=62.0).contains(&column) || !(1.0..=30.0).contains(&row) {
                    continue;
                }
                inside += 1;
                let [r, g, b] = picture.pixels[(y * WIDTH + x) as usize].map(f64::from);
                assert!(
                    (r / b - column).abs() < 1e-3 && (g / b - row).abs() < 1e-3,
                    "({x}, {y}): {} {}",
                    r / b,
                    g / b
                );
            }
        }
        assert!(inside > 1000, "{inside}");
    }
}

/// The mip is log2 of the texels from pixel to pixel, and fades linearly: a BTF that says its mip says it
/// here.
#[test]
fn the_level_of_detail_is_the_logarithm_of_the_step() {
    let mut scene = quad_scene();
    scene.lights = vec![Light::Directional {
        to_light: Vec3::Z,
        irradiance: Vec3::ONE,
    }];
    let btf = Formula::new((4096, 512), |mip, _, _, _, _| [f64::from(mip), 1.0, 0.0]);
    let picture = shade(&scene, &camera(), (WIDTH, HEIGHT), &see_all(), &[Some(&btf)]);
    let position = |x: u32, y: u32| closed_form(x, y).0;
    for y in 1..HEIGHT - 1 {
        for x in 1..WIDTH - 1 {
            // Central differences stand for the derivative: good to second order.
            let texels = DVec3::new(4096.0, 512.0, 0.0) / 2.0;
            let dx = ((position(x + 1, y) - position(x - 1, y)) / 2.0 * texels).length();
            let dy = ((position(x, y + 1) - position(x, y - 1)) / 2.0 * texels).length();
            let [mip, one, _] = picture.pixels[(y * WIDTH + x) as usize].map(f64::from);
            let expected = dx.max(dy).log2();
            assert!((1.0..12.0).contains(&expected), "a picture that tests something");
            assert!(
                (mip / one - expected).abs() < 2e-3,
                "({x}, {y}): {} for {expected}",
                mip / one
            );
        }
    }
}

/// From behind, the sheet turns about its tangent: y and z of the frame change sign.
#[test]
fn the_back_of_a_sheet_is_lit_and_seen_from_behind() {
    let mut scene = quad_scene();
    let to_light = Vec3::new(0.3, 0.5, -0.8);
    scene.lights = vec![sun(to_light), sun(Vec3::Z)];
    let mut camera = camera();
    camera.eye.z = -camera.eye.z;
    let btf = linear_btf();
    let picture = shade(&scene, &camera, (WIDTH, HEIGHT), &see_all(), &[Some(&btf)]);
    let to_light = to_light.normalize().as_dvec3();
    let light = DVec3::new(to_light.x, -to_light.y, -to_light.z);
    let rays = engine::reference::Rays::new(&camera, (WIDTH, HEIGHT));
    assert_close(&picture, |x, y| {
        let ray = rays.ray(x, y).normalize();
        let view = DVec3::new(-ray.x, ray.y, ray.z);
        let reflectance = DVec3::from(linear(parabolic(view), parabolic(light)));
        DVec3::new(3.0, 2.0, 1.0) * reflectance * light.z / PI
    });
}

/// Turning, scaling and moving scene, camera and lights together changes nothing.
#[test]
fn placement_does_not_matter() {
    let mut scene = quad_scene();
    let light = Vec3::new(0.3, 0.5, 0.8);
    scene.lights = vec![sun(light)];
    scene.ambient = Vec3::splat(0.25);
    let btf = linear_btf();
    let before = shade(&scene, &camera(), (WIDTH, HEIGHT), &see_all(), &[Some(&btf)]);
    let rotation = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -2.0);
    let placement = glam::Affine3A::from_scale_rotation_translation(
        Vec3::splat(3.0),
        rotation,
        Vec3::new(5.0, -7.0, 1.0),
    );
    scene.instances[0].world_from_mesh = placement * scene.instances[0].world_from_mesh;
    scene.lights = vec![sun(rotation * light)];
    let mut moved = camera();
    moved.eye = placement.transform_point3(moved.eye);
    moved.target = placement.transform_point3(moved.target);
    moved.up = rotation * moved.up;
    let after = shade(&scene, &moved, (WIDTH, HEIGHT), &see_all(), &[Some(&btf)]);
    for (before, after) in before.pixels.iter().flatten().zip(after.pixels.iter().flatten()) {
        assert!((before - after).abs() < 2e-5, "{before} {after}");
    }
}

#[test]
fn what_is_not_there_shows_the_background_or_black() {
    let mut scene = quad_scene();
    scene.background = Vec3::new(0.1, 0.2, 0.3);
    scene.lights = vec![sun(Vec3::Z)];
    let btf = linear_btf();
    let nothing = [[0, 0], [2, 0], [u32::MAX, 0], [1, 2], [1, u32::MAX]];
    let picture = shade(&scene, &camera(), (3, 2), &nothing, &[Some(&btf)]);
    assert_eq!(
        picture.pixels,
        vec![[0.1, 0.2, 0.3]; 6],
        "the sixth pixel is missing in the visibility"
    );
    let unknown = shade(&scene, &camera(), (1, 1), &[[1, 0]], &[]);
    assert_eq!(unknown.pixels, [[0.0; 3]]);
    let nowhere = shade(&scene, &camera(), (0, 5), &[], &[Some(&btf)]);
    assert!(nowhere.pixels.is_empty());
}

#[test]
fn degenerate_triangles_and_frames_stay_finite() {
    let mut scene = quad_scene();
    scene.lights = vec![sun(Vec3::Z)];
    scene.ambient = Vec3::ONE;
    let mesh = &mut scene.meshes[0];
    mesh.normals.fill(Vec3::ZERO);
    mesh.tangents.fill(glam::Vec4::ZERO);
    mesh.uvs.fill(Vec2::ZERO);
    let btf = linear_btf();
    let see = |scene: &scenes::Scene| shade(scene, &camera(), (WIDTH, HEIGHT), &see_all(), &[Some(&btf)]);
    assert!(
        see(&scene)
            .pixels
            .iter()
            .flatten()
            .all(|value| value.is_finite() && *value > 0.0)
    );
    for positions in [vec![Vec3::ZERO; 4], vec![Vec3::X, Vec3::Y, Vec3::X, Vec3::Y]] {
        scene.meshes[0].positions = positions;
        assert!(see(&scene).pixels.iter().flatten().all(|value| value.is_finite()));
    }
}
