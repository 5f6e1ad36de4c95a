// Steps of patches and edges, as `relevo::select::levels` says. One thread for each patch of each
// tile.

struct Space {
    low: vec3<f32>,
    high: vec3<f32>,
}

// Row `what` of a tile's table: steps of vertical errors, steps of horizontal ones, low, high,
// drawable.
fn entry(tile: Tile, what: u32, part: u32) -> f32 {
    let parts = frame.sizes.z * frame.sizes.z;
    let words = parts * (2u * frame.sizes.y + 5u);
    return tables[tile.slot * words + what * parts + part];
}

fn drawable(tile: Tile, part: u32) -> bool {
    return entry(tile, 2u * frame.sizes.y + 4u, part) > 0.0;
}

fn space_of(tile: Tile, part: u32) -> Space {
    let m = frame.sizes.z;
    let shift = exponent_of(tile) + frame.sizes.y;
    let column = tile.column + i32((part % m) << shift);
    let row = tile.row + i32((part / m) << shift);
    let side = i32(1u << shift);
    let north_west = across(frame, column, row);
    let south_east = across(frame, column + side, row + side);
    let steps_2 = 2u * frame.sizes.y + 2u;
    let low = above(frame, entry(tile, steps_2, part));
    let high = above(frame, entry(tile, steps_2 + 1u, part));
    return Space(vec3<f32>(north_west.x, south_east.y, low), vec3<f32>(south_east.x, north_west.y, high));
}

// False if the whole box is outside of the picture.
fn sees(space: Space) -> bool {
    var normals = array<vec3<f32>, 5>(
        frame.forward.xyz * frame.right.w - frame.right.xyz,
        frame.forward.xyz * frame.right.w + frame.right.xyz,
        frame.forward.xyz * frame.up.w - frame.up.xyz,
        frame.forward.xyz * frame.up.w + frame.up.xyz,
        frame.forward.xyz,
    );
    var inside = true;
    for (var i = 0u; i < 5u; i++) {
        let n = normals[i];
        let far = select(space.low, space.high, n > vec3<f32>(0.0));
        let least = select(0.0, frame.forward.w, i == 4u);
        inside = inside && dot(n, far) - least >= 0.0;
    }
    return inside;
}

// How near a box comes, and how much of a vertical and of a horizontal error in it is seen:
// `View::pixel_scale`.
struct Reach {
    depth: f32,
    vertical: f32,
    horizontal: f32,
}

fn reach_of(space: Space) -> Reach {
    let picture = vec2<f32>(frame.right.w, frame.up.w);
    var least = 3.0e38;
    var tangent_2 = 0.0;
    var low = picture;
    var high = -picture;
    for (var i = 0u; i < 8u; i++) {
        let corner = select(space.low, space.high, (vec3<u32>(i) & vec3<u32>(1u, 2u, 4u)) != vec3<u32>(0u));
        let z = dot(corner, frame.forward.xyz);
        let tangent = vec2<f32>(dot(corner, frame.right.xyz), dot(corner, frame.up.xyz)) / z;
        least = min(least, z);
        tangent_2 = max(tangent_2, dot(tangent, tangent));
        let within = clamp(tangent, -picture, picture);
        low = min(low, within);
        high = max(high, within);
    }
    let before = least > 0.0;
    let picture_2 = dot(picture, picture);
    let stretch = sqrt(1.0 + select(picture_2, min(picture_2, tangent_2), before));
    let upright = vec2<f32>(frame.right.z, frame.up.z);
    let at_low = abs(upright - select(-picture, low, before) * frame.forward.z);
    let at_high = abs(upright - select(picture, high, before) * frame.forward.z);
    let outside = max(max(space.low, -space.high), vec3<f32>(0.0));
    let depth = max(max(least, frame.forward.w), length(outside) / stretch);
    return Reach(depth, min(length(max(at_low, at_high)), stretch), stretch);
}

// Pixels of error of a patch at a step: `PixelScale::pixels`.
fn error_of(tile: Tile, part: u32, reach: Reach, step: u32) -> f32 {
    let vertical = entry(tile, step, part) * frame.spacing.z;
    let horizontal = entry(tile, frame.sizes.y + 1u + step, part);
    // The square of a great error would be infinite.
    let scale = max(abs(vertical), abs(horizontal));
    if scale <= 0.0 {
        return 0.0;
    }
    let error = vec2<f32>(vertical, horizontal) / scale;
    let left = reach.depth - scale * length(error);
    let seen = scale * length(error * vec2<f32>(reach.vertical, reach.horizontal));
    return select(3.0e38, frame.spacing.w * seen / max(left, 1.0e-30), left > 0.0);
}

