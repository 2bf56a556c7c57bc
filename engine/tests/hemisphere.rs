//! Maps of the light hemisphere against the triangulation that they stand for.

mod directions;

use directions::{bonn81, direction, rings, ubo151};
use engine::angular::{
    Hemisphere, ROW_TEXELS, Triangulation, map_side, map_texels, parabolic_from_direction,
};
use half::f16;
use tileset::Direction;

/// Directions over the upper hemisphere.
fn hemisphere(count: u32) -> impl Iterator<Item = [f64; 3]> {
    (0..count).map(move |i| {
        let z = 1.0 - (f64::from(i) + 0.5) / f64::from(count);
        let (sin, cos) = (f64::from(i) * 2.399963229728653).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        [radius * cos, radius * sin, z]
    })
}

/// Diffuse with a lobe of this width around the mirror direction of a view at 30°.
fn lobe(light: [f64; 3], exponent: f64) -> f64 {
    let half = [light[0] + 0.5, light[1], light[2] + 0.75f64.sqrt()];
    let length = half.iter().map(|x| x * x).sum::<f64>().sqrt();
    0.5 + 0.2 * light[1] + (half[2] / length).powf(exponent)
}

/// Radiance of a light, by the triangulation.
fn exact(triangulation: &Triangulation, samples: &[f64], cosine: bool, light: [f64; 3]) -> f64 {
    let taps = triangulation.taps(light);
    let value = |(index, weight): (u32, f64)| weight * samples[index as usize];
    let reflectance: f64 = taps.indices.into_iter().zip(taps.weights).map(value).sum();
    reflectance
        * if cosine {
            taps.horizon_scale(light[2])
        } else {
            light[2]
        }
}

/// Samples of the lobe.
fn samples(set: &[Direction], cosine: bool, exponent: f64) -> Vec<f64> {
    let sample = |direction: &Direction| {
        let light = direction.to_vector();
        lobe(light, exponent) * if cosine { light[2] } else { 1.0 }
    };
    set.iter().map(sample).collect()
}

/// Relative root mean square error of radiance over the hemisphere.
fn error(set: &[Direction], cosine: bool, exponent: f64, side: u32) -> f64 {
    let triangulation = Triangulation::new(set);
    let maps = Hemisphere::with_side(&triangulation, cosine, side);
    let samples = samples(set, cosine, exponent);
    let (mut difference, mut square) = (0.0, 0.0);
    for light in hemisphere(20_000) {
        let exact = exact(&triangulation, &samples, cosine, light);
        let ours = maps.interpolate(parabolic_from_direction(light), &samples) * light[2];
        difference += (ours - exact).powi(2);
        square += exact * exact;
    }
    (difference / square).sqrt()
}

/// The same for what the triangulation itself errs between the samples.
fn own_error(set: &[Direction], cosine: bool, exponent: f64) -> f64 {
    let triangulation = Triangulation::new(set);
    let samples = samples(set, cosine, exponent);
    let (mut difference, mut square) = (0.0, 0.0);
    for light in hemisphere(20_000).filter(|light| light[2] > 0.26) {
        let truth = lobe(light, exponent) * light[2];
        difference += (exact(&triangulation, &samples, cosine, light) - truth).powi(2);
        square += truth * truth;
    }
    (difference / square).sqrt()
}

#[test]
fn resampling_costs_little_and_less_the_larger_the_maps() {
    for (name, set) in [("81", bonn81()), ("151", ubo151())] {
        for (exponent, most, share) in [(1.0, 0.005, 0.6), (20.0, 0.02, 0.6), (200.0, 0.05, 0.8)] {
            for cosine in [false, true] {
                let own = own_error(&set, cosine, exponent);
                let at = |side| error(&set, cosine, exponent, side);
                let errors = [8, 16, 32, 64, 128].map(at);
                let chosen = at(map_side(set.len()));
                println!(
                    "{name} lights, cosine {cosine}, lobe {exponent}: sampled {own:.4}, {errors:.4?}, at {} {chosen:.4}",
                    map_side(set.len())
                );
                assert!(chosen < most, "{name} {cosine} {exponent}: {chosen}");
                assert!(
                    errors.windows(2).all(|pair| pair[1] < 0.75 * pair[0]),
                    "{name} {cosine} {exponent}: {errors:?}"
                );
                // Errors add as squares: with a highlight the sum grows by a sixth, with a narrow one by a quarter.
                assert!(
                    chosen < share * own,
                    "{name} {cosine} {exponent}: {chosen} of {own}"
                );
            }
        }
    }
}

