//! Settings of the engine: frames of settled views over the error of their pictures.

use std::time::{Duration, Instant};

use engine::angular::Angular;
use engine::frame::{Arithmetic, Budgets, Engine, Filter, Options, Policy};
use engine::gpu::{Context, PageFormat};
use engine::metrics::Picture;
use scenes::Camera;

use super::rounds::alternate;
use super::{Family, Knob, Point};
use crate::capped::{Capped, groups};
use crate::engine::Subject;
use crate::memory_quality::covered;
use crate::{Error, Result};

/// Longest time until a view has settled.
const LIMIT: Duration = Duration::from_secs(300);
/// Shares of the component groups, and cut-offs in parts of the default.
const SHARES: [f64; 5] = [1.0, 0.75, 0.5, 0.25, 0.125];
const CUT_OFFS: [f64; 7] = [0.0, 0.25, 1.0, 4.0, 16.0, 64.0, 256.0];

/// How to measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Width and height of the pictures, pixels.
    pub size: (u32, u32),
    /// Times that all views are drawn with each setting.
    pub rounds: usize,
    /// Most bytes of pages and columns on the GPU, of each of two engines.
    pub most_bytes: u64,
}

/// One setting of all knobs.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Setting {
    share: f64,
    component_error: f64,
    angular: Angular,
    format: PageFormat,
    filter: Filter,
    arithmetic: Arithmetic,
}

impl Default for Setting {
    fn default() -> Self {
        let options = Options::default();
        Self {
            share: 1.0,
            component_error: options.component_error,
            angular: options.angular,
            // What the engine takes where all has room, as here.
            format: options.page_format.unwrap_or_default(),
            filter: options.filter,
            arithmetic: options.arithmetic,
        }
    }
}

/// Measures all knobs of the engine at the views of a subject, two or more; and says of which the adapter has one setting only.
/// `progress` gets words on what is next.
///
/// # Errors
/// [`Error::Invalid`] for views that show nothing or do not fit into memory; those of the engine.
pub(super) fn pictures(
    subject: &Subject,
    plan: &Plan,
    progress: &dyn Fn(&str),
) -> Result<(Vec<Family>, Vec<String>)> {
    if subject.cameras.len() < 2 {
        return Err(Error::Invalid {
            what: "the way of the camera",
            found: format!("{} views", subject.cameras.len()),
            expected: "two views or more: one that is drawn already is not drawn again",
        });
    }
    let stage = Stage {
        context: Context::headless()?,
        subject,
        plan,
    };
    progress("the best pictures");
    let usual = Setting::default();
    let best = Setting {
        component_error: 0.0,
        angular: Angular::Delaunay,
        format: PageFormat::Half,
        share: 1.0,
        filter: Filter::Trilinear,
        arithmetic: Arithmetic::Single,
    };
    let mut run = stage.start(best)?;
    let best = run.pictures()?;
    let mut default = stage.start(usual)?;
    default.pictures()?;
    // The default beside itself: the same in all families.
    progress("the default");
    run = stage.with(run, usual)?;
    let of_default = stage.measure(String::new(), &mut run, &mut default, &best)?;
    let (mut families, mut skipped) = (Vec::new(), Vec::new());
    for (knob, settings) in settings() {
        if knob == Knob::Arithmetic && !stage.context.has_half_arithmetic() {
            skipped.push(format!(
                "{}: {} has no arithmetic of half floats",
                knob.title(),
                stage.context.adapter()
            ));
            continue;
        }
        let mut points = Vec::new();
        for setting in &settings {
            let setting_name = name(knob, setting);
            if *setting == usual {
                points.push(Point {
                    setting: setting_name,
                    ..of_default.clone()
                });
                continue;
            }
            progress(&format!("{}: {setting_name}", knob.title()));
            run = stage.with(run, *setting)?;
            points.push(stage.measure(setting_name, &mut run, &mut default, &best)?);
        }
        let usual = settings.iter().position(|setting| *setting == usual);
        families.push(Family::new(knob, usual.unwrap_or(0), points));
    }
    Ok((families, skipped))
}

