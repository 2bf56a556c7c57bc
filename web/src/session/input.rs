//! What users do: pointer, fingers, keys, and commands by name.

use glam::Vec2;
use viewer::{
    Command, Input,
    input::{Button, Modifiers, Phase},
};
use wasm_bindgen::prelude::*;

use super::Session;

#[wasm_bindgen]
impl Session {
    /// A button goes down: 0 the primary, 1 the middle, 2 the secondary one, as in the DOM.
    ///
    /// # Errors
    /// If the device fails.
    pub fn down(&mut self, button: u16, x: f32, y: f32, shift: bool, control: bool) -> Result<(), JsError> {
        let button = match button {
            0 => Button::Primary,
            1 => Button::Middle,
            _ => Button::Secondary,
        };
        let modifiers = Modifiers { shift, control };
        let at = Vec2::new(x, y);
        self.input(Input::Down {
            button,
            at,
            modifiers,
        })
        .map(drop)
    }

    /// The pointer moves.
    ///
    /// # Errors
    /// If the device fails.
    pub fn moved(&mut self, x: f32, y: f32) -> Result<(), JsError> {
        self.input(Input::Move { at: Vec2::new(x, y) }).map(drop)
    }

    /// Buttons are released.
    ///
    /// # Errors
    /// None that can happen.
    pub fn up(&mut self) -> Result<(), JsError> {
        self.input(Input::Up).map(drop)
    }

    /// The wheel turns by so many pixels; positive away from the user.
    ///
    /// # Errors
    /// None that can happen.
    pub fn wheel(&mut self, pixels: f32) -> Result<(), JsError> {
        self.input(Input::Wheel { pixels }).map(drop)
    }

    /// A finger starts (0), moves (1) or ends (2).
    ///
    /// # Errors
    /// If the device fails.
    pub fn touch(&mut self, id: u32, phase: u32, x: f32, y: f32) -> Result<(), JsError> {
        let phase = match phase {
            0 => Phase::Start,
            1 => Phase::Move,
            _ => Phase::End,
        };
        self.input(Input::Touch {
            id: id.into(),
            phase,
            at: Vec2::new(x, y),
        })
        .map(drop)
    }

    /// A key, by its DOM `code`, goes down or up. Returns a command that is the page's.
    ///
    /// # Errors
    /// If the device fails.
    pub fn key(
        &mut self,
        code: &str,
        down: bool,
        repeat: bool,
        shift: bool,
    ) -> Result<Option<String>, JsError> {
        self.input(Input::Key {
            code,
            down,
            repeat,
            shift,
        })
    }

    /// Nothing is pressed any more.
    ///
    /// # Errors
    /// None that can happen.
    pub fn blur(&mut self) -> Result<(), JsError> {
        self.input(Input::Blur).map(drop)
    }

    fn input(&mut self, input: Input<'_>) -> Result<Option<String>, JsError> {
        Ok(self.viewer.input(input)?.map(|command| name(command).to_owned()))
    }

    /// Does what a key would do; see `COMMANDS` in the package's `index.d.ts`. Returns whether there is such a command.
    ///
    /// # Errors
    /// If the device fails.
    pub fn command(&mut self, command: &str) -> Result<bool, JsError> {
        let Some((command, _)) = COMMANDS.iter().find(|(_, known)| *known == command) else {
            return Ok(false);
        };
        self.viewer.command(*command)?;
        Ok(true)
    }
}

const COMMANDS: [(Command, &str); 20] = [
    (Command::ToggleMode, "toggle-mode"),
    (Command::Reset, "reset"),
    (Command::NextShape, "next-shape"),
    (Command::NextOverlay, "next-overlay"),
    (Command::PreviousOverlay, "previous-overlay"),
    (Command::Brighter, "brighter"),
    (Command::Darker, "darker"),
    (Command::NextLight, "next-light"),
    (Command::AddLight, "add-light"),
    (Command::RemoveLight, "remove-light"),
    (Command::Record, "record"),
    (Command::Replay, "replay"),
    (Command::Turntable, "turntable"),
    (Command::Retry, "retry"),
    (Command::Split, "split"),
    (Command::Panel, "panel"),
    (Command::Help, "help"),
    (Command::Screenshot, "screenshot"),
    (Command::Radiance, "radiance"),
    (Command::Escape, "escape"),
];

fn name(command: Command) -> &'static str {
    let known = COMMANDS.iter().find(|(known, _)| *known == command);
    known.map_or("", |(_, name)| name)
}
