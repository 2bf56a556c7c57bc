//! Structs as they lie in GPU memory. What each member means stands in `wgsl/`.

use glam::{Mat4, UVec2, Vec2, Vec3, Vec4};

use crate::reflect::mirror;

/// [`Material::flags`]: the material repeats.
pub const REPEATS: u32 = 1;
/// [`Material::flags`]: the samples include the light's cosine.
pub const INCLUDES_COSINE: u32 = 2;
/// [`Light::kind`] of a directional light.
pub const DIRECTIONAL: u32 = 0;
/// [`Light::kind`] of a point light.
pub const POINT: u32 = 1;
/// Nothing there: entries of the page table, neighbours of a triangle.
pub const NONE: u32 = u32::MAX;
/// Length of [`Material::mips`]: down from the largest side that archives have, 2^16.
pub const MAX_MIPS: usize = 17;

mirror! {
    /// What is the same for every pixel of a frame.
    pub struct Frame {
        /// Clip space from positions relative to the eye.
        pub clip_from_eye: Mat4,
        /// World space.
        pub eye: Vec3,
        /// Lights.
        pub light_count: u32,
        /// Direction through the centre of the first pixel.
        pub ray_origin: Vec3,
        /// Factor before tone mapping.
        pub exposure: f32,
        /// Change of direction from a pixel to its right neighbour.
        pub ray_dx: Vec3,
        /// Side of a feedback cell in pixels.
        pub feedback_stride: u32,
        /// Change of direction from a pixel to its lower neighbour.
        pub ray_dy: Vec3,
        /// Which pixel of a feedback cell votes.
        pub feedback_phase: u32,
        /// Radiance of the surroundings.
        pub ambient: Vec3,
        /// Log2 of the width of the column cache in texels.
        pub column_shift: u32,
        /// Radiance where nothing is hit.
        pub background: Vec3,
        /// Width of the column cache less one.
        pub column_mask: u32,
        /// Pixels.
        pub size: UVec2,
        /// One over the texels of a layer of the page cache.
        pub page_scale: Vec2,
        /// Slots in a row of a layer of the page cache.
        pub slot_columns: u32,
        /// Slots in a layer.
        pub layer_slots: u32,
        /// Pixels of the picture that is shown, per pixel of this one.
        pub pixel_scale: f32,
        /// 1 if shading is to count what it fetches.
        pub count_work: u32,
        /// 1 if pages are bytes, to be multiplied by the scales of their slots.
        pub scaled: u32,
        /// 1 if the nearest mip is read alone.
        pub nearest_mip: u32,
        /// Not used.
        pub pads: UVec2,
    }
}

mirror! {
    /// Vertex of a mesh.
    pub struct Vertex {
        /// Mesh space.
        pub position: Vec3,
        /// Texture coordinate.
        pub u: f32,
        /// Mesh space, unit length.
        pub normal: Vec3,
        /// Texture coordinate.
        pub v: f32,
        /// Mesh space; in w the sign of the bitangent.
        pub tangent: Vec4,
    }
}

mirror! {
    /// A placed mesh.
    pub struct Instance {
        /// First row of the transform.
        pub world_from_mesh_x: Vec4,
        /// Second row.
        pub world_from_mesh_y: Vec4,
        /// Third row.
        pub world_from_mesh_z: Vec4,
        /// First row of the inverse transpose of the linear part.
        pub world_from_normal_x: Vec3,
        /// The mesh's first index.
        pub first_index: u32,
        /// Second row.
        pub world_from_normal_y: Vec3,
        /// The mesh's first vertex.
        pub first_vertex: u32,
        /// Third row.
        pub world_from_normal_z: Vec3,
        /// Index of the material.
        pub material: u32,
    }
}

mirror! {
    /// A mip of a material.
    pub struct Mip {
        /// Texels.
        pub size: Vec2,
        /// Where in a slot the payload begins, in texels.
        pub origin: Vec2,
        /// Columns and rows of pages.
        pub tiles: UVec2,
        /// Index of the first tile.
        pub first_tile: u32,
        /// Not used.
        pub pad: u32,
    }
}

