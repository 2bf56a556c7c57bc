//! Typed numbers in buffers (glTF 2.0, section 3.6.2), every offset checked.

use gltf::json::accessor::{Accessor, ComponentType, Type, sparse::Sparse};
use gltf::json::validation::Checked;
use gltf::json::{Index, Root};

use super::{Detail, MAX_ELEMENTS};

/// Most elements of an accessor that no bytes stand behind: sparse ones without a buffer view, which start as zeros.
const MAX_ZEROS: usize = 1 << 20;

/// Reads accessors, and counts what has been read against [`MAX_ELEMENTS`].
pub(super) struct Reader<'a> {
    pub(super) root: &'a Root,
    pub(super) buffers: &'a [Vec<u8>],
    pub(super) elements: usize,
}

/// Elements of one size at even distances.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
}

impl<'a> Elements<'a> {
    fn get(&self, index: usize) -> &'a [u8] {
        &self.bytes[index * self.stride..][..self.size]
    }
}

impl<'a> Reader<'a> {
    /// All elements of an accessor of `N` floats each, or of integers, as floats; values need not be finite. Integers
    /// that are not normalized are those of KHR_mesh_quantization.
    pub(super) fn floats<const N: usize>(
        &mut self,
        index: Index<Accessor>,
        what: &str,
    ) -> Detail<Vec<[f32; N]>> {
        let named = |detail| format!("{what} (accessors[{}]): {detail}", index.value());
        self.read_floats(index).map_err(named)
    }

    /// All elements of an accessor of unsigned integers.
    pub(super) fn indices(&mut self, index: Index<Accessor>) -> Detail<Vec<u32>> {
        let named = |detail| format!("indices (accessors[{}]): {detail}", index.value());
        self.read_indices(index).map_err(named)
    }

    fn read_floats<const N: usize>(&mut self, index: Index<Accessor>) -> Detail<Vec<[f32; N]>> {
        let (accessor, component) = self.accessor::<N>(index)?;
        if component == ComponentType::U32 {
            return Err("must be floats, or integers of 8 or 16 bits".into());
        }
        let normalized = accessor.normalized;
        let decode = |element: &[u8]| -> [f32; N] {
            std::array::from_fn(|lane| {
                decode_float(component, normalized, &element[lane * component.size()..])
            })
        };
        let count = accessor.count.0 as usize;
        let mut values = match accessor.buffer_view {
            Some(_) => {
                let elements = self.elements(accessor, component.size() * N)?;
                (0..count).map(|at| decode(elements.get(at))).collect()
            }
            None if accessor.sparse.is_some() && count <= MAX_ZEROS => vec![[0.0; N]; count],
            None if accessor.sparse.is_some() => {
                return Err(format!(
                    "{count} elements without a bufferView; at most {MAX_ZEROS} are zeros changed by sparse ones"
                ));
            }
            None => return Err(format!("has no bufferView; {}", super::UNPACK)),
        };
        if let Some(sparse) = &accessor.sparse {
            let changed = self.view(
                sparse.values.buffer_view,
                sparse.values.byte_offset.0,
                sparse.count.0,
                component.size() * N,
            )?;
            for (at, target) in self.sparse_targets(sparse)?.into_iter().enumerate() {
                *values
                    .get_mut(target as usize)
                    .ok_or_else(|| format!("sparse index {target} is beyond its {count} elements"))? =
                    decode(changed.get(at));
            }
        }
        Ok(values)
    }

    fn read_indices(&mut self, index: Index<Accessor>) -> Detail<Vec<u32>> {
        let (accessor, component) = self.accessor::<1>(index)?;
        if accessor.sparse.is_some() {
            return Err("sparse indices are not read: export them densely".into());
        }
        let elements = self.elements(accessor, component.size())?;
        (0..accessor.count.0 as usize)
            .map(|at| decode_index(component, elements.get(at)))
            .collect()
    }

    fn sparse_targets(&self, sparse: &Sparse) -> Detail<Vec<u32>> {
        let component = match sparse.indices.component_type {
            Checked::Valid(component) => component.0,
            Checked::Invalid => return Err("sparse indices have an unknown component type".into()),
        };
        let view = (sparse.indices.buffer_view, sparse.indices.byte_offset.0);
        let elements = self.view(view.0, view.1, sparse.count.0, component.size())?;
        (0..sparse.count.0 as usize)
            .map(|at| decode_index(component, elements.get(at)))
            .collect()
    }

