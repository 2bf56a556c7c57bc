//! Textures: what passes draw into, and the layered ones of the caches.

use crate::{Error, Result, gpu::Context};

/// Formats of the passes' outputs.
pub(super) const VISIBILITY: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Uint;
pub(super) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Full floats: half floats would cost a relative error of 2^-11, about what the whole renderer is allowed.
pub(super) const PICTURE: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
pub(super) const SCREEN: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Pages are filtered: four half floats a texel.
pub(super) const PAGES: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// Columns are not: eight half floats a texel, as words.
pub(super) const COLUMNS: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;

/// A texture and its view.
pub(super) struct Target {
    pub(super) texture: wgpu::Texture,
    pub(super) view: wgpu::TextureView,
}

/// The outputs of all passes, of the picture's size.
pub(super) struct Targets {
    pub(super) size: (u32, u32),
    pub(super) visibility: Target,
    pub(super) depth: Target,
    pub(super) picture: Target,
    pub(super) screen: Target,
}

impl Targets {
    /// # Errors
    /// [`Error::Budget`] for a picture without pixels, or larger than the adapter's textures.
    pub(super) fn new(context: &Context, size: (u32, u32)) -> Result<Self> {
        let limit = context.device.limits().max_texture_dimension_2d;
        if !(1..=limit).contains(&size.0) || !(1..=limit).contains(&size.1) {
            return Err(Error::Budget(format!(
                "a picture of {}x{} pixels: sides from 1 to {limit} can be drawn on this adapter",
                size.0, size.1
            )));
        }
        use wgpu::TextureUsages as Usage;
        let target = |label, format, usage| {
            let texture = context.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d {
                    width: size.0,
                    height: size.1,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            });
            Target {
                view: texture.create_view(&Default::default()),
                texture,
            }
        };
        let drawn = Usage::RENDER_ATTACHMENT | Usage::TEXTURE_BINDING | Usage::COPY_SRC;
        let written = Usage::STORAGE_BINDING | Usage::TEXTURE_BINDING | Usage::COPY_SRC;
        Ok(Self {
            size,
            visibility: target("visibility", VISIBILITY, drawn),
            depth: target("depth", DEPTH, Usage::RENDER_ATTACHMENT),
            picture: target("picture", PICTURE, written),
            screen: target("screen", SCREEN, written),
        })
    }

    pub(super) fn bytes(&self) -> u64 {
        [&self.visibility, &self.depth, &self.picture, &self.screen]
            .iter()
            .map(|target| u64::from(target.texture.format().block_copy_size(None).unwrap_or(4)))
            .sum::<u64>()
            * u64::from(self.size.0)
            * u64::from(self.size.1)
    }
}

/// An array of textures of width, height, layers, to be filled piece by piece, and for what else it is used.
pub(super) fn layers(
    context: &Context,
    label: &str,
    format: wgpu::TextureFormat,
    (width, height, layers): (u32, u32, u32),
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    context.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: layers,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST | usage,
        view_formats: &[],
    })
}

/// A view of all layers, also where there is only one.
pub(super) fn layers_view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// Writes texels into a rectangle of a layer.
pub(super) fn write(
    context: &Context,
    texture: &wgpu::Texture,
    origin: wgpu::Origin3d,
    (width, height): (u32, u32),
    bytes: &[u8],
) {
    context.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin,
            aspect: wgpu::TextureAspect::All,
        },
        bytes,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(width * texture.format().block_copy_size(None).unwrap_or(8)),
            rows_per_image: None,
        },
        wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
    );
}

/// Copies a rectangle of width and height from a place in one texture to one in another.
pub(super) fn copy(
    encoder: &mut wgpu::CommandEncoder,
    from: (&wgpu::Texture, wgpu::Origin3d),
    to: (&wgpu::Texture, wgpu::Origin3d),
    (width, height): (u32, u32),
) {
    let place = |(texture, origin)| wgpu::TexelCopyTextureInfo {
        texture,
        mip_level: 0,
        origin,
        aspect: wgpu::TextureAspect::All,
    };
    encoder.copy_texture_to_texture(
        place(from),
        place(to),
        wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
    );
}