mirror! {
    /// Where a triangulation lies in the words of the directions.
    pub struct Triangulation {
        /// Two words each.
        pub points: u32,
        /// Six words each: vertices, triangles beyond the opposite edges.
        pub triangles: u32,
        /// Two words each.
        pub hull: u32,
        /// One word for each cell of the start grid.
        pub start: u32,
        /// Triangles.
        pub triangle_count: u32,
        /// Edges of the hull.
        pub hull_count: u32,
    }
}

mirror! {
    /// A material.
    pub struct Material {
        /// Repeats over one unit of texture coordinates.
        pub uv_scale: Vec2,
        /// Added after scaling.
        pub uv_offset: Vec2,
        /// Of a diffuse material, or the mean of a BTF.
        pub albedo: Vec3,
        /// By which decoded eigen-textures are multiplied.
        pub texture_scale: f32,
        /// Component groups.
        pub groups: u32,
        /// First entry in the page table.
        pub page_table: u32,
        /// First counter in the votes.
        pub votes: u32,
        /// [`REPEATS`], [`INCLUDES_COSINE`].
        pub flags: u32,
        /// Mips.
        pub mip_count: u32,
        /// The finest mip in the packed tail.
        pub tail_mip: u32,
        /// Light directions.
        pub lights: u32,
        /// Texels along a side of a map of the light hemisphere.
        pub map_side: u32,
        /// Views.
        pub view_directions: Triangulation,
        /// Lights.
        pub light_directions: Triangulation,
        /// Mips, the finest first.
        pub mips: [Mip; MAX_MIPS],
    }
}

mirror! {
    /// A light source.
    pub struct Light {
        /// Unit vector towards a directional light, position of a point light.
        pub vector: Vec3,
        /// [`DIRECTIONAL`] or [`POINT`].
        pub kind: u32,
        /// Irradiance or radiant intensity.
        pub intensity: Vec3,
        /// Not used.
        pub pad: u32,
    }
}

mirror! {
    /// A rectangle of a cached page's border, and where its texels come from.
    pub struct Strip {
        /// First texel of the payload that is read, in its layer.
        pub source: UVec2,
        /// First texel of the border that is written, in its layer.
        pub destination: UVec2,
        /// Texels.
        pub size: UVec2,
        /// Along each axis 1 where the source goes on, 0 where it repeats.
        pub step: UVec2,
        /// Layer of the source.
        pub source_layer: u32,
        /// Layer of the destination.
        pub destination_layer: u32,
        /// First texel in the staging buffer.
        pub staging: u32,
        /// Not used.
        pub pad: u32,
        /// By component, the scale of the source's slot over that of the destination's; 1 where slots have none.
        pub ratio: Vec4,
    }
}

mirror! {
    /// A page to decode, and where its parent is.
    pub struct DecodedPage {
        /// First texel of its slot, in its layer.
        pub slot: UVec2,
        /// The parent's texel under the first of the payload, in its layer.
        pub parent: UVec2,
        /// Texels of the payload.
        pub size: UVec2,
        /// Along each axis bit 0 where the picture ends before the payload, bit 1 where it ends behind.
        pub ends: UVec2,
        /// Layer of the slot.
        pub layer: u32,
        /// Layer of the parent.
        pub parent_layer: u32,
        /// First of its words.
        pub words: u32,
        /// By which coefficients are multiplied.
        pub step: f32,
    }
}

mirror! {
    /// What is drawn over the picture.
    pub struct Overlay {
        /// Which overlay.
        pub kind: u32,
        /// 1 covers the picture.
        pub opacity: f32,
        /// Frames so far.
        pub now: u32,
        /// Not used.
        pub pad: u32,
        /// Colours of a scale from 0 to 1 in equal steps.
        pub scale: [Vec4; 9],
        /// Colours beside the scale.
        pub marks: [Vec4; 4],
    }
}
