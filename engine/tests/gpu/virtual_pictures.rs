//! Settled virtual pictures against full residency by an independent path: the f64 reference, which reads the whole decoded
//! archive and knows nothing of pages, slots, tables or borders.
//!
//! What is defined, and tested here, where a mesh or a light is out of the ordinary (`odd` tests what is not a number):
//!
//! - A view or a light outside the hull of the sampled directions takes the closest point of the hull; where the BTF
//!   includes the light's cosine, it is scaled from the hull's angle to the light's. Light from below the surface adds nothing.
//! - A triangle seen from behind is the other side of a sheet of the same material: normal and bitangent turn to the viewer.
//! - A triangle whose texture coordinates are all the same shows that one place at mip 0.
//! - Triangles without area, in space or on the screen, cover no pixel and show nothing.

use engine::gpu::page_cache::SLOT_BYTES;
use engine::metrics::{Comparison, compare};
use glam::{Vec2, Vec3};
use scenes::{Instance, Light, Mesh};

use super::*;
use crate::{
    material::{weave, white},
    pictures::{ambient_square, assert_shows, slanted},
    scene::{btf, square},
};

/// A square with a material, under ambient light and two lights.
fn lit_square(repeats: f32) -> Scene {
    Scene {
        lights: vec![
            Light::Directional {
                to_light: Vec3::new(0.5, 0.8, 0.3).normalize(),
                irradiance: Vec3::new(2.0, 1.9, 1.7),
            },
            Light::Point {
                position: Vec3::new(-0.5, 1.0, 0.5),
                intensity: Vec3::new(0.5, 0.8, 1.0),
            },
        ],
        ambient: Vec3::splat(0.2),
        ..ambient_square(repeats)
    }
}

/// Looks at a place of the square from a distance, `degrees` above its plane.
fn above(target: [f32; 2], distance: f32, degrees: f32) -> Camera {
    let target = Vec3::new(target[0], 0.0, target[1]);
    let (sin, cos) = degrees.to_radians().sin_cos();
    Camera {
        eye: target + Vec3::new(0.2 * cos, sin, 0.98 * cos) * distance,
        target,
        up: Vec3::Y,
        fov_y: 0.7,
        near: 1e-3,
    }
}

/// Steps in texels of mip 0 by pixels that see the square: the longer one, and its ratio to the shorter.
fn steps(camera: &Camera, size: (u32, u32), texels: Vec2) -> Vec<(f32, f32)> {
    let uv = |x: f32, y: f32| {
        let ray = camera.ray(x, y, size);
        let point = camera.eye - ray * (camera.eye.y / ray.y);
        (ray.y < 0.0 && point.x.abs() <= 1.0 && point.z.abs() <= 1.0)
            .then(|| Vec2::new(point.x, point.z) * 0.5)
    };
    let pixels = (0..size.0 * size.1).map(|at| ((at % size.0) as f32, (at / size.0) as f32));
    pixels
        .filter_map(|(x, y)| {
            let (here, right, below) = (uv(x, y)?, uv(x + 1.0, y)?, uv(x, y + 1.0)?);
            let (a, b) = (
                ((right - here) * texels).length(),
                ((below - here) * texels).length(),
            );
            Some((a.max(b), a.max(b) / a.min(b)))
        })
        .collect()
}

fn share<T>(of: &[T], what: impl Fn(&T) -> bool) -> f64 {
    of.iter().filter(|one| what(one)).count() as f64 / of.len().max(1) as f64
}

/// Settled pictures of an engine, all of which must fit, against the reference.
struct Compared<'a> {
    engine: Engine,
    scene: &'a Scene,
    archive: Vec<u8>,
}

impl<'a> Compared<'a> {
    fn new(recipe: &Recipe, scene: &'a Scene, size: (u32, u32)) -> Self {
        let archive = recipe.build();
        Self {
            engine: engine(scene, &[("weave", &archive)], options(size)),
            scene,
            archive,
        }
    }

