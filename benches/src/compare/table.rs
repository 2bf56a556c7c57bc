//! A comparison for people.

use std::fmt::Write;

use super::{Comparison, Verdict};

/// Most lines of a kind.
const MOST_LINES: usize = 60;

/// A Markdown table of what changed beyond noise, most changed first, and below it what else differs.
pub fn table(comparison: &Comparison) -> String {
    let count = |verdict| {
        comparison
            .figures
            .iter()
            .filter(|change| change.verdict == verdict)
            .count()
    };
    let mut text = format!(
        "{} figures: {} the same, {} within noise, {} better, {} worse, {} changed\n",
        comparison.figures.len(),
        count(Verdict::Same),
        count(Verdict::Noise),
        count(Verdict::Better),
        count(Verdict::Worse),
        count(Verdict::Changed),
    );
    let moved = |change: &&super::Change| !matches!(change.verdict, Verdict::Same | Verdict::Noise);
    let mut changes: Vec<_> = comparison.figures.iter().filter(moved).collect();
    changes.sort_by(|a, b| b.distance().total_cmp(&a.distance()));
    // Writing to a string cannot fail.
    if !changes.is_empty() {
        text.push_str("\n| figure | before | after | ratio | noise | |\n|---|---:|---:|---:|---:|---|\n");
    }
    for change in changes.iter().take(MOST_LINES) {
        let verdict = match change.verdict {
            Verdict::Better => "better",
            Verdict::Worse => "**worse**",
            _ => "changed",
        };
        let _ = writeln!(
            text,
            "| {} | {} | {} | {:.3} | {:.1} % | {verdict} |",
            change.place.replace('|', "/"),
            number(change.before),
            number(change.after),
            change.ratio,
            100.0 * change.noise,
        );
    }
    if changes.len() > MOST_LINES {
        let _ = writeln!(text, "\nand {} more; --json has all", changes.len() - MOST_LINES);
    }
    for [place, before, after] in comparison.texts.iter().take(MOST_LINES) {
        let _ = writeln!(text, "\n{place}: {before} → {after}");
    }
    for (only, places) in [
        ("before", &comparison.only_before),
        ("after", &comparison.only_after),
    ] {
        if let Some(first) = places.first() {
            let _ = writeln!(text, "\nonly {only}: {} figures, {first} first", places.len());
        }
    }
    text
}

fn number(value: f64) -> String {
    if value == value.trunc() && value.abs() < 1e15 {
        format!("{value}")
    } else {
        format!("{value:.4e}")
    }
}