#[test]
fn sides_follow_the_lights_and_maps_fill_rows() {
    assert_eq!([0, 1, 2, 30].map(map_side)[..3], [8; 3]);
    assert_eq!(map_side(usize::MAX >> 20), ROW_TEXELS);
    for lights in 0..5000 {
        let side = map_side(lights);
        assert!((8..=ROW_TEXELS).contains(&side) && map_side(lights + 1) >= side);
        // No larger map has as much room for others beside it.
        assert!(ROW_TEXELS / (side + 1) < ROW_TEXELS / side);
        for views in [1, 2, 81, 151, 4096] {
            let across = u64::from(ROW_TEXELS / side);
            let texels = map_texels(views, side);
            assert!(texels.is_multiple_of(u64::from(ROW_TEXELS)));
            let maps = texels / u64::from(ROW_TEXELS) / u64::from(side) * across;
            assert!(maps >= views as u64 * 3 && maps < (views as u64 + across) * 3);
        }
    }
}

/// The maps hold what [`Hemisphere::interpolate`] reads, for every view, colour and component, and the ambient light.
#[test]
fn maps_lie_where_shaders_look() {
    for (set, cosine) in [(bonn81(), false), (vec![direction(40.0, 30.0)], true)] {
        let triangulation = Triangulation::new(&set);
        let hemisphere = Hemisphere::new(&triangulation, cosine);
        let (side, views) = (hemisphere.side() as usize, 40);
        let quads = (set.len() + 1) * 3;
        let value = |view: usize, light: usize, rgb: usize, c: usize| {
            f16::from_f64(((view * 7 + light * 5 + rgb * 3 + c) % 11) as f64 / 8.0 - 0.5)
        };
        let column: Vec<[f16; 4]> = (0..views * quads)
            .map(|at| [0, 1, 2, 3].map(|c| value(at / quads, at % quads / 3, at % 3, c)))
            .collect();
        let maps = hemisphere.maps(&column);
        assert_eq!(maps.len() as u64, map_texels(views, hemisphere.side()));
        let across = ROW_TEXELS as usize / side;
        for (view, rgb, c) in [
            (0, 0, 0),
            (1, 2, 3),
            (views - 1, 1, 2),
            (across - 1, 2, 1),
            (across % views, 0, 3),
        ] {
            let corner = (view / across * 3 + rgb) * side * ROW_TEXELS as usize + view % across * side;
            assert_eq!(maps[corner][c], value(view, set.len(), rgb, c));
            let samples: Vec<f64> = (0..set.len())
                .map(|light| value(view, light, rgb, c).to_f64())
                .collect();
            for (x, y) in [
                (side / 2, side / 2),
                (side - 1, side / 3),
                (1, side - 1),
                (side - 1, side - 1),
            ] {
                // The centre of a texel, from the way back: a texel is one over the radius wide.
                let radius = (side as f64 - 1.0) / 2.0 - 1.0 / 64.0;
                let point = [x, y].map(|at| (at as f64 + 0.5 - side as f64 / 2.0) / radius);
                let wanted = hemisphere.interpolate(point, &samples);
                let found = maps[corner + y * ROW_TEXELS as usize + x][c].to_f64();
                assert!(
                    (found - wanted).abs() < 2e-3 * wanted.abs().max(1.0),
                    "{view} {rgb} {c} {x} {y}: {found} {wanted}"
                );
            }
        }
    }
}

/// Whatever was sampled where: values are finite, and without the cosine constant beyond the hull.
#[test]
fn odd_sets_have_finite_maps() {
    let sets = [
        Vec::new(),
        vec![direction(0.0, 0.0)],
        vec![direction(90.0, 0.0)],
        vec![direction(170.0, 10.0); 3],
        (-5..=5).map(|i| direction(f64::from(i) * 18.0, 33.0)).collect(),
        rings(&[(90.0, 12, 0.0)]),
        rings(&[(100.0, 5, 0.0), (170.0, 5, 20.0), (45.0, 3, 0.0)]),
    ];
    for set in sets {
        let triangulation = Triangulation::new(&set);
        for cosine in [false, true] {
            let hemisphere = Hemisphere::new(&triangulation, cosine);
            let largest = vec![[f16::MAX; 4]; (triangulation.points.len() + 1) * 3];
            let maps = hemisphere.maps(&largest);
            assert!(maps.iter().flatten().all(|value| value.is_finite()));
            let samples = vec![1.0; triangulation.points.len()];
            for light in self::hemisphere(500) {
                let ours = hemisphere.interpolate(parabolic_from_direction(light), &samples) * light[2];
                let exact = exact(&triangulation, &samples, cosine, light);
                assert!(ours.is_finite() && ours >= 0.0);
                assert!(
                    cosine || (ours - exact).abs() < 1e-6,
                    "{set:?} {light:?}: {ours} {exact}"
                );
            }
        }
    }
}
