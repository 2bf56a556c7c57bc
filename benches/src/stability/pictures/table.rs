//! Pictures for people.

use std::fmt::Write;

use super::PictureRow;

/// A Markdown table with a line for each case, of its worst view, and below it what is broken.
pub fn pictures_table(rows: &[PictureRow]) -> String {
    let mut text = String::from(
        "| case | views | pages not stored | archive | picture, worst | in | of its bound | in | rounding | |\n|---|---:|---:|---:|---:|---|---:|---|---:|---|\n",
    );
    for views in rows.chunk_by(|a, b| a.case == b.case) {
        let worst = |of: fn(&PictureRow) -> Option<f64>| {
            let known = views.iter().filter_map(|row| Some((of(row)?, row.view)));
            known.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, "–"))
        };
        let ((error, error_in), (of_bound, bound_in)) = (worst(|row| row.error), worst(|row| row.of_bound));
        let ok = views.iter().all(|row| row.broken.is_empty());
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {} | {} | {} | {:.2e} | {error:.2e} | {error_in} | {of_bound:.3} | {bound_in} | {:.1e} | {} |",
            views[0].case,
            views.len(),
            views[0].pages_not_stored,
            views[0].ledger,
            worst(|row| row.rounding).0,
            if ok { "ok" } else { "FAIL" },
        );
    }
    for row in rows {
        for broken in &row.broken {
            let _ = writeln!(text, "\n! {}, {}: {broken}", row.case, row.view);
        }
    }
    text
}
