//! Which key means what, and the text that says so.

/// What is done while a key is down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Hold {
    /// Towards what is seen.
    Forward,
    /// Away from it.
    Back,
    /// Sideways.
    Left,
    /// Sideways.
    Right,
    /// Upwards.
    Up,
    /// Downwards.
    Down,
    /// Around it, or the view.
    TurnLeft,
    /// Around it, or the view.
    TurnRight,
    /// Over it, or the view.
    TurnUp,
    /// Under it, or the view.
    TurnDown,
    /// All of these, faster.
    Fast,
    /// Dragging turns the light.
    Light,
}

/// What is done once when a key goes down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Orbit or fly.
    ToggleMode,
    /// Camera and light as in the beginning.
    Reset,
    /// The next shape of a lone archive.
    NextShape,
    /// The next overlay.
    NextOverlay,
    /// The overlay before.
    PreviousOverlay,
    /// A third of a stop.
    Brighter,
    /// A third of a stop.
    Darker,
    /// Chooses the next light.
    NextLight,
    /// One more light, from the camera.
    AddLight,
    /// Removes the chosen light.
    RemoveLight,
    /// Begins or ends recording a camera path.
    Record,
    /// Begins or ends replaying it.
    Replay,
    /// Once around the middle.
    Turntable,
    /// Asks again for what could not be had.
    Retry,
    /// Beside the picture with all resident. The program's, which must have a source for it.
    Split,
    /// The panel. The program's.
    Panel,
    /// The keys. The program's.
    Help,
    /// The picture to a file. The program's.
    Screenshot,
    /// Its radiance to a file. The program's.
    Radiance,
    /// Whatever is open is closed. The program's.
    Escape,
}

/// What a key means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binding {
    /// While it is down.
    Hold(Hold),
    /// Once.
    Press(Command),
}

/// What a key means, by its code and whether shift is down.
pub fn binding(code: &str, shift: bool) -> Option<Binding> {
    use Binding::{Hold as H, Press as P};
    Some(match (code, shift) {
        ("KeyW", _) => H(Hold::Forward),
        ("KeyS", _) => H(Hold::Back),
        ("KeyA", _) => H(Hold::Left),
        ("KeyD", _) => H(Hold::Right),
        ("KeyE", _) => H(Hold::Up),
        ("KeyQ", _) => H(Hold::Down),
        ("ArrowLeft", _) => H(Hold::TurnLeft),
        ("ArrowRight", _) => H(Hold::TurnRight),
        ("ArrowUp", _) => H(Hold::TurnUp),
        ("ArrowDown", _) => H(Hold::TurnDown),
        ("NumpadAdd" | "Equal", _) => H(Hold::Forward),
        ("NumpadSubtract" | "Minus", _) => H(Hold::Back),
        ("ShiftLeft" | "ShiftRight", _) => H(Hold::Fast),
        ("KeyL", _) => H(Hold::Light),
        ("KeyF", _) => P(Command::ToggleMode),
        ("KeyR" | "Home", _) => P(Command::Reset),
        ("KeyM", _) => P(Command::NextShape),
        ("KeyO", false) => P(Command::NextOverlay),
        ("KeyO", true) => P(Command::PreviousOverlay),
        ("BracketRight", _) => P(Command::Brighter),
        ("BracketLeft", _) => P(Command::Darker),
        ("KeyN", _) => P(Command::NextLight),
        ("Insert", _) => P(Command::AddLight),
        ("Delete", _) => P(Command::RemoveLight),
        ("KeyV", _) => P(Command::Record),
        ("Space", _) => P(Command::Replay),
        ("KeyT", _) => P(Command::Turntable),
        ("F5", _) => P(Command::Retry),
        ("KeyB", _) => P(Command::Split),
        ("KeyP", _) => P(Command::Panel),
        ("Slash" | "F1" | "KeyH", _) => P(Command::Help),
        ("KeyC", _) => P(Command::Screenshot),
        ("KeyX", _) => P(Command::Radiance),
        ("Escape", _) => P(Command::Escape),
        _ => return None,
    })
}

/// What a help page says: keys or gestures, and what they do.
pub const HELP: &[(&str, &str)] = &[
    ("drag", "turn around the middle; when flying, look around"),
    ("right drag, Shift+drag", "move sideways"),
    ("wheel, + and -", "nearer and further"),
    ("L+drag, Ctrl+drag", "turn the chosen light"),
    ("two fingers", "nearer, further, sideways"),
    ("three fingers", "turn the chosen light"),
    ("W A S D, Q E", "forward, left, back, right, down, up"),
    ("arrows", "turn"),
    ("Shift", "faster"),
    ("F", "orbit or fly"),
    ("R, Home", "camera and light as in the beginning"),
    ("M", "next shape: plane, sphere, cylinder, cloth"),
    ("O, Shift+O", "next overlay, the one before"),
    ("[ and ]", "darker, brighter by a third of a stop"),
    ("N, Insert, Delete", "choose the next light, add one, remove it"),
    ("V, Space", "record a camera path, replay it"),
    ("T", "turntable"),
    ("C", "picture to a PNG"),
    ("P", "panel"),
    ("?, H", "these keys"),
];

/// The same of what only a window of the desktop does.
pub const WINDOW_HELP: &[(&str, &str)] = &[
    ("X", "radiance to an EXR"),
    ("B", "beside the picture with everything resident"),
    ("F5", "ask the server again"),
    ("Ctrl+Q", "close the window"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_mean_one_thing() {
        assert_eq!(binding("KeyW", true), Some(Binding::Hold(Hold::Forward)));
        assert_eq!(binding("KeyO", false), Some(Binding::Press(Command::NextOverlay)));
        assert_eq!(
            binding("KeyO", true),
            Some(Binding::Press(Command::PreviousOverlay))
        );
        assert_eq!(binding("keyw", false), None);
        assert_eq!(binding("", false), None);
    }
}
