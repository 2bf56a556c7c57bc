//! A BTF on disk, read through a memory map.

use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};

use half::f16;
use half::slice::HalfFloatSliceExt;
use memmap2::Mmap;
use tileset::Direction;

use super::header::Header;
use super::{Sampling, sampling_path};
use crate::source::Images;
use crate::{Error, Result};

/// Largest accepted `NAME.json`: far above what the accepted number of directions needs.
const MAX_JSON_BYTES: u64 = 16 << 20;

/// Type of the samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dtype {
    /// Half floats, numpy's "<f2".
    F16,
    /// Single floats, numpy's "<f4".
    F32,
}

impl Dtype {
    /// Bytes of a sample.
    pub fn bytes(self) -> usize {
        match self {
            Dtype::F16 => 2,
            Dtype::F32 => 4,
        }
    }

    /// numpy's name.
    pub fn descr(self) -> &'static str {
        match self {
            Dtype::F16 => "<f2",
            Dtype::F32 => "<f4",
        }
    }
}

/// Samples as they lie in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Samples<'a> {
    /// Half floats.
    F16(&'a [f16]),
    /// Single floats.
    F32(&'a [f32]),
}

impl Samples<'_> {
    /// Number of samples.
    pub fn len(&self) -> usize {
        match self {
            Samples::F16(samples) => samples.len(),
            Samples::F32(samples) => samples.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One sample.
    ///
    /// # Panics
    /// If `index` is not less than [`Samples::len`].
    pub fn get(&self, index: usize) -> f64 {
        match self {
            Samples::F16(samples) => samples[index].to_f64(),
            Samples::F32(samples) => samples[index].into(),
        }
    }

    /// A part of them.
    ///
    /// # Panics
    /// If `range` does not lie within.
    pub fn slice(&self, range: Range<usize>) -> Self {
        match self {
            Samples::F16(samples) => Samples::F16(&samples[range]),
            Samples::F32(samples) => Samples::F32(&samples[range]),
        }
    }

    /// All of them as f32, in bulk.
    ///
    /// # Panics
    /// If `out` has another length.
    pub fn to_f32(&self, out: &mut [f32]) {
        match self {
            Samples::F16(samples) => samples.convert_to_f32_slice(out),
            Samples::F32(samples) => out.copy_from_slice(samples),
        }
    }
}

/// A BTF: samples `[view][light][rgb][y][x]`, linear; radiance factors with the cosine left out or in, as
/// [`Sampling::cosine`] says.
///
/// As a matrix it has one row for every (view, light, rgb) and one column for every texel.
#[derive(Debug)]
pub struct NpyBtf {
    path: PathBuf,
    name: String,
    sampling: Sampling,
    width: u32,
    height: u32,
    dtype: Dtype,
    map: Mmap,
    data_offset: usize,
}

impl NpyBtf {
    /// Maps `NAME.npy` and reads `NAME.json`. Nothing of the samples is read yet.
    ///
    /// The file must not be made shorter while it is mapped.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Format`] saying which part of which file contradicts what.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        let metadata = file.metadata().map_err(Error::io(path, "open"))?;
        if !metadata.is_file() {
            return Err(Error::format(path, "is no file; give the .npy file of a BTF"));
        }
        if metadata.len() == 0 {
            return Err(Error::format(path, "is empty, expected a .npy file"));
        }
        // SAFETY: the map is only read, and every bit pattern is a valid half or single float. A file that is
        // cut short while mapped ends the process, as the doc comment says.
        let map = unsafe { Mmap::map(&file) }.map_err(Error::io(path, "map into memory"))?;
        let header = Header::parse(&map).map_err(|detail| Error::format(path, detail))?;
        let (dtype, [views, lights, height, width]) =
            check(&header, map.len()).map_err(|detail| Error::format(path, detail))?;
        let sampling = read_sampling(&sampling_path(path))?;
        let described = (sampling.views.len(), sampling.lights.len());
        if described != (views, lights) {
            let detail = format!(
                "names {} views and {} lights, but {} holds {views} and {lights}",
                described.0,
                described.1,
                path.display()
            );
            return Err(Error::format(&sampling_path(path), detail));
        }
        let name = path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let (width, height) = (width as u32, height as u32); // both checked against MAX_SIDE_TEXELS
        Ok(Self {
            path: path.to_owned(),
            name,
            sampling,
            width,
            height,
            dtype,
            map,
            data_offset: header.data_offset,
        })
    }

    /// The `.npy` file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file's name without its extension.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Directions, wrapping, cosine.
    pub fn sampling(&self) -> &Sampling {
        &self.sampling
    }

    /// View directions ωo.
    pub fn views(&self) -> &[Direction] {
        &self.sampling.views
    }

    /// Light directions ωi.
    pub fn lights(&self) -> &[Direction] {
        &self.sampling.lights
    }

    /// Whether the material repeats in both directions.
    pub fn wrap(&self) -> bool {
        self.sampling.wrap
    }

    /// Whether the samples include the cosine of the light's polar angle.
    pub fn cosine(&self) -> bool {
        self.sampling.cosine
    }

    /// Texels in a row of the picture.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows of the picture.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Type of the samples.
    pub fn dtype(&self) -> Dtype {
        self.dtype
    }

    /// Rows of the matrix: views × lights × 3.
    pub fn rows(&self) -> usize {
        self.views().len() * self.lights().len() * 3
    }

    /// Columns of the matrix: texels, width × height.
    pub fn columns(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Bytes of all samples.
    pub fn sample_bytes(&self) -> u64 {
        (self.map.len() - self.data_offset) as u64
    }

    /// One picture `[y][x]`: the samples of one channel (0 red, 1 green, 2 blue) under one view and light.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn row(&self, view: usize, light: usize, rgb: usize) -> Samples<'_> {
        assert!(view < self.views().len() && light < self.lights().len() && rgb < 3);
        let row = (view * self.lights().len() + light) * 3 + rgb;
        self.row_block(row..row + 1)
    }

    /// Consecutive rows of the matrix, one after the other.
    ///
    /// # Panics
    /// If `rows` ends beyond [`NpyBtf::rows`].
    pub fn row_block(&self, rows: Range<usize>) -> Samples<'_> {
        let bytes = &self.map[self.byte_range(rows)];
        // Both casts hold: `check` refuses samples that are not aligned.
        match self.dtype {
            Dtype::F16 => Samples::F16(bytemuck::cast_slice(bytes)),
            Dtype::F32 => Samples::F32(bytemuck::cast_slice(bytes)),
        }
    }

    /// Linear RGB of one texel under one view and light. Not checked for NaN and infinity.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn texel(&self, view: usize, light: usize, x: u32, y: u32) -> [f64; 3] {
        assert!(x < self.width && y < self.height);
        let texel = y as usize * self.width as usize + x as usize;
        std::array::from_fn(|rgb| self.row(view, light, rgb).get(texel))
    }

    /// Starts to fetch rows that are needed soon.
    fn prefetch(&self, rows: Range<usize>) {
        #[cfg(unix)]
        {
            let bytes = self.byte_range(rows);
            // Advice only: where it is refused, the rows are read when they are touched.
            let _ = self
                .map
                .advise_range(memmap2::Advice::WillNeed, bytes.start, bytes.len());
        }
        #[cfg(not(unix))]
        let _ = rows;
    }

    /// Takes rows that are no longer needed out of this process's resident memory. The system keeps them cached
    /// as long as it likes; touching them again maps them again.
    fn release(&self, rows: Range<usize>) {
        #[cfg(unix)]
        {
            let bytes = self.byte_range(rows);
            // SAFETY: the map is a read-only map of a file, so dropped pages come back with the same bytes.
            let _ = unsafe {
                self.map
                    .unchecked_advise_range(memmap2::UncheckedAdvice::DontNeed, bytes.start, bytes.len())
            };
        }
        #[cfg(not(unix))]
        let _ = rows;
    }

    fn byte_range(&self, rows: Range<usize>) -> Range<usize> {
        let row_bytes = self.columns() * self.dtype.bytes();
        self.data_offset + rows.start * row_bytes..self.data_offset + rows.end * row_bytes
    }
}

