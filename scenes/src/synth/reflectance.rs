//! What one point of a surface reflects towards one view, for all lights at once.
//!
//! Diffuse: the term that leaves to the diffuse lobe what the glossy one does not reflect (Ashikhmin, Shirley, An
//! Anisotropic Phong BRDF Model, 2000, equation 5). Glossy: anisotropic GGX (Walter et al., Microfacet Models for
//! Refraction through Rough Surfaces, 2007; Burley, Physically Based Shading at Disney, 2012), with the
//! shadowing-masking approximation without roots of Hammon, PBR Diffuse Lighting for GGX+Smith Microsurfaces,
//! 2017, and Schlick's Fresnel term. Written with the unnormalized half vector h = ωi + ωo: |h|² = 2 + 2 ωi·ωo does not
//! depend on the surface, so that one division per light is all that is left, and no root.

use glam::Vec3;

/// Lights are handled in groups of this many: the bits of one byte of the mask of visible lights.
pub(super) const LANES: usize = 8;
/// Lowest cosine between normal and view: cells at silhouettes may face away from who sees their edge.
const MIN_VIEW_COSINE: f32 = 0.06;
/// What a stored unit of bounced light means: 16 bits span [0, 1].
pub(super) const BOUNCE_UNIT: f32 = 1.0 / 65535.0;

/// What a surface is made of at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Attributes {
    /// Unit normal with the finest relief.
    pub(super) normal: Vec3,
    /// Direction along fibres or scratches; any length, need not be perpendicular to the normal.
    pub(super) tangent: Vec3,
    /// Diffuse albedo, linear RGB.
    pub(super) diffuse: Vec3,
    /// Reflectance of the glossy lobe at normal incidence, linear RGB.
    pub(super) specular: Vec3,
    /// GGX's α along and across the tangent.
    pub(super) roughness: [f32; 2],
}

/// [`Attributes`] made ready for [`shade`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub(super) struct Point {
    normal: [f32; 3],
    /// Tangent over its α, so that its dot product with h is one of the ellipsoid's coordinates.
    tangent: [f32; 3],
    /// Inverse α across the tangent.
    inverse_across: f32,
    /// 1 / (2 αx αy).
    scale: f32,
    roughness: f32,
    diffuse: [f32; 3],
    specular: [f32; 3],
    /// Index of the patch whose bounced light this point gets.
    pub(super) patch: u32,
}

impl Attributes {
    /// Brings everything into range: unit vectors, albedos whose sum is at most one.
    pub(super) fn prepare(self) -> Point {
        let normal = self.normal.try_normalize().unwrap_or(Vec3::Z);
        let tangent = (self.tangent - normal * normal.dot(self.tangent))
            .try_normalize()
            .unwrap_or_else(|| normal.any_orthonormal_vector());
        let [along, across] = self.roughness.map(|a| a.clamp(0.02, 1.0));
        let specular = self.specular.clamp(Vec3::ZERO, Vec3::splat(0.98));
        let diffuse = self.diffuse.clamp(Vec3::ZERO, Vec3::splat(0.98)) * (Vec3::ONE - specular);
        Point {
            normal: normal.into(),
            tangent: (tangent / along).into(),
            inverse_across: 1.0 / across,
            scale: 0.5 / (along * across),
            roughness: (along * across).sqrt(),
            diffuse: diffuse.into(),
            specular: specular.into(),
            patch: u32::MAX,
        }
    }
}

/// The light directions, one array per coordinate, padded with zeros to whole groups.
pub(super) struct Lights {
    /// Number of lights.
    pub(super) count: usize,
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

impl Lights {
    pub(super) fn new(directions: &[Vec3]) -> Lights {
        let padded = directions.len().next_multiple_of(LANES);
        let axis = |f: fn(&Vec3) -> f32| {
            let mut values: Vec<f32> = directions.iter().map(f).collect();
            values.resize(padded, 0.0);
            values
        };
        Lights {
            count: directions.len(),
            x: axis(|d| d.x),
            y: axis(|d| d.y),
            z: axis(|d| d.z),
        }
    }

    /// The first `count` of these lights, or all if there are no more.
    pub(super) fn first(&self, count: usize) -> Lights {
        let count = count.min(self.count);
        Lights::new(&(0..count).map(|n| self.direction(n)).collect::<Vec<_>>())
    }

    /// Number of lights with the padding.
    pub(super) fn padded(&self) -> usize {
        self.x.len()
    }

    /// Bytes in a mask of lights.
    pub(super) fn mask_bytes(&self) -> usize {
        self.padded() / LANES
    }

