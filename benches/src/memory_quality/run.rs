//! One view under each setting.

use std::time::Duration;

use engine::frame::{Budgets, Engine, Options, Policy};
use engine::gpu::{Context, PageFormat};
use engine::metrics::{Comparison, Picture, compare, flip};
use scenes::{Camera, Scene, Surface};
use serde::{Deserialize, Serialize};

use super::shots::{self, Kept, Shot};
use crate::capped::{Capped, groups};
use crate::engine::Subject;
use crate::{Error, Result};

/// Longest time until a setting has settled.
const LIMIT: Duration = Duration::from_secs(600);
/// Bytes of the caches before it is known what they have to hold.
const FIRST_BYTES: u64 = 16 << 20;

/// How to measure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// Formats of the page cache; the first is the one that chosen points are of.
    pub formats: Vec<PageFormat>,
    /// Shares of each material's component groups that are used, the largest first; 1 is all.
    pub shares: Vec<f64>,
    /// Budgets of each format and share, from one page for each material to all.
    pub steps: usize,
    /// Most bytes of the caches on the GPU.
    pub most_bytes: u64,
}

/// What is varied.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting {
    /// Texels of the page cache.
    pub format: PageFormat,
    /// Share of the component groups of each material.
    pub share: f64,
    /// Component groups of the material that has most, with that share.
    pub groups: u16,
    /// Slots of the page cache.
    pub page_slots: u32,
}

/// How far a picture is from another.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// RMSE before tone mapping; RMSE, PSNR, SSIM and ΔE after.
    #[serde(flatten)]
    pub measured: Comparison,
    /// Mean FLIP after tone mapping.
    pub flip: f64,
    /// Mean HDR-FLIP, before tone mapping.
    pub hdr_flip: f64,
}

impl Quality {
    fn new(picture: &Picture, reference: &Picture, covered: &[bool]) -> Result<Self> {
        let all = || {
            Some(Self {
                measured: compare(picture, reference, Some(covered), 0.0)?,
                flip: flip::mean_flip(picture, reference, Some(covered), 0.0)?,
                hdr_flip: flip::mean_hdr_flip(picture, reference, Some(covered))?,
            })
        };
        all().ok_or(Error::Invalid {
            what: "the view",
            found: "without a pixel of a streamed material".into(),
            expected: "one that shows some; give a camera path",
        })
    }
}

/// What a setting gave.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// What was set.
    #[serde(flatten)]
    pub setting: Setting,
    /// Bytes of the page cache.
    pub page_bytes: u64,
    /// Bytes of the columns that are resident.
    pub column_bytes: u64,
    /// Pages that are resident.
    pub pages_resident: u32,
    /// Error of reflectance that the engine predicts against all groups that it is told of (RMS).
    pub predicted_rms: f64,
    /// Against full residency in half floats with all groups.
    pub full: Quality,
    /// Against the uncompressed BTFs.
    pub reference: Option<Quality>,
}

impl Point {
    /// Bytes of pages and columns.
    pub fn bytes(&self) -> u64 {
        self.page_bytes + self.column_bytes
    }
}

/// All that was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Results {
    /// The scene.
    pub name: String,
    /// Adapter and driver.
    pub adapter: String,
    /// Settings.
    pub plan: Plan,
    /// Streamed materials of the scene.
    pub materials: usize,
    /// Pages that the view wants with all groups.
    pub pages_wanted: u32,
    /// Bytes of full residency: these pages in half floats, and all columns.
    pub full_bytes: u64,
    /// Full residency against the uncompressed BTFs: what no budget makes better.
    pub full_reference: Option<Quality>,
    /// By format, share and rising budget.
    pub points: Vec<Point>,
    /// The point at the knee of the first format with the largest share.
    pub knee: Option<usize>,
    /// Pictures at chosen points.
    #[serde(skip)]
    pub shots: Vec<Shot>,
}

impl Results {
    /// The points of a curve, by rising budget, with their indices.
    pub fn curve(&self, format: PageFormat, share: f64) -> impl Iterator<Item = (usize, &Point)> {
        let points = self.points.iter().enumerate();
        points.filter(move |(_, point)| point.setting.format == format && point.setting.share == share)
    }
}

/// The uncompressed BTFs, shaded at the pixels of a visibility pass, `[y][x]` of instance and triangle.
pub type Truth<'a> = &'a dyn Fn(&Camera, &[[u32; 2]]) -> Picture;

