//! The panel beside the picture.

mod settings;
mod shown;

use egui::{CollapsingHeader, Panel as Side, Rect, ScrollArea, Ui};
use viewer::{Command, Viewer, quality::Quality};

use crate::{maps::CacheColor, notices};

/// Width of the panel, points.
const WIDTH: f32 = 300.0;
/// Seconds for which something that was said stays.
const SAID_SECONDS: f64 = 6.0;

/// What a button asks for that the panel cannot do.
pub(crate) enum Action {
    Command(Command),
    /// Frames of a video, once around.
    Turntable(usize),
    SavePath,
}

/// What the panel remembers.
pub(crate) struct Panel {
    pub(crate) open: bool,
    pub(crate) help: bool,
    /// Where the picture of full residency begins, from 0 to 1.
    pub(crate) split: f32,
    /// Pixels of the picture for one of the window, each way.
    pub(crate) resolution: f32,
    said: Option<(String, Option<f64>)>,
    quality: Quality,
    cache_color: CacheColor,
    /// Whose page tree is shown.
    tree: usize,
    turntable_frames: usize,
}

impl Panel {
    pub(crate) fn new(open: bool, viewer: &Viewer) -> Self {
        let budgets = viewer.budgets();
        Self {
            open,
            help: false,
            split: 0.5,
            resolution: 1.0,
            said: None,
            quality: Quality {
                target_rms: 0.01,
                most_bytes: (budgets.page_cache_bytes + budgets.column_cache_bytes).max(64 << 20),
            },
            cache_color: CacheColor::Material,
            tree: 0,
            turntable_frames: 120,
        }
    }

    /// Says something for some seconds.
    pub(crate) fn say(&mut self, text: String) {
        self.said = Some((text, None));
    }

    /// Says what went wrong with a change that the user asked for.
    fn check(&mut self, result: engine::Result<()>) {
        if let Err(error) = result {
            self.say(error.to_string());
        }
    }

    /// Everything but the picture; returns where that goes.
    pub(crate) fn show(&mut self, ui: &mut Ui, viewer: &mut Viewer, actions: &mut Vec<Action>) -> Rect {
        let context = ui.ctx().clone();
        if self.open {
            Side::right("panel").exact_size(WIDTH).show(ui, |ui| {
                ScrollArea::vertical()
                    .auto_shrink(false)
                    .show(ui, |ui| self.sections(ui, viewer, actions));
            });
        }
        let picture = ui.available_rect_before_wrap();
        notices::legend(&context, picture, viewer.engine().overlay());
        notices::progress(&context, picture, viewer.report());
        notices::banner(&context, picture, viewer.report(), actions);
        if self.help {
            notices::help(&context, &mut self.help);
        }
        if let Some((text, until)) = &mut self.said {
            let now = context.input(|input| input.time);
            if now > *until.get_or_insert(now + SAID_SECONDS) {
                self.said = None;
            } else {
                notices::said(&context, picture, text);
            }
        }
        if viewer.reference().is_some() {
            self.divide(ui, picture);
        }
        picture
    }

    /// The line between the two pictures, which can be dragged.
    fn divide(&mut self, ui: &mut Ui, picture: Rect) {
        let x = picture.left() + picture.width() * self.split;
        let line = Rect::from_x_y_ranges(x - 4.0..=x + 4.0, picture.y_range());
        egui::Area::new(egui::Id::unique("split"))
            .order(egui::Order::Middle)
            .fixed_pos(line.min)
            .show(ui.ctx(), |ui| {
                let (rect, response) = ui.allocate_exact_size(line.size(), egui::Sense::drag());
                let stroke = egui::Stroke::new(1.5, egui::Color32::WHITE);
                ui.painter().vline(rect.center().x, rect.y_range(), stroke);
                if response.dragged() {
                    let moved = response.drag_delta().x / picture.width().max(1.0);
                    self.split = (self.split + moved).clamp(0.02, 0.98);
                }
                response.on_hover_cursor(egui::CursorIcon::ResizeHorizontal);
            });
    }

    fn sections(&mut self, ui: &mut Ui, viewer: &mut Viewer, actions: &mut Vec<Action>) {
        shown::state(ui, viewer);
        section(ui, "Camera and light", true, |ui| {
            self.camera(ui, viewer, actions)
        });
        section(ui, "Budgets", true, |ui| self.budgets(ui, viewer));
        section(ui, "Quality", false, |ui| self.filters(ui, viewer));
        section(ui, "Overlay", true, |ui| self.overlay(ui, viewer));
        section(ui, "Course", true, |ui| shown::course(ui, viewer));
        section(ui, "Materials", false, |ui| shown::materials(ui, viewer));
        section(ui, "Page cache", false, |ui| self.cache(ui, viewer));
        section(ui, "Page tree", false, |ui| self.page_tree(ui, viewer));
        section(ui, "Record", false, |ui| self.record(ui, viewer, actions));
        section(ui, "Link", false, |ui| {
            ui.label("Give this to --link, or to the address of a page:");
            ui.add(egui::Label::new(egui::RichText::new(viewer.link().to_string()).monospace()).wrap());
        });
        let problems = &viewer.report().problems;
        if !problems.is_empty() {
            section(ui, "Problems", false, |ui| {
                for problem in problems.iter().rev() {
                    ui.label(problem);
                }
            });
        }
    }
}

fn section(ui: &mut Ui, title: &str, open: bool, contents: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(title).default_open(open).show(ui, contents);
}
