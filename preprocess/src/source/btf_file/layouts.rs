//! What follows the header in files that hold factors.

use std::sync::Arc;

use super::bytes::{ByteFile, Cursor};
use super::colour::ColourModel;
use super::factored::Factored;
use super::header::Header;
use super::matrix::{Matrix, Scalar};
use super::product::{Mean, Product, Side};
use crate::Result;

/// Most components that are accepted; their number never exceeds the lesser side of the matrix, and a file of more
/// than some hundred is none that was compressed.
const MAX_COMPONENTS: u32 = 1 << 14;

/// The sizes in front of a factorization: u8 scalar size, u32 components, u32 rows, u32 columns.
struct Sizes {
    scalar: Scalar,
    components: usize,
    rows: usize,
    columns: usize,
    /// Where they stand.
    at: u64,
}

impl Sizes {
    fn read(cursor: &mut Cursor<'_>, what: &str) -> Result<Self> {
        let at = cursor.at();
        let scalar = Scalar::read(cursor, what)?;
        let components = cursor.u32(format_args!("the number of components of {what}"))?;
        if components == 0 || components > MAX_COMPONENTS {
            return Err(cursor.file().error(format!(
                "has {components} components in {what} (byte {}), expected 1 to {MAX_COMPONENTS}",
                at + 1
            )));
        }
        let rows = cursor.u32(format_args!("the number of rows of {what}"))? as usize;
        let columns = cursor.u32(format_args!("the number of columns of {what}"))? as usize;
        let components = components as usize;
        Ok(Self {
            scalar,
            components,
            rows,
            columns,
            at,
        })
    }

    /// Whether the factors are stored as `upright` says, (rows, columns), and not as `transposed` says.
    fn upright(
        &self,
        file: &ByteFile,
        what: &str,
        upright: (usize, usize),
        transposed: (usize, usize),
    ) -> Result<bool> {
        match (self.rows, self.columns) {
            found if found == upright => Ok(true),
            found if found == transposed => Ok(false),
            found => Err(file.error(format!(
                "has {what} of {} x {} (byte {}), expected {} x {} or, transposed, {} x {} after its counts of views, \
                 lights and texels",
                found.0, found.1, self.at, upright.0, upright.1, transposed.0, transposed.1
            ))),
        }
    }

    fn matrix(
        &self,
        cursor: &mut Cursor<'_>,
        file: &Arc<ByteFile>,
        what: String,
        rows: usize,
    ) -> Result<Matrix> {
        Matrix::next(cursor, file, what, (rows, self.components), self.scalar)
    }

    /// Steps over as many scalars as there are components.
    fn skip_values(&self, cursor: &mut Cursor<'_>, what: String) -> Result<()> {
        cursor.skip(what, (self.components * self.scalar.bytes()) as u64)
    }
}

/// FMF: rows are `rgb + 3·(light + lights·view)` and columns `x + width·y`; or, transposed, rows are
/// `rgb + 3·(x + width·y)` and columns `light + lights·view`. A spectrum has its channels in place of rgb, and their number
/// in place of 3.
pub(super) fn fmf(
    cursor: &mut Cursor<'_>,
    file: &Arc<ByteFile>,
    header: &mut Header,
    extended: bool,
) -> Result<Factored> {
    let mut colour = ColourModel::Rgb;
    if extended {
        let at = cursor.at();
        let version = cursor.u8("the version of the FMF header")?;
        if version > 2 {
            return Err(file.error(format!(
                "has an FMF header of version {version} (byte {at}), known are 0 to 2"
            )));
        }
        if version >= 1 && cursor.u32("the range reduction")? != 0 {
            colour = ColourModel::LogRgb;
        }
        if version >= 2 {
            let width = cursor.u32("the width of the height map")?;
            let height = cursor.u32("the height of the height map")?;
            // At most 2^64 - 2^33 + 1 texels of two bytes: saturating, and then longer than any file.
            let bytes = (u64::from(width) * u64::from(height)).saturating_mul(2);
            cursor.skip(format_args!("a height map of {width} x {height} f16"), bytes)?;
            if bytes > 0 {
                header
                    .notes
                    .push(format!("a height map of {width}x{height} is stored and not used"));
            }
        }
    }
    let channels = header.channels();
    if colour == ColourModel::LogRgb && header.spectrum.is_some() {
        return Err(file.error(format!(
            "holds logarithms of a spectrum of {channels} channels, which do not add up to colours: spectra are read \
             without range reduction; convert it to linear values or to RGB with the tool that wrote it"
        )));
    }
    cursor.u32("the number of components")?;
    let sizes = Sizes::read(cursor, "the factorization")?;
    let (images, texels) = (header.images(), header.texels());
    let upright = sizes.upright(
        file,
        "factors",
        (channels * images, texels),
        (channels * texels, images),
    )?;
    sizes.skip_values(cursor, format!("{} singular values", sizes.components))?;
    let u = sizes.matrix(cursor, file, "U".into(), sizes.rows)?;
    let v = sizes.matrix(cursor, file, "S*V".into(), sizes.columns)?;
    cursor.finish("S*V")?;
    let scalar = u.scalar();
    let u = match header.spectrum.take() {
        None => Side::Interleaved(u),
        Some(rgb) => Side::Spectrum(u, rgb),
    };
    let (images_side, texels_side) = if upright {
        (u, Side::Shared(v))
    } else {
        (Side::Shared(v), u)
    };
    let product = Product {
        images: images_side,
        texels: texels_side,
        mean: Mean::Zero,
    };
    let what = format!(
        "full matrix factorization of {}, {} components of {}",
        colour.name(),
        sizes.components,
        scalar.name()
    );
    Ok(factored(file, header, what, colour, vec![product], images))
}

