//! The suite for people.

use std::fmt::Write;

use super::Row;

/// An aligned table with a line for each case, and below the lines of those that failed what is broken.
pub fn table(rows: &[Row]) -> String {
    let mut lines = vec![
        [
            "case",
            "rows x columns",
            "rank",
            "|UtU-I|",
            "|VtV-I|",
            "optimum",
            "error",
            "stated",
            "half",
            "codec",
            "decoded",
            "ledger",
            "",
        ]
        .map(str::to_owned),
    ];
    let number = |value: f64| {
        if value == 0.0 {
            "0".to_owned()
        } else {
            format!("{value:.2e}")
        }
    };
    for row in rows {
        let mut line = std::array::from_fn(|_| "-".to_owned());
        if let Some(m) = &row.measured {
            let errors = [
                m.u_defect,
                m.v_defect,
                m.optimum,
                m.rank_true,
                m.rank_stated,
                m.half_true,
                m.codec_stated,
                m.total_true,
                m.total_stated,
            ];
            line[2] = format!("{}/{}", m.rank, m.components);
            for (cell, value) in line[3..].iter_mut().zip(errors) {
                *cell = number(value);
            }
        }
        line[0] = row.case.to_owned();
        line[1] = format!("{} x {}", row.shape.rows(), row.shape.columns());
        line[12] = if row.broken.is_empty() { "ok" } else { "FAIL" }.to_owned();
        lines.push(line);
    }
    let widths: [usize; 13] = std::array::from_fn(|column| {
        let length = |line: &[String; 13]| line[column].chars().count();
        lines.iter().map(length).max().unwrap_or(0)
    });
    let mut text = String::new();
    for (index, line) in lines.iter().enumerate() {
        let mut out = format!("{:<1$}", line[0], widths[0]);
        for (cell, width) in line.iter().zip(widths).skip(1) {
            // Writing to a string cannot fail.
            let _ = write!(out, "  {cell:>width$}");
        }
        text.push_str(out.trim_end());
        text.push('\n');
        for broken in index.checked_sub(1).map_or(&[][..], |row| &rows[row].broken) {
            text.push_str("    ! ");
            text.push_str(broken);
            text.push('\n');
        }
    }
    text
}
