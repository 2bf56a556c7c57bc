//! Texels on their way into the caches, and entries into their tables: written into buffers that stay mapped, and copied from there
//! by one command each.
//!
//! `Queue::write_texture` makes a buffer for each call: the system maps, clears and faults it in, which takes several times as
//! long as the texels. Here a few buffers go round: mapped, filled, copied from, mapped again when the GPU is done. If none is
//! free, or a rectangle is larger than a buffer, the queue does it after all; nothing waits.
//!
//! Browsers copy mapped memory to and fro themselves, whole: there the queue always does it.

use std::sync::{
    Arc,
    atomic::{AtomicU8, Ordering},
};

use super::{context::Context, targets};

/// Bytes of a buffer: 18 pages of half floats.
const BUFFER_BYTES: u64 = 1 << 20;
/// Most of them: four frames of as many pages as a frame uploads by default.
const MOST_BUFFERS: usize = if cfg!(target_arch = "wasm32") { 0 } else { 8 };
/// Those that are there from the start.
const FIRST_BUFFERS: usize = 2;
/// Copies begin at multiples of this, which any texel divides.
const ALIGNMENT: u64 = 16;

/// The buffer is not mapped yet.
const FLYING: u8 = 0;
/// Mapped.
const FREE: u8 = 1;
/// It never will be: the device is gone.
const LOST: u8 = 2;

/// A buffer, and what of it is taken.
struct Staging {
    buffer: wgpu::Buffer,
    /// While it is being filled.
    view: Option<wgpu::BufferViewMut>,
    used_bytes: u64,
    state: Arc<AtomicU8>,
}

/// What is to be copied from an offset in a buffer.
struct Copy {
    staging: usize,
    offset: u64,
    to: Destination,
}

enum Destination {
    Texels {
        texture: wgpu::Texture,
        origin: wgpu::Origin3d,
        size: (u32, u32),
        pitch: u32,
    },
    Bytes {
        buffer: wgpu::Buffer,
        offset: u64,
        bytes: u64,
    },
}

/// Uploads of a frame.
pub(super) struct Uploads {
    ring: Vec<Staging>,
    copies: Vec<Copy>,
}

impl Uploads {
    pub(super) fn new(context: &Context) -> Self {
        let first = FIRST_BUFFERS.min(MOST_BUFFERS);
        Self {
            ring: (0..first).map(|_| Staging::new(context)).collect(),
            copies: Vec::new(),
        }
    }

    /// Takes the texels of a rectangle of a layer, `[y][x]`, whose rows are so many bytes apart. They are there for all that is
    /// submitted after [`Uploads::submit`].
    pub(super) fn write(
        &mut self,
        context: &Context,
        texture: &wgpu::Texture,
        origin: wgpu::Origin3d,
        (width, height): (u32, u32),
        row_bytes: u32,
        texels: &[u8],
    ) {
        let written_bytes = width * texture.format().block_copy_size(None).unwrap_or(8);
        // WebGPU copies rows at multiples of this.
        let pitch = written_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = u64::from(pitch) * u64::from(height);
        let Some(at) = self.room(context, bytes) else {
            // What the queue writes comes before what is submitted later: earlier texels of the same place must not.
            self.submit(context);
            return targets::write(context, texture, origin, (width, height), row_bytes, texels);
        };
        let staging = &mut self.ring[at];
        let offset = staging.used_bytes;
        staging.used_bytes = (offset + bytes).next_multiple_of(ALIGNMENT);
        let Some(view) = &mut staging.view else { return };
        let mut place = view.slice(offset as usize..(offset + bytes) as usize);
        if pitch == row_bytes {
            place.copy_from_slice(&texels[..bytes as usize]);
        } else {
            let rows = texels.chunks(row_bytes as usize).take(height as usize);
            for (row, first) in rows.zip((0..).step_by(pitch as usize)) {
                let row = &row[..written_bytes as usize];
                place.slice(first..first + row.len()).copy_from_slice(row);
            }
        }
        let to = Destination::Texels {
            texture: texture.clone(),
            origin,
            size: (width, height),
            pitch,
        };
        self.copies.push(Copy {
            staging: at,
            offset,
            to,
        });
    }

    /// Takes bytes of a buffer, whole words; likewise.
    pub(super) fn write_buffer(
        &mut self,
        context: &Context,
        buffer: &wgpu::Buffer,
        first: u64,
        contents: &[u8],
    ) {
        let bytes = contents.len() as u64;
        let Some(at) = self.room(context, bytes) else {
            self.submit(context);
            return context.queue.write_buffer(buffer, first, contents);
        };
        let staging = &mut self.ring[at];
        let offset = staging.used_bytes;
        staging.used_bytes = (offset + bytes).next_multiple_of(ALIGNMENT);
        let Some(view) = &mut staging.view else { return };
        view.slice(offset as usize..(offset + bytes) as usize)
            .copy_from_slice(contents);
        let to = Destination::Bytes {
            buffer: buffer.clone(),
            offset: first,
            bytes,
        };
        self.copies.push(Copy {
            staging: at,
            offset,
            to,
        });
    }

    /// A mapped buffer that has so much room left.
    fn room(&mut self, context: &Context, bytes: u64) -> Option<usize> {
        if bytes > BUFFER_BYTES {
            return None;
        }
        let open = |staging: &Staging| staging.view.is_some() && staging.used_bytes + bytes <= BUFFER_BYTES;
        if let Some(at) = self.ring.iter().position(open) {
            return Some(at);
        }
        let free = self.ring.iter_mut().position(Staging::open);
        if free.is_some() || self.ring.len() >= MOST_BUFFERS {
            return free;
        }
        let mut staging = Staging::new(context);
        let opened = staging.open();
        self.ring.push(staging);
        opened.then(|| self.ring.len() - 1)
    }

