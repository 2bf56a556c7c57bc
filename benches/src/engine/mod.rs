//! What virtual textures cost in a frame, and what is skipped.
//!
//! - [`Subject`]: a scene, its archives, and the way of a camera; [`built_in`] makes those that run anywhere.
//! - [`measure`] (`case`) measures one: `duel` draws each view with and without virtual textures, alternately, `motion` flies
//!   over the scene from an empty cache, `stand` stays where it is, `saved` switches kinds of skipping off.
//! - [`table`](fn@table) shows.
//!
//! The baseline is `engine::frame::Engine::draw_resident`: the same renderer and a copy of the same pages and columns, all that the
//! way wants resident, where the shader computes their places; without page table, feedback, votes, residency, streaming,
//! stitching, and look-ahead. Scenes whose pages are too many for such a copy are measured against the page table, and the
//! report says so.

mod archive;
mod case;
mod duel;
mod motion;
mod report;
mod saved;
mod stand;
mod subject;

pub use case::{Case, Plan, measure};
pub use duel::Duel;
pub use motion::Motion;
pub(crate) use motion::thread_time;
pub use report::{frames, memory, processor, saved, skipped, table};
pub use saved::Saved;
pub use stand::Stand;
pub use subject::{Archives, Subject, built_in, orbit};

/// The middle of values that are sorted here; 0 of none.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    quantile(values, 0.5)
}

/// The value under which a share of all lie; 0 of none.
pub(crate) fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1);
    values
        .get((last as f64 * share).round() as usize)
        .copied()
        .unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_of_sorted_values() {
        assert_eq!(quantile(&mut [], 0.5), 0.0);
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(quantile(&mut [3.0, 1.0, 2.0], 1.0), 3.0);
    }
}
