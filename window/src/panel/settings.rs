//! What the panel changes.

use egui::{ComboBox, Slider, Ui};
use engine::{
    Overlay,
    angular::Angular,
    frame::{Budgets, Filter, MAX_PREFETCH_SECONDS, MIN_HOST_BYTES},
};
use glam::Vec3;
use scenes::{Light, Shape};
use viewer::{Command, Mode, Viewer};

use super::{Action, Panel};

const MIB: f64 = 1_048_576.0;

impl Panel {
    pub(super) fn camera(&mut self, ui: &mut Ui, viewer: &mut Viewer, actions: &mut Vec<Action>) {
        ui.horizontal(|ui| {
            let mut mode = viewer.mode();
            ui.selectable_value(&mut mode, Mode::Orbit, "orbit");
            ui.selectable_value(&mut mode, Mode::Fly, "fly");
            if mode != viewer.mode() {
                viewer.controls_mut().set_mode(mode);
            }
            command(ui, actions, "reset", Command::Reset);
            let beside = if viewer.reference().is_some() {
                "one picture"
            } else {
                "beside full"
            };
            command(ui, actions, beside, Command::Split);
        });
        if let Some(shape) = viewer.shape() {
            let mut chosen = shape;
            ui.horizontal(|ui| {
                for shape in Shape::ALL {
                    ui.selectable_value(&mut chosen, shape, shape.name());
                }
            });
            self.check(viewer.set_shape(chosen));
        }
        let mut stops = viewer.exposure_stops();
        if ui
            .add(Slider::new(&mut stops, -8.0..=8.0).text("exposure, stops"))
            .changed()
        {
            viewer.set_exposure_stops(stops);
        }
        ui.add(Slider::new(&mut self.resolution, 0.1..=1.0).text("resolution"));
        self.lights(ui, viewer, actions);
    }

    fn lights(&mut self, ui: &mut Ui, viewer: &mut Viewer, actions: &mut Vec<Action>) {
        let mut lights = viewer.lights().clone();
        ui.horizontal_wrapped(|ui| {
            for (at, light) in viewer.lights().all().iter().enumerate() {
                let kind = match light {
                    Light::Directional { .. } => "sun",
                    Light::Point { .. } => "lamp",
                };
                let chosen = lights.chosen() == Some(at);
                if ui
                    .selectable_label(chosen, format!("{kind} {}", at + 1))
                    .clicked()
                {
                    lights.choose(at);
                }
            }
            command(ui, actions, "+", Command::AddLight);
            command(ui, actions, "-", Command::RemoveLight);
        });
        if let Some(light) = lights.chosen().map(|chosen| lights.all()[chosen]) {
            let (Light::Directional {
                irradiance: color, ..
            }
            | Light::Point { intensity: color, .. }) = light;
            let most = color.max_element().max(1e-3);
            let mut hue = (color / most).to_array();
            let mut bright = most;
            ui.horizontal(|ui| {
                let hued = ui.color_edit_button_rgb(&mut hue).changed();
                let brightness = Slider::new(&mut bright, 1e-3..=1e3).logarithmic(true);
                if hued | ui.add(brightness).changed() {
                    lights.set_color(Vec3::from_array(hue) * bright);
                }
            });
            ui.weak("L+drag or Ctrl+drag turns it");
        }
        self.check(viewer.set_lights(lights));
    }

    pub(super) fn budgets(&mut self, ui: &mut Ui, viewer: &mut Viewer) {
        let before = viewer.budgets();
        let mut budgets = before;
        mebibytes(
            ui,
            "page cache, MiB",
            &mut budgets.page_cache_bytes,
            0.25..=4096.0,
        );
        mebibytes(
            ui,
            "column cache, MiB",
            &mut budgets.column_cache_bytes,
            0.25..=4096.0,
        );
        mebibytes(
            ui,
            "host, MiB",
            &mut budgets.host_bytes,
            MIN_HOST_BYTES as f64 / MIB..=4096.0,
        );
        mebibytes(ui, "in flight, MiB", &mut budgets.bytes_in_flight, 0.01..=256.0);
        let count = |ui: &mut Ui, text, value: &mut usize| {
            ui.add(Slider::new(value, 1..=256).logarithmic(true).text(text));
        };
        count(ui, "requests", &mut budgets.requests_in_flight);
        count(ui, "uploads a frame", &mut budgets.uploads_per_frame);
        if budgets != before {
            let result = viewer.set_budgets(Budgets { ..budgets });
            self.check(result);
        }
    }

