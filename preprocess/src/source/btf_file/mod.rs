//! UBO `.btf` files: UBO2014, OBJECTS2011 and OBJECTS2012 of the University of Bonn.
//!
//! | signature | samples |
//! |---|---|
//! | `!FMF12FCER`, `!FMF06FC`, `!FMF06FCR` | full matrix factorization: ρ = U·(S·V)ᵀ of all of RGB, or of log RGB |
//! | `!DFMF08FCR` | a factorization for each channel of a colour model |
//! | `!PVF06FC`, `!PVF06FCR`, magic 301074 | a PCA for each view |
//! | `!BDIF06R2!` | no factorization: half floats, one apparent BRDF after the other, plain, bzip2 or sparse |
//!
//! Factors stay in the file; images are multiplied when they are asked for. [`LowRank`](super::LowRank) hands the
//! factors on where colours are linear: FMF without range reduction, DFMF in RGB, YUV, YCoCg or PCA, and PVF of
//! one view.
//!
//! The samples of BDI files are transposed once, when the first image is asked for, into a scratch file of
//! 2 bytes × 3 × views × lights × texels stored. It lies beside the `.btf` file, or in the system's folder for
//! temporary files if that folder cannot be written, has no name (on Windows: is deleted when it is closed), and
//! goes with the reader, however that ends. At most 64 MiB of samples are held twice while it is made.
//!
//! What is read and not applied, and named by [`Btf::notes`]: local frames (signatures with an R: the samples'
//! directions are taken as those of the tangent frame), the height map, the XML text, and the rgb scale, which neither of
//! the two readers named below applies; samples are taken as radiance factors. The files do not say whether the material repeats; it is taken not to.
//!
//! Channels that are named by wavelengths are a spectrum, which becomes linear RGB under D65 (CIE 1931 observer) in BDI
//! files and in linear FMF files, where its layout is known: their channels lie next to each other.
//!
//! Not supported, with an error that says so: spectra in other layouts, colour model 6, and lights that differ between
//! views.
//!
//! Nothing in a header is believed before it is compared with the file's length, so memory stays below a small
//! multiple of that length whatever a header claims.
//!
//! Source: the University of Bonn's btflib (Merzbach, 2014 to 2016) and the Free BTF Library (Velinov, 2016)
//! describe the bytes; Müller, Meseth, Sattler, Sarlette, Klein: Acquisition, Synthesis and Rendering of
//! Bidirectional Texture Functions, 2005, the factorizations.

mod bdi;
mod bytes;
mod colour;
mod factored;
mod header;
mod layouts;
mod low_rank;
mod matrix;
mod pieces;
mod product;
mod transpose;

use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use self::bytes::{ByteFile, Cursor};
use self::header::{Header, Kind, OLD_PVF_MAGIC, Signature};
use crate::source::Images;
use crate::{Btf, Result};

/// Whether `path` is to be read by this module: by the first bytes of the file, or else by its name.
pub(super) fn is_btf_file(path: &Path) -> bool {
    if !path.is_file() {
        return false;
    }
    let mut first = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(18).read_to_end(&mut first));
    read.is_ok() && Signature::find(&first).is_some()
        || path
            .extension()
            .is_some_and(|extension| extension.eq_ignore_ascii_case("btf"))
}

/// Opens a `.btf` file. Its header is read and compared with its length, its samples are not read.
///
/// # Errors
/// [`crate::Error::Io`], or [`crate::Error::Format`] naming the byte, what stands there and what was expected.
pub(super) fn open(path: &Path) -> Result<Btf> {
    let file = Arc::new(ByteFile::open(path)?);
    let mut cursor = Cursor::new(&file);
    let cursor = &mut cursor;
    let signature = Signature::read(cursor)?;
    let mut slots = None;
    let mut header = if signature.kind == Kind::Pvf && is_old_pvf(cursor)? {
        let (header, count) = Header::read_old_pvf(cursor)?;
        slots = Some(count);
        header
    } else {
        Header::read(cursor)?
    };
    if let (Kind::Dfmf | Kind::Pvf, Some(spectrum)) = (signature.kind, &header.spectrum) {
        return Err(file.error(format!(
            "holds a spectrum of {} channels as DFMF or PVF, for which the order of channels is not public: spectra are \
             read from BDI and FMF files; convert it to one of them, or to linear RGB, with the tool that wrote it",
            spectrum.len()
        )));
    }
    if signature.frames && signature.kind != Kind::Bdi && slots.is_none() {
        header.skip_frames(cursor)?;
    }
    let images: Box<dyn Images> = match signature.kind {
        Kind::Fmf { extended } => Box::new(layouts::fmf(cursor, &file, &mut header, extended)?),
        Kind::Dfmf => Box::new(layouts::dfmf(cursor, &file, &header)?),
        Kind::Pvf => Box::new(layouts::pvf(cursor, &file, &header, slots)?),
        Kind::Bdi => Box::new(bdi::open(cursor, &file, &mut header)?),
    };
    Btf::new(path, header.sampling, (header.width, header.height), images)
}

/// Steps over the older magic number if it comes next.
fn is_old_pvf(cursor: &mut Cursor<'_>) -> Result<bool> {
    let mut ahead = Cursor::new(cursor.file());
    ahead.skip("the signature", cursor.at())?;
    let old = ahead.u32("the size of the meta data")? == OLD_PVF_MAGIC;
    if old {
        *cursor = ahead;
    }
    Ok(old)
}
