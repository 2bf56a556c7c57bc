//! Camera paths: recorded while the user moves, replayed, and turntables.

use std::f32::consts::TAU;

use glam::Quat;
use scenes::{
    Camera, CameraPath,
    camera_path::{Key, MAX_KEYS},
};

/// Keys in a second while recording; between them the path is smooth.
const KEYS_PER_SECOND: f32 = 10.0;

/// Takes the camera down while it moves.
#[derive(Clone, Debug, Default)]
pub struct Recorder {
    keys: Vec<Key>,
    time: f32,
}

impl Recorder {
    /// The camera so many seconds after the last call. Returns whether there is room for more.
    pub fn add(&mut self, seconds: f32, camera: &Camera) -> bool {
        self.time += seconds.max(0.0);
        let last = self.keys.last().map(|key| key.time);
        if last.is_none_or(|last| self.time - last >= 1.0 / KEYS_PER_SECOND) && camera.problem().is_none() {
            self.keys.push(Key {
                time: self.time,
                camera: *camera,
            });
        }
        self.keys.len() < MAX_KEYS
    }

    /// Seconds since the start.
    pub fn seconds(&self) -> f32 {
        self.time
    }

    /// The path; `None` if nothing was recorded.
    pub fn finish(self) -> Option<CameraPath> {
        CameraPath::new(self.keys).ok()
    }
}

/// A motion that can be replayed.
#[derive(Clone, Debug)]
pub enum Motion {
    /// A recorded path.
    Path(CameraPath),
    /// Once around the vertical through what this camera looks at.
    Turntable {
        /// At the start and the end.
        camera: Camera,
        /// Of the whole turn.
        seconds: f32,
    },
}

impl Motion {
    /// Seconds from start to end.
    pub fn seconds(&self) -> f32 {
        match self {
            Motion::Path(path) => path.duration(),
            Motion::Turntable { seconds, .. } => *seconds,
        }
    }

    /// The camera at a time from the start.
    pub fn at(&self, time: f32) -> Camera {
        match self {
            Motion::Path(path) => path.sample(path.keys()[0].time + time),
            Motion::Turntable { camera, seconds } => turned(camera, time / seconds.max(1e-3)),
        }
    }

    /// `count` cameras, evenly spaced: along a path with both ends, around a turntable without the last, which is the first.
    pub fn frames(&self, count: usize) -> Vec<Camera> {
        match self {
            Motion::Path(path) => path.frames(count).collect(),
            Motion::Turntable { camera, .. } => (0..count)
                .map(|frame| turned(camera, frame as f32 / count as f32))
                .collect(),
        }
    }
}

/// A motion that is being replayed.
#[derive(Clone, Debug)]
pub struct Player {
    motion: Motion,
    time: f32,
}

impl Player {
    /// From the start.
    pub fn new(motion: Motion) -> Self {
        Self { motion, time: 0.0 }
    }

    /// The camera so many seconds later, and whether that is before the end.
    pub fn advance(&mut self, seconds: f32) -> (Camera, bool) {
        self.time += seconds.max(0.0);
        let end = self.motion.seconds();
        (self.motion.at(self.time.min(end)), self.time < end)
    }

    /// Seconds since the start.
    pub fn seconds(&self) -> f32 {
        self.time
    }
}

/// The camera after a share of a turn.
fn turned(camera: &Camera, share: f32) -> Camera {
    let turn = Quat::from_rotation_y(share.fract() * TAU);
    Camera {
        eye: camera.target + turn * (camera.eye - camera.target),
        up: turn * camera.up,
        ..*camera
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn camera(x: f32) -> Camera {
        Camera {
            eye: Vec3::new(x, 1.0, 3.0),
            target: Vec3::ZERO,
            up: Vec3::Y,
            fov_y: 0.7,
            near: 0.01,
        }
    }

    #[test]
    fn what_was_recorded_is_replayed() {
        let mut recorder = Recorder::default();
        for frame in 0..120u8 {
            assert!(recorder.add(1.0 / 60.0, &camera(f32::from(frame) / 60.0)));
        }
        let path = recorder.finish().unwrap();
        assert!((18..=21).contains(&path.keys().len()), "{}", path.keys().len());
        let mut player = Player::new(Motion::Path(path));
        let mut seen = Vec::new();
        loop {
            let (camera, more) = player.advance(1.0 / 30.0);
            seen.push(camera.eye.x);
            if !more {
                break;
            }
        }
        assert!(seen.windows(2).all(|pair| pair[1] >= pair[0] - 1e-4));
        assert!((seen[seen.len() / 2] - 1.0).abs() < 0.1, "{seen:?}");
        assert!(Recorder::default().finish().is_none());
    }

    #[test]
    fn a_turntable_goes_once_around() {
        let motion = Motion::Turntable {
            camera: camera(1.0),
            seconds: 4.0,
        };
        let frames = motion.frames(8);
        for frame in &frames {
            assert_eq!(frame.problem(), None);
            assert!((frame.eye.length() - camera(1.0).eye.length()).abs() < 1e-4);
            assert!((frame.eye.y - 1.0).abs() < 1e-5);
        }
        assert!((frames[4].eye.x + frames[0].eye.x).abs() < 1e-4);
        assert!(frames[7].eye.distance(frames[0].eye) > 0.5);
        assert!(motion.at(4.0).eye.distance(camera(1.0).eye) < 1e-3);
    }
}