/// Measures the first view of a subject. `progress` gets words on what is next.
///
/// # Errors
/// [`Error::Invalid`] for a plan or a subject of which nothing can be measured; those of the engine.
pub fn measure(
    subject: &Subject,
    plan: &Plan,
    truth: Option<Truth<'_>>,
    progress: &dyn Fn(&str),
) -> Result<Results> {
    check(plan)?;
    let Some(&camera) = subject.cameras.first() else {
        return Err(Error::Invalid {
            what: "the way of the camera",
            found: "without a view".into(),
            expected: "one view or more; give a camera path, or a scene with a mesh",
        });
    };
    let stage = Stage {
        context: Context::headless()?,
        subject,
        plan,
        camera,
    };
    progress("full residency");
    let mut full = stage.start(PageFormat::Half, 1.0)?;
    let pages_wanted = full.hold_all()?;
    let picture = full.engine.picture()?;
    let ids = full.engine.visibility()?;
    let covered = covered(&subject.scene, &ids);
    let truth = truth.map(|truth| {
        progress("the reference");
        truth(&camera, &ids)
    });
    let against = |picture: &Picture, truth: &Option<Picture>| {
        let quality = |truth| Quality::new(picture, truth, &covered);
        truth.as_ref().map(quality).transpose()
    };
    let mut results = Results {
        name: subject.name.clone(),
        adapter: full.engine.adapter(),
        plan: plan.clone(),
        materials: full.engine.materials().len(),
        pages_wanted,
        full_bytes: u64::from(pages_wanted) * PageFormat::Half.slot_bytes() + full.column_bytes(),
        full_reference: against(&picture, &truth)?,
        points: Vec::new(),
        knee: None,
        shots: Vec::new(),
    };
    drop(full);
    let mut kept = Vec::new();
    for &format in &plan.formats {
        for &share in &plan.shares {
            let mut run = stage.start(format, share)?;
            let wanted = run.hold_all()?;
            let least = (results.materials as u32).clamp(1, wanted);
            for slots in budgets(least, wanted, plan.steps) {
                progress(&format!(
                    "{format:?} pages, {:.0} % of the components, {slots} slots",
                    100.0 * share
                ));
                let (shown, mut point) = run.measure(slots, &picture, &covered)?;
                point.reference = against(&shown, &truth)?;
                kept.push(Kept::new(&shown, &picture));
                results.points.push(point);
            }
        }
    }
    shots::choose(&mut results, &kept, &picture, truth.as_ref());
    Ok(results)
}

fn check(plan: &Plan) -> Result<()> {
    let wrong = |what, found: String, expected| {
        Err(Error::Invalid {
            what,
            found,
            expected,
        })
    };
    if plan.formats.is_empty() || plan.shares.is_empty() {
        return wrong("formats or ranks", "none".into(), "one of each or more");
    }
    if let Some(share) = plan
        .shares
        .iter()
        .find(|share| !(**share > 0.0 && **share <= 1.0))
    {
        return wrong(
            "a share of components",
            share.to_string(),
            "above 0 and at most 1",
        );
    }
    if !(2..=1000).contains(&plan.steps) {
        return wrong("the number of budgets", plan.steps.to_string(), "2 to 1000");
    }
    Ok(())
}

/// Rising numbers of slots, each about as many times the one before; both ends are among them.
fn budgets(least: u32, most: u32, steps: usize) -> Vec<u32> {
    let ratio = f64::from(most.max(1)) / f64::from(least.max(1));
    let step = |step: usize| {
        let share = step as f64 / (steps - 1) as f64;
        (f64::from(least.max(1)) * ratio.powf(share)).round() as u32
    };
    let mut slots: Vec<_> = (0..steps).map(step).collect();
    slots.dedup();
    slots
}

/// Pixels that show a streamed material.
pub(crate) fn covered(scene: &Scene, ids: &[[u32; 2]]) -> Vec<bool> {
    let is_btf = |instance: u32| {
        let instance = scene.instances.get((instance as usize).checked_sub(1)?)?;
        let material = scene.materials.get(scene.meshes.get(instance.mesh)?.material)?;
        Some(matches!(material.surface, Surface::Btf { .. }))
    };
    ids.iter().map(|ids| is_btf(ids[0]) == Some(true)).collect()
}

/// What all settings share.
struct Stage<'a> {
    context: Context,
    subject: &'a Subject,
    plan: &'a Plan,
    camera: Camera,
}

/// An engine with one format and share.
struct Run<'a> {
    stage: &'a Stage<'a>,
    engine: Engine,
    format: PageFormat,
    share: f64,
    /// Component groups: of all materials, and of the one that has most.
    all_groups: u64,
    most_groups: u16,
}

