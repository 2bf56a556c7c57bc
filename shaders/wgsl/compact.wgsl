// Counters that are not zero, as pairs of index and votes, in no order; and zeros for the next time.
//
// Bytes that are read back then follow what is seen, not what exists.

struct Pairs {
    count: atomic<u32>,
    pad: u32,
    // As long as the counters: each has a place.
    list: array<vec2<u32>>,
}

const WORKGROUP: u32 = 256u;

@group(0) @binding(0) var<storage, read_write> votes: array<u32>;
@group(0) @binding(1) var<storage, read_write> pairs: Pairs;

@compute @workgroup_size(WORKGROUP)
fn compact(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var counter = id.x; counter < arrayLength(&votes); counter += groups.x * WORKGROUP) {
        let count = votes[counter];
        if count > 0u {
            votes[counter] = 0u;
            pairs.list[atomicAdd(&pairs.count, 1u)] = vec2(counter, count);
        }
    }
}
