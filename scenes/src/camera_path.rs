//! Recorded camera paths: key frames in JSON, and smooth movement between them. docs/scenes.md gives the format.

use std::path::Path;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::{Camera, Error, Result, file};

/// Most keys of a path.
pub const MAX_KEYS: usize = 100_000;
/// Largest accepted file, bytes.
const MAX_FILE_BYTES: u64 = 64 << 20;

/// A camera and when it is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Seconds from the start.
    pub time: f32,
    /// The camera then.
    pub camera: Camera,
}

/// Key frames, ascending in time, and what happens between them: eye and target follow a cubic Hermite
/// spline through the keys that starts and ends at rest; up and field of view ease from key to key.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    keys: Vec<Key>,
}

/// The file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileForm {
    keys: Vec<KeyForm>,
}

/// A key in the file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyForm {
    time: f32,
    eye: [f32; 3],
    target: [f32; 3],
    #[serde(default = "up")]
    up: [f32; 3],
    #[serde(default = "fov_degrees")]
    fov_degrees: f32,
    #[serde(default = "near")]
    near: f32,
}

fn up() -> [f32; 3] {
    [0.0, 1.0, 0.0]
}

fn fov_degrees() -> f32 {
    40.0
}

fn near() -> f32 {
    0.01
}

impl CameraPath {
    /// A path through these keys.
    ///
    /// # Errors
    /// What is wrong and in which key: no keys or more than [`MAX_KEYS`], times that do not ascend, a camera
    /// with a [`Camera::problem`].
    pub fn new(keys: Vec<Key>) -> std::result::Result<Self, String> {
        if keys.is_empty() || keys.len() > MAX_KEYS {
            return Err(format!("{} keys; a path has 1 to {MAX_KEYS}", keys.len()));
        }
        for (index, key) in keys.iter().enumerate() {
            if let Some(problem) = key.camera.problem() {
                return Err(format!("key {index} {problem}"));
            }
            if !key.time.is_finite() || (index > 0 && key.time <= keys[index - 1].time) {
                return Err(format!(
                    "key {index} is at {} s; times must be finite and ascend",
                    key.time
                ));
            }
        }
        Ok(Self { keys })
    }

    /// The keys.
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// Seconds from the first key to the last.
    pub fn duration(&self) -> f32 {
        self.keys[self.keys.len() - 1].time - self.keys[0].time
    }

    /// The camera at a time; before the first key the first, after the last the last.
    pub fn sample(&self, time: f32) -> Camera {
        let after = self.keys.partition_point(|key| key.time <= time);
        if after == 0 {
            return self.keys[0].camera;
        }
        if after == self.keys.len() {
            return self.keys[after - 1].camera;
        }
        let (from, to) = (self.keys[after - 1], self.keys[after]);
        let span = to.time - from.time;
        let s = (time - from.time) / span;
        let ease = s * s * (3.0 - 2.0 * s);
        let along = |point: fn(&Camera) -> Vec3| {
            let start = self.velocity(after - 1, point) * span;
            let end = self.velocity(after, point) * span;
            hermite(point(&from.camera), start, point(&to.camera), end, s)
        };
        Camera {
            eye: along(|camera| camera.eye),
            target: along(|camera| camera.target),
            up: from
                .camera
                .up
                .lerp(to.camera.up, ease)
                .try_normalize()
                .unwrap_or(from.camera.up),
            fov_y: from.camera.fov_y + (to.camera.fov_y - from.camera.fov_y) * ease,
            near: from.camera.near + (to.camera.near - from.camera.near) * ease,
        }
    }

    /// `count` cameras, evenly spaced in time from the first key to the last.
    pub fn frames(&self, count: usize) -> impl Iterator<Item = Camera> + '_ {
        let steps = count.saturating_sub(1).max(1) as f32;
        (0..count).map(move |frame| self.sample(self.keys[0].time + self.duration() * frame as f32 / steps))
    }

    /// Velocity at a key: that of the parabola through it and its neighbours; zero at both ends.
    fn velocity(&self, key: usize, point: fn(&Camera) -> Vec3) -> Vec3 {
        if key == 0 || key + 1 == self.keys.len() {
            return Vec3::ZERO;
        }
        let [before, here, after] = [key - 1, key, key + 1].map(|index| self.keys[index]);
        let (span_in, span_out) = (here.time - before.time, after.time - here.time);
        let velocity_in = (point(&here.camera) - point(&before.camera)) / span_in;
        let velocity_out = (point(&after.camera) - point(&here.camera)) / span_out;
        (velocity_in * span_out + velocity_out * span_in) / (span_in + span_out)
    }

    /// Reads a path from a JSON file.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Invalid`] that names the line or key.
    pub fn load(path: &Path) -> Result<Self> {
        let bytes = file::read(path, MAX_FILE_BYTES)?;
        let invalid = |detail: String| Error::Invalid {
            path: path.into(),
            detail,
        };
        let form: FileForm = serde_json::from_slice(&bytes).map_err(|error| {
            invalid(format!(
                "not a camera path: {error}; docs/scenes.md gives the format"
            ))
        })?;
        let keys = form.keys.into_iter().map(|key| Key {
            time: key.time,
            camera: Camera {
                eye: key.eye.into(),
                target: key.target.into(),
                up: key.up.into(),
                fov_y: key.fov_degrees.to_radians(),
                near: key.near,
            },
        });
        Self::new(keys.collect()).map_err(|detail| invalid(format!("camera path: {detail}")))
    }

    /// Writes the path as JSON.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn save(&self, path: &Path) -> Result<()> {
        let keys = self.keys.iter().map(|Key { time, camera }| KeyForm {
            time: *time,
            eye: camera.eye.into(),
            target: camera.target.into(),
            up: camera.up.into(),
            fov_degrees: camera.fov_y.to_degrees(),
            near: camera.near,
        });
        let mut text = serde_json::to_vec_pretty(&FileForm { keys: keys.collect() }).map_err(|error| {
            Error::Invalid {
                path: path.into(),
                detail: error.to_string(),
            }
        })?;
        text.push(b'\n');
        file::write(path, &text)
    }
}

