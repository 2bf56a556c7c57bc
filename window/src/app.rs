//! The event loop: what happens, and when there is something to draw.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use egui::{ViewportId, ViewportOutput};
use engine::{frame::Options, gpu::Area};
use serde_json::json;
use viewer::{Command, Viewer, recorder::Motion};
use winit::{
    application::ApplicationHandler,
    dpi::PhysicalSize,
    event::{StartCause, WindowEvent},
    event_loop::{ActiveEventLoop, ControlFlow},
    window::{Window, WindowId},
};

use crate::{
    Show,
    events::{Teller, Translator},
    panel::{Action, Panel},
    shots::{self, Video},
    surface::{Painted, Surface},
};

/// Pause between frames in which nothing moves: an archive may have changed, a host may be there again.
const AT_REST: Duration = Duration::from_millis(250);

/// A window's life.
pub(crate) struct App {
    /// Until the window opens.
    show: Option<Show>,
    open: Option<Open>,
    /// What ended it, if that was an error.
    failure: Option<anyhow::Error>,
}

/// An open window.
struct Open {
    window: Arc<Window>,
    surface: Surface,
    viewer: Viewer,
    panel: Panel,
    egui: egui_winit::State,
    translator: Translator,
    teller: Teller,
    show: Show,
    /// Of the window, that the picture takes.
    area: Area,
    last: Instant,
    /// A video that is being written.
    video: Option<Video>,
}

impl App {
    pub(crate) fn new(show: Show) -> Self {
        Self {
            show: Some(show),
            open: None,
            failure: None,
        }
    }

    /// After the end: what was wrong.
    pub(crate) fn finish(self) -> Result<()> {
        self.failure.map_or(Ok(()), Err)
    }

    fn attempt(&mut self, event_loop: &ActiveEventLoop, what: impl FnOnce(&mut Self) -> Result<()>) {
        if let Err(error) = what(self) {
            self.failure.get_or_insert(error);
            event_loop.exit();
        }
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if let Some(show) = self.show.take() {
            self.attempt(event_loop, |app| {
                app.open = Some(Open::new(event_loop, show)?);
                Ok(())
            });
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(open)) = (cause, &self.open) {
            open.window.request_redraw();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        self.attempt(event_loop, |app| {
            let Some(open) = &mut app.open else { return Ok(()) };
            if matches!(event, WindowEvent::CloseRequested) {
                open.teller.tell("closed", &json!(null));
                event_loop.exit();
                return Ok(());
            }
            open.event(event_loop, &event)
        });
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // The surface goes before the connection to the display does.
        self.open = None;
    }
}

impl Open {
    fn new(event_loop: &ActiveEventLoop, show: Show) -> Result<Self> {
        let size = PhysicalSize::new(show.options.size.0, show.options.size.1);
        let attributes = Window::default_attributes()
            .with_title(format!("{} - Eigentile", show.title))
            .with_inner_size(size)
            .with_min_inner_size(PhysicalSize::new(320, 240));
        let window = event_loop
            .create_window(attributes)
            .context("no window can be opened")?;
        let window = Arc::new(window);
        let surface = Surface::new(&window)?;
        let options = Options {
            size: surface.size(),
            wait: false,
            ..show.options.clone()
        };
        let source = (show.open)()?;
        let mut viewer = Viewer::new(surface.context().clone(), show.subject.clone(), source, options)?;
        viewer.follow(&show.link)?;
        if let Some(path) = &show.path {
            viewer.set_motion(Motion::Path(path.clone()));
        }
        let context = egui::Context::default();
        let largest = surface.context().device().limits().max_texture_dimension_2d;
        let egui = egui_winit::State::new(
            context,
            ViewportId::ROOT,
            &window,
            Some(window.scale_factor() as f32),
            window.theme(),
            Some(largest as usize),
        );
        window.request_redraw();
        Ok(Self {
            area: Area {
                width: surface.size().0,
                height: surface.size().1,
                ..Area::default()
            },
            panel: Panel::new(show.panel, &viewer),
            teller: Teller::new(show.events),
            translator: Translator::default(),
            last: Instant::now(),
            video: None,
            window,
            surface,
            viewer,
            egui,
            show,
        })
    }

    fn event(&mut self, event_loop: &ActiveEventLoop, event: &WindowEvent) -> Result<()> {
        match event {
            WindowEvent::RedrawRequested => return self.draw(event_loop),
            WindowEvent::Resized(size) => self.surface.resize((size.width, size.height))?,
            _ => {}
        }
        if self.translator.quits(event) {
            self.teller.tell("closed", &json!(null));
            event_loop.exit();
            return Ok(());
        }
        let response = self.egui.on_window_event(&self.window, event);
        if response.repaint {
            self.window.request_redraw();
        }
        // What is released was pressed somewhere, and must not stay so.
        let released = matches!(event, WindowEvent::MouseInput { state, .. } if !state.is_pressed())
            || matches!(event, WindowEvent::KeyboardInput { event, .. } if !event.state.is_pressed());
        let mut code = String::new();
        if let Some(input) = self.translator.input(event, self.area, &mut code)
            && (!response.consumed || released)
            && !matches!(
                event,
                WindowEvent::KeyboardInput {
                    is_synthetic: true,
                    ..
                }
            )
        {
            if let Some(command) = self.viewer.input(input)? {
                self.command(command)?;
            }
            self.window.request_redraw();
        }
        Ok(())
    }

    /// A command that is not the viewer's.
    fn command(&mut self, command: Command) -> Result<()> {
        self.teller.tell("command", &json!(format!("{command:?}")));
        match command {
            Command::Panel => self.panel.open = !self.panel.open,
            Command::Help => self.panel.help = !self.panel.help,
            Command::Escape => {
                self.panel.help = false;
                self.video = None;
            }
            Command::Split => self.split()?,
            Command::Screenshot => self.shoot(shots::png),
            Command::Radiance => self.shoot(shots::exr),
            _ => {}
        }
        Ok(())
    }