    /// The accessor and its component type, after its count was taken from what is left of the limit.
    fn accessor<const N: usize>(&mut self, index: Index<Accessor>) -> Detail<(&'a Accessor, ComponentType)> {
        let accessor = self.root.get(index).ok_or("there is no such accessor")?;
        let count = usize::try_from(accessor.count.0).unwrap_or(usize::MAX);
        self.elements = self.elements.saturating_add(count);
        if self.elements > MAX_ELEMENTS {
            return Err(format!(
                "{count} elements, with which the scene has more than {MAX_ELEMENTS}"
            ));
        }
        let expected = [Type::Scalar, Type::Vec2, Type::Vec3, Type::Vec4][N - 1];
        match (accessor.type_, accessor.component_type) {
            (Checked::Valid(found), Checked::Valid(component)) if found == expected => {
                Ok((accessor, component.0))
            }
            (Checked::Valid(found), Checked::Valid(_)) => Err(format!("is {found:?}, expected {expected:?}")),
            _ => Err("has an unknown type".into()),
        }
    }

    fn elements(&self, accessor: &Accessor, size: usize) -> Detail<Elements<'a>> {
        let view = accessor
            .buffer_view
            .ok_or_else(|| format!("has no bufferView; {}", super::UNPACK))?;
        self.view(
            view,
            accessor.byte_offset.unwrap_or_default().0,
            accessor.count.0,
            size,
        )
    }

    /// `count` elements of `size` bytes from `offset` in a buffer view.
    fn view(
        &self,
        index: Index<gltf::json::buffer::View>,
        offset: u64,
        count: u64,
        size: usize,
    ) -> Detail<Elements<'a>> {
        let name = format!("bufferViews[{}]", index.value());
        let view = self
            .root
            .get(index)
            .ok_or_else(|| format!("there is no {name}"))?;
        let buffer = self.buffers.get(view.buffer.value());
        let buffer = buffer.ok_or_else(|| {
            format!(
                "{name} lies in buffers[{}], which is not there",
                view.buffer.value()
            )
        })?;
        let start = view.byte_offset.unwrap_or_default().0;
        let bytes = usize::try_from(start)
            .ok()
            .zip(usize::try_from(view.byte_length.0).ok());
        let bytes = bytes
            .and_then(|(start, length)| buffer.get(start..)?.get(..length))
            .ok_or_else(|| {
                let (length, whole) = (view.byte_length.0, buffer.len());
                format!("{name} has {length} bytes from {start} on, beyond the {whole} of its buffer")
            })?;
        let stride = view.byte_stride.map_or(size, |stride| stride.0);
        if stride < size {
            return Err(format!(
                "{name} has a byteStride of {stride}, less than an element's {size} bytes"
            ));
        }
        let needed = match count {
            0 => Some(0),
            _ => (count - 1)
                .checked_mul(stride as u64)
                .and_then(|last| last.checked_add(size as u64)),
        };
        let end = needed.and_then(|needed| needed.checked_add(offset));
        match end {
            Some(end) if end <= bytes.len() as u64 => Ok(Elements {
                bytes: &bytes[offset as usize..],
                stride,
                size,
            }),
            _ => Err(format!(
                "{count} elements from byte {offset} on reach beyond {name} of {} bytes",
                bytes.len()
            )),
        }
    }
}

/// Normalized integers become floats as glTF 2.0, section 3.6.2.2 says; others keep their value.
fn decode_float(component: ComponentType, normalized: bool, bytes: &[u8]) -> f32 {
    let (value, largest) = match component {
        ComponentType::I8 => (f32::from(bytes[0] as i8), 127.0),
        ComponentType::U8 => (f32::from(bytes[0]), 255.0),
        ComponentType::I16 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
        ComponentType::U16 => (f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
        ComponentType::U32 | ComponentType::F32 => {
            return f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        }
    };
    if normalized {
        (value / largest).max(-1.0)
    } else {
        value
    }
}

fn decode_index(component: ComponentType, bytes: &[u8]) -> Detail<u32> {
    match component {
        ComponentType::U8 => Ok(bytes[0].into()),
        ComponentType::U16 => Ok(u16::from_le_bytes([bytes[0], bytes[1]]).into()),
        ComponentType::U32 => Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        _ => Err("indices must be unsigned integers".into()),
    }
}