// Numbers of a patch's edges: north, east, south, west.
fn edges_of(index: u32) -> vec4<u32> {
    let m = frame.sizes.z;
    let number = index / (m * m);
    let part = index % (m * m);
    let x = part % m;
    let y = part / m;
    let base = number * 2u * m * (m + 1u);
    let down = base + m * (m + 1u);
    let own = vec4<u32>(base + y * m + x, down + (x + 1u) * m + y, base + (y + 1u) * m + x, down + x * m + y);
    let tile = tiles[number];
    let along = vec4<u32>(x, y, x, y);
    let side = tile.first + ((tile.local * m + along) >> (tile.side & vec4<u32>(255u)));
    return select(own, side, at_side(part));
}

fn at_side(part: u32) -> vec4<bool> {
    let m = frame.sizes.z;
    let x = part % m;
    let y = part / m;
    return vec4<bool>(y == 0u, x + 1u == m, y + 1u == m, x == 0u);
}

fn set_edge(number: u32, exponent: u32) {
    atomicMax(&edges[frame.counts.z + number], 255u - exponent);
}

fn edge(number: u32) -> u32 {
    return 255u - atomicLoad(&edges[frame.counts.z + number]);
}

fn patches() -> u32 {
    return frame.counts.x * frame.sizes.z * frame.sizes.z;
}

// The greatest exponent whose error is within the tolerance.
@compute @workgroup_size(64)
fn base(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread(id, groups);
    if i >= patches() {
        return;
    }
    let parts = frame.sizes.z * frame.sizes.z;
    let part = i % parts;
    let tile = tiles[i / parts];
    let space = space_of(tile, part);
    var step = frame.sizes.y;
    if drawable(tile, part) && sees(space) {
        let reach = reach_of(space);
        while step > 0u && !(error_of(tile, part, reach, step) <= frame.sun.w) {
            step -= 1u;
        }
    }
    let inner = exponent_of(tile) + step;
    steps[i] = inner;
    let numbers = edges_of(i);
    let limits = select(vec4<u32>(0u), tile.side >> vec4<u32>(8u), at_side(part));
    if frame.sizes.w == 1u {
        let of_edges = select(vec4<u32>(inner), limits, at_side(part));
        for (var s = 0u; s < 4u; s++) {
            set_edge(numbers[s], of_edges[s]);
        }
        return;
    }
    let least = max(max(limits.x, limits.y), max(limits.z, limits.w));
    steps[patches() + i] = least;
    for (var s = 0u; s < 4u; s++) {
        atomicMax(&edges[numbers[s]], least);
    }
}

// No patch is finer than the vertices of its edges allow: one round.
@compute @workgroup_size(64)
fn coarsen(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread(id, groups);
    if i >= patches() {
        return;
    }
    let numbers = edges_of(i);
    let before = steps[patches() + i];
    var least = before;
    for (var s = 0u; s < 4u; s++) {
        least = max(least, max(atomicLoad(&edges[numbers[s]]), 1u) - 1u);
    }
    if least == before {
        return;
    }
    steps[patches() + i] = least;
    for (var s = 0u; s < 4u; s++) {
        atomicMax(&edges[numbers[s]], least);
    }
}

// Between the two fixed points.
@compute @workgroup_size(64)
fn join(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread(id, groups);
    if i >= patches() {
        return;
    }
    let inner = max(steps[i], steps[patches() + i]);
    steps[i] = inner;
    let numbers = edges_of(i);
    for (var s = 0u; s < 4u; s++) {
        set_edge(numbers[s], inner);
    }
}

// Patches of an edge differ by one at most: one round.
@compute @workgroup_size(64)
fn balance(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread(id, groups);
    if i >= patches() {
        return;
    }
    let numbers = edges_of(i);
    let before = steps[i];
    var inner = before;
    for (var s = 0u; s < 4u; s++) {
        inner = min(inner, edge(numbers[s]) + 1u);
    }
    if inner == before {
        return;
    }
    steps[i] = inner;
    for (var s = 0u; s < 4u; s++) {
        set_edge(numbers[s], inner);
    }
}

// Which patches are drawn, and how wrong they are.
@compute @workgroup_size(64)
fn finish(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = thread(id, groups);
    if i >= patches() {
        return;
    }
    let parts = frame.sizes.z * frame.sizes.z;
    let part = i % parts;
    let tile = tiles[i / parts];
    let space = space_of(tile, part);
    let inner = steps[i] & 255u;
    let step = min(max(inner, exponent_of(tile)) - exponent_of(tile), frame.sizes.y);
    steps[i] = inner | select(0u, 256u, drawable(tile, part) && sees(space));
    steps[patches() + i] = bitcast<u32>(error_of(tile, part, reach_of(space), step));
}
