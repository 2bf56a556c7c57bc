//! What making materials takes, before it is begun.

use scenes::paper::{PATCHES, Recipe};

use super::materials::Plan;
use super::traced;
use crate::bytes;

/// Seconds of a core for building a material, before anything is traced.
const BUILD_SECONDS: f64 = 0.8;
/// Texels that a core traces from a view in a second, with their shares of the cells' shadow rays.
const SEEN_PER_SECOND: f64 = 6.0e5;
/// Samples (texel, view and light) that a core shades in a second.
const SHADED_PER_SECOND: f64 = 6.0e7;
/// Samples times components that are factorized in a second on one core, and those that are projected.
const PRODUCTS_PER_SECOND: f64 = 2.5e9;
const PROJECTED_PER_SECOND: f64 = 2.0e10;
/// Texels times components that are coded, written and measured in a second on one core.
const CODED_PER_SECOND: f64 = 4.0e6;
/// Bytes of an archive for each texel and component, and for each row of the BTF and component.
const PAGE_BYTES: f64 = 0.31;
const COLUMN_BYTES: f64 = 0.35;

/// Bytes that tracing takes for each texel (distances and cells of the surface), and rays that are traced ahead.
const TRACED_BYTES: f64 = 1400.0;
const AHEAD_BYTES: f64 = 32e6;

/// Bytes while a material of so many texels is traced: samples of the known texels are held as they were traced, and parted.
fn tracing_bytes(texels: f64, known: f64) -> f64 {
    texels * TRACED_BYTES + AHEAD_BYTES + known * 12.0
}

/// Bytes while eigen-textures are coded on so many cores: the textures in f32; as decoders see them, in halves; for each core the mips of
/// one group; and the pages.
fn coding_bytes(texels: f64, components: f64, cores: f64) -> f64 {
    let groups = (components / 4.0).ceil();
    texels * (4.0 * components + 8.0 * groups + PAGE_BYTES * components + 22.0 * cores.min(groups))
}

/// Time and space.
pub(super) struct Estimate {
    seconds: f64,
    archive_bytes: f64,
    memory_bytes: f64,
}

impl Estimate {
    pub(super) fn of(plan: &Plan, recipes: &[&Recipe]) -> Estimate {
        let cores = std::thread::available_parallelism().map_or(1.0, |cores| cores.get() as f64);
        let directions = plan.sampling.directions().len() as f64;
        let components = f64::from(plan.components);
        let mut estimate = Estimate {
            seconds: 0.0,
            archive_bytes: 0.0,
            memory_bytes: 0.0,
        };
        for recipe in recipes {
            let texels = f64::from(recipe.size).powi(2);
            let (traced, styles) = match recipe.worn {
                Some(_) => (texels / f64::from(PATCHES * PATCHES), 2.0),
                None => (texels, 1.0),
            };
            let [known, seen, shaded] = traced::work(traced, directions);
            let trace = BUILD_SECONDS + seen / SEEN_PER_SECOND + shaded / SHADED_PER_SECOND;
            let factorize = 3.0 * components * (known / PRODUCTS_PER_SECOND + shaded / PROJECTED_PER_SECOND);
            let code = texels * components / CODED_PER_SECOND;
            estimate.seconds += (styles * (trace + factorize) + code) / cores;
            estimate.archive_bytes +=
                components * (PAGE_BYTES * texels + COLUMN_BYTES * 3.0 * directions * directions);
            let memory = tracing_bytes(traced, known).max(coding_bytes(texels, components, cores));
            estimate.memory_bytes = estimate.memory_bytes.max(memory);
        }
        estimate
    }

    pub(super) fn text(&self) -> String {
        format!(
            "about {} on this machine, {} of archives; {} of memory meanwhile",
            duration(self.seconds),
            bytes::text(self.archive_bytes as u64),
            bytes::text(self.memory_bytes.max(64e6) as u64),
        )
    }
}

/// A rough time.
pub(super) fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::{coding_bytes, duration, tracing_bytes};
    use crate::scene::traced;

    /// Both measured on two cores: 2747 MiB of a blended material of 2048² texels, 704 of a traced one of 512².
    #[test]
    fn memory_is_that_of_the_textures_and_little_more() {
        let texels = 2048.0f64.powi(2);
        assert!((2.75e9..3.0e9).contains(&coding_bytes(texels, 100.0, 2.0)));
        let [known, ..] = traced::work(512.0f64.powi(2), 81.0);
        assert!((0.65e9..0.8e9).contains(&tracing_bytes(512.0f64.powi(2), known)));
    }

    #[test]
    fn times_are_rough() {
        assert_eq!(
            [4.2, 89.0, 91.0, 3600.0, 9000.0].map(duration),
            ["4 s", "89 s", "2 min", "60 min", "2.5 h"]
        );
    }
}
