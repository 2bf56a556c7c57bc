// Meshes, pulled from storage buffers by vertex index.

#import frame

struct Vertex {
    position: vec3<f32>,
    u: f32,
    normal: vec3<f32>,
    v: f32,
    // In w the sign of the bitangent, as in glTF.
    tangent: vec4<f32>,
}

// A placed mesh.
struct Instance {
    // Rows of the affine transform.
    world_from_mesh_x: vec4<f32>,
    world_from_mesh_y: vec4<f32>,
    world_from_mesh_z: vec4<f32>,
    // Rows of the inverse transpose of its linear part: for normals.
    world_from_normal_x: vec3<f32>,
    first_index: u32,
    world_from_normal_y: vec3<f32>,
    first_vertex: u32,
    world_from_normal_z: vec3<f32>,
    material: u32,
}

@group(0) @binding(1) var<storage, read> vertices: array<Vertex>;
@group(0) @binding(2) var<storage, read> indices: array<u32>;
@group(0) @binding(3) var<storage, read> instances: array<Instance>;

// The vertex of a corner (three a triangle) of an instance.
fn vertex_index(instance: u32, corner: u32) -> u32 {
    return instances[instance].first_vertex + indices[instances[instance].first_index + corner];
}

// A difference of positions of the mesh, in world space.
fn world_from_offset(instance: u32, offset: vec3<f32>) -> vec3<f32> {
    return vec3(
        dot(instances[instance].world_from_mesh_x.xyz, offset),
        dot(instances[instance].world_from_mesh_y.xyz, offset),
        dot(instances[instance].world_from_mesh_z.xyz, offset),
    );
}

// A position of the mesh in world space, relative to the eye.
fn eye_from_position(instance: u32, position: vec3<f32>) -> vec3<f32> {
    let translation = vec3(
        instances[instance].world_from_mesh_x.w,
        instances[instance].world_from_mesh_y.w,
        instances[instance].world_from_mesh_z.w,
    );
    return world_from_offset(instance, position) + (translation - frame.eye);
}

// A normal of the mesh in world space, not of unit length.
fn world_from_normal(instance: u32, normal: vec3<f32>) -> vec3<f32> {
    return vec3(
        dot(instances[instance].world_from_normal_x, normal),
        dot(instances[instance].world_from_normal_y, normal),
        dot(instances[instance].world_from_normal_z, normal),
    );
}