impl Stage<'_> {
    fn start(&self, format: PageFormat, share: f64) -> Result<Run<'_>> {
        let options = Options {
            size: self.plan.size,
            budgets: Budgets {
                page_cache_bytes: FIRST_BYTES,
                column_cache_bytes: FIRST_BYTES,
                ..Budgets::default()
            },
            page_format: Some(format),
            fade_frames: 0,
            prefetch_seconds: 0.0,
            ..Options::default()
        };
        let source = self.subject.archives.source()?;
        let policy: Box<dyn Policy> = Box::new(Capped::new(share));
        let context = self.context.clone();
        let mut engine = Engine::with_policy(context, &self.subject.scene, source, options, policy)?;
        engine.wait_for_materials(LIMIT)?;
        let used = || {
            engine
                .materials()
                .into_iter()
                .map(|material| groups(material.groups, share))
        };
        Ok(Run {
            stage: self,
            all_groups: used().map(u64::from).sum(),
            most_groups: used().max().unwrap_or(0),
            engine,
            format,
            share,
        })
    }
}

impl Run<'_> {
    /// Settles with room for all that the view wants. Returns how many pages that are.
    fn hold_all(&mut self) -> Result<u32> {
        let (_, slot_bytes) = self.engine.column_slots();
        let columns = (self.all_groups * slot_bytes).max(1);
        let mut pages = FIRST_BYTES;
        loop {
            if pages.saturating_add(columns) > self.stage.plan.most_bytes {
                return Err(Error::Invalid {
                    what: "memory on the GPU for full residency",
                    found: format!("{} MiB", (pages.saturating_add(columns)) >> 20),
                    expected: "at most what was allowed; allow more, or draw a smaller picture",
                });
            }
            self.set_budgets(pages, columns)?;
            let stats = self.settle()?;
            if stats.pages_wanted <= self.engine.page_slots() {
                return Ok(stats.pages_wanted.max(1));
            }
            // Grids of slots leave up to 1 % of a budget unused.
            let needed = u64::from(stats.pages_wanted) * self.format.slot_bytes();
            pages = (needed + needed / 64).max(pages + pages / 8);
        }
    }

    fn set_budgets(&mut self, page_cache_bytes: u64, column_cache_bytes: u64) -> Result<()> {
        Ok(self.engine.set_budgets(Budgets {
            page_cache_bytes,
            column_cache_bytes,
            ..self.engine.budgets()
        })?)
    }

    fn settle(&mut self) -> Result<engine::frame::FrameStats> {
        let frames = self.engine.settle(&self.stage.camera, LIMIT)?;
        match frames.last() {
            Some(last) if last.settled => Ok(*last),
            _ => Err(Error::Invalid {
                what: "the view",
                found: self
                    .engine
                    .problems()
                    .last()
                    .unwrap_or("still loading")
                    .to_owned(),
                expected: "settled within ten minutes; are all archives there?",
            }),
        }
    }

    fn column_bytes(&self) -> u64 {
        let resident = self.engine.cache_map().columns.iter().flatten().count() as u64;
        resident * self.engine.column_slots().1
    }

    fn measure(&mut self, slots: u32, full: &Picture, covered: &[bool]) -> Result<(Picture, Point)> {
        let columns = self.engine.budgets().column_cache_bytes;
        // Grids of slots leave up to 1 % of a budget unused.
        let budget = u64::from(slots + slots / 64) * self.format.slot_bytes();
        // Columns stay while they have room, wanted or not: what counts are those that come back.
        let (_, column) = self.engine.column_slots();
        self.set_budgets(budget, column)?;
        self.set_budgets(budget, columns)?;
        let stats = self.settle()?;
        let shown = self.engine.picture()?;
        let page_slots = self.engine.page_slots();
        let point = Point {
            setting: Setting {
                format: self.format,
                share: self.share,
                groups: self.most_groups,
                page_slots,
            },
            page_bytes: u64::from(page_slots) * self.format.slot_bytes(),
            column_bytes: self.column_bytes(),
            pages_resident: stats.pages_resident,
            predicted_rms: stats.predicted_rms,
            full: Quality::new(&shown, full, covered)?,
            reference: None,
        };
        Ok((shown, point))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_rise_from_end_to_end() {
        assert_eq!(budgets(1, 64, 4), [1, 4, 16, 64]);
        assert_eq!(budgets(5, 5, 3), [5]);
        assert_eq!(budgets(2, 3, 9), [2, 3]);
        let slots = budgets(100, 12345, 7);
        assert!(slots.is_sorted() && slots[0] == 100 && slots[6] == 12345);
    }
}