    /// Begins or ends the picture beside.
    fn split(&mut self) -> Result<()> {
        let source = match self.viewer.reference() {
            Some(_) => None,
            None => Some((self.show.open)()?),
        };
        if let Err(error) = self.viewer.set_reference(source) {
            self.panel.say(format!("No picture beside: {error}"));
        }
        Ok(())
    }

    /// Writes files; what goes wrong with them does not end the window.
    fn shoot(&mut self, shot: fn(&mut Viewer, &Show) -> Result<String>) {
        let said =
            shot(&mut self.viewer, &self.show).unwrap_or_else(|error| format!("Not written: {error:#}"));
        self.teller.tell("written", &json!(said));
        self.panel.say(said);
    }

    fn draw(&mut self, event_loop: &ActiveEventLoop) -> Result<()> {
        let seconds = self.last.elapsed().as_secs_f32();
        self.last = Instant::now();
        let input = self.egui.take_egui_input(&self.window);
        let context = self.egui.egui_ctx().clone();
        let mut picture = egui::Rect::NOTHING;
        let mut actions = Vec::new();
        let output = context.run_ui(input, |ui| {
            actions.clear();
            picture = self.panel.show(ui, &mut self.viewer, &mut actions);
        });
        self.egui
            .handle_platform_output(&self.window, output.platform_output);
        let pixels_per_point = output.pixels_per_point;
        let mut painted = Painted {
            primitives: context.tessellate(output.shapes, pixels_per_point),
            textures: output.textures_delta,
            pixels_per_point,
        };
        for action in actions {
            self.act(action)?;
        }

        self.area = area(picture, pixels_per_point, self.surface.size());
        let scale = |side: u32| ((side as f32 * self.panel.resolution) as u32).max(1);
        self.viewer
            .resize((scale(self.area.width), scale(self.area.height)))?;
        if let Some(camera) = self.video.as_ref().and_then(Video::camera) {
            self.viewer.controls_mut().set_camera(camera);
        }
        self.viewer.frame(seconds)?;
        self.write_video();
        let on_screen = self
            .surface
            .show(&mut self.viewer, self.area, self.panel.split, &mut painted)?;
        if on_screen {
            self.teller.follow(self.viewer.report(), self.surface.size());
        }

        let repaint = output
            .viewport_output
            .get(&ViewportId::ROOT)
            .map_or(Duration::MAX, |root: &ViewportOutput| root.repaint_delay);
        if self.moving() || repaint.is_zero() {
            event_loop.set_control_flow(ControlFlow::Wait);
            self.window.request_redraw();
        } else {
            let next = Instant::now() + repaint.min(AT_REST);
            event_loop.set_control_flow(ControlFlow::WaitUntil(next));
        }
        Ok(())
    }

    fn write_video(&mut self) {
        let Some(video) = &mut self.video else { return };
        match video.follow(&self.viewer, &self.show) {
            Ok(said) => {
                if video.camera().is_none() {
                    self.video = None;
                    self.teller.tell("written", &json!(said));
                }
                self.panel.say(said);
            }
            Err(error) => {
                self.video = None;
                self.panel.say(format!("Not written: {error:#}"));
            }
        }
    }

    fn act(&mut self, action: Action) -> Result<()> {
        match action {
            Action::Command(command) => {
                if let Some(command) = self.viewer.command(command)? {
                    self.command(command)?;
                }
            }
            Action::Turntable(frames) => match Video::new(&self.viewer, &self.show, frames) {
                Ok(video) => self.video = Some(video),
                Err(error) => self.panel.say(format!("Not written: {error:#}")),
            },
            Action::SavePath => self.shoot(shots::path),
        }
        Ok(())
    }

    /// Whether the next frame will differ from this one.
    fn moving(&self) -> bool {
        !self.viewer.report().frame.settled
            || self.viewer.reference().is_some_and(|(_, stats)| !stats.settled)
            || self.video.is_some()
            || self.viewer.replaying().is_some()
            || self.viewer.recording().is_some()
    }
}

/// A rectangle in points as pixels of a window of this size: never outside of it, never empty.
fn area(rect: egui::Rect, pixels_per_point: f32, size: (u32, u32)) -> Area {
    let pixel = |points: f32, most: u32| (points * pixels_per_point).round().clamp(0.0, most as f32) as u32;
    let (x, y) = (pixel(rect.min.x, size.0 - 1), pixel(rect.min.y, size.1 - 1));
    Area {
        x,
        y,
        width: pixel(rect.max.x, size.0).max(x + 1) - x,
        height: pixel(rect.max.y, size.1).max(y + 1) - y,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_are_inside_of_the_window_and_not_empty() {
        let rect = |x0, y0, x1, y1| egui::Rect::from_min_max(egui::pos2(x0, y0), egui::pos2(x1, y1));
        let whole = area(rect(0.0, 0.0, 400.0, 300.0), 2.0, (800, 600));
        assert_eq!((whole.x, whole.y, whole.width, whole.height), (0, 0, 800, 600));
        for odd in [
            egui::Rect::NOTHING,
            egui::Rect::EVERYTHING,
            egui::Rect::NAN,
            rect(900.0, 900.0, 10.0, 10.0),
        ] {
            let area = area(odd, 1.5, (800, 600));
            assert!(area.width >= 1 && area.x + area.width <= 800, "{area:?}");
            assert!(area.height >= 1 && area.y + area.height <= 600, "{area:?}");
        }
    }
}
