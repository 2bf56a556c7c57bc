//! One session: a scene or a lone archive, its engine, and what a user does with them.

mod drawing;
mod settings;

use engine::{
    Error, Overlay, Result,
    frame::{Engine, Event, FrameStats, Options},
    gpu::Context,
    stream::TileSource,
};
use scenes::{Camera, Scene, Shape, lone};

use crate::{
    Command, Input, Link, Report,
    controls::{Controls, Mode, Response},
    lights::Lights,
    quality::Quality,
    recorder::{Motion, Player, Recorder},
    report::{History, Watch},
};

/// Stops of one step of exposure.
const EXPOSURE_STEP: f32 = 1.0 / 3.0;
/// Seconds of a turntable.
const TURNTABLE_SECONDS: f32 = 8.0;

/// What is shown.
#[derive(Clone, Debug)]
pub enum Subject {
    /// A scene, with its cameras and lights.
    Scene(Scene),
    /// One archive of this name, on a shape.
    Archive(String),
}

/// A scene or a lone archive, drawn by an engine and followed by a user.
pub struct Viewer {
    engine: Engine,
    /// The picture with all resident, to compare with, and what its last frame did.
    reference: Option<(Engine, FrameStats)>,
    scene: Scene,
    /// Of a lone archive: its name and shape.
    lone: Option<(String, Shape)>,
    controls: Controls,
    lights: Lights,
    /// What [`Command::Reset`] goes back to.
    home: (Camera, Lights, f32),
    quality: Option<Quality>,
    recorder: Option<Recorder>,
    /// What was recorded or loaded last.
    motion: Option<Motion>,
    player: Option<Player>,
    watch: Watch,
    history: History,
    report: Report,
    /// Of the target that was drawn into last.
    present: Option<(wgpu::TextureFormat, engine::gpu::Present)>,
}

impl Viewer {
    /// Begins to stream and draw. Nothing waits: the first frames show mean colours.
    ///
    /// # Errors
    /// Those of [`Engine::new`].
    pub fn new(
        context: Context,
        subject: Subject,
        source: Box<dyn TileSource>,
        options: Options,
    ) -> Result<Self> {
        let (scene, lone) = match subject {
            Subject::Scene(scene) => (scene, None),
            Subject::Archive(name) => {
                let shape = Shape::default();
                (lone::lone(&name, shape), Some((name, shape)))
            }
        };
        let lights = Lights::new(&scene.lights);
        let camera = first_camera(&scene, options.size);
        let mut controls = Controls::new(&camera, scene.bounds());
        controls.set_height(options.size.1);
        let report = Report {
            origin: source.origin(),
            ..Report::default()
        };
        let home = (camera, lights.clone(), options.exposure_stops);
        let mut engine = Engine::new(context, &scene, source, options)?;
        engine.set_lights(lights.all())?;
        Ok(Self {
            engine,
            reference: None,
            scene,
            lone,
            controls,
            lights,
            home,
            quality: None,
            recorder: None,
            motion: None,
            player: None,
            watch: Watch::default(),
            history: History::default(),
            report,
            present: None,
        })
    }

    /// Takes what a user does. Commands that are the program's, because they need a panel, a file or a source, come back.
    ///
    /// # Errors
    /// Those of the engine, for what a command changes.
    pub fn input(&mut self, input: Input<'_>) -> Result<Option<Command>> {
        match self.controls.input(input) {
            Response::None => Ok(None),
            Response::Light(by) => {
                let camera = self.controls.camera();
                self.lights.drag(by, &camera, self.controls.centre());
                self.show_lights()?;
                Ok(None)
            }
            Response::Command(command) => self.command(command),
        }
    }

