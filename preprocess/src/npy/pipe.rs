//! A BTF that arrives through a pipe: an `.npy` array that is read once, from its first image to its last, and its
//! directions from a file. Nothing of it is kept but what the caller asked for last.

use std::io::{ErrorKind, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use half::f16;

use super::header::{self, Header};
use super::mapped::{check_shape, read_sampling};
use super::{Dtype, Samples};
use crate::source::{Images, Overrides};
use crate::{Btf, Error, Result};

/// Bytes of half floats converted at a time.
const CHUNK_BYTES: usize = 1 << 16;

/// The samples in a pipe.
struct Pipe {
    /// What the pipe is called in errors.
    path: PathBuf,
    dtype: Dtype,
    image_samples: usize,
    images: usize,
    source: Mutex<Source>,
}

struct Source {
    reader: Box<dyn Read + Send>,
    /// The image that comes next.
    next: usize,
}

impl std::fmt::Debug for Pipe {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Pipe({})", self.path.display())
    }
}

/// A BTF of the array that `reader` gives, called `path` in errors and names, and of the directions in the file
/// `directions`. Its images can be read once and in order; whatever asks for more gets an error.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] for another array than [`super::NpyBtf::open`] takes, and for other numbers of
/// directions than the array's; [`Error::Invalid`] for a colour, which is linear RGB.
pub fn read_once(
    reader: impl Read + Send + 'static,
    path: &Path,
    directions: &Path,
    overrides: &Overrides,
) -> Result<Btf> {
    if overrides.color.is_some() {
        return Err(Error::Invalid {
            what: "the colour of images",
            found: format!("given for {}", path.display()),
            expected: "given for sets of images only: an array is linear RGB",
        });
    }
    let mut reader: Box<dyn Read + Send> = Box::new(reader);
    let bytes = header::read(&mut reader).map_err(Error::io(path, "read the header"))?;
    let shape = Header::parse(&bytes).and_then(|header| check_shape(&header));
    let (dtype, [views, lights, height, width]) = shape.map_err(|detail| Error::format(path, detail))?;
    let mut sampling = read_sampling(directions)?;
    sampling.wrap = overrides.wrap.unwrap_or(sampling.wrap);
    sampling.cosine = overrides.cosine.unwrap_or(sampling.cosine);
    let described = (sampling.views.len(), sampling.lights.len());
    if described != (views, lights) {
        let detail = format!(
            "names {} views and {} lights, but {} holds {views} and {lights}",
            described.0,
            described.1,
            path.display()
        );
        return Err(Error::format(directions, detail));
    }
    let pipe = Pipe {
        path: path.to_owned(),
        dtype,
        image_samples: 3 * height * width,
        images: views * lights,
        source: Mutex::new(Source { reader, next: 0 }),
    };
    Btf::new(path, sampling, (width as u32, height as u32), Box::new(pipe)) // both checked against MAX_SIDE_TEXELS
}

impl Images for Pipe {
    fn format(&self) -> String {
        format!("numpy array of {} through a pipe", self.dtype.descr())
    }

    fn stored_bytes(&self) -> u64 {
        self.images as u64 * self.image_samples as u64 * self.dtype.bytes() as u64
    }

    fn samples<'a>(&'a self, images: Range<usize>, buffer: &'a mut Vec<f32>) -> Result<Samples<'a>> {
        // A panic of another thread leaves the place in the pipe as it was.
        let mut source = self.source.lock().unwrap_or_else(PoisonError::into_inner);
        let Source { reader, next } = &mut *source;
        if images.start != *next {
            let detail = format!(
                "is a pipe, which can be read once, from its first image to its last: image {} was asked for where \
                 {next} comes next; write the array into a file for more than one pass",
                images.start
            );
            return Err(Error::format(&self.path, detail));
        }
        buffer.clear();
        for image in images {
            let begin = buffer.len();
            buffer.resize(begin + self.image_samples, 0.0);
            self.dtype.read(reader, &mut buffer[begin..]).map_err(|error| {
                if error.kind() == ErrorKind::UnexpectedEof {
                    let detail = format!(
                        "ends inside image {image} of {}: the program that writes into the pipe stopped early",
                        self.images
                    );
                    return Error::format(&self.path, detail);
                }
                Error::io(&self.path, "read")(error)
            })?;
            *next = image + 1;
        }
        if *next == self.images {
            let more = reader.take(1).read_to_end(&mut Vec::new());
            if more.map_err(Error::io(&self.path, "read"))? > 0 {
                let detail = "goes on after its last image: its header is wrong";
                return Err(Error::format(&self.path, detail));
            }
        }
        Ok(Samples::F32(buffer))
    }

    fn place(&self, image: usize) -> String {
        format!("image {image} of the pipe")
    }
}

impl Dtype {
    /// Reads as many samples as there are.
    fn read(self, reader: &mut impl Read, samples: &mut [f32]) -> std::io::Result<()> {
        match self {
            Dtype::F32 => {
                reader.read_exact(bytemuck::cast_slice_mut(samples))?;
                samples
                    .iter_mut()
                    .for_each(|sample| *sample = f32::from_bits(u32::from_le(sample.to_bits())));
            }
            Dtype::F16 => {
                let mut bytes = [0; CHUNK_BYTES];
                for samples in samples.chunks_mut(CHUNK_BYTES / 2) {
                    let bytes = &mut bytes[..2 * samples.len()];
                    reader.read_exact(bytes)?;
                    for (sample, &bytes) in samples.iter_mut().zip(bytes.as_chunks::<2>().0) {
                        *sample = f16::from_le_bytes(bytes).to_f32();
                    }
                }
            }
        }
        Ok(())
    }
}
