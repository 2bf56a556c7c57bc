//! A camera that follows the user: around a point, or through the scene. Up stays up.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Vec2, Vec3};
use scenes::Camera;

use crate::{
    input::{Button, Input},
    keys::{self, Binding, Command, Hold},
    touch::{Fingers, Gesture},
};

/// What dragging and keys do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// The camera turns around a point.
    #[default]
    Orbit,
    /// The camera turns in its place, and flies.
    Fly,
}

/// Largest angle above and below the horizon: just short of the poles, where left and right are not defined.
const MOST_PITCH: f32 = FRAC_PI_2 - 0.01;
/// A drag over the height of the picture turns by so much.
const TURN: f32 = 0.5 * TAU;
/// Radians a second that a key turns by.
const KEY_TURN: f32 = 1.2;
/// Radii of the scene in a second that keys move by, and how many times that with shift.
const KEY_MOVE: f32 = 0.6;
const FAST: f32 = 4.0;
/// Of the wheel: e-folds of distance per pixel.
const WHEEL: f32 = 2.5e-3;
/// Seconds in which a turn that was let go loses all but 1/e of its speed, and the speed that counts as none, radians a
/// second: the picture must come to rest to settle.
const COAST: f32 = 0.12;
const AT_REST: f32 = 0.02;
/// A longer step of time than this is one in which the program has stood still, seconds.
const LONGEST_STEP: f32 = 0.25;
/// Distances from the point that the camera turns around, in radii of the scene.
const NEAREST: f32 = 1e-3;
const FURTHEST: f32 = 50.0;

/// What the pointer does while its button is down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Drag {
    Turn,
    Pan,
    Light,
}

/// What an event asks of others than the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Response {
    /// Nothing.
    None,
    /// The light is dragged by so many heights of the picture, to the right and down.
    Light(Vec2),
    /// A command.
    Command(Command),
}

/// A camera and what is being done to it.
#[derive(Clone, Debug)]
pub struct Controls {
    mode: Mode,
    target: Vec3,
    distance: f32,
    /// About the vertical, to the right; 0 looks along -z.
    yaw: f32,
    /// Above the horizon.
    pitch: f32,
    fov_y: f32,
    near: f32,
    /// Middle and radius of the scene.
    centre: Vec3,
    radius: f32,
    /// Least distance from the point that it turns around.
    nearest: f32,
    /// Height of the picture in pixels.
    height: f32,
    pointer: Vec2,
    drag: Option<Drag>,
    fingers: Fingers,
    /// A bit for each [`Hold`].
    held: u16,
    /// Turned by dragging since the last step, radians, and the speed that is left of it.
    turned: Vec2,
    speed: Vec2,
}

impl Controls {
    /// Follows `camera` in a scene with this box around it; `camera` must have no [`Camera::problem`], what is odd in it
    /// is replaced.
    pub fn new(camera: &Camera, bounds: Option<(Vec3, Vec3)>) -> Self {
        let (min, max) = bounds.unwrap_or((Vec3::NEG_ONE, Vec3::ONE));
        let finite = |vector: Vec3| if vector.is_finite() { vector } else { Vec3::ZERO };
        let centre = finite((min + max) * 0.5).clamp(Vec3::splat(-1e9), Vec3::splat(1e9));
        let radius = Some((max - min).length() * 0.5).filter(|radius| radius.is_finite());
        let radius = radius.unwrap_or(1.0).clamp(1e-2, 1e9);
        let mut controls = Self {
            mode: Mode::Orbit,
            target: centre,
            distance: 1.0,
            yaw: 0.0,
            pitch: 0.0,
            fov_y: 0.7,
            near: 0.01,
            centre,
            radius,
            // Far from the origin floats cannot tell nearer places apart.
            nearest: (radius * NEAREST).max(centre.length() * 1e-4),
            height: 720.0,
            pointer: Vec2::ZERO,
            drag: None,
            fingers: Fingers::default(),
            held: 0,
            turned: Vec2::ZERO,
            speed: Vec2::ZERO,
        };
        controls.set_camera(camera);
        controls
    }

