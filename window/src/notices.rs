//! What lies over the picture: materials on their way, a host that does not answer, the keys, what was written.

use egui::{Align2, Area, Color32, Context, Frame, Grid, Id, Order, ProgressBar, Rect, Ui, Vec2, Window};
use engine::Overlay;
use viewer::{Command, Connection, Report, keys};

use crate::panel::Action;

/// Most materials whose progress is listed.
const MOST_LISTED: usize = 12;

/// A banner over the picture while the host does not answer, with a button to ask again.
pub(crate) fn banner(context: &Context, picture: Rect, report: &Report, actions: &mut Vec<Action>) {
    let (text, fill) = match &report.connection {
        Connection::Fine => return,
        Connection::Waiting => (
            format!("{} does not answer; it is being asked again", report.origin),
            Color32::from_rgb(120, 80, 0),
        ),
        Connection::Lost(why) => (
            format!("Not all can be had of {}: {why}", report.origin),
            Color32::from_rgb(140, 40, 20),
        ),
    };
    over(
        context,
        "banner",
        picture.center_top() + Vec2::new(0.0, 10.0),
        Align2::CENTER_TOP,
        |ui| {
            Frame::popup(ui.style()).fill(fill).show(ui, |ui| {
                ui.set_max_width((picture.width() - 40.0).clamp(120.0, 640.0));
                ui.colored_label(Color32::WHITE, text);
                ui.horizontal(|ui| {
                    if ui.button("Retry (F5)").clicked() {
                        actions.push(Action::Command(Command::Retry));
                    }
                    ui.colored_label(Color32::from_gray(220), "What is here stays in view.");
                });
            });
        },
    );
}

/// Progress by material, until all that is in view shows something of its own.
pub(crate) fn progress(context: &Context, picture: Rect, report: &Report) {
    let waits = |state: &str| matches!(state, "unknown" | "loading");
    let in_view = |material: &&viewer::report::MaterialReport| {
        waits(material.state) && (material.progress.is_some() || material.state == "unknown")
    };
    let open: Vec<_> = report.materials.iter().filter(in_view).collect();
    if open.is_empty() || report.frame.settled {
        return;
    }
    over(
        context,
        "progress",
        picture.left_bottom() + Vec2::new(10.0, -10.0),
        Align2::LEFT_BOTTOM,
        |ui| {
            Frame::popup(ui.style()).show(ui, |ui| {
                let total = report.materials.len();
                ui.strong(format!("{} of {total} materials", total - open.len()));
                Grid::new("materials on their way").show(ui, |ui| {
                    for material in open.iter().take(MOST_LISTED) {
                        ui.label(&material.name);
                        bar(ui, material.progress.unwrap_or(0.0));
                        ui.label(bytes(material.wire_bytes));
                        ui.end_row();
                    }
                });
                if open.len() > MOST_LISTED {
                    ui.label(format!("and {} more", open.len() - MOST_LISTED));
                }
            });
        },
    );
}

/// How far something is, from 0 to 1.
pub(crate) fn bar(ui: &mut Ui, share: f64) {
    let bar = ProgressBar::new(share as f32)
        .desired_width(90.0)
        .text(format!("{:.0} %", share * 100.0));
    ui.add(bar);
}

/// What an overlay's colours mean.
pub(crate) fn legend(context: &Context, picture: Rect, overlay: Overlay) {
    if overlay == Overlay::None {
        return;
    }
    over(
        context,
        "legend",
        picture.right_bottom() + Vec2::new(-10.0, -10.0),
        Align2::RIGHT_BOTTOM,
        |ui| {
            Frame::popup(ui.style()).show(ui, |ui| {
                ui.strong(overlay.title());
                for (label, [r, g, b]) in overlay.legend() {
                    ui.horizontal(|ui| {
                        let (rect, _) = ui.allocate_exact_size(Vec2::splat(12.0), egui::Sense::hover());
                        ui.painter().rect_filled(rect, 1.0, Color32::from_rgb(r, g, b));
                        ui.label(label);
                    });
                }
            });
        },
    );
}

/// What has just been done.
pub(crate) fn said(context: &Context, picture: Rect, text: &str) {
    over(
        context,
        "said",
        picture.center_bottom() + Vec2::new(0.0, -14.0),
        Align2::CENTER_BOTTOM,
        |ui| {
            Frame::popup(ui.style()).show(ui, |ui| ui.label(text));
        },
    );
}

/// The keys.
pub(crate) fn help(context: &Context, open: &mut bool) {
    Window::new("Keys")
        .open(open)
        .collapsible(false)
        .resizable(false)
        .anchor(Align2::CENTER_CENTER, Vec2::ZERO)
        .show(context, |ui| {
            Grid::new("keys").striped(true).show(ui, |ui| {
                for (keys, what) in keys::HELP.iter().chain(keys::WINDOW_HELP) {
                    ui.strong(*keys);
                    ui.label(*what);
                    ui.end_row();
                }
            });
        });
}

fn over(context: &Context, id: &str, at: egui::Pos2, align: Align2, contents: impl FnOnce(&mut Ui)) {
    Area::new(Id::unique(id))
        // Above the line between two pictures.
        .order(Order::Foreground)
        .pivot(align)
        .fixed_pos(at)
        .show(context, contents);
}

/// For people.
pub(crate) fn bytes(bytes: u64) -> String {
    let (value, unit) = match bytes {
        0..1024 => return format!("{bytes} B"),
        1024..1_048_576 => (bytes as f64 / 1024.0, "KiB"),
        1_048_576..1_073_741_824 => (bytes as f64 / 1_048_576.0, "MiB"),
        _ => (bytes as f64 / 1_073_741_824.0, "GiB"),
    };
    format!("{value:.1} {unit}")
}

#[cfg(test)]
mod tests {
    #[test]
    fn bytes_are_readable() {
        assert_eq!(super::bytes(12), "12 B");
        assert_eq!(super::bytes(1536), "1.5 KiB");
        assert_eq!(super::bytes(3 << 30), "3.0 GiB");
    }
}
