//! Mips for BTFs of which only the finest is stored.

use std::{
    num::NonZeroUsize,
    sync::{Arc, Mutex, PoisonError},
};

use lru::LruCache;
use tileset::{Direction, Pyramid, codec::MipImage};

use super::{Footprint, Reflectance, reflectance::taps};
use crate::angular::Taps;

/// A BTF of which only the finest mip is stored, as it was measured or synthesized.
pub trait Samples: Sync {
    /// Width and height in texels; at least 1 and at most [`tileset::MAX_SIDE_TEXELS`].
    fn size(&self) -> (u32, u32);
    /// Whether it repeats.
    fn wrap(&self) -> bool;
    /// Whether the samples include the light's cosine.
    fn cosine(&self) -> bool;
    /// View directions.
    fn views(&self) -> &[Direction];
    /// Light directions.
    fn lights(&self) -> &[Direction];
    /// Linear RGB of a texel, for indices of view and light.
    fn texel(&self, x: u32, y: u32, view: u32, light: u32) -> [f64; 3];
}

/// Samples with mips, made when they are asked for.
///
/// Coarser mips are the same as those of archives: see [`MipImage::downsample`].
/// They are made for whole images (one view and light) and kept as f32, the most recently used ones up to a
/// number of bytes; so is, for each view, the image under uniform light.
pub struct Mipped<S> {
    samples: S,
    pyramid: Pyramid,
    images: Mutex<LruCache<Key, Arc<Vec<MipImage>>>>,
}

#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Key {
    /// From mip 1 on: mip 0 is read from the samples.
    Lit { view: u32, light: u32 },
    /// From mip 0 on.
    Ambient { view: u32 },
}

impl<S: Samples> Mipped<S> {
    /// Mips for these samples in about `cache_bytes` of memory, or as many as the largest image takes for
    /// each thread that shades.
    ///
    /// # Errors
    /// If the size of the samples is none that a material can have.
    pub fn new(samples: S, cache_bytes: u64) -> crate::Result<Self> {
        let (width, height) = samples.size();
        let pyramid = Pyramid::new(width, height, samples.wrap())?;
        let image_bytes = u64::from(width) * u64::from(height) * size_of::<[f32; 4]>() as u64 * 4 / 3;
        let images = usize::try_from(cache_bytes / image_bytes.max(1))
            .unwrap_or(usize::MAX)
            .clamp(1, 1 << 24);
        let images = NonZeroUsize::new(images).unwrap_or(NonZeroUsize::MIN);
        Ok(Self {
            samples,
            pyramid,
            images: Mutex::new(LruCache::new(images)),
        })
    }

    /// The image from the cache, or made, outside the lock: two threads may make the same one, which is
    /// waste, but never wrong.
    fn image(&self, key: Key, make: impl FnOnce() -> Vec<MipImage>) -> Arc<Vec<MipImage>> {
        let lock = || self.images.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(image) = lock().get(&key) {
            return image.clone();
        }
        let image = Arc::new(make());
        lock().put(key, image.clone());
        image
    }

    fn finest(&self, texel: impl Fn(u32, u32) -> [f64; 3]) -> MipImage {
        let (width, height) = self.pyramid.mip_size(0);
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let texels = texels
            .map(|(x, y)| texel(x, y))
            .map(|[r, g, b]| [r as f32, g as f32, b as f32, 0.0]);
        MipImage {
            width,
            height,
            texels: texels.collect(),
        }
    }

    fn mips(&self, finest: MipImage) -> Vec<MipImage> {
        let mut mips = vec![finest];
        for mip in 1..usize::from(self.pyramid.mip_count()) {
            mips.push(mips[mip - 1].downsample());
        }
        mips
    }

    fn lit(&self, view: u32, light: u32) -> Arc<Vec<MipImage>> {
        self.image(Key::Lit { view, light }, || {
            let mut mips = self.mips(self.finest(|x, y| self.samples.texel(x, y, view, light)));
            mips[0].texels = Vec::new();
            mips
        })
    }

    fn under_uniform_light(&self, view: u32, weights: &[f64]) -> Arc<Vec<MipImage>> {
        self.image(Key::Ambient { view }, || {
            let (width, height) = self.pyramid.mip_size(0);
            // Light by light, each image from its first texel to its last: the order in which samples are
            // stored.
            let mut sums = vec![[0.0; 3]; width as usize * height as usize];
            for (light, &weight) in weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
                for (at, sum) in sums.iter_mut().enumerate() {
                    let (x, y) = (at as u32 % width, at as u32 / width);
                    super::reflectance::add(sum, weight, self.samples.texel(x, y, view, light as u32));
                }
            }
            self.mips(self.finest(|x, y| sums[y as usize * width as usize + x as usize]))
        })
    }
}

impl<S: Samples> Reflectance for Mipped<S> {
    fn size(&self) -> (u32, u32) {
        self.pyramid.mip_size(0)
    }

    fn wrap(&self) -> bool {
        self.pyramid.wrap()
    }

    fn cosine(&self) -> bool {
        self.samples.cosine()
    }

    fn views(&self) -> &[Direction] {
        self.samples.views()
    }

    fn lights(&self) -> &[Direction] {
        self.samples.lights()
    }

    fn texel(&self, mip: u8, x: u32, y: u32, view: u32, light: u32) -> [f64; 3] {
        if mip == 0 {
            self.samples.texel(x, y, view, light)
        } else {
            texel(&self.lit(view, light), mip, x, y)
        }
    }

    fn filter(&self, footprint: &Footprint, view: u32, light: u32) -> [f64; 3] {
        let mut sum = [0.0; 3];
        let mips = footprint
            .texels()
            .iter()
            .any(|texel| texel.mip > 0)
            .then(|| self.lit(view, light));
        for at in footprint.texels() {
            let rgb = match &mips {
                Some(mips) if at.mip > 0 => texel(mips, at.mip, at.x, at.y),
                _ => self.samples.texel(at.x, at.y, view, light),
            };
            super::reflectance::add(&mut sum, at.weight, rgb);
        }
        sum
    }

    fn ambient(&self, footprint: &Footprint, views: &Taps, weights: &[f64]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (view, view_weight) in taps(views) {
            let mips = self.under_uniform_light(view, weights);
            for at in footprint.texels() {
                let rgb = texel(&mips, at.mip, at.x, at.y);
                super::reflectance::add(&mut sum, view_weight * at.weight, rgb);
            }
        }
        sum
    }
}

fn texel(mips: &[MipImage], mip: u8, x: u32, y: u32) -> [f64; 3] {
    let image = &mips[usize::from(mip)];
    let [r, g, b, _] = image.texels[y as usize * image.width as usize + x as usize];
    [r.into(), g.into(), b.into()]
}
