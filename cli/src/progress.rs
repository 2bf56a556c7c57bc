//! Progress of what takes more than a second. Drawn on the terminal, and nowhere else.

use std::sync::Mutex;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A bar for `total` units of `what`; invisible if `quiet`, or if standard error is not a terminal.
pub(crate) fn bar(what: &str, total: u64, quiet: bool) -> ProgressBar {
    let target = if quiet {
        ProgressDrawTarget::hidden()
    } else {
        ProgressDrawTarget::stderr()
    };
    let bar = ProgressBar::with_draw_target(Some(total), target);
    let style = ProgressStyle::with_template("{prefix:>22} {wide_bar} {pos}/{len} {elapsed} (left: {eta})");
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar.set_prefix(what.to_owned());
    bar
}

/// A spinner for what has no known end.
pub(crate) fn spinner(what: &str, quiet: bool) -> ProgressBar {
    let bar = bar(what, 0, quiet);
    if let Ok(style) = ProgressStyle::with_template("{prefix:>22} {spinner} {msg} {elapsed}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// Bars for the phases of preprocessing, one after the other.
pub(crate) struct Phases {
    quiet: bool,
    label: String,
    current: Mutex<Option<(::preprocess::Phase, ProgressBar)>>,
}

impl Phases {
    /// `label` goes before the name of each phase.
    pub(crate) fn new(label: &str, quiet: bool) -> Self {
        Self {
            quiet,
            label: label.to_owned(),
            current: Mutex::new(None),
        }
    }

    /// Takes a report.
    pub(crate) fn show(&self, progress: ::preprocess::Progress) {
        let Ok(mut current) = self.current.lock() else {
            return;
        };
        if current.as_ref().is_none_or(|(phase, _)| *phase != progress.phase) {
            if let Some((_, bar)) = current.take() {
                bar.finish_and_clear();
            }
            let name = format!("{}{}", self.label, progress.phase);
            *current = Some((progress.phase, bar(&name, progress.total, self.quiet)));
        }
        if let Some((_, bar)) = &*current {
            bar.set_position(progress.done);
        }
    }

    /// Takes the last bar away.
    pub(crate) fn finish(&self) {
        if let Ok(mut current) = self.current.lock()
            && let Some((_, bar)) = current.take()
        {
            bar.finish_and_clear();
        }
    }
}
