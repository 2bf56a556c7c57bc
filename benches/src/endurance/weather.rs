//! What goes wrong, and when.

use engine::stream::Faults;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::Rng;
use serde::Serialize;

/// What a line is like for some seconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Weather {
    /// As it should be.
    Clear,
    /// Every request fails.
    Lost,
    /// Every request fails, for a second: those in flight, too.
    Restarted,
    /// One record in five has a wrong byte, and one in five comes twice.
    Corrupt,
    /// A twentieth of the line.
    Slow,
}

impl Weather {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Clear,
        Self::Lost,
        Self::Restarted,
        Self::Corrupt,
        Self::Slow,
    ];

    /// Half of the time clear, otherwise any other.
    pub(super) fn draw(random: &mut ChaCha8Rng) -> Self {
        let which = random.next_u32() as usize % 8;
        Self::ALL
            .get(which.saturating_sub(3))
            .copied()
            .unwrap_or(Self::Clear)
    }

    /// Seconds that it lasts.
    pub(super) fn seconds(self, random: &mut ChaCha8Rng) -> f64 {
        match self {
            Self::Restarted => 1.0,
            _ => 2.0 + 8.0 * unit(random),
        }
    }

    pub(super) fn faults(self) -> Faults {
        match self {
            Self::Clear | Self::Slow => Faults::default(),
            Self::Lost | Self::Restarted => Faults {
                fail: 1.0,
                ..Faults::default()
            },
            Self::Corrupt => Faults {
                damage: 0.2,
                repeat: 0.2,
                ..Faults::default()
            },
        }
    }

    /// Part of the time that passes on the line.
    pub(super) fn speed(self) -> f64 {
        if self == Self::Slow { 0.05 } else { 1.0 }
    }
}

/// Uniform in [0, 1).
pub(super) fn unit(random: &mut ChaCha8Rng) -> f64 {
    f64::from(random.next_u32()) * 0.5f64.powi(32)
}
