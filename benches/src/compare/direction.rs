//! Whether more is better.

use serde::Serialize;

/// Which way a figure should go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Less is better.
    Less,
    /// More is better.
    More,
    /// The name does not tell.
    Unknown,
}

/// Words of names. What is more of the first beats the others: bytes saved, frames per second.
const MORE: [&str; 7] = ["ssim", "psnr", "saved", "skipped", "hits", "fps", "speed"];
const LESS: [&str; 18] = [
    "ms", "us", "ns", "seconds", "bytes", "rms", "rmse", "mse", "mae", "error", "flip", "ratio", "mib",
    "latency", "wasted", "resent", "swapped", "dropped",
];
/// First parts of places that hold what was asked for, not what came of it.
const SETTINGS: [&str; 4] = ["settings", "plan", "size", "bounds"];

impl Direction {
    /// Of the figure at this place.
    pub fn of(place: &str) -> Self {
        if SETTINGS
            .iter()
            .any(|name| place.split(['.', '[', ']']).any(|part| part == *name))
        {
            return Self::Unknown;
        }
        // Entries of lists have names of their own, which say nothing.
        let mut depth = 0;
        let outside: String = place
            .chars()
            .filter(|letter| {
                depth += i32::from(*letter == '[');
                let kept = depth == 0;
                depth -= i32::from(*letter == ']');
                kept
            })
            .collect();
        if outside.contains("per_second") {
            return Self::More;
        }
        let words = || outside.split(['.', '_']);
        if words().any(|word| MORE.contains(&word)) {
            Self::More
        } else if words().any(|word| LESS.contains(&word)) {
            Self::Less
        } else {
            Self::Unknown
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell() {
        for (place, direction) in [
            ("cases[tori].duel.virtual_ms.frame", Direction::Less),
            ("cases[tori].duel.frames_per_second", Direction::More),
            ("counts.saved_bytes", Direction::More),
            ("counts.line_bytes", Direction::Less),
            ("replays[4g/static/ours].points[3].ssim", Direction::More),
            ("cases[2.5 ms].materials", Direction::Unknown),
            ("settings.page_cache_bytes", Direction::Unknown),
        ] {
            assert_eq!(Direction::of(place), direction, "{place}");
        }
    }
}