/// What is tried of each knob; the rest is the default.
fn settings() -> [(Knob, Vec<Setting>); 6] {
    let usual = Setting::default();
    let shares = SHARES.map(|share| Setting { share, ..usual });
    let cut_offs = CUT_OFFS.map(|part| Setting {
        component_error: part * usual.component_error,
        ..usual
    });
    let angular = [Angular::Delaunay, Angular::Hemisphere].map(|angular| Setting { angular, ..usual });
    let filters = [Filter::Trilinear, Filter::Bilinear].map(|filter| Setting { filter, ..usual });
    let formats = [PageFormat::Half, PageFormat::Byte].map(|format| Setting { format, ..usual });
    let arithmetic = [Arithmetic::Auto, Arithmetic::Single, Arithmetic::Half];
    let arithmetic = arithmetic.map(|arithmetic| Setting { arithmetic, ..usual });
    [
        (Knob::Components, shares.to_vec()),
        (Knob::CutOff, cut_offs.to_vec()),
        (Knob::Angular, angular.to_vec()),
        (Knob::Filter, filters.to_vec()),
        (Knob::Arithmetic, arithmetic.to_vec()),
        (Knob::PageFormat, formats.to_vec()),
    ]
}

fn name(knob: Knob, setting: &Setting) -> String {
    match knob {
        Knob::CutOff => setting.component_error.to_string(),
        Knob::Angular => match setting.angular {
            Angular::Delaunay => "Delaunay taps".into(),
            Angular::Hemisphere => "light hemispheres".into(),
        },
        Knob::Filter => match setting.filter {
            Filter::Trilinear => "trilinear".into(),
            Filter::Bilinear => "bilinear".into(),
        },
        Knob::Arithmetic => match setting.arithmetic {
            Arithmetic::Auto => "as it chooses".into(),
            Arithmetic::Single => "single precision".into(),
            Arithmetic::Half => "half floats".into(),
        },
        Knob::PageFormat => match setting.format {
            PageFormat::Half => "half floats".into(),
            PageFormat::Byte => "bytes".into(),
        },
        _ => format!("{} %", 100.0 * setting.share),
    }
}

/// What all settings share.
struct Stage<'a> {
    context: Context,
    subject: &'a Subject,
    plan: &'a Plan,
}

/// An engine with one setting, and room for all that its views want.
struct Run<'a> {
    engine: Engine,
    cameras: &'a [Camera],
    setting: Setting,
    /// By view: pixels of streamed materials. Of the last call of [`Run::pictures`].
    covered: Vec<Vec<bool>>,
    subject: &'a Subject,
}