    pub(super) fn filters(&mut self, ui: &mut Ui, viewer: &mut Viewer) {
        let mut on = viewer.quality().is_some();
        let mut quality = viewer.quality().unwrap_or(self.quality);
        let toggled = ui.checkbox(&mut on, "target error instead of budgets").changed();
        let target = Slider::new(&mut quality.target_rms, 1e-4..=0.3).logarithmic(true);
        let moved = ui.add_enabled(on, target.text("target error")).changed();
        if toggled || moved {
            self.quality = quality;
            self.check(viewer.set_quality(on.then_some(quality)));
        }
        ui.separator();
        let options = viewer.engine().options().clone();
        let mut error = options.component_error;
        let slider = Slider::new(&mut error, 0.0..=0.05)
            .logarithmic(true)
            .smallest_positive(1e-5);
        if ui.add(slider.text("left out components")).changed() {
            self.check(viewer.engine_mut().set_component_error(error));
        }
        let mut fade = options.fade_frames;
        if ui
            .add(Slider::new(&mut fade, 0..=60).text("fade, frames"))
            .changed()
        {
            self.check(viewer.engine_mut().set_fade_frames(fade));
        }
        let mut ahead = options.prefetch_seconds;
        let slider = Slider::new(&mut ahead, 0.0..=MAX_PREFETCH_SECONDS);
        if ui.add(slider.text("look ahead, s")).changed() {
            viewer.engine_mut().set_prefetch_seconds(ahead);
        }
        let ways = [
            (Angular::Delaunay, "Delaunay"),
            (Angular::Hemisphere, "hemisphere"),
        ];
        if let Some(angular) = one_of(ui, "directions", options.angular, ways) {
            self.check(viewer.set_angular(angular));
        }
        let filters = [(Filter::Trilinear, "trilinear"), (Filter::Bilinear, "bilinear")];
        if let Some(filter) = one_of(ui, "mips", options.filter, filters) {
            self.check(viewer.engine_mut().set_filter(filter));
        }
    }

    pub(super) fn overlay(&mut self, ui: &mut Ui, viewer: &mut Viewer) {
        let now = viewer.engine().overlay();
        let mut chosen = now;
        ComboBox::from_id_salt("overlay")
            .selected_text(now.name())
            .show_ui(ui, |ui| {
                for overlay in Overlay::ALL {
                    ui.selectable_value(&mut chosen, overlay, overlay.name());
                }
            });
        if chosen != now {
            self.check(viewer.engine_mut().set_overlay(chosen));
        }
        let mut opacity = viewer.engine().overlay_opacity();
        let slider = Slider::new(&mut opacity, 0.0..=1.0).text("opacity");
        if ui.add_enabled(chosen != Overlay::None, slider).changed() {
            viewer.engine_mut().set_overlay_opacity(opacity);
        }
    }

    pub(super) fn record(&mut self, ui: &mut Ui, viewer: &mut Viewer, actions: &mut Vec<Action>) {
        ui.horizontal_wrapped(|ui| {
            let recording = viewer
                .recording()
                .map_or("record".into(), |at| format!("stop ({at:.1} s)"));
            command(ui, actions, &recording, Command::Record);
            let replaying = viewer
                .replaying()
                .map_or("replay".into(), |at| format!("stop ({at:.1} s)"));
            command(ui, actions, &replaying, Command::Replay);
            command(ui, actions, "turntable", Command::Turntable);
            if ui.button("save path").clicked() {
                actions.push(Action::SavePath);
            }
        });
        ui.horizontal_wrapped(|ui| {
            command(ui, actions, "picture (PNG)", Command::Screenshot);
            command(ui, actions, "radiance (EXR)", Command::Radiance);
        });
        ui.horizontal(|ui| {
            if ui.button("turntable video").clicked() {
                actions.push(Action::Turntable(self.turntable_frames));
            }
            ui.add(Slider::new(&mut self.turntable_frames, 1..=600).text("frames"));
        });
    }
}

fn command(ui: &mut Ui, actions: &mut Vec<Action>, text: &str, command: Command) {
    if ui.button(text).clicked() {
        actions.push(Action::Command(command));
    }
}

/// A slider over bytes; they change only where it moves, so that what was given to the byte stays so.
fn mebibytes(ui: &mut Ui, text: &str, bytes: &mut u64, range: std::ops::RangeInclusive<f64>) {
    let mut value = *bytes as f64 / MIB;
    let slider = Slider::new(&mut value, range).logarithmic(true).max_decimals(2);
    if ui.add(slider.text(text)).changed() {
        *bytes = (value * MIB) as u64;
    }
}

/// A row of names of which one is chosen; another one that was clicked.
fn one_of<T: Copy + PartialEq>(ui: &mut Ui, label: &str, now: T, choices: [(T, &str); 2]) -> Option<T> {
    let mut chosen = now;
    ui.horizontal(|ui| {
        ui.label(label);
        for (value, name) in choices {
            ui.selectable_value(&mut chosen, value, name);
        }
    });
    (chosen != now).then_some(chosen)
}
