//! Rows for people.

use super::Results;

/// A Markdown table.
pub fn table(results: &Results) -> String {
    let mut text = String::from(
        "| materials | texels | tiles | index, kB | GPU besides caches, MiB | host, MiB | process, MiB | known, ms | settled, ms | CPU moving, ms | submission | still | submission |\n\
         |---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    for row in &results.rows {
        text.push_str(&format!(
            "| {} | {}² | {} | {:.1} | {:.2} | {:.2} | {} | {:.0} | {:.0} | {:.3} | {:.3} | {:.3} | {:.3} |\n",
            row.materials,
            row.side_texels,
            row.tiles,
            row.index_bytes as f64 / 1e3,
            mib(row.gpu_bytes),
            mib(row.host_bytes),
            row.resident_bytes.map_or("–".into(), |bytes| format!("{:.1}", mib(bytes))),
            row.known_ms,
            row.settled_ms,
            row.moving_ms,
            row.moving_submit_ms,
            row.still_ms,
            row.still_submit_ms,
        ));
    }
    text
}
