//! Any BTF to the exchange format, as a stream.

use std::path::Path;

use super::Btf;
use crate::npy::{BtfWriter, Dtype, Sampling};
use crate::{Error, Result};

/// Samples held in memory at a time, unless one image has more.
const BLOCK_SAMPLES: usize = 16 << 20;

/// What to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conversion {
    /// Type of the samples.
    pub dtype: Dtype,
    /// Only this view.
    pub view: Option<usize>,
    /// Only this light.
    pub light: Option<usize>,
}

/// Writes `NAME.npy` and `NAME.json`, which get their names when they are complete. `progress` is told how many
/// images of how many are done.
///
/// # Errors
/// Those of reading; [`Error::BadSample`]; [`Error::Format`] where a sample is too large for half floats or the output
/// is the input; [`Error::Invalid`] for a view or light that is not there; [`Error::Io`].
pub fn convert(
    btf: &Btf,
    output: &Path,
    conversion: Conversion,
    progress: &dyn Fn(usize, usize),
) -> Result<()> {
    let pick = |what, index: Option<usize>, count: usize| match index {
        None => Ok(0..count),
        Some(index) if index < count => Ok(index..index + 1),
        Some(index) => Err(Error::Invalid {
            what,
            found: index.to_string(),
            expected: "less than their number: `eigentile inspect` prints it",
        }),
    };
    let views = pick("the index of the view", conversion.view, btf.views().len())?;
    let lights = pick("the index of the light", conversion.light, btf.lights().len())?;
    let same = |path: &Path| {
        let known = |path: &Path| std::fs::canonicalize(path).ok();
        known(path).is_some() && known(path) == known(btf.path())
    };
    if same(output) || same(&output.with_extension("json")) {
        return Err(Error::format(output, "is the input itself: choose another name"));
    }
    let sampling = Sampling {
        views: btf.views()[views.clone()].to_vec(),
        lights: btf.lights()[lights.clone()].to_vec(),
        wrap: btf.wrap(),
        cosine: btf.cosine(),
    };
    let mut writer = BtfWriter::create(output, sampling, btf.width(), btf.height(), conversion.dtype)?;
    let image_samples = 3 * btf.columns();
    let block = (BLOCK_SAMPLES / image_samples).max(1);
    let total = views.len() * lights.len();
    let (mut done, mut buffer, mut singles) = (0, Vec::new(), Vec::new());
    progress(done, total);
    // The images of one view are consecutive; all of them are if no light is left out.
    let runs: Vec<_> = if lights.len() == btf.lights().len() {
        std::iter::once(views.start * lights.len()..views.end * lights.len()).collect()
    } else {
        views
            .map(|view| view * btf.lights().len())
            .map(|first| first + lights.start..first + lights.end)
            .collect()
    };
    for run in runs {
        for first in run.clone().step_by(block) {
            let images = first..(first + block).min(run.end);
            btf.prefetch(images.end..(images.end + block).min(run.end));
            let samples = btf.samples(images.clone(), &mut buffer)?;
            if let Some(error) = btf.bad_sample(first, &samples) {
                return Err(error);
            }
            singles.resize(samples.len(), 0f32);
            samples.to_f32(&mut singles);
            if conversion.dtype == Dtype::F16 {
                check_range(btf, first, &singles)?;
            }
            writer.write_f32(&singles)?;
            btf.release(images.clone());
            done += images.len();
            progress(done, total);
        }
    }
    writer.finish()
}

/// Half floats end at 65504.
fn check_range(btf: &Btf, first: usize, samples: &[f32]) -> Result<()> {
    let largest = half::f16::MAX.to_f32();
    let Some(index) = samples.iter().position(|sample| sample.abs() > largest) else {
        return Ok(());
    };
    let detail = format!(
        "{}: the sample {} is too large for half floats, which end at {largest}: write single floats (--float)",
        btf.place(first + index / (3 * btf.columns())),
        samples[index]
    );
    Err(Error::format(btf.path(), detail))
}
