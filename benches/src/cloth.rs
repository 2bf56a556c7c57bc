//! A small synthetic BTF: an input for benchmarks of single stages that is made in a moment.

use std::path::Path;

use preprocess::Btf;
use preprocess::npy::{BtfWriter, Dtype, Sampling};
use scenes::synth::{SynthOptions, synthesize};

use crate::{Error, Result};

/// Lights of each view.
const LIGHTS: usize = 4;

/// Writes a cloth of `size`² texels under 81 × 4 directions into `folder`, and opens it.
///
/// # Errors
/// [`Error::Program`] for a size that cannot be made, [`Error::Preprocess`] where the file cannot be written or read.
pub fn small_cloth(folder: &Path, size: u32) -> Result<Btf> {
    let mut options = SynthOptions::default();
    options.lights.truncate(LIGHTS);
    cloth(folder, size, options)
}

/// The same under 31 × 31 directions all over the hemisphere, for pictures.
///
/// # Errors
/// Those of [`small_cloth`].
pub fn sparse_cloth(folder: &Path, size: u32) -> Result<Btf> {
    let directions = scenes::synth::Sampling::Sparse31.directions();
    let options = SynthOptions {
        views: directions.clone(),
        lights: directions,
        ..SynthOptions::default()
    };
    cloth(folder, size, options)
}

fn cloth(folder: &Path, size: u32, options: SynthOptions) -> Result<Btf> {
    let path = folder.join("cloth.npy");
    let options = SynthOptions {
        size,
        samples_per_texel: 1,
        ..options
    };
    let sampling = Sampling {
        views: options.views.clone(),
        lights: options.lights.clone(),
        wrap: true,
        cosine: true,
    };
    let mut writer = BtfWriter::create(&path, sampling, size, size, Dtype::F16)?;
    let mut sink = |_, view: &[_]| writer.write_f16(view).map_err(std::io::Error::other);
    synthesize("cloth", &options, &mut sink, &|_, _| ()).map_err(|error| Error::Program {
        program: "synth",
        detail: error.to_string(),
    })?;
    writer.finish()?;
    Ok(Btf::open(&path)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cloth_is_as_small_as_it_says() {
        let folder = tempfile::tempdir().unwrap();
        let btf = small_cloth(folder.path(), 16).unwrap();
        assert_eq!((btf.views().len(), btf.lights().len()), (81, LIGHTS));
        assert_eq!(
            (btf.width(), btf.height(), btf.wrap(), btf.cosine()),
            (16, 16, true, true)
        );
    }
}