    /// Copies what has been written, after all that the queue has been given so far.
    pub(super) fn submit(&mut self, context: &Context) {
        if self.copies.is_empty() {
            return;
        }
        for staging in &mut self.ring {
            if staging.view.take().is_some() {
                staging.buffer.unmap();
            }
        }
        let mut encoder = context.device.create_command_encoder(&Default::default());
        for Copy { staging, offset, to } in self.copies.drain(..) {
            let from = &self.ring[staging].buffer;
            match to {
                Destination::Texels {
                    texture,
                    origin,
                    size,
                    pitch,
                } => {
                    let layout = wgpu::TexelCopyBufferLayout {
                        offset,
                        bytes_per_row: Some(pitch),
                        rows_per_image: None,
                    };
                    let place = wgpu::TexelCopyTextureInfo {
                        origin,
                        ..texture.as_image_copy()
                    };
                    let extent = wgpu::Extent3d {
                        width: size.0,
                        height: size.1,
                        depth_or_array_layers: 1,
                    };
                    let source = wgpu::TexelCopyBufferInfo { buffer: from, layout };
                    encoder.copy_buffer_to_texture(source, place, extent);
                }
                Destination::Bytes {
                    buffer,
                    offset: first,
                    bytes,
                } => encoder.copy_buffer_to_buffer(from, offset, &buffer, first, bytes),
            }
        }
        context.queue.submit([encoder.finish()]);
        self.ring.iter_mut().for_each(Staging::recall);
    }

    pub(super) fn bytes(&self) -> u64 {
        self.ring.len() as u64 * BUFFER_BYTES
    }
}

impl Staging {
    fn new(context: &Context) -> Self {
        let buffer = context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("uploads"),
            size: BUFFER_BYTES,
            usage: wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::MAP_WRITE,
            mapped_at_creation: true,
        });
        Self {
            buffer,
            view: None,
            used_bytes: 0,
            state: Arc::new(AtomicU8::new(FREE)),
        }
    }

    /// Starts to fill it, if it is free. Returns whether it was.
    fn open(&mut self) -> bool {
        if self.view.is_some() || self.state.load(Ordering::Acquire) != FREE {
            return false;
        }
        self.view = self.buffer.get_mapped_range_mut(..).ok();
        self.view.is_some()
    }

    /// Asks for a buffer back that has been copied from.
    fn recall(&mut self) {
        if std::mem::take(&mut self.used_bytes) == 0 {
            return;
        }
        self.state.store(FLYING, Ordering::Release);
        let state = self.state.clone();
        self.buffer.map_async(wgpu::MapMode::Write, .., move |mapped| {
            state.store(if mapped.is_ok() { FREE } else { LOST }, Ordering::Release);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::readback;

    const SIDE: u32 = 300;

    /// Writes rectangles over each other, in and beyond what buffers hold, and compares with the same on the host.
    #[test]
    fn rectangles_arrive_in_order_whichever_way_they_take() {
        let context = Context::headless().unwrap();
        let usage = wgpu::TextureUsages::COPY_SRC;
        let size = (SIDE, SIDE, 2);
        let texture = targets::layers(&context, "test", wgpu::TextureFormat::Rgba8Snorm, size, usage);
        let mut uploads = Uploads::new(&context);
        let mut expected = vec![[0u8; 4]; (SIDE * SIDE * 2) as usize];
        let mut random = 1u32;
        let mut next = |end: u32| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 8) % end
        };
        for round in 0..40u32 {
            // Up to 14 MiB a round: more than all buffers together.
            for _ in 0..if round % 8 == 7 { 40 } else { 3 } {
                let (width, height) = (1 + next(SIDE), 1 + next(SIDE));
                let (x, y, z) = (next(SIDE - width + 1), next(SIDE - height + 1), next(2));
                let row_texels = width + next(3);
                let value = next(127) as u8;
                let texel = |at: u32| [value, (at % 128) as u8, (at / 128 % 128) as u8, round as u8];
                let texels: Vec<_> = (0..row_texels * height).map(texel).collect();
                for (row, texels) in (y..).zip(texels.chunks(row_texels as usize)) {
                    let first = ((z * SIDE + row) * SIDE + x) as usize;
                    expected[first..first + width as usize].copy_from_slice(&texels[..width as usize]);
                }
                let bytes = texels.as_flattened();
                let origin = wgpu::Origin3d { x, y, z };
                uploads.write(&context, &texture, origin, (width, height), row_texels * 4, bytes);
            }
            uploads.submit(&context);
            assert!(uploads.bytes() <= MOST_BUFFERS as u64 * BUFFER_BYTES);
            if round % 3 == 0 {
                context.wait().unwrap();
            }
        }
        for z in 0..2 {
            let origin = wgpu::Origin3d { x: 0, y: 0, z };
            let found = readback::rectangle(&context, &texture, origin, (SIDE, SIDE)).unwrap();
            let first = (z * SIDE * SIDE) as usize;
            let layer = &expected[first..first + (SIDE * SIDE) as usize];
            assert!(found == layer.as_flattened(), "layer {z}");
        }
        // Buffers go round: more came than were ever made.
        context.wait().unwrap();
        assert!(uploads.ring.len() > FIRST_BUFFERS);
        assert!(uploads.ring.iter_mut().all(Staging::open));
    }
}
