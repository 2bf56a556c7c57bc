//! Fingers: what several of them do together.

use glam::Vec2;

use crate::input::Phase;

/// Most fingers that are followed.
const MOST: usize = 10;
/// Fingers nearer to each other than this do not pinch, pixels.
const LEAST_SPAN: f32 = 8.0;

/// Fingers are not further out than this, pixels, so that distances between them are finite.
const FURTHEST: f32 = 1e6;

/// Fingers that are down.
#[derive(Clone, Debug, Default)]
pub(crate) struct Fingers {
    down: Vec<(u64, Vec2)>,
}

/// What a change of one finger means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Gesture {
    /// Nothing.
    None,
    /// One finger has moved by so much.
    Drag(Vec2),
    /// Two fingers: by what their middle has moved, and how many times further apart they are.
    Pinch(Vec2, f32),
    /// Three fingers: what their middle has moved by.
    Light(Vec2),
}

impl Fingers {
    pub(crate) fn change(&mut self, id: u64, phase: Phase, at: Vec2) -> Gesture {
        let at = at.clamp(Vec2::splat(-FURTHEST), Vec2::splat(FURTHEST));
        let known = self.down.iter().position(|(finger, _)| *finger == id);
        match (phase, known) {
            (Phase::Start, None) if self.down.len() < MOST => self.down.push((id, at)),
            (Phase::Start | Phase::Move, Some(known)) => {
                let before = self.spread();
                self.down[known].1 = at;
                let after = self.spread();
                if phase == Phase::Start {
                    return Gesture::None;
                }
                let moved = after.0 - before.0;
                return match self.down.len() {
                    1 => Gesture::Drag(moved),
                    2 if before.1 > LEAST_SPAN && after.1 > LEAST_SPAN => {
                        Gesture::Pinch(moved, after.1 / before.1)
                    }
                    2 => Gesture::Pinch(moved, 1.0),
                    _ => Gesture::Light(moved),
                };
            }
            (Phase::End, Some(known)) => {
                self.down.remove(known);
            }
            _ => {}
        }
        Gesture::None
    }

    /// Whether exactly one finger is down.
    pub(crate) fn one(&self) -> bool {
        self.down.len() == 1
    }

    pub(crate) fn clear(&mut self) {
        self.down.clear();
    }

    /// The middle of all fingers, and the distance between the first two.
    fn spread(&self) -> (Vec2, f32) {
        let count = self.down.len().max(1) as f32;
        let middle = self.down.iter().map(|(_, at)| *at).sum::<Vec2>() / count;
        let apart = match &self.down[..] {
            [(_, a), (_, b), ..] => a.distance(*b),
            _ => 0.0,
        };
        (middle, apart)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fingers_drag_pinch_and_turn_the_light() {
        let mut fingers = Fingers::default();
        let at = Vec2::new;
        assert_eq!(fingers.change(1, Phase::Move, at(5.0, 5.0)), Gesture::None);
        fingers.change(1, Phase::Start, at(0.0, 0.0));
        assert_eq!(
            fingers.change(1, Phase::Move, at(3.0, 4.0)),
            Gesture::Drag(at(3.0, 4.0))
        );
        fingers.change(2, Phase::Start, at(103.0, 4.0));
        assert_eq!(
            fingers.change(2, Phase::Move, at(203.0, 4.0)),
            Gesture::Pinch(at(50.0, 0.0), 2.0)
        );
        fingers.change(3, Phase::Start, at(0.0, 4.0));
        assert_eq!(
            fingers.change(3, Phase::Move, at(0.0, 7.0)),
            Gesture::Light(at(0.0, 1.0))
        );
        fingers.change(1, Phase::End, at(0.0, 0.0));
        fingers.change(2, Phase::End, at(0.0, 0.0));
        assert!(fingers.one());
    }
}