/// The cubic with these end points and end derivatives, for s from 0 to 1.
fn hermite(start: Vec3, start_slope: Vec3, end: Vec3, end_slope: Vec3, s: f32) -> Vec3 {
    let (s2, s3) = (s * s, s * s * s);
    start * (2.0 * s3 - 3.0 * s2 + 1.0)
        + start_slope * (s3 - 2.0 * s2 + s)
        + end * (3.0 * s2 - 2.0 * s3)
        + end_slope * (s3 - s2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(time: f32, x: f32) -> Key {
        let eye = Vec3::new(x, 1.0 + x * x, 3.0);
        Key {
            time,
            camera: Camera {
                eye,
                target: Vec3::ZERO,
                up: Vec3::Y,
                fov_y: 0.6 + 0.1 * x,
                near: 0.01,
            },
        }
    }

    fn path() -> CameraPath {
        CameraPath::new(vec![key(1.0, 0.0), key(2.0, 1.0), key(4.5, 3.0), key(5.0, 2.0)]).unwrap()
    }

    #[test]
    fn passes_through_its_keys_and_holds_beyond_the_ends() {
        let path = path();
        for key in path.keys() {
            assert!((path.sample(key.time).eye - key.camera.eye).length() < 1e-5);
        }
        assert_eq!(path.sample(-7.0), path.keys()[0].camera);
        assert_eq!(path.sample(99.0), path.keys()[3].camera);
        let frames: Vec<_> = path.frames(9).collect();
        assert_eq!(
            (frames.len(), frames[0], frames[8]),
            (9, path.keys()[0].camera, path.keys()[3].camera)
        );
        assert_eq!(
            (path.frames(0).count(), path.frames(1).next()),
            (0, Some(path.keys()[0].camera))
        );
    }

    #[test]
    fn moves_without_jumps_in_place_and_velocity() {
        let path = path();
        let step = 1e-3;
        let velocity = |time: f32| (path.sample(time + step).eye - path.sample(time).eye) / step;
        for key in &path.keys()[1..3] {
            let (before, after) = (velocity(key.time - 2.0 * step), velocity(key.time + step));
            assert!(
                (before - after).length() < 0.15 * before.length().max(1.0),
                "{before} {after}"
            );
        }
        assert!(velocity(1.0).length() < 0.05 && velocity(5.0 - step).length() < 0.05);
    }

    #[test]
    fn survives_a_file_and_rejects_bad_ones() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.json");
        path().save(&file).unwrap();
        let loaded = CameraPath::load(&file).unwrap();
        for (a, b) in loaded.keys().iter().zip(path().keys()) {
            assert!(a.time == b.time && a.camera.eye == b.camera.eye);
            assert!((a.camera.fov_y - b.camera.fov_y).abs() < 1e-6);
        }
        let key = r#"{"time": 0, "eye": [0,0,1], "target": [0,0,0]}"#;
        for (text, complaint) in [
            ("{", "not a camera path"),
            (r#"{"keys": []}"#, "0 keys"),
            (
                r#"{"keys": [{"time": 0, "eye": [0,0,1], "target": [0,0,0], "pov": 3}]}"#,
                "pov",
            ),
            (
                r#"{"keys": [{"time": 0, "eye": [0,0,0], "target": [0,0,0]}]}"#,
                "key 0 has eye and target",
            ),
            (&format!(r#"{{"keys": [{key}, {key}]}}"#), "key 1 is at 0 s"),
        ] {
            std::fs::write(&file, text).unwrap();
            let message = CameraPath::load(&file).unwrap_err().to_string();
            assert!(
                message.contains(complaint) && message.contains("path.json"),
                "{message}"
            );
        }
        assert!(matches!(
            CameraPath::load(&folder.path().join("none.json")),
            Err(Error::Io { .. })
        ));
    }
}