impl Images for NpyBtf {
    fn format(&self) -> String {
        format!("numpy array of {}", self.dtype.descr())
    }

    fn stored_bytes(&self) -> u64 {
        self.sample_bytes()
    }

    fn sample_bytes(&self) -> usize {
        self.dtype.bytes()
    }

    fn samples<'a>(&'a self, images: Range<usize>, _buffer: &'a mut Vec<f32>) -> Result<Samples<'a>> {
        Ok(self.row_block(images.start * 3..images.end * 3))
    }

    fn prefetch(&self, images: Range<usize>) {
        NpyBtf::prefetch(self, images.start * 3..images.end * 3);
    }

    fn release(&self, images: Range<usize>) {
        NpyBtf::release(self, images.start * 3..images.end * 3);
    }

    fn place(&self, image: usize) -> String {
        format!("bytes from {}", self.byte_range(image * 3..image * 3 + 3).start)
    }
}

/// Type and [views, lights, height, width] of an acceptable header, compared with the length of the file.
fn check(header: &Header, file_bytes: usize) -> std::result::Result<(Dtype, [usize; 4]), String> {
    let (dtype, shape) = check_shape(header)?;
    let expected = shape.iter().product::<usize>() as u64 * 3 * dtype.bytes() as u64;
    let found = (file_bytes - header.data_offset) as u64;
    if found != expected {
        return Err(format!(
            "holds {found} bytes of samples, but shape {:?} of {:?} takes {expected}: the file is cut short or \
             its header is wrong",
            header.shape, header.descr
        ));
    }
    if !header.data_offset.is_multiple_of(dtype.bytes()) {
        return Err(format!(
            "has its samples at byte {}, not a multiple of {}: save it again with numpy.save",
            header.data_offset,
            dtype.bytes()
        ));
    }
    Ok((dtype, shape))
}

