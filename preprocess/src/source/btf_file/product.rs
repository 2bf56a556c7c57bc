//! A product of two factors in the file: which rows belong to an image, which to a texel.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::matrix::Matrix;
use crate::Result;

/// `value[image][channel][texel] = Σ_k images[image, channel][k]·texels[texel, channel][k]`, plus the means.
#[derive(Debug)]
pub(super) struct Product {
    /// The factor with rows for images: all images of the file, or the lights of one view.
    pub(super) images: Side,
    /// The factor with rows for texels.
    pub(super) texels: Side,
    /// What was subtracted before the factorization.
    pub(super) mean: Mean,
}

/// One of the two factors.
#[derive(Debug)]
pub(super) enum Side {
    /// One row an item, for all channels.
    Shared(Matrix),
    /// Row `3·item + channel`.
    Interleaved(Matrix),
    /// Row `channels·item + channel` of a spectrum, and what its channels add to red, green and blue.
    Spectrum(Matrix, Vec<[f32; 3]>),
    /// One matrix a channel, with a row an item.
    Planes([Matrix; 3]),
}

/// A column of means.
#[derive(Debug)]
pub(super) enum Mean {
    /// There is none.
    Zero,
    /// Row `3·image + channel`.
    Images(Matrix),
    /// Row `3·texel + channel`.
    Texels(Matrix),
}

/// Rows of a [`Side`] in memory.
pub(super) struct Rows {
    data: Vec<f32>,
    items: usize,
    /// For every channel: where its first row begins, how far its rows lie apart, how long they are.
    channels: [(usize, usize, usize); 3],
}

impl Side {
    fn matrices(&self) -> &[Matrix] {
        match self {
            Side::Shared(matrix) | Side::Interleaved(matrix) | Side::Spectrum(matrix, _) => {
                std::slice::from_ref(matrix)
            }
            Side::Planes(matrices) => matrices,
        }
    }

    /// Terms of each channel.
    pub(super) fn terms(&self) -> [usize; 3] {
        match self {
            Side::Shared(matrix) | Side::Interleaved(matrix) | Side::Spectrum(matrix, _) => {
                [matrix.columns(); 3]
            }
            Side::Planes(matrices) => matrices.each_ref().map(Matrix::columns),
        }
    }

    /// Bytes in the file.
    pub(super) fn bytes(&self) -> u64 {
        self.matrices().iter().map(Matrix::bytes).sum()
    }

    /// Where the first row of an item begins in the file.
    pub(super) fn offset(&self, item: usize) -> u64 {
        match self {
            Side::Interleaved(matrix) => matrix.row_offset(3 * item),
            Side::Spectrum(matrix, rgb) => matrix.row_offset(rgb.len() * item),
            _ => self.matrices()[0].row_offset(item),
        }
    }

    /// Reads the rows of some items.
    pub(super) fn read(&self, items: Range<usize>) -> Result<Rows> {
        let mut data = Vec::new();
        let terms = self.terms();
        let channels = match self {
            Side::Shared(matrix) => {
                matrix.read(items.clone(), &mut data)?;
                [(0, terms[0], terms[0]); 3]
            }
            Side::Interleaved(matrix) => {
                matrix.read(3 * items.start..3 * items.end, &mut data)?;
                std::array::from_fn(|channel| (channel * terms[0], 3 * terms[0], terms[0]))
            }
            Side::Spectrum(matrix, rgb) => {
                let mut spectrum = Vec::new();
                for item in items.clone() {
                    spectrum.clear();
                    matrix.read(rgb.len() * item..rgb.len() * (item + 1), &mut spectrum)?;
                    for colour in 0..3 {
                        data.extend((0..terms[0]).map(|term| -> f32 {
                            let values = spectrum.iter().skip(term).step_by(terms[0]);
                            values.zip(rgb).map(|(value, rgb)| value * rgb[colour]).sum()
                        }));
                    }
                }
                std::array::from_fn(|channel| (channel * terms[0], 3 * terms[0], terms[0]))
            }
            Side::Planes(matrices) => {
                let mut starts = [0; 3];
                for (start, matrix) in starts.iter_mut().zip(matrices) {
                    *start = data.len();
                    matrix.read(items.clone(), &mut data)?;
                }
                std::array::from_fn(|channel| (starts[channel], terms[channel], terms[channel]))
            }
        };
        let items = items.len();
        Ok(Rows {
            data,
            items,
            channels,
        })
    }
}

impl Rows {
    /// Rows of all channels, `3·item + channel`, of an interleaved side.
    fn interleaved(&self) -> MatRef<'_, f32> {
        MatRef::from_row_major_slice(&self.data, 3 * self.items, self.channels[0].2)
    }

    /// items × terms of a channel.
    pub(super) fn channel(&self, channel: usize) -> MatRef<'_, f32> {
        let (start, stride, terms) = self.channels[channel];
        MatRef::from_row_major_slice_with_stride(&self.data[start..], self.items, terms, stride)
    }
}

impl Product {
    /// Most terms of a channel.
    pub(super) fn most_terms(&self) -> usize {
        self.texels.terms().into_iter().max().expect("three channels")
    }

    /// Values of some texels under the images of `left`, `[image][channel][texel]`. `image_means` are those of the
    /// images, if there are any.
    pub(super) fn values(
        &self,
        left: &Rows,
        image_means: &[f32],
        texels: Range<usize>,
        images: Range<usize>,
        out: &mut Vec<f32>,
    ) -> Result<()> {
        let count = texels.len();
        let right = self.texels.read(texels.clone())?;
        out.resize(3 * images.len() * count, 0.0);
        if let (Side::Interleaved(_) | Side::Spectrum(..), Side::Shared(_)) = (&self.images, &self.texels) {
            // One product for the three channels packs the texel factor once and not three times.
            let left = left.interleaved().subrows(3 * images.start, 3 * images.len());
            let values = MatMut::from_row_major_slice_mut(out, 3 * images.len(), count);
            let right = right.channel(0).transpose();
            matmul(values, Accum::Replace, left, right, 1.0, Par::Seq);
        } else {
            for channel in 0..3 {
                let left = left.channel(channel).subrows(images.start, images.len());
                let right = right.channel(channel).transpose();
                let plane = &mut out[channel * count..];
                // Columns and a transposition: faer 0.24.4's own strided row-major view swaps its strides.
                let values =
                    MatMut::from_column_major_slice_with_stride_mut(plane, count, images.len(), 3 * count);
                let values = values.transpose_mut();
                matmul(values, Accum::Replace, left, right, 1.0, Par::Seq);
            }
        }
        match &self.mean {
            Mean::Zero => {}
            Mean::Images(_) => {
                let means = &image_means[3 * images.start..3 * images.end];
                for (row, mean) in out.chunks_exact_mut(count).zip(means) {
                    row.iter_mut().for_each(|value| *value += mean);
                }
            }
            Mean::Texels(matrix) => {
                let mut means = Vec::new();
                matrix.read(3 * texels.start..3 * texels.end, &mut means)?;
                for (row, values) in out.chunks_exact_mut(count).enumerate() {
                    for (value, mean) in values.iter_mut().zip(means.iter().skip(row % 3).step_by(3)) {
                        *value += mean;
                    }
                }
            }
        }
        Ok(())
    }

    /// The means of some images, `3·image + channel`; empty if images have none.
    pub(super) fn image_means(&self, images: Range<usize>) -> Result<Vec<f32>> {
        let mut means = Vec::new();
        if let Mean::Images(matrix) = &self.mean {
            matrix.read(3 * images.start..3 * images.end, &mut means)?;
        }
        Ok(means)
    }
}
