//! What a BTF holds, for people.

use std::io::Write;
use std::path::Path;

use ::preprocess::source::{Inspection, Overrides, Table, inspect};
use anyhow::{Result, bail};

use crate::{bytes, file};

/// Rings of directions printed at most.
const MAX_RINGS: usize = 24;

/// Prints what a file or folder holds.
///
/// # Errors
/// If it cannot be preprocessed; what is wrong has been printed then.
pub(super) fn run(path: &Path, overrides: &Overrides, json: bool) -> Result<()> {
    let inspection = inspect(path, overrides);
    if inspection.format.is_none()
        && let [problem] = &inspection.problems[..]
        && !json
    {
        bail!("{}: {problem}", path.display());
    }
    if json {
        file::print_json(&inspection)?;
    } else {
        std::io::stdout().lock().write_all(text(&inspection).as_bytes())?;
    }
    if !inspection.usable {
        bail!(
            "{} cannot be preprocessed: {}",
            path.display(),
            inspection.problems.join("; ")
        );
    }
    Ok(())
}

fn text(inspection: &Inspection) -> String {
    let mut text = format!("{}\n", inspection.path);
    let mut line = |name: &str, value: String| text += &format!("  {name:12} {value}\n");
    if let Some(format) = &inspection.format {
        line("format", format.clone());
    }
    if let (Some(width), Some(height)) = (inspection.width, inspection.height) {
        let repeats = if inspection.wrap == Some(true) {
            ", repeating"
        } else {
            ", not repeating"
        };
        line("texels", format!("{width} x {height}{repeats}"));
    }
    for (name, table) in [("views", &inspection.views), ("lights", &inspection.lights)] {
        if let Some(table) = table {
            line(name, directions(table));
        }
    }
    if let Some(equal) = inspection.views_equal_lights {
        line(
            "",
            format!(
                "lights {} the views",
                if equal {
                    "are the same directions as"
                } else {
                    "differ from"
                }
            ),
        );
    }
    if let Some(cosine) = inspection.cosine {
        line("cosine", if cosine { "included" } else { "left out" }.into());
    }
    line(
        "images",
        match inspection.missing_images {
            0 => inspection.images.to_string(),
            missing => format!("{}, {missing} missing", inspection.images),
        },
    );
    if let Some(terms) = inspection.stored_terms {
        line("factors", format!("{terms} terms in the file"));
    }
    if let (Some(stored), Some([rows, columns]), Some(matrix)) = (
        inspection.stored_bytes,
        inspection.matrix,
        inspection.matrix_bytes,
    ) {
        let size = format!("{rows} x {columns}, {} as floats", bytes::text(matrix));
        line(
            "matrix",
            format!("{size}, from {} on the disk", bytes::text(stored)),
        );
    }
    if let Some(sample) = &inspection.sample {
        let [red, green, blue] = sample.mean_rgb;
        line(
            "values",
            format!(
                "{} to {}, mean {red:.4} {green:.4} {blue:.4} (of {} images)",
                sample.min, sample.max, sample.images
            ),
        );
        for (count, what) in [
            (sample.nan, "are no numbers"),
            (sample.infinite, "are infinite or absurdly large"),
            (sample.negative, "are negative"),
            (sample.beyond_half, "are too large for half floats"),
        ] {
            if count > 0 {
                line("", format!("{count} samples of these {what}"));
            }
        }
    }
    if let Some(estimate) = &inspection.estimate {
        line(
            "estimate",
            format!(
                "{:.1} s for each pass over the samples; {} for the factors at rank 100",
                estimate.pass_seconds,
                bytes::text(estimate.factor_bytes)
            ),
        );
    }
    for note in &inspection.notes {
        line("note", note.clone());
    }
    for problem in &inspection.problems {
        line("problem", problem.clone());
    }
    text
}

/// `81: theta 0 (1), 15 (6), …`
fn directions(table: &Table) -> String {
    let rings = table.rings.iter().take(MAX_RINGS);
    let rings: Vec<String> = rings
        .map(|ring| format!("{} ({})", ring.theta, ring.count))
        .collect();
    let more = table.rings.len() - rings.len();
    let more = if more > 0 {
        format!(" and {more} more thetas")
    } else {
        String::new()
    };
    format!("{}: theta {}{more}", table.count, rings.join(", "))
}
