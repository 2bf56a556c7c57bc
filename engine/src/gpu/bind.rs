//! Bind groups: layouts from lists of bindings, and buffers with contents.

use wgpu::util::DeviceExt;

use crate::{Error, Result, gpu::Context};

/// What a shader binds.
#[derive(Clone, Copy)]
pub(super) enum Binding {
    Uniform,
    /// Read only.
    Storage,
    /// Read and written.
    Counters,
    /// Array of filtered textures.
    Layers,
    /// Array of textures of words.
    Words,
    /// Texels read one by one: floats, or unsigned integers.
    Floats,
    Integers,
    /// A texture that is filtered.
    Filtered,
    Sampler,
    /// Written.
    Picture(wgpu::TextureFormat),
    /// Array of textures, written.
    Slots(wgpu::TextureFormat),
}

impl Binding {
    fn ty(self) -> wgpu::BindingType {
        let buffer = |ty| wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let texture = |sample_type, view_dimension| wgpu::BindingType::Texture {
            sample_type,
            view_dimension,
            multisampled: false,
        };
        let written = |format, view_dimension| wgpu::BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format,
            view_dimension,
        };
        match self {
            Binding::Uniform => buffer(wgpu::BufferBindingType::Uniform),
            Binding::Storage => buffer(wgpu::BufferBindingType::Storage { read_only: true }),
            Binding::Counters => buffer(wgpu::BufferBindingType::Storage { read_only: false }),
            Binding::Layers => texture(
                wgpu::TextureSampleType::Float { filterable: true },
                wgpu::TextureViewDimension::D2Array,
            ),
            Binding::Filtered => texture(
                wgpu::TextureSampleType::Float { filterable: true },
                wgpu::TextureViewDimension::D2,
            ),
            Binding::Words => texture(wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D2Array),
            Binding::Floats => texture(
                wgpu::TextureSampleType::Float { filterable: false },
                wgpu::TextureViewDimension::D2,
            ),
            Binding::Integers => texture(wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D2),
            Binding::Sampler => wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
            Binding::Picture(format) => written(format, wgpu::TextureViewDimension::D2),
            Binding::Slots(format) => written(format, wgpu::TextureViewDimension::D2Array),
        }
    }
}

/// A layout with these bindings at 0, 1, 2, …
pub(super) fn layout(
    context: &Context,
    label: &str,
    visibility: wgpu::ShaderStages,
    bindings: &[Binding],
) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = (0..)
        .zip(bindings)
        .map(|(binding, kind)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility,
            ty: kind.ty(),
            count: None,
        })
        .collect();
    context
        .device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(label),
            entries: &entries,
        })
}

/// A bind group with these resources at 0, 1, 2, …
pub(super) fn group(
    context: &Context,
    label: &str,
    layout: &wgpu::BindGroupLayout,
    resources: &[wgpu::BindingResource<'_>],
) -> wgpu::BindGroup {
    let entries: Vec<_> = (0..)
        .zip(resources)
        .map(|(binding, resource)| wgpu::BindGroupEntry {
            binding,
            resource: resource.clone(),
        })
        .collect();
    context.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(label),
        layout,
        entries: &entries,
    })
}

/// A storage buffer with contents; of one element of zeros if there are none, since bindings cannot be empty.
///
/// # Errors
/// [`Error::Budget`] beyond what the adapter binds.
pub(super) fn storage<T: bytemuck::Pod>(
    context: &Context,
    label: &str,
    contents: &[T],
) -> Result<wgpu::Buffer> {
    let empty = [T::zeroed()];
    let contents: &[u8] = bytemuck::cast_slice(if contents.is_empty() { &empty } else { contents });
    check_size(context, label, contents.len() as u64)?;
    Ok(context
        .device
        .create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some(label),
            contents,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
        }))
}

/// A storage buffer of zeros, of at least 16 bytes, and for what else it is used.
///
/// # Errors
/// [`Error::Budget`] beyond what the adapter binds.
pub(super) fn zeros(
    context: &Context,
    label: &str,
    bytes: u64,
    usage: wgpu::BufferUsages,
) -> Result<wgpu::Buffer> {
    check_size(context, label, bytes)?;
    Ok(context.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes.max(16),
        usage: usage | wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    }))
}

fn check_size(context: &Context, label: &str, bytes: u64) -> Result<()> {
    let limits = context.device.limits();
    let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    if bytes > limit {
        return Err(Error::Budget(format!(
            "the {label} of this scene take {bytes} bytes, but a buffer of this adapter holds at most {limit}: \
             draw fewer or smaller things at once"
        )));
    }
    Ok(())
}

/// A compute pipeline of the shader of this name, whose entry point has the same name.
pub(super) fn compute(
    context: &Context,
    name: &'static str,
    groups: &[&wgpu::BindGroupLayout],
) -> Result<wgpu::ComputePipeline> {
    Ok(pipeline(context, &module(context, name)?, name, groups))
}

/// A compute pipeline of an entry point of a module.
pub(super) fn pipeline(
    context: &Context,
    module: &wgpu::ShaderModule,
    entry_point: &str,
    groups: &[&wgpu::BindGroupLayout],
) -> wgpu::ComputePipeline {
    variation(context, module, entry_point, groups, &[])
}

/// The same with values for override constants.
pub(super) fn variation(
    context: &Context,
    module: &wgpu::ShaderModule,
    entry_point: &str,
    groups: &[&wgpu::BindGroupLayout],
    constants: &[(&str, f64)],
) -> wgpu::ComputePipeline {
    let groups: Vec<_> = groups.iter().copied().map(Some).collect();
    let layout = context
        .device
        .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(entry_point),
            bind_group_layouts: &groups,
            immediate_size: 0,
        });
    context
        .device
        .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry_point),
            layout: Some(&layout),
            module,
            entry_point: Some(entry_point),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                ..Default::default()
            },
            cache: None,
        })
}

/// The module of a shader.
pub(super) fn module(context: &Context, name: &'static str) -> Result<wgpu::ShaderModule> {
    variant(context, name, &[])
}

/// The module of a shader, with imports that stand for other files; see [`shaders::variant`].
pub(super) fn variant(
    context: &Context,
    name: &'static str,
    choices: &[(&str, &str)],
) -> Result<wgpu::ShaderModule> {
    let source = shaders::variant(name, choices).map_err(|error| Error::Adapter(error.to_string()))?;
    Ok(context.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(name),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    }))
}

/// Workgroups of passes over pictures are 8 × 8 invocations.
pub(super) const WORKGROUP_SIDE: u32 = 8;

/// Begins a compute pass.
pub(super) fn pass<'encoder>(
    encoder: &'encoder mut wgpu::CommandEncoder,
    label: &str,
    timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
) -> wgpu::ComputePass<'encoder> {
    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
        label: Some(label),
        timestamp_writes,
    })
}

/// Runs a pipeline over `size` invocations.
pub(super) fn dispatch(
    pass: &mut wgpu::ComputePass<'_>,
    pipeline: &wgpu::ComputePipeline,
    groups: &[&wgpu::BindGroup],
    size: (u32, u32),
) {
    pass.set_pipeline(pipeline);
    for (index, group) in (0..).zip(groups) {
        pass.set_bind_group(index, *group, &[]);
    }
    pass.dispatch_workgroups(
        size.0.div_ceil(WORKGROUP_SIDE),
        size.1.div_ceil(WORKGROUP_SIDE),
        1,
    );
}
