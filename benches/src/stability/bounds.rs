//! What is promised, and the judge of whether it is kept.

use serde::Serialize;

use super::{Measured, RepairMeasured};

/// Bounds of one case. All errors are relative to ‖B‖.
///
/// Each test of an error is "at most a share of what it is compared with, and a floor": where the truth is zero, or
/// near the rounding of f32, ratios say nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bounds {
    /// Largest entry of |UᵀU/m − I| and of |VᵀV − I|.
    pub orthonormality: f64,
    /// Error of the truncated product, in errors of the f64 optimum of the same rank.
    pub optimum_ratio: f64,
    /// The same, floor.
    pub optimum_floor: f64,
    /// |stated − true| of the rank error, as a share of the true one.
    pub stated_share: f64,
    /// The same, floor.
    pub stated_floor: f64,
    /// Loss of half floats.
    pub half: f64,
    /// |stated − true| of what half floats lose, and of the whole way, as a share of the true one.
    pub ledger_share: f64,
    /// The same, floor.
    pub ledger_floor: f64,
    /// Loss of the codec, in the sum of the quantizer steps of pages and eigen-ABRDFs, times the root of the number of
    /// components.
    pub codec_steps: f64,
    /// The rank that must be found, where it is known.
    pub rank: Option<usize>,
    /// Difference of the repaired samples to what they were before they were harmed.
    pub repair: f64,
}

impl Bounds {
    /// What holds wherever no case says otherwise.
    pub const DEFAULT: Bounds = Bounds {
        // Factors are rounded to f32, 6e-8 an entry, after products of f32 of whose errors the Gram matrix in f64
        // takes out the linear part; a hundredfold for sums over a subspace of some twenty vectors.
        orthonormality: 1e-5,
        // What a random subspace misses after two passes that sharpen it.
        optimum_ratio: 1.02,
        // Components below 1e-6 of the first are rounding of f32 products, and are left out.
        optimum_floor: 2e-6,
        // Errors are computed in f64 from f32 products. The factors are rounded to f32 after that, 6e-8 an entry, which
        // in a constant BTF is the same rounding everywhere: 4e-7 was seen.
        stated_share: 0.01,
        stated_floor: 1e-6,
        // A half float is off by at most 2⁻¹¹ of its value; two factors.
        half: 1.0 / 1024.0,
        // What the rank leaves out and what is lost after it add up as squares, as if they were uncorrelated.
        ledger_share: 0.02,
        ledger_floor: 1e-6,
        // No coefficient of either orthonormal transform is off by more than a step.
        codec_steps: 1.0,
        rank: None,
        repair: 0.0,
    };

    /// What is broken, for people; empty if nothing is. NaN breaks every bound.
    pub fn broken(&self, measured: &Measured) -> Vec<String> {
        let mut broken = Vec::new();
        let mut at_most = |what: &str, value: f64, bound: f64| {
            let within = value <= bound; // false for NaN
            if !within {
                broken.push(format!("{what} is {value:.3e}, more than {bound:.3e}"));
            }
        };
        let m = measured;
        at_most("orthonormality of U", m.u_defect, self.orthonormality);
        at_most("orthonormality of V", m.v_defect, self.orthonormality);
        at_most(
            "error of the truncated product",
            m.rank_true,
            self.optimum_ratio * m.optimum + self.optimum_floor,
        );
        // Nothing beats the optimum but rounding: a smaller error would mean a wrong judge.
        at_most(
            "optimum",
            m.optimum,
            m.rank_true * (1.0 + 1e-9) + self.stated_floor,
        );
        for (what, stated, truth, share, floor) in [
            (
                "rank error",
                m.rank_stated,
                m.rank_true,
                self.stated_share,
                self.stated_floor,
            ),
            (
                "loss of half floats",
                m.half_stated,
                m.half_true,
                self.ledger_share,
                self.ledger_floor,
            ),
            (
                "end-to-end error",
                m.total_stated,
                m.total_true,
                self.ledger_share,
                self.ledger_floor,
            ),
        ] {
            at_most(
                &format!("stated minus true {what}"),
                (stated - truth).abs(),
                share * truth + floor,
            );
        }
        at_most("loss of half floats", m.half_true, self.half);
        let codec = self.codec_steps * (m.step + m.column_step) * (m.rank as f64).sqrt();
        at_most("loss of the codec", m.codec_stated, codec + self.ledger_floor);
        let rank = self.optimum_ratio * m.optimum + self.optimum_floor;
        // By the triangle inequality: no bound of its own.
        at_most(
            "end-to-end error",
            m.total_true,
            rank + self.half + codec + self.ledger_floor,
        );
        at_most("components", m.rank as f64, m.components as f64);
        if let Some(rank) = self.rank {
            at_most("distance to the true rank", m.rank.abs_diff(rank) as f64, 0.0);
        }
        if let Some(RepairMeasured {
            loss,
            samples,
            harmed,
            ..
        }) = m.repair
        {
            at_most("difference of repaired samples", loss, self.repair);
            at_most("miscounted repairs", samples.abs_diff(harmed) as f64, 0.0);
        }
        broken
    }
}