    /// Light `index`, not in the padding.
    pub(super) fn direction(&self, index: usize) -> Vec3 {
        Vec3::new(self.x[index], self.y[index], self.z[index])
    }
}

/// What depends on view and light only, in the lights' order.
pub(super) struct View {
    pub(super) direction: Vec3,
    /// |h|⁴.
    half_length_4: Vec<f32>,
    /// (1 − ωi·h/|h|)⁵.
    fresnel: Vec<f32>,
}

impl View {
    pub(super) fn new(direction: Vec3, lights: &Lights) -> View {
        let cosine = |l: usize| {
            (lights.x[l] * direction.x + lights.y[l] * direction.y + lights.z[l] * direction.z)
                .clamp(-1.0, 1.0)
        };
        let squared = |l: usize| 2.0 + 2.0 * cosine(l);
        View {
            direction,
            half_length_4: (0..lights.padded()).map(|l| squared(l) * squared(l)).collect(),
            fresnel: (0..lights.padded())
                .map(|l| (1.0 - 0.5 * squared(l).sqrt()).max(0.0).powi(5))
                .collect(),
        }
    }
}

/// For each byte the eight numbers, 0 or 1, of its bits.
static BITS: [[f32; LANES]; 256] = {
    let mut table = [[0.0; LANES]; 256];
    let mut n = 0;
    while n < 256 {
        let mut bit = 0;
        while bit < LANES {
            table[n][bit] = (n >> bit & 1) as f32;
            bit += 1;
        }
        n += 1;
    }
    table
};

/// Adds to `sum`, `[rgb][light]` with padded lights, the radiance factors (cosine included) of `point` towards
/// `view`. `lit` has a bit for each visible light; `bounced` is the light that arrives by way of other
/// surfaces, `[rgb][light]` of these lights or more, in units of [`BOUNCE_UNIT`], or empty. `scratch` has room for the padded lights, four
/// times.
#[inline(always)]
pub(super) fn shade(
    point: &Point,
    lit: &[u8],
    bounced: &[u16],
    view: &View,
    lights: &Lights,
    scratch: &mut [f32],
    sum: &mut [f32],
) {
    let padded = lights.padded();
    let (visible, rest) = scratch.split_at_mut(padded);
    let (diffuse, rest) = rest.split_at_mut(padded);
    let (glossy, rim) = rest.split_at_mut(padded);
    for (visible, byte) in visible.chunks_exact_mut(LANES).zip(lit) {
        visible.copy_from_slice(&BITS[usize::from(*byte)]);
    }
    lobes(point, view, lights, visible, diffuse, glossy, &mut rim[..padded]);
    let edge = point.specular.map(|s| (1.0 - point.roughness - s).max(0.0));
    for (channel, sum) in sum.chunks_exact_mut(padded).enumerate() {
        let (albedo, specular, edge) = (point.diffuse[channel], point.specular[channel], edge[channel]);
        combine(sum, [diffuse, glossy, &rim[..padded]], [albedo, specular, edge]);
        if !bounced.is_empty() {
            let bounced = &bounced[channel * (bounced.len() / 3)..][..padded];
            add_bounced(sum, bounced, albedo * BOUNCE_UNIT);
        }
    }
}

/// The two lobes without their colours, per light: diffuse, glossy, and glossy times Schlick's term. The outputs are
/// arguments of their own so that the compiler knows them apart and uses wide registers.
#[inline(always)]
fn lobes(
    point: &Point,
    view: &View,
    lights: &Lights,
    visible: &[f32],
    diffuse: &mut [f32],
    glossy: &mut [f32],
    rim: &mut [f32],
) {
    let (n, t) = (Vec3::from(point.normal), Vec3::from(point.tangent));
    // The bitangent over its α; the tangent's length is 1/α along.
    let b = n.cross(t) * (point.inverse_across / t.length().max(1e-9));
    let v = view.direction;
    let (nv, tv, bv) = (n.dot(v).max(MIN_VIEW_COSINE), t.dot(v), b.dot(v));
    let diffuse_view = 28.0 / 23.0 * (1.0 - fifth_power(1.0 - 0.5 * nv));
    let mask_nv = point.roughness * nv;
    let mask_nl = 2.0 * nv * (1.0 - point.roughness) + point.roughness;
    let scale = point.scale;

    let count = visible.len();
    let (x, y, z) = (&lights.x[..count], &lights.y[..count], &lights.z[..count]);
    let (half_4, fresnel) = (&view.half_length_4[..count], &view.fresnel[..count]);
    let (diffuse, glossy, rim) = (&mut diffuse[..count], &mut glossy[..count], &mut rim[..count]);
    for l in 0..count {
        let nl = (n.x * x[l] + n.y * y[l] + n.z * z[l]).max(0.0);
        let nh = nl + nv;
        let th = t.x * x[l] + t.y * y[l] + t.z * z[l] + tv;
        let bh = b.x * x[l] + b.y * y[l] + b.z * z[l] + bv;
        let q = th * th + bh * bh + nh * nh;
        let light = visible[l] * nl;
        let lobe = light * half_4[l] * scale / (q * q * (mask_nl * nl + mask_nv));
        diffuse[l] = light * diffuse_view * (1.0 - fifth_power(1.0 - 0.5 * nl));
        glossy[l] = lobe;
        rim[l] = lobe * fresnel[l];
    }
}

#[inline(always)]
fn combine(sum: &mut [f32], lobes: [&[f32]; 3], weights: [f32; 3]) {
    let count = sum.len();
    let [a, b, c] = lobes.map(|lobe| &lobe[..count]);
    for l in 0..count {
        sum[l] += weights[0] * a[l] + weights[1] * b[l] + weights[2] * c[l];
    }
}

#[inline(always)]
fn add_bounced(sum: &mut [f32], bounced: &[u16], albedo: f32) {
    for (sum, bounced) in sum.iter_mut().zip(bounced) {
        *sum += albedo * f32::from(*bounced);
    }
}

#[inline(always)]
fn fifth_power(x: f32) -> f32 {
    let square = x * x;
    square * square * x
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attributes(diffuse: f32, specular: f32, roughness: [f32; 2]) -> Attributes {
        Attributes {
            normal: Vec3::Z,
            tangent: Vec3::X,
            diffuse: Vec3::splat(diffuse),
            specular: Vec3::splat(specular),
            roughness,
        }
    }

    fn direction(theta: f32, phi: f32) -> Vec3 {
        Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    }

    /// Reflectance for one light, integrated over the views; the mean of the hemisphere's radiance factors
    /// weighted by the view's cosine, over the light's cosine.
    fn albedo(point: &Point, light: Vec3) -> f32 {
        let lights = Lights::new(&[light]);
        let (mut total, steps) = (0.0, 200);
        for i in 0..steps {
            for j in 0..2 * steps {
                let theta = (i as f32 + 0.5) / steps as f32 * std::f32::consts::FRAC_PI_2;
                let phi = (j as f32 + 0.5) / (2 * steps) as f32 * std::f32::consts::TAU;
                let mut sum = [0.0; 24];
                shade(
                    point,
                    &[1],
                    &[],
                    &View::new(direction(theta, phi), &lights),
                    &lights,
                    &mut [0.0; 32],
                    &mut sum,
                );
                let solid_angle = theta.sin() * std::f32::consts::FRAC_PI_2 / steps as f32
                    * std::f32::consts::PI
                    / steps as f32;
                total += sum[0] * theta.cos() * solid_angle / std::f32::consts::PI;
            }
        }
        total / light.z
    }

    #[test]
    fn never_reflects_more_than_arrives() {
        for (diffuse, specular) in [(1.0, 0.0), (0.0, 1.0), (1.0, 0.04), (1.0, 0.5)] {
            for roughness in [[0.15, 0.15], [0.5, 0.5], [1.0, 1.0], [0.2, 0.6]] {
                for theta in [0.0, 0.5, 1.0, 1.3] {
                    let value = albedo(
                        &attributes(diffuse, specular, roughness).prepare(),
                        direction(theta, 0.3),
                    );
                    assert!(
                        value < 1.06,
                        "{diffuse} {specular} {roughness:?} {theta}: {value}"
                    );
                    assert!(value > 0.2, "{diffuse} {specular} {roughness:?} {theta}: {value}");
                }
            }
        }
    }

    #[test]
    fn reciprocal_without_the_cosine() {
        let point = attributes(0.4, 0.3, [0.3, 0.5]).prepare();
        let (a, b) = (direction(0.4, 0.2), direction(1.0, 2.0));
        let towards = |light: Vec3, view: Vec3| {
            let lights = Lights::new(&[light]);
            let mut sum = [0.0; 24];
            shade(
                &point,
                &[1],
                &[],
                &View::new(view, &lights),
                &lights,
                &mut [0.0; 32],
                &mut sum,
            );
            sum[0] / light.z
        };
        assert!((towards(a, b) - towards(b, a)).abs() < 1e-5);
    }

    #[test]
    fn masked_lights_and_the_padding_give_nothing() {
        let point = attributes(0.4, 0.3, [0.3, 0.5]).prepare();
        let lights = Lights::new(&[Vec3::Z, direction(0.5, 1.0)]);
        let mut sum = [0.0; 24];
        shade(
            &point,
            &[0b10],
            &[],
            &View::new(Vec3::Z, &lights),
            &lights,
            &mut [0.0; 32],
            &mut sum,
        );
        assert_eq!(sum[0], 0.0);
        assert!(sum[1] > 0.0);
        assert!(sum[2..8].iter().all(|v| *v == 0.0));
    }

    #[test]
    fn bounced_light_is_diffuse() {
        let point = attributes(0.5, 0.0, [0.3, 0.5]).prepare();
        let lights = Lights::new(&[Vec3::Z]);
        let mut sum = [0.0; 24];
        shade(
            &point,
            &[0],
            &[65535; 24],
            &View::new(Vec3::Z, &lights),
            &lights,
            &mut [0.0; 32],
            &mut sum,
        );
        assert!((sum[0] - 0.5).abs() < 1e-6);
    }
}
