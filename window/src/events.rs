//! From winit's events to the viewer's, and what the program tells on standard output.

use std::io::Write as _;

use engine::gpu::Area;
use glam::Vec2;
use serde_json::{Value, json};
use viewer::{
    Connection, Input, Report,
    input::{Button, Modifiers, Phase},
};
use winit::{
    event::{ElementState, MouseButton, MouseScrollDelta, TouchPhase, WindowEvent},
    keyboard::{KeyCode, ModifiersState, PhysicalKey},
};

/// Pixels that a line of the wheel stands for.
const LINE: f32 = 50.0;

/// What has to be remembered between events.
#[derive(Default)]
pub(crate) struct Translator {
    modifiers: ModifiersState,
    pointer: Vec2,
}

impl Translator {
    /// Whether it is the key that closes windows: Ctrl+Q or Ctrl+W, on a Mac with the command key.
    pub(crate) fn quits(&self, event: &WindowEvent) -> bool {
        let held = self.modifiers.control_key() || self.modifiers.super_key();
        let WindowEvent::KeyboardInput { event, .. } = event else {
            return false;
        };
        let key = event.physical_key;
        let quits = [KeyCode::KeyQ, KeyCode::KeyW]
            .map(PhysicalKey::Code)
            .contains(&key);
        held && quits && event.state == ElementState::Pressed
    }

    /// What an event means, if anything, for a picture in this area of the window; its keys' codes go through `code`.
    pub(crate) fn input<'a>(
        &mut self,
        event: &WindowEvent,
        area: Area,
        code: &'a mut String,
    ) -> Option<Input<'a>> {
        let origin = Vec2::new(area.x as f32, area.y as f32);
        match event {
            WindowEvent::ModifiersChanged(modifiers) => {
                self.modifiers = modifiers.state();
                None
            }
            WindowEvent::CursorMoved { position, .. } => {
                self.pointer = Vec2::new(position.x as f32, position.y as f32) - origin;
                Some(Input::Move { at: self.pointer })
            }
            WindowEvent::MouseInput { state, button, .. } => {
                if *state == ElementState::Released {
                    return Some(Input::Up);
                }
                let button = match button {
                    MouseButton::Left => Button::Primary,
                    MouseButton::Right => Button::Secondary,
                    MouseButton::Middle => Button::Middle,
                    _ => return None,
                };
                let modifiers = Modifiers {
                    shift: self.modifiers.shift_key(),
                    control: self.modifiers.control_key() || self.modifiers.super_key(),
                };
                Some(Input::Down {
                    button,
                    at: self.pointer,
                    modifiers,
                })
            }
            WindowEvent::MouseWheel { delta, .. } => Some(Input::Wheel {
                pixels: match delta {
                    MouseScrollDelta::LineDelta(_, lines) => lines * LINE,
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y as f32,
                },
            }),
            WindowEvent::Touch(touch) => Some(Input::Touch {
                id: touch.id,
                phase: match touch.phase {
                    TouchPhase::Started => Phase::Start,
                    TouchPhase::Moved => Phase::Move,
                    TouchPhase::Ended | TouchPhase::Cancelled => Phase::End,
                },
                at: Vec2::new(touch.location.x as f32, touch.location.y as f32) - origin,
            }),
            WindowEvent::KeyboardInput { event, .. } => {
                let PhysicalKey::Code(key) = event.physical_key else {
                    return None;
                };
                *code = name(key);
                Some(Input::Key {
                    code,
                    down: event.state == ElementState::Pressed,
                    repeat: event.repeat,
                    shift: self.modifiers.shift_key(),
                })
            }
            WindowEvent::Focused(false) => Some(Input::Blur),
            _ => None,
        }
    }
}

/// The W3C's name of a key, which winit's are.
fn name(key: KeyCode) -> String {
    format!("{key:?}")
}

/// Tells what has changed, a JSON object a line, for programs that drive this one.
#[derive(Default)]
pub(crate) struct Teller {
    on: bool,
    opened: bool,
    shown: bool,
    settled: bool,
    connection: Connection,
}

impl Teller {
    pub(crate) fn new(on: bool) -> Self {
        Self {
            on,
            ..Self::default()
        }
    }

    /// One thing that has happened. Nobody may read it any more: that is no failure of a window.
    pub(crate) fn tell(&self, event: &str, detail: &Value) {
        if self.on {
            let mut output = std::io::stdout().lock();
            let line = json!({ "event": event, "detail": detail });
            let _ = writeln!(output, "{line}").and_then(|()| output.flush());
        }
    }

    /// After a frame that is on the screen.
    pub(crate) fn follow(&mut self, report: &Report, size: (u32, u32)) {
        if !std::mem::replace(&mut self.opened, true) {
            self.tell("opened", &json!({ "width": size.0, "height": size.1 }));
        }
        if report.shown && !std::mem::replace(&mut self.shown, true) {
            self.tell(
                "first_picture",
                &json!({ "wire_bytes": report.frame.wire_bytes_total }),
            );
        }
        if std::mem::replace(&mut self.settled, report.frame.settled) != report.frame.settled
            && report.frame.settled
        {
            let frame = &report.frame;
            self.tell(
                "settled",
                &json!({ "pages": frame.pages_resident, "predicted_rms": frame.predicted_rms }),
            );
        }
        if report.connection != self.connection {
            self.connection = report.connection.clone();
            self.tell("connection", &json!(self.connection));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_have_the_names_that_the_viewer_knows() {
        for (key, code) in [
            (KeyCode::KeyW, "KeyW"),
            (KeyCode::ArrowLeft, "ArrowLeft"),
            (KeyCode::BracketLeft, "BracketLeft"),
            (KeyCode::ShiftLeft, "ShiftLeft"),
            (KeyCode::Space, "Space"),
            (KeyCode::F5, "F5"),
            (KeyCode::Slash, "Slash"),
            (KeyCode::Insert, "Insert"),
            (KeyCode::NumpadAdd, "NumpadAdd"),
            (KeyCode::Escape, "Escape"),
        ] {
            assert_eq!(name(key), code);
            assert!(viewer::keys::binding(code, false).is_some(), "{code}");
        }
    }
}