    /// Does what a command says, or gives it back, if it is the program's.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn command(&mut self, command: Command) -> Result<Option<Command>> {
        match command {
            Command::ToggleMode => self.controls.set_mode(match self.controls.mode() {
                Mode::Orbit => Mode::Fly,
                Mode::Fly => Mode::Orbit,
            }),
            Command::Reset => {
                let (camera, lights, stops) = self.home.clone();
                self.player = None;
                self.controls.set_camera(&camera);
                self.lights = lights;
                self.set_exposure_stops(stops);
                self.show_lights()?;
            }
            Command::NextShape => self.next_shape()?,
            Command::Brighter => self.set_exposure_stops(self.exposure_stops() + EXPOSURE_STEP),
            Command::Darker => self.set_exposure_stops(self.exposure_stops() - EXPOSURE_STEP),
            Command::NextLight => self.lights.choose_next(),
            Command::AddLight => {
                self.lights.add(&self.controls.camera());
                self.show_lights()?;
            }
            Command::RemoveLight => {
                self.lights.remove();
                self.show_lights()?;
            }
            Command::Record => self.toggle_recording(),
            Command::Replay => {
                self.player = match self.player {
                    Some(_) => None,
                    None => self.motion.clone().map(Player::new),
                };
            }
            Command::Turntable => {
                self.player = match self.player {
                    Some(_) => None,
                    None => Some(Player::new(self.turntable())),
                };
            }
            Command::Retry => {
                self.engine.retry();
                if let Some((reference, _)) = &mut self.reference {
                    reference.retry();
                }
                self.watch.retry();
            }
            Command::NextOverlay => self.step_overlay(1)?,
            Command::PreviousOverlay => self.step_overlay(Overlay::ALL.len() - 1)?,
            Command::Split
            | Command::Panel
            | Command::Help
            | Command::Screenshot
            | Command::Radiance
            | Command::Escape => return Ok(Some(command)),
        }
        Ok(None)
    }

    /// Lets so many seconds pass, and draws a frame of what the camera then sees.
    ///
    /// # Errors
    /// Those of [`Engine::frame`].
    pub fn frame(&mut self, seconds: f32) -> Result<&Report> {
        self.controls.advance(seconds);
        if let Some(player) = &mut self.player {
            let (camera, more) = player.advance(seconds);
            self.controls.set_camera(&camera);
            if !more {
                self.player = None;
            }
        }
        let camera = self.controls.camera();
        if let Some(recorder) = &mut self.recorder
            && !recorder.add(seconds, &camera)
        {
            self.toggle_recording();
        }
        let stats = self.engine.frame(&camera)?;
        if let Some((reference, last)) = &mut self.reference {
            *last = reference.frame(&camera)?;
        }
        for event in self.engine.events() {
            match event {
                Event::Problem(message) => {
                    self.watch.problem(&message);
                    self.report.add_problem(message);
                }
                Event::FirstPicture(_) => self.report.shown = true,
                _ => {}
            }
        }
        self.history.add(&stats);
        self.report.frame = stats;
        self.report.counters = self.engine.counters();
        self.report.source = self.engine.source_stats();
        let connection = self
            .watch
            .update(&stats, &self.report.counters, &self.report.source);
        self.report.connection = connection.clone();
        self.report.materials = self.engine.materials().into_iter().map(Into::into).collect();
        self.follow_quality(&stats);
        Ok(&self.report)
    }

    /// What there is to tell after the last frame.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// The last frames.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// The engine that draws.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// The same, for what only it can do.
    pub fn engine_mut(&mut self) -> &mut Engine {
        &mut self.engine
    }

    /// The scene as it is drawn, with the lights as they are.
    pub fn scene(&self) -> Scene {
        Scene {
            lights: self.lights.all().to_vec(),
            ..self.scene.clone()
        }
    }

    /// The camera.
    pub fn camera(&self) -> Camera {
        self.controls.camera()
    }

    /// The camera's controls.
    pub fn controls_mut(&mut self) -> &mut Controls {
        &mut self.controls
    }

    /// What dragging does.
    pub fn mode(&self) -> Mode {
        self.controls.mode()
    }

    /// Shape of a lone archive; `None` for scenes.
    pub fn shape(&self) -> Option<Shape> {
        self.lone.as_ref().map(|(_, shape)| *shape)
    }

    /// Shows a lone archive on another shape; nothing for scenes.
    ///
    /// # Errors
    /// Those of [`Engine::set_geometry`].
    pub fn set_shape(&mut self, shape: Shape) -> Result<()> {
        let Some((name, shown)) = &mut self.lone else {
            return Ok(());
        };
        if *shown == shape {
            return Ok(());
        }
        *shown = shape;
        self.scene = lone::lone(name, shape);
        // Lights stay where the user has them.
        let scene = self.scene();
        self.engine.set_geometry(&scene)?;
        if let Some((reference, _)) = &mut self.reference {
            reference.set_geometry(&scene)?;
        }
        if let Some(camera) = scene.cameras.first() {
            self.home.0 = *camera;
            let mode = self.controls.mode();
            self.controls = Controls::new(camera, scene.bounds());
            self.controls.set_mode(mode);
            self.controls.set_height(self.engine.size().1);
        }
        Ok(())
    }

    fn next_shape(&mut self) -> Result<()> {
        let Some(shape) = self.shape() else { return Ok(()) };
        let at = Shape::ALL.iter().position(|known| *known == shape).unwrap_or(0);
        self.set_shape(Shape::ALL[(at + 1) % Shape::ALL.len()])
    }

    /// The lights.
    pub fn lights(&self) -> &Lights {
        &self.lights
    }

    /// Changes the lights.
    ///
    /// # Errors
    /// Those of [`Engine::set_lights`].
    pub fn set_lights(&mut self, lights: Lights) -> Result<()> {
        if lights.all().len() != self.lights.all().len() || lights != self.lights {
            self.lights = lights;
            self.show_lights()?;
        }
        Ok(())
    }

    fn show_lights(&mut self) -> Result<()> {
        self.engine.set_lights(self.lights.all())?;
        match &mut self.reference {
            Some((reference, _)) => reference.set_lights(self.lights.all()),
            None => Ok(()),
        }
    }

    /// What a link would restore.
    pub fn link(&self) -> Link {
        Link {
            camera: Some(self.controls.camera()),
            mode: Some(self.controls.mode()).filter(|mode| *mode != Mode::Orbit),
            lights: (self.lights.all() != self.home.1.all()).then(|| self.lights.all().to_vec()),
            exposure_stops: Some(self.exposure_stops()).filter(|stops| *stops != 0.0),
            shape: self.shape(),
            overlay: Some(self.engine.overlay()).filter(|overlay| *overlay != Overlay::None),
        }
    }

    /// Restores what a link says, and leaves the rest as it is.
    ///
    /// # Errors
    /// Those of the engine, for what changes.
    pub fn follow(&mut self, link: &Link) -> Result<()> {
        if let Some(shape) = link.shape {
            self.set_shape(shape)?;
        }
        if let Some(camera) = &link.camera {
            let near = self.controls.camera().near;
            self.player = None;
            self.controls.set_camera(&Camera { near, ..*camera });
        }
        if let Some(mode) = link.mode {
            self.controls.set_mode(mode);
        }
        if let Some(lights) = &link.lights {
            self.lights = Lights::new(lights);
            self.show_lights()?;
        }
        if let Some(stops) = link.exposure_stops {
            self.set_exposure_stops(stops);
        }
        if let Some(overlay) = link.overlay {
            self.engine.set_overlay(overlay)?;
        }
        Ok(())
    }

    /// Whether a camera path is being recorded, and for how many seconds.
    pub fn recording(&self) -> Option<f32> {
        self.recorder.as_ref().map(Recorder::seconds)
    }

    /// Whether a motion is being replayed, and since how many seconds.
    pub fn replaying(&self) -> Option<f32> {
        self.player.as_ref().map(Player::seconds)
    }

    /// What was recorded or given last.
    pub fn motion(&self) -> Option<&Motion> {
        self.motion.as_ref()
    }

    /// Gives a motion to replay.
    pub fn set_motion(&mut self, motion: Motion) {
        self.motion = Some(motion);
        self.player = None;
    }

    /// Once around what the camera looks at.
    pub fn turntable(&self) -> Motion {
        Motion::Turntable {
            camera: self.controls.camera(),
            seconds: TURNTABLE_SECONDS,
        }
    }

    fn step_overlay(&mut self, steps: usize) -> Result<()> {
        let now = self.engine.overlay();
        let at = Overlay::ALL.iter().position(|known| *known == now).unwrap_or(0);
        self.engine
            .set_overlay(Overlay::ALL[(at + steps) % Overlay::ALL.len()])
    }

    fn toggle_recording(&mut self) {
        match self.recorder.take() {
            None => self.recorder = Some(Recorder::default()),
            Some(recorder) => {
                if let Some(path) = recorder.finish() {
                    self.motion = Some(Motion::Path(path));
                }
            }
        }
    }
}

/// The scene's own, or one that shows everything.
fn first_camera(scene: &Scene, size: (u32, u32)) -> Camera {
    let aspect = size.0 as f32 / size.1.max(1) as f32;
    let own = scene.cameras.iter().find(|camera| camera.problem().is_none());
    match (own, scene.bounds()) {
        (Some(camera), _) => *camera,
        (None, Some((min, max))) => Camera::framing(min, max, aspect),
        (None, None) => Camera::framing(glam::Vec3::NEG_ONE, glam::Vec3::ONE, aspect),
    }
}

/// An engine's error, of what a program asks of a viewer.
pub(crate) fn budget(text: String) -> Error {
    Error::Budget(text)
}
