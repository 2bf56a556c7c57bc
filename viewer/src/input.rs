//! What users do, as plain events: positions in pixels of the picture, from its upper left corner.

use glam::Vec2;

/// A button of the pointer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    /// Mostly the left one; also a pen.
    Primary,
    /// Mostly the right one.
    Secondary,
    /// The wheel.
    Middle,
}

/// Keys that were down with a button.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Modifiers {
    /// Shift: pans instead of turning.
    pub shift: bool,
    /// Control, or command: turns the light instead of the camera.
    pub control: bool,
}

/// What becomes of a finger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// It is put down.
    Start,
    /// It moves.
    Move,
    /// It is lifted, or the system has taken the gesture for itself.
    End,
}

/// Something that a user does. Values that are not finite are ignored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Input<'a> {
    /// A button goes down.
    Down {
        /// Which.
        button: Button,
        /// Where.
        at: Vec2,
        /// With which keys.
        modifiers: Modifiers,
    },
    /// The pointer moves, with or without a button.
    Move {
        /// To where.
        at: Vec2,
    },
    /// Buttons are released.
    Up,
    /// The wheel turns.
    Wheel {
        /// Pixels; positive away from the user, which goes nearer. A notch is about 50.
        pixels: f32,
    },
    /// A finger.
    Touch {
        /// Which; the same from start to end.
        id: u64,
        /// What becomes of it.
        phase: Phase,
        /// Where.
        at: Vec2,
    },
    /// A key goes down or up, by its `code` as in the W3C's "UI Events KeyboardEvent code Values": `KeyW`, `ArrowLeft`.
    Key {
        /// The key's place on the keyboard.
        code: &'a str,
        /// Down, or up.
        down: bool,
        /// It has been down for long and repeats.
        repeat: bool,
        /// With shift.
        shift: bool,
    },
    /// The keyboard belongs to somebody else from now on: no key is down any more, no button either.
    Blur,
}
