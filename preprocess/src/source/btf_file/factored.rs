//! The images of files that hold factors: full matrix (FMF), decorrelated (DFMF) and per-view (PVF) factorizations.
//!
//! Factors stay in the file. A call reads the rows of its images once, and goes through the texels in blocks that
//! the threads share: read, multiply, turn into RGB, write to the buffer.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::bytes::ByteFile;
use super::colour::ColourModel;
use super::pieces::{even_bounds, pieces};
use super::product::Product;
use crate::Result;
use crate::npy::Samples;
use crate::source::{Images, LowRank};

/// Scalars of a texel factor that a task holds: 2 MiB of f32.
const BLOCK_SCALARS: usize = 1 << 19;
/// Most texels of a task.
const BLOCK_TEXELS: usize = 512;
/// Images whose values a task holds at a time: with three channels and `BLOCK_TEXELS` 1.5 MiB. Many images to few
/// texels: the product packs the texel factor anew for each block of images.
const BLOCK_IMAGES: usize = 256;

/// Images that are products of factors.
#[derive(Debug)]
pub(super) struct Factored {
    /// For people.
    pub(super) file: Arc<ByteFile>,
    pub(super) format: String,
    pub(super) notes: Vec<String>,
    pub(super) colour: ColourModel,
    /// One product for all images, or one a view.
    pub(super) products: Vec<Product>,
    /// Images that a product holds.
    pub(super) product_images: usize,
    /// Texels of an image.
    pub(super) texels: usize,
}

impl Factored {
    /// Writes the images of one product to `out`, `[image][rgb][texel]`.
    fn decode(&self, product: &Product, images: Range<usize>, out: &mut [f32]) -> Result<()> {
        let left = product.images.read(images.clone())?;
        let means = product.image_means(images.clone())?;
        let count = (BLOCK_SCALARS / product.most_terms()).clamp(1, BLOCK_TEXELS);
        let bounds = even_bounds(self.texels, count);
        pieces(out, &bounds)
            .into_par_iter()
            .zip(bounds.par_windows(2))
            .try_for_each_init(Vec::new, |values, (mut rows, bounds)| {
                let texels = bounds[0]..bounds[1];
                for (block, rows) in rows.chunks_mut(3 * BLOCK_IMAGES).enumerate() {
                    let first = block * BLOCK_IMAGES;
                    let images = first..first + rows.len() / 3;
                    product.values(&left, &means, texels.clone(), images, values)?;
                    self.write_rgb(values, rows);
                }
                Ok(())
            })
    }

    /// Turns values `[image][channel][texel]` into the rows `[image, rgb][texel]`.
    fn write_rgb(&self, values: &[f32], rows: &mut [&mut [f32]]) {
        let texels = rows[0].len();
        for (values, rows) in values.chunks_exact(3 * texels).zip(rows.as_chunks_mut::<3>().0) {
            if self.colour == ColourModel::Rgb {
                let values = values.chunks_exact(texels);
                rows.iter_mut()
                    .zip(values)
                    .for_each(|(row, values)| row.copy_from_slice(values));
                continue;
            }
            let (y, chroma) = values.split_at(texels);
            let (u, v) = chroma.split_at(texels);
            let [red, green, blue] = rows;
            for texel in 0..texels {
                [red[texel], green[texel], blue[texel]] = self.colour.rgb([y[texel], u[texel], v[texel]]);
            }
        }
    }
}

impl Images for Factored {
    fn format(&self) -> String {
        self.format.clone()
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn stored_bytes(&self) -> u64 {
        let bytes = |product: &Product| product.images.bytes() + product.texels.bytes();
        self.products.iter().map(bytes).sum()
    }

    fn samples<'a>(&'a self, images: Range<usize>, buffer: &'a mut Vec<f32>) -> Result<Samples<'a>> {
        let image_samples = 3 * self.texels;
        buffer.resize(images.len() * image_samples, 0.0);
        let mut out = &mut buffer[..];
        let mut at = images.start;
        while at < images.end {
            let product = at / self.product_images;
            let first = product * self.product_images;
            let end = images.end.min(first + self.product_images);
            let (here, rest) = out.split_at_mut((end - at) * image_samples);
            self.decode(&self.products[product], at - first..end - first, here)?;
            (out, at) = (rest, end);
        }
        Ok(Samples::F32(buffer))
    }

    fn place(&self, image: usize) -> String {
        let product = &self.products[image / self.product_images];
        let row = image % self.product_images;
        format!("its factors, from byte {}", product.images.offset(row))
    }

    fn low_rank(&self) -> Result<Option<LowRank>> {
        let ([product], Some(colour)) = (self.products.as_slice(), self.colour.linear()) else {
            return Ok(None);
        };
        let low_rank = super::low_rank::low_rank(product, colour, self.product_images, self.texels)?;
        for (what, factor) in [("image", &low_rank.u), ("texel", &low_rank.v)] {
            let rows = factor.len() / low_rank.terms;
            if let Some(bad) = factor.iter().position(|value| !value.is_finite()) {
                let row = if what == "image" {
                    bad % rows / 3
                } else {
                    bad % rows
                };
                return Err(self.file.error(format!(
                    "has a factor that is {} in component {} of {what} {row}: factors must be finite; repair it at \
                     its source",
                    factor[bad],
                    bad / rows
                )));
            }
        }
        Ok(Some(low_rank))
    }
}