/// Type of the samples, and views, lights, height and width, all of them accepted: the bytes of all samples are less
/// than 2⁶⁴.
pub(super) fn check_shape(header: &Header) -> std::result::Result<(Dtype, [usize; 4]), String> {
    let dtype = match header.descr.as_str() {
        "<f2" => Dtype::F16,
        "<f4" => Dtype::F32,
        other => {
            return Err(format!(
                "holds samples of type {other:?}, expected \"<f2\" or \"<f4\": convert with \
                 array.astype('<f2') before numpy.save"
            ));
        }
    };
    if header.fortran_order {
        return Err("is in Fortran order, expected C order: save numpy.ascontiguousarray(array)".into());
    }
    let shape_error = |detail: &str| {
        format!(
            "has shape {:?}: {detail}; expected (views, lights, 3, height, width)",
            header.shape
        )
    };
    let &[views, lights, channels, height, width] = header.shape.as_slice() else {
        return Err(shape_error(&format!("{} axes", header.shape.len())));
    };
    if channels != 3 {
        return Err(shape_error(&format!("{channels} channels on the third axis")));
    }
    let directions = 1..=u64::from(tileset::MAX_DIRECTIONS);
    let sides = 1..=u64::from(tileset::MAX_SIDE_TEXELS);
    for (what, length, accepted) in [
        ("views", views, &directions),
        ("lights", lights, &directions),
        ("rows of texels", height, &sides),
        ("columns of texels", width, &sides),
    ] {
        if !accepted.contains(&length) {
            return Err(shape_error(&format!(
                "{length} {what}, accepted are 1 to {}",
                accepted.end()
            )));
        }
    }
    // 2^12 · 2^12 · 3 · 2^16 · 2^16 · 4 < 2^64.
    Ok((
        dtype,
        [views, lights, height, width].map(|length| length as usize),
    ))
}

pub(super) fn read_sampling(path: &Path) -> Result<Sampling> {
    let file = File::open(path).map_err(Error::io(
        path,
        "open the directions that belong to the .npy file",
    ))?;
    let mut text = String::new();
    file.take(MAX_JSON_BYTES + 1)
        .read_to_string(&mut text)
        .map_err(Error::io(path, "read"))?;
    if text.len() as u64 > MAX_JSON_BYTES {
        return Err(Error::format(
            path,
            format!("is longer than {MAX_JSON_BYTES} bytes"),
        ));
    }
    Sampling::parse(&text).map_err(|detail| Error::format(path, detail))
}