    fn picture(&mut self, name: &str, camera: &Camera) -> Comparison {
        let frames = settle(&mut self.engine, camera);
        let last = frames.last().unwrap();
        assert_eq!(last.predicted_rms, 0.0, "{name}: not everything fits");
        save(&self.engine, &format!("virtual {name}.png"));
        let picture = self.engine.picture().unwrap();
        let all = reference(&self.engine, self.scene, camera, &[("weave", &self.archive)]);
        let seen = self.engine.visibility().unwrap();
        let covered: Vec<bool> = seen.iter().map(|ids| ids[0] != 0).collect();
        let compared = compare(&picture, &all, Some(&covered), 0.0).unwrap();
        println!(
            "{name}: PSNR {:.1} dB, relative RMSE {:.1e}, {} pixels, {} pages",
            compared.psnr_db, compared.relative_rmse, compared.pixels, last.pages_resident
        );
        compared
    }
}

fn assert_equal(name: &str, compared: &Comparison) {
    assert!(
        compared.psnr_db >= 60.0 && compared.relative_rmse <= 1e-3 && compared.pixels > 500,
        "{name}: {compared:?}"
    );
}

#[test]
fn virtual_pictures_are_those_of_full_residency_under_every_filter() {
    let size = (96, 64);
    let square = Recipe {
        groups: 2,
        ..Default::default()
    };
    let odd = Recipe {
        width: 77,
        height: 200,
        ..square
    };
    let clamped = Recipe { wrap: false, ..odd };
    type Steps<'a> = &'a dyn Fn(&[(f32, f32)]) -> f64;
    let magnified: Steps<'_> = &|steps| share(steps, |(step, _)| *step < 1.0);
    let minified: Steps<'_> = &|steps| share(steps, |(step, _)| *step > 2.0);
    let blended = |step: f32| step > 1.0 && (0.1..0.9).contains(&step.log2().fract());
    let between: Steps<'_> = &|steps| share(steps, |(step, _)| blended(*step));
    let coarsest: Steps<'_> = &|steps| share(steps, |(step, _)| *step > 256.0);
    let anisotropic: Steps<'_> = &|steps| share(steps, |(_, ratio)| *ratio > 6.0);
    let any: Steps<'_> = &|steps| share(steps, |_| true);
    // Place of the square, distance, degrees above it, and what at least half of the footprints must be.
    let square_views = [
        ("magnified", [0.1, 0.2], 0.25, 60.0, magnified),
        ("page corner", [-0.333, 0.0], 0.12, 70.0, magnified),
        ("seam that wraps", [0.333, 0.333], 0.12, 70.0, magnified),
        ("between mips", [0.0, 0.0], 2.0, 35.0, between),
        ("minified", [0.0, 0.0], 4.0, 50.0, minified),
        ("anisotropic", [0.0, 0.5], 1.0, 6.0, anisotropic),
    ];
    let odd_views = [
        ("odd size", [0.1, 0.1], 1.5, 40.0, any),
        ("odd seam", [0.333, 0.333], 0.2, 60.0, magnified),
        ("odd, anisotropic, minified", [0.0, 0.0], 1.4, 8.0, anisotropic),
    ];
    // The outer borders are the codec's; this codec quantizes them like any texel.
    let clamped_views = [
        ("clamped border", [0.33, 0.33], 0.3, 60.0, magnified),
        ("clamped, minified", [0.0, 0.0], 2.5, 20.0, minified),
    ];
    let coarse_views = [("1 × 1 mip", [0.0, 0.0], 2.0, 50.0, coarsest)];
    type Views<'a> = &'a [(&'a str, [f32; 2], f32, f32, Steps<'a>)];
    let all: [(Recipe, f32, Views<'_>); 4] = [
        (square, 1.5, &square_views),
        (odd, 1.5, &odd_views),
        (clamped, 1.5, &clamped_views),
        (odd, 3000.0, &coarse_views),
    ];
    for (recipe, repeats, views) in all {
        let scene = lit_square(repeats);
        let mut drawn = Compared::new(&recipe, &scene, size);
        let texels = Vec2::new(recipe.width as f32, recipe.height as f32) * repeats;
        for &(name, place, distance, degrees, of_footprints) in views {
            let camera = above(place, distance, degrees);
            let part = of_footprints(&steps(&camera, size, texels));
            assert!(part > 0.5, "{name}: only {part} of the footprints");
            assert_equal(name, &drawn.picture(name, &camera));
        }
    }
}

#[test]
fn a_page_that_is_missing_is_noticed() {
    // The same comparison must fail where not everything fits.
    let archive = Recipe {
        groups: 2,
        ..Default::default()
    }
    .build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = (lit_square(1.0), above([0.0, 0.0], 1.2, 60.0));
    let few = Options {
        budgets: Budgets {
            page_cache_bytes: 6 * SLOT_BYTES,
            ..options((96, 64)).budgets
        },
        ..options((96, 64))
    };
    let mut engine = engine(&scene, archives, few);
    settle(&mut engine, &camera);
    let all = reference(&engine, &scene, &camera, archives);
    let compared = compare(&engine.picture().unwrap(), &all, None, 0.0).unwrap();
    assert!(
        compared.psnr_db < 60.0 && compared.relative_rmse > 5e-3,
        "{compared:?}"
    );
}

#[test]
fn beyond_the_sampled_cone_the_closest_direction_stands_in() {
    // Directions are sampled up to 75 degrees from the normal; here the view is at 85, and lights are at 80 and 89.9.
    for cosine in [false, true] {
        let recipe = Recipe {
            width: 64,
            height: 64,
            groups: 1,
            cosine,
            ..Default::default()
        };
        let mut scene = lit_square(1.0);
        let grazing = |degrees: f32, side: f32| Light::Directional {
            to_light: Vec3::new(
                side * degrees.to_radians().cos(),
                degrees.to_radians().sin(),
                0.1 * side,
            )
            .normalize(),
            irradiance: Vec3::splat(3.0),
        };
        scene.lights = vec![grazing(10.0, 1.0), grazing(0.1, -1.0)];
        let camera = above([0.0, 0.3], 1.2, 5.0);
        assert_equal(
            "beyond the cone",
            &Compared::new(&recipe, &scene, (96, 64)).picture("beyond the cone", &camera),
        );
        // Without ambient light what comes from below the horizon leaves the material black.
        scene.ambient = Vec3::ZERO;
        scene.lights = vec![grazing(-0.1, 1.0), grazing(-60.0, 1.0)];
        let archive = recipe.build();
        let mut engine = engine(&scene, &[("weave", &archive)], options((48, 32)));
        settle(&mut engine, &camera);
        let picture = engine.picture().unwrap();
        let seen = engine.visibility().unwrap();
        let mut covered = seen.iter().zip(&picture.pixels).filter(|(ids, _)| ids[0] != 0);
        assert!(covered.clone().count() > 100 && covered.all(|(_, pixel)| *pixel == [0.0; 3]));
    }
}

#[test]
fn both_sides_of_a_sheet_are_the_same_material() {
    let recipe = Recipe {
        width: 128,
        height: 64,
        groups: 1,
        ..Default::default()
    };
    let scene = lit_square(1.0);
    let front = above([0.1, 0.2], 1.5, 50.0);
    // The scene mirrored at the plane of the square: eye and lights below it.
    let below = |v: Vec3| Vec3::new(v.x, -v.y, v.z);
    let mirrored = Scene {
        lights: scene
            .lights
            .iter()
            .map(|light| match *light {
                Light::Directional { to_light, irradiance } => Light::Directional {
                    to_light: below(to_light),
                    irradiance,
                },
                Light::Point { position, intensity } => Light::Point {
                    position: below(position),
                    intensity,
                },
            })
            .collect(),
        ..scene.clone()
    };
    let behind = Camera {
        eye: below(front.eye),
        ..front
    };
    let name = "from behind";
    assert_equal(
        name,
        &Compared::new(&recipe, &mirrored, (96, 64)).picture(name, &behind),
    );
    // Lights above the sheet do not shine through it.
    let mut dark = scene;
    dark.ambient = Vec3::ZERO;
    let archive = recipe.build();
    let mut engine = engine(&dark, &[("weave", &archive)], options((48, 32)));
    settle(&mut engine, &behind);
    let seen = engine.visibility().unwrap();
    let picture = engine.picture().unwrap();
    let mut covered = seen.iter().zip(&picture.pixels).filter(|(ids, _)| ids[0] != 0);
    assert!(covered.clone().count() > 100 && covered.all(|(_, pixel)| *pixel == [0.0; 3]));
}

#[test]
fn one_texture_coordinate_is_one_place_at_the_finest_mip() {
    let recipe = Recipe {
        groups: 1,
        abrdf: white,
        ..Default::default()
    };
    let archive = recipe.build();
    // The centre of a texel, so that filtering changes nothing.
    let place = Vec2::new(100.5, 37.5) / 256.0;
    let mut scene = ambient_square(1.0);
    scene.meshes[0].uvs = vec![place; 4];
    let camera = slanted(1.5);
    let mut engine = engine(&scene, &[("weave", &archive)], options((64, 48)));
    settle(&mut engine, &camera);
    let expected = weave(0, place.x.into(), place.y.into());
    assert_shows(&engine, &camera, 5e-3, |_, _| expected);
}

#[test]
fn triangles_without_area_show_nothing() {
    let recipe = Recipe {
        width: 64,
        height: 64,
        groups: 1,
        ..Default::default()
    };
    let archive = recipe.build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let plain = lit_square(1.0);
    let camera = above([0.0, 0.0], 1.8, 50.0);
    // Above the square: points, lines, and a triangle that the camera sees exactly edge on.
    let corners = |positions: [Vec3; 3]| Mesh {
        positions: positions.to_vec(),
        indices: vec![0, 1, 2],
        normals: vec![Vec3::Y; 3],
        tangents: vec![glam::Vec4::new(1.0, 0.0, 0.0, 1.0); 3],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::Y],
        material: 0,
    };
    let (a, b) = (Vec3::new(-0.5, 0.1, 0.2), Vec3::new(0.5, 0.2, -0.3));
    let mut scene = plain.clone();
    scene.meshes.extend([
        corners([a; 3]),
        corners([a, b, b]),
        corners([a, b, a.lerp(b, 0.5)]),
        corners([a, b, camera.eye.lerp(a, 0.5)]),
        corners([a, b, camera.eye]),
        Mesh {
            positions: vec![Vec3::ZERO; 4],
            ..square(0)
        },
    ]);
    scene.materials.push(btf("weave", 1.0));
    scene.instances = (0..scene.meshes.len())
        .map(|mesh| Instance {
            mesh,
            world_from_mesh: Default::default(),
        })
        .collect();
    let shot = |scene: &Scene| {
        let mut engine = engine(scene, archives, options((96, 64)));
        settle(&mut engine, &camera);
        (engine.picture().unwrap(), engine.visibility().unwrap())
    };
    let ((without, _), (with, seen)) = (shot(&plain), shot(&scene));
    assert!(with.pixels.iter().flatten().all(|value| value.is_finite()));
    let of_odd: Vec<usize> = (0..seen.len()).filter(|&at| seen[at][0] > 1).collect();
    // Edge on only rounding decides whether a sample is inside; points and lines never are.
    assert!(
        of_odd.iter().all(|&at| (5..=6).contains(&seen[at][0])),
        "{of_odd:?}"
    );
    assert!(of_odd.len() <= 96);
    let same = (0..seen.len()).filter(|&at| seen[at][0] <= 1);
    assert!(same.clone().count() > 5000);
    for at in same {
        assert_eq!(with.pixels[at], without.pixels[at], "pixel {at}");
    }
}