impl<'a> Stage<'a> {
    fn start(&self, setting: Setting) -> Result<Run<'a>> {
        let options = Options {
            size: self.plan.size,
            component_error: setting.component_error,
            angular: setting.angular,
            page_format: Some(setting.format),
            filter: setting.filter,
            arithmetic: setting.arithmetic,
            fade_frames: 0,
            prefetch_seconds: 0.0,
            ..Options::default()
        };
        let source = self.subject.archives.source()?;
        let policy: Box<dyn Policy> = Box::new(Capped::new(setting.share));
        let context = self.context.clone();
        let mut engine = Engine::with_policy(context, &self.subject.scene, source, options, policy)?;
        engine.wait_for_materials(LIMIT)?;
        let run = Run {
            engine,
            cameras: &self.subject.cameras,
            setting,
            covered: Vec::new(),
            subject: self.subject,
        };
        self.make_room(run)
    }

    /// The same engine with another setting, where it can be changed; otherwise a new one.
    fn with(&self, mut run: Run<'a>, setting: Setting) -> Result<Run<'a>> {
        let rest = Setting {
            component_error: run.setting.component_error,
            ..setting
        };
        if run.setting != rest {
            drop(run);
            return self.start(setting);
        }
        run.engine.set_component_error(setting.component_error)?;
        run.setting = setting;
        Ok(run)
    }

    /// Room for all: all pages of all groups, or what is allowed.
    fn make_room(&self, mut run: Run<'a>) -> Result<Run<'a>> {
        let (engine, setting) = (&mut run.engine, run.setting);
        let pages: u64 = engine
            .material_infos()
            .map(|info| u64::from(groups(info.groups, setting.share)) * u64::from(info.pyramid.tile_count()))
            .sum();
        let columns: u64 = engine
            .material_infos()
            .map(|info| u64::from(groups(info.groups, setting.share)))
            .sum();
        let column_bytes = (columns * engine.column_slots().1).max(1);
        // Grids of slots leave up to 1 % of a budget unused.
        let page_bytes = (pages + pages / 64 + 1) * setting.format.slot_bytes();
        let most = self.plan.most_bytes.saturating_sub(column_bytes).max(1);
        engine.set_budgets(Budgets {
            page_cache_bytes: page_bytes.min(most),
            column_cache_bytes: column_bytes.min(self.plan.most_bytes),
            ..engine.budgets()
        })?;
        Ok(run)
    }

    fn measure(
        &self,
        name: String,
        run: &mut Run<'_>,
        default: &mut Run<'_>,
        best: &[Picture],
    ) -> Result<Point> {
        let pictures = run.pictures()?;
        let times = alternate(self.plan.rounds * self.subject.cameras.len(), {
            let mut drawn = [0usize; 2];
            let run = &mut *run;
            move |which| {
                let at = drawn[usize::from(which)];
                drawn[usize::from(which)] += 1;
                if which { run.time(at) } else { default.time(at) }
            }
        })?;
        let (work, bytes) = run.work()?;
        Ok(Point {
            setting: name,
            ms: times.ms,
            ratio: times.ratio,
            noise: times.noise,
            work,
            bytes: Some(bytes),
            error: error(&pictures, best, &run.covered)?,
            error_of_btf: None,
            beaten_by: None,
        })
    }
}

impl Run<'_> {
    /// Settles all views.
    fn pictures(&mut self) -> Result<Vec<Picture>> {
        self.covered.clear();
        // The first time what later views want may still take the place of what earlier ones have.
        for camera in self.cameras {
            self.settle(camera)?;
        }
        let mut pictures = Vec::new();
        for camera in self.cameras {
            self.settle(camera)?;
            pictures.push(self.engine.picture()?);
            let ids = self.engine.visibility()?;
            self.covered.push(covered(&self.subject.scene, &ids));
        }
        Ok(pictures)
    }

    fn settle(&mut self, camera: &Camera) -> Result<()> {
        let wrong = |found: String, expected| {
            Err(Error::Invalid {
                what: "a view",
                found,
                expected,
            })
        };
        match self.engine.settle(camera, LIMIT)?.last() {
            Some(last) if !last.settled => wrong(
                self.engine.problems().last().unwrap_or("still loading").into(),
                "settled within five minutes; are all archives there?",
            ),
            // Rounding to bytes is predicted, too, and no reason for more memory.
            Some(last) if self.setting.format == PageFormat::Half && last.predicted_rms > 0.0 => wrong(
                format!("not resident as a whole: error {:.4}", last.predicted_rms),
                "within the memory that is allowed; allow more, or draw smaller pictures",
            ),
            _ => Ok(()),
        }
    }

    /// Milliseconds of a frame from the call to the end of all work.
    fn time(&mut self, view: usize) -> Result<f64> {
        let camera = &self.cameras[view % self.cameras.len()];
        let watch = Instant::now();
        self.engine.frame(camera)?;
        self.engine.wait()?;
        Ok(watch.elapsed().as_secs_f64() * 1e3)
    }

    /// Samples of textures that shading takes at all views, and bytes of what is resident.
    fn work(&mut self) -> Result<(f64, u64)> {
        let lights = self.subject.scene.lights.len() as u32;
        // Of pages one sample in each mip.
        let mips = match self.setting.filter {
            Filter::Trilinear => 2,
            Filter::Bilinear => 1,
        };
        let samples = mips + lights * self.setting.angular.fetches();
        let mut fetched = 0.0;
        for camera in self.cameras {
            self.settle(camera)?;
            fetched += f64::from(self.engine.shading_work()?.groups_fetched);
        }
        let map = self.engine.cache_map();
        let pages = map.pages.iter().flatten().count() as u64;
        let columns = map.columns.iter().flatten().count() as u64;
        let bytes = pages * self.setting.format.slot_bytes() + columns * self.engine.column_slots().1;
        Ok((fetched * f64::from(samples), bytes))
    }
}

/// Root mean square difference of radiance over all covered pixels of all views, relative to the best pictures.
fn error(pictures: &[Picture], best: &[Picture], covered: &[Vec<bool>]) -> Result<f64> {
    let (mut squared, mut energy, mut pixels) = (0f64, 0f64, 0u64);
    for ((picture, best), covered) in pictures.iter().zip(best).zip(covered) {
        for ((pixel, best), _) in picture
            .pixels
            .iter()
            .zip(&best.pixels)
            .zip(covered)
            .filter(|(_, covered)| **covered)
        {
            pixels += 1;
            for (value, best) in pixel.iter().zip(best) {
                squared += (f64::from(*value) - f64::from(*best)).powi(2);
                energy += f64::from(*best).powi(2);
            }
        }
    }
    if pixels == 0 || energy == 0.0 {
        return Err(Error::Invalid {
            what: "the views",
            found: "without a lit pixel of a streamed material".into(),
            expected: "ones that show some; give a camera path",
        });
    }
    Ok((squared / energy).sqrt())
}
