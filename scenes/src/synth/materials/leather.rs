//! Leather: domed cells between creases, wrinkles over several cells, pores, and a waxed gloss that is worn on the
//! heights.

use super::{Material, bump};
use crate::synth::noise::{Noise, smoothstep};
use crate::synth::random::Random;
use crate::synth::reflectance::Attributes;
use crate::synth::volume::{Row, Solid};
use glam::{Vec2, Vec3, vec2, vec3};
use std::ops::Range;

/// Cells along each side of the patch: full grain, coarse grain, fine grain, and scales.
const CELLS: [[i32; 2]; 4] = [[17, 20], [9, 11], [29, 31], [6, 9]];

/// Creased leather.
pub(super) struct Leather {
    cells_along: [i32; 2],
    /// Height of the cells, in that of full grain.
    swell: f32,
    warp: Noise,
    cells: Noise,
    fine: Noise,
    wrinkles: Noise,
    grain: Noise,
    color: Noise,
}

/// The relief at a point and what shaped it.
struct Relief {
    height: f32,
    /// 0 on a cell, 1 at the bottom of a crease.
    crease: f32,
    pore: f32,
}

impl Leather {
    pub(super) fn new(seed: u64, pattern: u32) -> Leather {
        let cells_along = CELLS[pattern as usize % CELLS.len()];
        let random = &mut Random::new(seed, "leather");
        let mut noise = || Noise::new(random);
        Leather {
            cells_along,
            swell: (CELLS[0][0] as f32 / cells_along[0] as f32).sqrt(),
            warp: noise(),
            cells: noise(),
            fine: noise(),
            wrinkles: noise(),
            grain: noise(),
            color: noise(),
        }
    }

    fn relief(&self, p: Vec2) -> Relief {
        let q = p.extend(0.0);
        let warp = vec2(
            self.warp.fractal(q, [5, 5], 3),
            self.warp.derive(9).fractal(q, [5, 5], 3),
        );
        let [across, up] = self.cells_along;
        let stretched = (p + 0.035 * warp) * vec2(across as f32, up as f32);
        let cell = self.cells.cells(stretched, self.cells_along);
        let fine = self.fine.cells((p + 0.012 * warp) * 41.0, [41, 41]);
        let wrinkle = self.wrinkles.fractal(q, [4, 4], 4);
        let ridge = 1.0
            - (self
                .wrinkles
                .derive(5)
                .fractal(q + vec3(0.0, 0.0, 0.3), [3, 3], 2)
                .abs()
                * 5.0)
                .min(1.0);
        let width = 0.11 + 0.08 * wrinkle;
        let crease = 1.0 - smoothstep(0.0, width.max(0.04), cell.edge);
        let fine_crease = 1.0 - smoothstep(0.0, 0.22, fine.edge);
        let dome = 1.0 - (1.0 - (cell.edge * 1.9).min(1.0)).powi(2);
        let pore_here = (fine.id & 15) < 2;
        let pore = if pore_here {
            1.0 - smoothstep(0.06, 0.22, fine.nearest)
        } else {
            0.0
        };
        let height = self.swell * (0.0062 * dome - 0.0040 * crease) - 0.0016 * fine_crease * (0.3 + dome)
            + 0.010 * wrinkle
            - 0.0065 * ridge * ridge
            - 0.005 * pore
            + 0.0022 * ((cell.id >> 8 & 255) as f32 / 255.0);
        Relief {
            height,
            crease: crease.max(0.8 * ridge * ridge),
            pore,
        }
    }
}

impl Solid for Leather {
    fn extent(&self) -> Range<f32> {
        -0.04..0.035
    }

    fn fill(&self, row: &mut Row<'_>) {
        let y = row.y;
        row.add_below(|x| (self.relief(vec2(x, y)).height.clamp(-0.038, 0.033), 0));
    }
}

impl Material for Leather {
    fn attributes(&self, p: Vec3, normal: Vec3, _part: u16) -> Attributes {
        let relief = self.relief(p.truncate());
        let grain = |q: Vec3| 0.0011 * self.grain.fractal(q, [90, 90], 2);
        let tone = self.color.fractal(p, [3, 3], 4);
        let mottle = self.color.derive(3).fractal(p, [24, 24], 3);
        let worn = smoothstep(-0.003, 0.011, relief.height - 0.006 * tone + 0.003 * mottle);
        let dark = vec3(0.045, 0.016, 0.008);
        let brown = vec3(0.155, 0.055, 0.021);
        let tan = vec3(0.33, 0.145, 0.058);
        let mut diffuse =
            brown.lerp(tan, (0.55 * worn + 0.35 * tone).clamp(0.0, 1.0)) * (1.0 + 0.25 * mottle);
        diffuse = diffuse.lerp(dark, (0.5 * relief.crease + 0.6 * relief.pore).min(0.9));
        let alpha = 0.27 + 0.22 * relief.crease + 0.12 * (0.5 + mottle) - 0.08 * worn;
        Attributes {
            normal: bump(p, normal, 0.0015, grain),
            tangent: Vec3::X,
            diffuse,
            specular: Vec3::splat(0.05 * (1.0 - 0.6 * relief.crease)),
            roughness: [alpha; 2],
        }
    }

    fn as_solid(&self) -> &dyn Solid {
        self
    }
}
