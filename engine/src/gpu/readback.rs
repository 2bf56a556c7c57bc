//! Reading textures back, for programs that may wait.

use crate::{
    Error, Result,
    gpu::{Context, targets::Target},
};

/// All texels of a texture, row by row without padding. Waits for the GPU; not in browsers.
///
/// # Errors
/// [`Error::Adapter`] if the device fails.
pub(super) fn texels(context: &Context, target: &Target) -> Result<Vec<u8>> {
    let size = (target.texture.width(), target.texture.height());
    rectangle(context, &target.texture, wgpu::Origin3d::ZERO, size)
}

/// The same of a rectangle in a layer.
///
/// # Errors
/// [`Error::Adapter`] if the device fails.
pub(super) fn rectangle(
    context: &Context,
    texture: &wgpu::Texture,
    origin: wgpu::Origin3d,
    (width, height): (u32, u32),
) -> Result<Vec<u8>> {
    let row_bytes = width * texture.format().block_copy_size(None).unwrap_or(4);
    // WebGPU copies rows at multiples of this.
    let pitch = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = staging(context, u64::from(pitch) * u64::from(height));
    let mut encoder = context.device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        wgpu::TexelCopyTextureInfo {
            origin,
            ..texture.as_image_copy()
        },
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(pitch),
                rows_per_image: None,
            },
        },
        wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
    );
    let mapped = contents(context, encoder, &buffer)?;
    Ok(mapped
        .chunks_exact(pitch as usize)
        .flat_map(|row| &row[..row_bytes as usize])
        .copied()
        .collect())
}

/// The first bytes of a buffer, a multiple of four. Waits.
///
/// # Errors
/// [`Error::Adapter`] if the device fails.
pub(super) fn head(context: &Context, source: &wgpu::Buffer, bytes: u64) -> Result<Vec<u8>> {
    let buffer = staging(context, bytes);
    let mut encoder = context.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(source, 0, &buffer, 0, bytes);
    contents(context, encoder, &buffer)
}

fn staging(context: &Context, size: u64) -> wgpu::Buffer {
    context.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("readback"),
        size,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    })
}

/// Submits, waits, and returns what is then in the buffer.
fn contents(context: &Context, encoder: wgpu::CommandEncoder, buffer: &wgpu::Buffer) -> Result<Vec<u8>> {
    context.queue.submit([encoder.finish()]);
    // The result is told by get_mapped_range.
    buffer.map_async(wgpu::MapMode::Read, .., |_| {});
    context.wait()?;
    let mapped = buffer
        .get_mapped_range(..)
        .map_err(|error| Error::Adapter(error.to_string()))?;
    Ok(mapped.to_vec())
}