    /// Goes to a camera, without its roll.
    pub fn set_camera(&mut self, camera: &Camera) {
        if camera.problem().is_some() {
            return;
        }
        let forward = (camera.target - camera.eye).normalize();
        // Straight up or down, the way to the upper edge tells what is ahead.
        let ahead = if forward.y.abs() < 0.9999 {
            forward
        } else {
            camera.up * -forward.y.signum()
        };
        self.yaw = ahead.x.atan2(-ahead.z);
        self.pitch = forward.y.clamp(-1.0, 1.0).asin().clamp(-MOST_PITCH, MOST_PITCH);
        self.distance = self.limited((camera.target - camera.eye).length());
        self.target = camera.eye + self.forward() * self.distance;
        self.fov_y = camera.fov_y.clamp(0.05, 2.6);
        self.near = camera.near.clamp(self.radius * 1e-6, self.radius);
        (self.turned, self.speed) = Default::default();
        self.keep_near();
    }

    /// The camera.
    pub fn camera(&self) -> Camera {
        let eye = self.target - self.forward() * self.distance;
        Camera {
            eye,
            target: self.target,
            up: Vec3::Y,
            fov_y: self.fov_y,
            near: self.near.min(self.distance * 0.05),
        }
    }

    /// What dragging and keys do.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Chooses what dragging and keys do.
    pub fn set_mode(&mut self, mode: Mode) {
        self.mode = mode;
        self.speed = Vec2::ZERO;
    }

    /// The picture's height in pixels, by which drags are measured.
    pub fn set_height(&mut self, pixels: u32) {
        self.height = pixels.max(1) as f32;
    }

    /// Radius of the scene.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Middle of the scene.
    pub fn centre(&self) -> Vec3 {
        self.centre
    }

    /// Takes what the user does.
    pub fn input(&mut self, input: Input<'_>) -> Response {
        match input {
            Input::Down {
                button,
                at,
                modifiers,
            } if at.is_finite() => {
                self.pointer = at;
                self.speed = Vec2::ZERO;
                self.drag = Some(match button {
                    Button::Primary if modifiers.control || self.holds(Hold::Light) => Drag::Light,
                    Button::Primary if !modifiers.shift => Drag::Turn,
                    _ => Drag::Pan,
                });
            }
            Input::Move { at } if at.is_finite() => {
                let moved = at - self.pointer;
                self.pointer = at;
                return match self.drag {
                    Some(drag) => self.dragged(drag, moved),
                    None => Response::None,
                };
            }
            Input::Up => self.drag = None,
            Input::Wheel { pixels } if pixels.is_finite() => self.zoom((-pixels * WHEEL).exp()),
            Input::Touch { id, phase, at } if at.is_finite() => {
                return match self.fingers.change(id, phase, at) {
                    Gesture::None => {
                        self.speed *= f32::from(u8::from(!self.fingers.one()));
                        Response::None
                    }
                    Gesture::Drag(moved) => self.dragged(Drag::Turn, moved),
                    Gesture::Pinch(moved, factor) => {
                        self.zoom(1.0 / factor);
                        self.dragged(Drag::Pan, moved)
                    }
                    Gesture::Light(moved) => self.dragged(Drag::Light, moved),
                };
            }
            Input::Key {
                code,
                down,
                repeat,
                shift,
            } => match keys::binding(code, shift) {
                Some(Binding::Hold(hold)) => {
                    let bit = 1 << hold as u8;
                    self.held = if down { self.held | bit } else { self.held & !bit };
                }
                Some(Binding::Press(command)) if down && !repeat => return Response::Command(command),
                _ => {}
            },
            Input::Blur => {
                self.drag = None;
                self.held = 0;
                self.fingers.clear();
            }
            _ => {}
        }
        Response::None
    }

