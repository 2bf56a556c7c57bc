//! What passes draw into, and the layered textures of the caches.

use crate::{
    Error, Result,
    gpu::{Context, bind},
};

/// Formats of the passes' outputs.
pub(super) const VISIBILITY: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Uint;
pub(super) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Full floats: half floats would cost a relative error of 2^-11, about what the whole renderer is allowed.
pub(super) const PICTURE: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
pub(super) const SCREEN: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Columns are not: eight half floats a texel, as words.
pub(super) const COLUMNS: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;
/// Unless they are maps of the light hemisphere: four half floats a texel.
pub(super) const MAPS: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// A texture and its view.
pub(super) struct Target {
    pub(super) texture: wgpu::Texture,
    pub(super) view: wgpu::TextureView,
}

/// Ids of what pixels see.
pub(super) struct Ids {
    pub(super) size: (u32, u32),
    pub(super) visibility: Target,
    pub(super) depth: Target,
}

/// The outputs of all passes, of the picture's size.
pub(super) struct Targets {
    pub(super) size: (u32, u32),
    pub(super) ids: Ids,
    /// Of cameras that are not shown: one pixel for [`AHEAD_SIDE`]² of the picture.
    pub(super) ahead: Ids,
    /// Items to shade, and the workgroups that take; see `work.wgsl`.
    pub(super) work: wgpu::Buffer,
    pub(super) workgroups: wgpu::Buffer,
    pub(super) picture: Target,
    pub(super) screen: Target,
}

/// Side of the squares of the picture for which one pixel votes ahead.
pub(super) const AHEAD_SIDE: u32 = 4;
/// Bytes of the counts before the list of items.
pub(super) const WORK_HEADER_BYTES: u64 = 32;
/// Items for each tile of the picture, and one if it is mixed; `MOST_ITEMS` in `work.wgsl`.
const TILE_ITEMS: u64 = 2 + 1;
const ITEM_BYTES: u64 = 8;
/// Bytes of the workgroups to dispatch of three kinds.
const WORKGROUPS_BYTES: u64 = 3 * 12;

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
        let target = |label, format, size: (u32, u32), usage| {
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
        let ids = |size| Ids {
            size,
            visibility: target("visibility", VISIBILITY, size, drawn),
            depth: target("depth", DEPTH, size, Usage::RENDER_ATTACHMENT),
        };
        let work_bytes = WORK_HEADER_BYTES + tiles(size) * TILE_ITEMS * ITEM_BYTES;
        Ok(Self {
            size,
            ids: ids(size),
            ahead: ids((size.0.div_ceil(AHEAD_SIDE), size.1.div_ceil(AHEAD_SIDE))),
            work: bind::zeros(
                context,
                "items to shade",
                work_bytes,
                wgpu::BufferUsages::COPY_SRC,
            )?,
            workgroups: bind::zeros(
                context,
                "workgroups",
                WORKGROUPS_BYTES,
                wgpu::BufferUsages::INDIRECT,
            )?,
            picture: target("picture", PICTURE, size, written),
            screen: target("screen", SCREEN, size, written),
        })
    }

    /// Starts the lists of items anew. Rows of workgroups are as long as there are rows at most: neither is more than
    /// the square root of the items that textures of 2^15 texels a side can have, 2^13.
    pub(super) fn clear_work(&self, queue: &wgpu::Queue) {
        let across = ((tiles(self.size) * TILE_ITEMS) as f64).sqrt().ceil() as u32;
        queue.write_buffer(&self.work, 0, &[0; WORK_HEADER_BYTES as usize]);
        queue.write_buffer(&self.workgroups, 0, bytemuck::bytes_of(&[[across, 0, 1]; 3]));
    }

    pub(super) fn bytes(&self) -> u64 {
        let Self { ids, ahead, .. } = self;
        let targets = [
            &ids.visibility,
            &ids.depth,
            &ahead.visibility,
            &ahead.depth,
            &self.picture,
            &self.screen,
        ];
        let bytes = targets.map(|Target { texture, .. }| {
            let texel = texture.format().block_copy_size(None).unwrap_or(4);
            u64::from(texel) * u64::from(texture.width()) * u64::from(texture.height())
        });
        bytes.iter().sum::<u64>() + self.work.size() + self.workgroups.size()
    }
}

/// Tiles of a picture of this size, one workgroup each.
fn tiles((width, height): (u32, u32)) -> u64 {
    let along = |side: u32| u64::from(side.div_ceil(bind::WORKGROUP_SIDE));
    along(width) * along(height)
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

/// Writes texels into a rectangle of a layer; rows are so many bytes apart.
pub(super) fn write(
    context: &Context,
    texture: &wgpu::Texture,
    origin: wgpu::Origin3d,
    (width, height): (u32, u32),
    row_bytes: u32,
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
            bytes_per_row: Some(row_bytes),
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
