use glam::{Vec2, Vec3};
use proptest::prelude::*;
use scenes::Camera;

use super::{Controls, Mode, Response};
use crate::input::{Button, Input, Modifiers, Phase};

/// Numbers of any size, and none.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => -2000f32..2000.0,
        1 => -1e30f32..1e30,
        1 => Just(f32::NAN),
        1 => Just(f32::INFINITY),
        1 => Just(0.0),
    ]
}

fn place() -> impl Strategy<Value = Vec2> {
    (number(), number()).prop_map(|(x, y)| Vec2::new(x, y))
}

const CODES: [&str; 14] = [
    "KeyW",
    "KeyS",
    "KeyA",
    "KeyD",
    "KeyQ",
    "KeyE",
    "ArrowLeft",
    "ArrowRight",
    "ArrowUp",
    "ArrowDown",
    "ShiftLeft",
    "KeyL",
    "Equal",
    "Tab",
];

#[derive(Clone, Debug)]
enum Step {
    Event(Input<'static>),
    Time(f32),
    Mode(Mode),
}

fn step() -> impl Strategy<Value = Step> {
    let button = prop_oneof![
        Just(Button::Primary),
        Just(Button::Secondary),
        Just(Button::Middle)
    ];
    let phase = prop_oneof![Just(Phase::Start), Just(Phase::Move), Just(Phase::End)];
    let modifiers = any::<(bool, bool)>().prop_map(|(shift, control)| Modifiers { shift, control });
    prop_oneof![
        2 => (button, place(), modifiers).prop_map(|(button, at, modifiers)| {
            Step::Event(Input::Down {
                button,
                at,
                modifiers,
            })
        }),
        4 => place().prop_map(|at| Step::Event(Input::Move { at })),
        1 => Just(Step::Event(Input::Up)),
        1 => number().prop_map(|pixels| Step::Event(Input::Wheel { pixels })),
        2 => (0..4u64, phase, place()).prop_map(|(id, phase, at)| Step::Event(Input::Touch { id, phase, at })),
        3 => (0..CODES.len(), any::<bool>()).prop_map(|(code, down)| {
            Step::Event(Input::Key {
                code: CODES[code],
                down,
                repeat: false,
                shift: false,
            })
        }),
        1 => Just(Step::Event(Input::Blur)),
        3 => number().prop_map(Step::Time),
        1 => any::<bool>().prop_map(|fly| Step::Mode(if fly { Mode::Fly } else { Mode::Orbit })),
    ]
}

fn start() -> Camera {
    Camera {
        eye: Vec3::new(0.4, 0.6, 2.0),
        target: Vec3::ZERO,
        up: Vec3::Y,
        fov_y: 0.7,
        near: 0.02,
    }
}

fn controls() -> Controls {
    Controls::new(&start(), Some((Vec3::splat(-0.5), Vec3::splat(0.5))))
}

fn assert_near(a: &Camera, b: &Camera) {
    assert!((a.eye - b.eye).length() < 1e-3, "{a:?} {b:?}");
    assert!(
        (a.basis().forward - b.basis().forward).length() < 1e-3,
        "{a:?} {b:?}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Whatever is done, the camera can be used, stays the right way up, in front of what it turns around, and near.
    #[test]
    fn nothing_turns_a_camera_inside_out(
        steps in prop::collection::vec(step(), 1..120),
        middle in (-1e4f32..1e4, -1e4f32..1e4, -1e4f32..1e4),
        radius in prop_oneof![1e-3f32..1e3, Just(0.0f32), Just(1e6)],
        height in 0u32..5000,
    ) {
        let middle = Vec3::from(middle);
        let bounds = (middle - radius, middle + radius);
        let camera = Camera::framing(bounds.0, bounds.1, 1.5);
        let mut controls = Controls::new(&camera, Some(bounds));
        controls.set_height(height);
        for step in steps {
            match step {
                Step::Event(input) => { controls.input(input); }
                Step::Time(seconds) => controls.advance(seconds),
                Step::Mode(mode) => controls.set_mode(mode),
            }
            let camera = controls.camera();
            prop_assert_eq!(camera.problem(), None);
            let basis = camera.basis();
            prop_assert!(basis.up.y > 0.0, "upside down: {:?}", camera);
            prop_assert!(camera.near < (camera.target - camera.eye).length());
            prop_assert!((camera.eye - controls.centre()).length() < controls.radius() * 200.0 + controls.centre().length() * 0.01);
        }
    }

    /// A camera that the controls have made is the one that they go to when told.
    #[test]
    fn a_camera_comes_back(yaw in -3.1f32..3.1, pitch in -1.55f32..1.55, distance in 0.1f32..20.0) {
        let forward = Vec3::new(yaw.sin() * pitch.cos(), pitch.sin(), -yaw.cos() * pitch.cos());
        let camera = Camera { eye: forward * -distance, target: Vec3::ZERO, ..start() };
        let mut controls = controls();
        controls.set_camera(&camera);
        assert_near(&controls.camera(), &camera);
        let again = controls.camera();
        controls.set_camera(&again);
        assert_near(&controls.camera(), &again);
    }
}

fn drag(controls: &mut Controls, button: Button, modifiers: Modifiers, by: Vec2) -> Response {
    let at = Vec2::new(300.0, 200.0);
    controls.input(Input::Down {
        button,
        at,
        modifiers,
    });
    let response = controls.input(Input::Move { at: at + by });
    controls.input(Input::Up);
    response
}

/// The cameras before and after a drag to the right and down.
fn turned(mut controls: Controls) -> [Camera; 2] {
    let before = controls.camera();
    drag(
        &mut controls,
        Button::Primary,
        Modifiers::default(),
        Vec2::new(80.0, 40.0),
    );
    [before, controls.camera()]
}

#[test]
fn dragging_around_a_point_keeps_the_distance_and_takes_the_scene_along() {
    let [before, after] = turned(controls());
    assert_eq!(after.target, before.target);
    let distance = |camera: &Camera| (camera.eye - camera.target).length();
    assert!((distance(&after) - distance(&before)).abs() < 1e-4);
    // The pointer went right and down: the camera goes left and up.
    assert!(after.eye.x < before.eye.x && after.eye.y > before.eye.y);
}

#[test]
fn looking_around_keeps_the_place() {
    let mut controls = controls();
    controls.set_mode(Mode::Fly);
    let [before, after] = turned(controls);
    assert!((after.eye - before.eye).length() < 1e-5);
    assert!(after.basis().forward.dot(before.basis().right) < -0.01);
}

#[test]
fn panning_keeps_the_point_under_the_pointer() {
    let mut controls = controls();
    let (size, before) = ((1280, 720), controls.camera());
    let shift = Modifiers {
        shift: true,
        ..Modifiers::default()
    };
    drag(&mut controls, Button::Primary, shift, Vec2::new(100.0, -60.0));
    let after = controls.camera();
    let ray = after.ray(640.0 + 100.0, 360.0 - 60.0, size);
    let along = (before.target - after.eye).normalize();
    assert!((ray - along).length() < 1e-3, "{ray} {along}");
}

#[test]
fn a_pinch_goes_nearer_and_the_wheel_back() {
    let mut controls = controls();
    let distance = |controls: &Controls| (controls.camera().eye - controls.camera().target).length();
    let before = distance(&controls);
    for (id, x) in [(1, 100.0), (2, 200.0)] {
        let (phase, at) = (Phase::Start, Vec2::new(x, 50.0));
        controls.input(Input::Touch { id, phase, at });
    }
    let (phase, at) = (Phase::Move, Vec2::new(300.0, 50.0));
    controls.input(Input::Touch { id: 2, phase, at });
    assert!((distance(&controls) - before / 2.0).abs() < 1e-4);
    controls.input(Input::Wheel {
        pixels: -2f32.ln() / super::WHEEL,
    });
    assert!((distance(&controls) - before).abs() < 1e-3);
}

#[test]
fn a_turn_runs_out_and_comes_to_rest() {
    let mut controls = controls();
    let at = Vec2::new(300.0, 200.0);
    controls.input(Input::Down {
        button: Button::Primary,
        at,
        modifiers: Modifiers::default(),
    });
    for frame in 1..6u8 {
        controls.input(Input::Move {
            at: at + Vec2::X * 12.0 * f32::from(frame),
        });
        controls.advance(1.0 / 60.0);
    }
    controls.input(Input::Up);
    let released = controls.camera();
    controls.advance(1.0 / 60.0);
    assert!(controls.camera().eye.x < released.eye.x, "goes on");
    (0..120).for_each(|_| controls.advance(1.0 / 60.0));
    let rest = controls.camera();
    controls.advance(1.0 / 60.0);
    assert_eq!(controls.camera(), rest);
}

#[test]
fn the_light_is_dragged_with_control_and_the_camera_stays() {
    let mut controls = controls();
    let before = controls.camera();
    let control = Modifiers {
        control: true,
        ..Modifiers::default()
    };
    let response = drag(&mut controls, Button::Primary, control, Vec2::new(72.0, 0.0));
    assert_eq!(response, Response::Light(Vec2::new(0.1, 0.0)));
    assert_eq!(controls.camera(), before);
}

#[test]
fn a_key_moves_while_it_is_down() {
    let mut controls = controls();
    controls.set_mode(Mode::Fly);
    let key = |down| Input::Key {
        code: "KeyW",
        down,
        repeat: false,
        shift: false,
    };
    let before = controls.camera();
    controls.input(key(true));
    controls.advance(0.1);
    let there = controls.camera();
    assert!((there.eye - before.eye).dot(before.basis().forward) > 0.01);
    controls.input(key(false));
    controls.advance(0.1);
    assert_eq!(controls.camera(), there);
    controls.input(key(true));
    controls.input(Input::Blur);
    controls.advance(0.1);
    assert_eq!(controls.camera(), there);
}