    /// Lets so much time pass: keys that are down go on moving, a turn that was let go runs out.
    pub fn advance(&mut self, seconds: f32) {
        let seconds = if seconds.is_finite() {
            seconds.clamp(0.0, LONGEST_STEP)
        } else {
            0.0
        };
        if seconds == 0.0 {
            return;
        }
        if self.drag == Some(Drag::Turn) || self.fingers.one() {
            let speed = std::mem::take(&mut self.turned) / seconds;
            // Over some frames: the last one before letting go is often a short one.
            self.speed += (speed - self.speed) * (1.0 - (-seconds / 0.03).exp());
        } else {
            self.turned = Vec2::ZERO;
            if self.speed != Vec2::ZERO {
                self.turn(self.speed * seconds);
                self.speed *= (-seconds / COAST).exp();
                if self.speed.length() < AT_REST {
                    self.speed = Vec2::ZERO;
                }
            }
        }
        let axis =
            |plus, minus| f32::from(u8::from(self.holds(plus))) - f32::from(u8::from(self.holds(minus)));
        let faster = if self.holds(Hold::Fast) { FAST } else { 1.0 };
        let turn = Vec2::new(
            axis(Hold::TurnRight, Hold::TurnLeft),
            axis(Hold::TurnUp, Hold::TurnDown),
        );
        let forward = axis(Hold::Forward, Hold::Back);
        let aside = Vec2::new(axis(Hold::Right, Hold::Left), axis(Hold::Up, Hold::Down));
        if turn != Vec2::ZERO {
            // Around a thing, the key says where the camera goes.
            let turn = if self.mode == Mode::Orbit {
                turn * Vec2::new(-1.0, -1.0)
            } else {
                turn
            };
            self.turn(turn * (KEY_TURN * seconds));
        }
        match self.mode {
            Mode::Orbit if forward != 0.0 => self.zoom((-forward * faster * seconds).exp()),
            Mode::Fly => self.shift(self.forward() * (forward * self.radius * KEY_MOVE * faster * seconds)),
            Mode::Orbit => {}
        }
        if aside != Vec2::ZERO {
            let scale = match self.mode {
                Mode::Orbit => self.distance,
                Mode::Fly => self.radius,
            };
            let basis = self.camera().basis();
            let up = if self.mode == Mode::Fly { Vec3::Y } else { basis.up };
            self.shift((basis.right * aside.x + up * aside.y) * (scale * KEY_MOVE * faster * seconds));
        }
    }

    fn holds(&self, hold: Hold) -> bool {
        self.held >> hold as u8 & 1 == 1
    }

    fn dragged(&mut self, drag: Drag, moved: Vec2) -> Response {
        let moved = moved / self.height;
        match drag {
            Drag::Light => return Response::Light(moved),
            Drag::Turn => {
                // The scene follows the pointer around a point; looking around, the picture does.
                let turn = match self.mode {
                    Mode::Orbit => Vec2::new(moved.x, -moved.y) * TURN,
                    Mode::Fly => Vec2::new(-moved.x, moved.y) * self.fov_y,
                };
                self.turned += turn;
                self.turn(turn);
            }
            Drag::Pan => {
                // What is at the distance of the target stays under the pointer.
                let across = 2.0 * self.distance * (self.fov_y * 0.5).tan();
                let basis = self.camera().basis();
                self.shift((basis.right * -moved.x + basis.up * moved.y) * across);
            }
        }
        Response::None
    }

    /// Turns the view to the right and upwards: around the target, or in its place.
    fn turn(&mut self, angles: Vec2) {
        let eye = self.target - self.forward() * self.distance;
        self.yaw = (self.yaw + angles.x).rem_euclid(TAU);
        self.pitch = (self.pitch + angles.y).clamp(-MOST_PITCH, MOST_PITCH);
        if self.mode == Mode::Fly {
            self.target = eye + self.forward() * self.distance;
            self.keep_near();
        }
    }

    /// Goes `factor` times as far away from the target; flying, forward by what that makes.
    fn zoom(&mut self, factor: f32) {
        let factor = factor.clamp(0.1, 10.0);
        match self.mode {
            Mode::Orbit => self.distance = self.limited(self.distance * factor),
            Mode::Fly => self.shift(self.forward() * (-factor.ln() * self.radius * 0.5)),
        }
    }

    fn shift(&mut self, by: Vec3) {
        self.target += by;
        self.keep_near();
    }

    /// Nobody finds back from further away.
    fn keep_near(&mut self) {
        let reach = Vec3::splat(self.radius * FURTHEST);
        self.target = self.target.clamp(self.centre - reach, self.centre + reach);
    }

    fn limited(&self, distance: f32) -> f32 {
        distance.clamp(self.nearest, (self.radius * FURTHEST).max(self.nearest * 2.0))
    }

    fn forward(&self) -> Vec3 {
        let (sin, cos) = self.yaw.sin_cos();
        Vec3::new(sin * self.pitch.cos(), self.pitch.sin(), -cos * self.pitch.cos())
    }
}

#[cfg(test)]
mod tests;
