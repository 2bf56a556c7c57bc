//! What the panel shows and nobody can change.

use egui::{Grid, Ui};
use engine::frame::Milliseconds;
use viewer::{Viewer, report::Sample};

use crate::{
    charts::{COLORS, Line, chart},
    maps,
    notices::{bar, bytes},
};

/// A phase of a frame and its colour's place.
type Phase = (&'static str, fn(&Milliseconds) -> f64);

const PHASES: [Phase; 6] = [
    ("draw", |ms| ms.draw),
    ("votes", |ms| ms.votes),
    ("residency", |ms| ms.residency),
    ("source", |ms| ms.source),
    ("decode", |ms| ms.decode),
    ("upload", |ms| ms.upload),
];

/// How it stands, in a few lines.
pub(super) fn state(ui: &mut Ui, viewer: &Viewer) {
    let report = viewer.report();
    let frame = &report.frame;
    ui.add_space(4.0);
    let state = match (frame.settled, frame.in_flight) {
        (true, _) => "settled".to_owned(),
        (false, 0) => "looking".to_owned(),
        (false, items) => format!("streaming, {items} to come"),
    };
    ui.horizontal(|ui| {
        ui.strong(state);
        ui.weak("? for keys");
    });
    let error = format!("{:.5}", frame.predicted_rms);
    Grid::new("state").num_columns(2).show(ui, |ui| {
        let mut row = |name: &str, value: String| {
            ui.label(name);
            ui.label(value);
            ui.end_row();
        };
        row("predicted error", error);
        let wanted = frame.pages_wanted;
        row(
            "pages",
            format!("{} of {wanted} wanted", frame.pages_resident.min(wanted)),
        );
        row("columns", frame.columns_resident.to_string());
        row("over the wire", bytes(frame.wire_bytes_total));
        row("on the GPU", bytes(frame.gpu_bytes));
        row("on the host", bytes(frame.host_bytes));
    });
    if let Some((_, beside)) = viewer.reference() {
        let settled = if beside.settled { "settled" } else { "streaming" };
        ui.label(format!("beside: {settled}, error {:.5}", beside.predicted_rms));
    }
    ui.weak(&report.origin).on_hover_text(viewer.engine().adapter());
}

/// Charts of the last frames.
pub(super) fn course(ui: &mut Ui, viewer: &Viewer) {
    let values = |value: &dyn Fn(&Sample) -> f64| viewer.history().samples().map(value).collect::<Vec<_>>();
    let line = |name, color, value: &dyn Fn(&Sample) -> f64| Line {
        name,
        color: COLORS[color],
        values: values(value),
    };
    chart(
        ui,
        "error",
        &[line("", 0, &|sample| sample.predicted_rms)],
        |value| format!("{value:.4}"),
    );
    chart(
        ui,
        "bytes",
        &[line("", 1, &|sample| sample.wire_bytes_total as f64)],
        |value| bytes(value as u64),
    );
    chart(
        ui,
        "pages",
        &[
            line("wanted", 3, &|sample| sample.pages_wanted.into()),
            line("resident", 2, &|sample| sample.pages_resident.into()),
        ],
        |value| format!("{value:.0}"),
    );
    let phases: Vec<_> = PHASES
        .iter()
        .enumerate()
        .map(|(at, (name, of))| line(name, at, &|sample| of(&sample.ms)))
        .collect();
    chart(ui, "ms", &phases, |value| format!("{value:.1}"));
}

/// All materials and how far they are.
pub(super) fn materials(ui: &mut Ui, viewer: &Viewer) {
    Grid::new("materials").striped(true).show(ui, |ui| {
        for material in &viewer.report().materials {
            let name = ui.label(&material.name);
            if let Some(why) = &material.failure {
                name.on_hover_text(why);
            }
            match material.progress {
                Some(share) => bar(ui, share),
                None => {
                    ui.weak("not in view");
                }
            }
            ui.label(material.state);
            ui.label(bytes(material.wire_bytes));
            ui.end_row();
        }
    });
}

impl super::Panel {
    pub(super) fn cache(&mut self, ui: &mut Ui, viewer: &Viewer) {
        ui.horizontal(|ui| {
            for (color, name) in [
                (maps::CacheColor::Material, "material"),
                (maps::CacheColor::Mip, "mip"),
                (maps::CacheColor::Age, "age"),
            ] {
                ui.selectable_value(&mut self.cache_color, color, name);
            }
        });
        maps::cache(ui, viewer, self.cache_color);
    }

    pub(super) fn page_tree(&mut self, ui: &mut Ui, viewer: &Viewer) {
        let materials = &viewer.report().materials;
        let name = |at: usize| materials.get(at).map_or("", |material| &material.name);
        egui::ComboBox::from_id_salt("tree")
            .selected_text(name(self.tree))
            .show_ui(ui, |ui| {
                for at in 0..materials.len() {
                    ui.selectable_value(&mut self.tree, at, name(at));
                }
            });
        match viewer.engine().page_tree(self.tree) {
            Some(tree) => maps::tree(ui, &tree),
            None => {
                ui.weak("not known yet");
            }
        }
    }
}
