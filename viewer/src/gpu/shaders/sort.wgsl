// From steps to instances, bucket by bucket, and to indirect draws. One thread for each patch of
// each draw. Bucket numbers and pieces are those of `relevo::select::pattern`.

struct Patch {
    draw: u32,
    part: u32,
    shown: bool,
    cut: bool,
    step: u32,
    outer: vec4<u32>,
    odd: bool,
}

fn patch_of(i: u32) -> Patch {
    let m = frame.sizes.z;
    let number = i / (m * m);
    let part = i % (m * m);
    var found = Patch(number, part, false, false, 0u, vec4<u32>(0u), false);
    if number >= frame.counts.y {
        return found;
    }
    let draw = draws[number];
    let corner = vec2<u32>(part % m, part / m);
    let window = window_of(draw);
    let low = corner << vec2<u32>(frame.sizes.y);
    let high = (corner + 1u) << vec2<u32>(frame.sizes.y);
    let index = draw.tile * m * m + part;
    let inner = steps[index];
    found.shown = all(window.xy < high) && all(low < window.zw) && (inner & 256u) != 0u;
    found.cut = any(window.xy > low) || any(window.zw < high);
    let tile = tiles[draw.tile];
    let least = exponent_of(tile);
    let numbers = edges_of(index);
    let outer = vec4<u32>(edge(numbers.x), edge(numbers.y), edge(numbers.z), edge(numbers.w));
    let most = vec4<u32>(frame.sizes.y);
    found.step = min(max(inner & 255u, least) - least, frame.sizes.y);
    found.outer = min(max(outer, vec4<u32>(least)) - least, most);
    // Parity of the patch's column + row over the level; tiles with several patches have an even
    // number of them.
    found.odd = ((corner.x + corner.y + select(0u, tile.kind >> 16u, m == 1u)) & 1u) == 1u;
    return found;
}

// How many pieces: the whole, or a middle and four sides.
fn pieces(it: Patch) -> u32 {
    return select(5u, 1u, all(it.outer == vec4<u32>(it.step)));
}

// Bucket of piece 0, the middle, or of 1 to 4, the sides from the north clockwise.
fn bucket_of(it: Patch, piece: u32) -> u32 {
    let p = frame.sizes.y;
    let k = it.step;
    let paper = frame.sizes.w == 1u;
    let ring = select(k, min(k, p - 1u), paper);
    if piece == 0u {
        let full = k + select(0u, 1u, k == p && it.odd);
        return select(p + 2u + ring, full, pieces(it) == 1u);
    }
    let at = piece - 1u;
    if paper {
        return 2u * p + 3u + (5u + ring) * (p + 1u) + it.outer[at];
    }
    let strips = 2u * p + 3u + 5u * k;
    if it.outer[at] < k {
        return strips + 4u;
    }
    if k == p {
        return strips + 3u;
    }
    let left = select(0u, 1u, it.outer[(at + 3u) & 3u] < k);
    let right = select(0u, 2u, it.outer[(at + 1u) & 3u] < k);
    return strips + left + right;
}

@compute @workgroup_size(64)
fn count(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let it = patch_of(thread(id, groups));
    if !it.shown {
        return;
    }
    for (var piece = 0u; piece < pieces(it); piece++) {
        atomicAdd(&buckets[bucket_of(it, piece)], 1u);
    }
}

@compute @workgroup_size(1)
fn layout_buckets() {
    let n = frame.counts.w;
    var first = 0u;
    for (var b = 0u; b < n; b++) {
        let count = atomicLoad(&buckets[b]);
        atomicStore(&buckets[n + b], first);
        first += count;
        let mesh = meshes[b];
        for (var i = 0u; i < 2u; i++) {
            let at = 5u * (i * n + b);
            arguments[at] = select(mesh.y, mesh.w, i == 1u);
            arguments[at + 1u] = count;
            arguments[at + 2u] = select(mesh.x, mesh.z, i == 1u);
            arguments[at + 3u] = 0u;
            arguments[at + 4u] = 0u;
        }
    }
}

@compute @workgroup_size(64)
fn scatter(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let it = patch_of(thread(id, groups));
    if !it.shown {
        return;
    }
    let n = frame.counts.w;
    for (var piece = 0u; piece < pieces(it); piece++) {
        let bucket = bucket_of(it, piece);
        let at = atomicLoad(&buckets[n + bucket]) + atomicAdd(&buckets[2u * n + bucket], 1u);
        let turn = select(piece, 1u, piece == 0u) - 1u;
        instances[at] = Instance(it.draw, it.part | (turn << 16u) | select(0u, CUT, it.cut));
    }
}