/// DFMF: a factorization for each channel of the colour model; rows are `view·lights + light` and columns
/// `x + width·y`, or the other way round.
pub(super) fn dfmf(cursor: &mut Cursor<'_>, file: &Arc<ByteFile>, header: &Header) -> Result<Factored> {
    cursor.u32("the number of components")?;
    let at = cursor.at();
    let model = cursor.i32("the colour model")?;
    let mut numbers = [0.0; 12];
    for number in &mut numbers {
        *number = cursor.f32("mean and matrix of the colour model")?;
    }
    let mean = [numbers[0], numbers[1], numbers[2]];
    let matrix = std::array::from_fn(|i| std::array::from_fn(|j| numbers[3 + 3 * i + j]));
    let colour = ColourModel::new(file, at, model, mean, matrix)?;
    let (images, texels) = (header.images(), header.texels());
    let (mut uprights, mut planes) = (Vec::new(), Vec::new());
    let mut components = Vec::new();
    for channel in 0..3 {
        let what = format!("channel {channel}");
        let sizes = Sizes::read(cursor, &what)?;
        let upright = sizes.upright(
            file,
            &format!("factors of {what}"),
            (images, texels),
            (texels, images),
        )?;
        sizes.skip_values(cursor, format!("{} singular values of {what}", sizes.components))?;
        let u = sizes.matrix(cursor, file, format!("U of {what}"), sizes.rows)?;
        let v = sizes.matrix(cursor, file, format!("S*V of {what}"), sizes.columns)?;
        components.push(format!("{} of {}", sizes.components, sizes.scalar.name()));
        uprights.push(upright);
        planes.push(if upright { (u, v) } else { (v, u) });
    }
    cursor.finish("the factors of channel 2")?;
    let side = |pick: fn(&(Matrix, Matrix)) -> &Matrix| {
        Side::Planes(std::array::from_fn(|channel| pick(&planes[channel]).clone()))
    };
    let product = Product {
        images: side(|p| &p.0),
        texels: side(|p| &p.1),
        mean: Mean::Zero,
    };
    let what = format!(
        "decorrelated full matrix factorization, colour model {model} ({}), components {}",
        colour.name(),
        components.join(", ")
    );
    Ok(factored(file, header, what, colour, vec![product], images))
}

/// PVF: u32 components and u32 slots, then a PCA for each view. Its dimensions are `rgb + 3·light` and its weights
/// those of texels; or, transposed, dimensions `rgb + 3·(x + width·y)` and weights of lights.
pub(super) fn pvf(
    cursor: &mut Cursor<'_>,
    file: &Arc<ByteFile>,
    header: &Header,
    slots: Option<u32>,
) -> Result<Factored> {
    let slots = match slots {
        Some(slots) => slots,
        None => {
            cursor.u32("the number of components")?;
            cursor.u32("the number of view slots")?
        }
    };
    let (views, lights) = (header.sampling.views.len(), header.sampling.lights.len());
    if slots as usize != views {
        return Err(file.error(format!(
            "has {slots} view slots and {views} views (before byte {}): expected one slot for every view",
            cursor.at()
        )));
    }
    let texels = header.texels();
    let mut products = Vec::new();
    let (mut fewest, mut most) = (usize::MAX, 0);
    for view in 0..views {
        let what = format!("view {view}");
        // Weights stand before dimensions.
        let sizes = Sizes::read(cursor, &what)?;
        let (weights, dimensions) = (sizes.rows, sizes.columns);
        let per_light = sizes.upright(
            file,
            &format!("weights and dimensions of {what}"),
            (texels, 3 * lights),
            (lights, 3 * texels),
        )?;
        sizes.skip_values(cursor, format!("{} eigenvalues of {what}", sizes.components))?;
        let mean = Matrix::next(
            cursor,
            file,
            format!("the mean of {what}"),
            (dimensions, 1),
            sizes.scalar,
        )?;
        let c = sizes.matrix(cursor, file, format!("the components of {what}"), dimensions)?;
        let w = sizes.matrix(cursor, file, format!("the weights of {what}"), weights)?;
        products.push(if per_light {
            Product {
                images: Side::Interleaved(c),
                texels: Side::Shared(w),
                mean: Mean::Images(mean),
            }
        } else {
            Product {
                images: Side::Shared(w),
                texels: Side::Interleaved(c),
                mean: Mean::Texels(mean),
            }
        });
        (fewest, most) = (fewest.min(sizes.components), most.max(sizes.components));
    }
    cursor.finish("the last view")?;
    let what = format!("per-view factorization, {fewest} to {most} components a view");
    Ok(factored(file, header, what, ColourModel::Rgb, products, lights))
}

fn factored(
    file: &Arc<ByteFile>,
    header: &Header,
    what: String,
    colour: ColourModel,
    products: Vec<Product>,
    product_images: usize,
) -> Factored {
    Factored {
        file: file.clone(),
        format: format!("UBO .btf, {what}"),
        notes: header.notes.clone(),
        colour,
        products,
        product_images,
        texels: header.texels(),
    }
}
