// What a pixel sees: the point of a triangle that a ray meets, its frame and its texture coordinates.

#import geometry
#import material

struct Surface {
    material: u32,
    // World space, relative to the eye.
    position: vec3<f32>,
    // Orthonormal frame in world space; the normal is on the eye's side of the triangle.
    tangent: vec3<f32>,
    bitangent: vec3<f32>,
    normal: vec3<f32>,
    // Texture coordinates of the material and their derivatives by pixels.
    st: vec2<f32>,
    st_dx: vec2<f32>,
    st_dy: vec2<f32>,
}

// A vector of world space in the tangent frame.
fn tangent_from_world(surface: Surface, v: vec3<f32>) -> vec3<f32> {
    return vec3(dot(surface.tangent, v), dot(surface.bitangent, v), dot(surface.normal, v));
}

// `v` made a unit vector, or `other` where `v` has no direction, or z. Squares beyond what floats hold have none either.
fn unit(v: vec3<f32>, other: vec3<f32>) -> vec3<f32> {
    let squares = vec2(dot(v, v), dot(other, other));
    let usable = (squares > vec2(1e-24, 1e-37)) & (squares < vec2(1e37));
    return normalize(select(select(vec3(0.0, 0.0, 1.0), other, usable.y), v, usable.x));
}

// A unit vector across `normal`, for tangents that are degenerate.
fn any_tangent(normal: vec3<f32>) -> vec3<f32> {
    let axis = select(vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), abs(normal.x) > 0.5);
    return normalize(axis - normal * dot(normal, axis));
}

// Ray against plane as Möller and Trumbore 1997, with the terms that do not depend on the ray taken out, so
// that the derivatives by pixels cost three dot products each. The eye is the origin, so the ray r meets the plane
// in a + b e + c f = k r for the corner a and the edges e, f. Multiplied by f × a, e × f and a × e:
// b a·(e × f) = k r·(f × a), a·(e × f) = k r·(e × f), c a·(e × f) = k r·(a × e).
// Edges are taken before the transform: small triangles far from the origin keep their precision.
//
// The material is that of the instance. Passes hand it over, because they know it for a whole workgroup.
fn surface(pixel: vec2<u32>, instance: u32, triangle: u32, material: u32) -> Surface {
    let a = vertex_index(instance, triangle * 3u);
    let b = vertex_index(instance, triangle * 3u + 1u);
    let c = vertex_index(instance, triangle * 3u + 2u);
    let origin = eye_from_position(instance, vertices[a].position);
    let edge_b = world_from_offset(instance, vertices[b].position - vertices[a].position);
    let edge_c = world_from_offset(instance, vertices[c].position - vertices[a].position);
    let weight_b = cross(edge_c, origin);
    let weight_c = cross(origin, edge_b);
    let whole = cross(edge_b, edge_c);

    let ray = frame.ray_origin + f32(pixel.x) * frame.ray_dx + f32(pixel.y) * frame.ray_dy;
    let facing = dot(ray, whole);
    // A triangle seen edge on has no inside; its first vertex stands for it.
    let scale = select(0.0, 1.0 / facing, abs(facing) > 1e-30);
    let bc = vec2(dot(ray, weight_b), dot(ray, weight_c)) * scale;
    let bc_dx = (vec2(dot(frame.ray_dx, weight_b), dot(frame.ray_dx, weight_c)) - bc * dot(frame.ray_dx, whole)) * scale;
    let bc_dy = (vec2(dot(frame.ray_dy, weight_b), dot(frame.ray_dy, weight_c)) - bc * dot(frame.ray_dy, whole)) * scale;

    var result: Surface;
    result.material = material;
    result.position = origin + edge_b * bc.x + edge_c * bc.y;

    let weights = vec3(1.0 - bc.x - bc.y, bc);
    let mesh_normal = weights.x * vertices[a].normal + weights.y * vertices[b].normal + weights.z * vertices[c].normal;
    let mesh_tangent = weights.x * vertices[a].tangent + weights.y * vertices[b].tangent + weights.z * vertices[c].tangent;
    result.normal = unit(world_from_normal(instance, mesh_normal), whole);
    let along = world_from_offset(instance, mesh_tangent.xyz);
    let across = along - result.normal * dot(result.normal, along);
    result.tangent = unit(across, any_tangent(result.normal));
    result.bitangent = cross(result.normal, result.tangent) * select(1.0, -1.0, mesh_tangent.w < 0.0);
    if facing > 0.0 {
        result.normal = -result.normal;
        result.bitangent = -result.bitangent;
    }

    let uv = vec2(vertices[a].u, vertices[a].v);
    let uv_b = vec2(vertices[b].u, vertices[b].v) - uv;
    let uv_c = vec2(vertices[c].u, vertices[c].v) - uv;
    let uv_scale = materials[result.material].uv_scale;
    result.st = (uv + uv_b * bc.x + uv_c * bc.y) * uv_scale + materials[result.material].uv_offset;
    result.st_dx = (uv_b * bc_dx.x + uv_c * bc_dx.y) * uv_scale;
    result.st_dy = (uv_b * bc_dy.x + uv_c * bc_dy.y) * uv_scale;
    return result;
}
