//! Storage buffers that grow: tables get longer with each material that becomes known.

use crate::{Error, Result, gpu::Context};

/// Least bytes of a buffer: bindings cannot be empty.
const LEAST_BYTES: u64 = 256;

/// A storage buffer with room for more. Contents move on the GPU when it has to be replaced by a larger one, and sizes
/// double, so that all growth together costs about as much as the contents.
pub(super) struct Growing {
    label: &'static str,
    pub(super) buffer: wgpu::Buffer,
    used_bytes: u64,
}

impl Growing {
    pub(super) fn new(context: &Context, label: &'static str) -> Self {
        Self {
            label,
            buffer: create(context, label, LEAST_BYTES),
            used_bytes: 0,
        }
    }

    /// Makes room for so many bytes more. The buffer may be another one afterwards.
    ///
    /// # Errors
    /// [`Error::Budget`] beyond what the adapter binds; then nothing has changed.
    pub(super) fn reserve(&mut self, context: &Context, more_bytes: u64) -> Result<()> {
        let needed = self.used_bytes + more_bytes;
        if needed <= self.buffer.size() {
            return Ok(());
        }
        let limit = most_bytes(context);
        if needed > limit {
            return Err(Error::Budget(format!(
                "the {} of this scene take {needed} bytes, but a buffer of this adapter holds at most {limit}: \
                 draw fewer or smaller materials at once",
                self.label
            )));
        }
        let larger = create(context, self.label, needed.max(self.buffer.size() * 2).min(limit));
        let mut encoder = context.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&self.buffer, 0, &larger, 0, self.used_bytes);
        context.queue.submit([encoder.finish()]);
        self.buffer = larger;
        Ok(())
    }

    /// Appends words for which there is room.
    pub(super) fn append(&mut self, context: &Context, words: &[u32]) {
        let bytes: &[u8] = bytemuck::cast_slice(words);
        context.queue.write_buffer(&self.buffer, self.used_bytes, bytes);
        self.used_bytes += bytes.len() as u64;
    }

    /// Counts so many bytes, for which there is room, as written: somebody else will.
    pub(super) fn skip(&mut self, bytes: u64) {
        self.used_bytes += bytes;
    }
}

/// Most bytes of a storage buffer.
pub(super) fn most_bytes(context: &Context) -> u64 {
    let limits = context.device.limits();
    // A multiple of what buffers are aligned to.
    limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) & !255
}

fn create(context: &Context, label: &str, bytes: u64) -> wgpu::Buffer {
    context.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes.next_multiple_of(4),
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}
