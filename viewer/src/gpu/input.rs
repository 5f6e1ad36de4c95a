//! The input of a frame as the passes read it. Input that does not fit together is refused.

use bytemuck::{Pod, Zeroable};
use relevo_core::select::imagery::Draw;
use relevo_core::select::neighbours::edges_of_tile;
use relevo_core::select::{Chosen, EdgeRule, Levels};
use relevo_core::{Error, Result};

use super::atlas::Atlas;
use super::sizes::Sizes;
use super::{FrameInput, Paint};

/// Bytes of a [`GpuTile`].
pub(crate) const TILE_BYTES: u64 = size_of::<GpuTile>() as u64;
/// Bytes of a [`GpuDraw`].
pub(crate) const DRAW_BYTES: u64 = size_of::<GpuDraw>() as u64;

/// Most threads of a pass.
const MOST_PARTS: u64 = 1 << 28;

/// `Frame` of `common.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct GpuFrame {
    right: [f32; 4],
    up: [f32; 4],
    forward: [f32; 4],
    spacing: [f32; 4],
    eye: [f32; 4],
    sun: [f32; 4],
    range: [f32; 4],
    sizes: [u32; 4],
    counts: [u32; 4],
    atlas: [u32; 4],
    look: [u32; 4],
}

/// `Tile` of `common.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct GpuTile {
    column: i32,
    row: i32,
    kind: u32,
    slot: u32,
    first: [u32; 4],
    local: [u32; 4],
    side: [u32; 4],
}

/// `Draw` of `common.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct GpuDraw {
    tile: u32,
    image: u32,
    west_east: u32,
    north_south: u32,
    texel: [f32; 4],
}

/// The input of a frame, packed.
#[derive(Debug)]
pub(crate) struct Packed {
    pub frame: GpuFrame,
    pub tiles: Vec<GpuTile>,
    pub draws: Vec<GpuDraw>,
    /// Patches of all draws that meet their windows.
    pub parts: u64,
    /// Exponents of patches, and 255 less those of edges.
    pub levels: Option<(Vec<u32>, Vec<u32>)>,
}

fn wrong(what: impl Into<String>) -> Error {
    Error::usage(format!("this picture cannot be drawn: {}", what.into()))
}

/// Returns column and row of the camera: whole samples, and the fractions.
fn camera(input: &FrameInput<'_>) -> Result<([i64; 2], [f64; 2])> {
    let frame = input.frame;
    let view = input.view;
    let numbers = [view.eye, view.right, view.up, view.forward].into_iter().flatten();
    let others = [view.tan_x, view.tan_y, view.near, frame.dx, frame.dy, frame.exaggeration, input.tolerance];
    if !numbers.chain(others).all(f64::is_finite) {
        return Err(wrong("the camera, the frame or the tolerance is not a number"));
    }
    if [view.tan_x, view.tan_y, view.near, frame.dx, frame.dy, frame.exaggeration].iter().any(|&n| n <= 0.0) {
        return Err(wrong(
            "the field of view, the near plane, the spacing and the exaggeration must be above 0",
        ));
    }
    let [column, row, _] = frame.lattice(view.eye);
    let whole = [column.floor(), row.floor()];
    Ok((whole.map(|n| n as i64), [column - whole[0], row - whole[1]]))
}

impl GpuFrame {
    fn new(input: &FrameInput<'_>, sizes: Sizes, fraction: [f64; 2], srgb: bool, buckets: u32) -> Self {
        let (view, frame, look) = (input.view, input.frame, &input.look);
        let with = |v: [f64; 3], w: f64| [v[0] as f32, v[1] as f32, v[2] as f32, w as f32];
        let high = view.eye[2] as f32;
        // Single precision must not let a patch above the tolerance.
        let tolerance = input.tolerance * (1.0 - 1e-5);
        let tiles = input.selection.tiles.len() as u32;
        Self {
            right: with(view.right, view.tan_x),
            up: with(view.up, view.tan_y),
            forward: with(view.forward, view.near),
            spacing: [frame.dx, frame.dy, frame.exaggeration, view.lambda()].map(|n| n as f32),
            eye: [fraction[0] as f32, fraction[1] as f32, high, (view.eye[2] - f64::from(high)) as f32],
            sun: [look.sun[0], look.sun[1], look.sun[2], tolerance as f32],
            range: [look.range[0], look.range[1], 0.0, 0.0],
            sizes: [
                sizes.tile,
                sizes.patch_log2.into(),
                sizes.patches(),
                u32::from(input.rule == EdgeRule::Paper),
            ],
            counts: [tiles, input.draws.len() as u32, tiles * edges_of_tile(sizes.patches()), buckets],
            atlas: [sizes.height_packing().across, sizes.image_packing().across, sizes.image_side, 0],
            look: [paint(look.paint), u32::from(look.borders) | u32::from(!srgb) << 1, 0, 0],
        }
    }
}

fn paint(paint: Paint) -> u32 {
    match paint {
        Paint::Terrain | Paint::Count => 0,
        Paint::Tint => 1,
        Paint::TileLevel => 2,
        Paint::Step => 3,
        Paint::Error => 4,
    }
}

/// Packs a tile, relative to the camera's column and row.
fn tile(chosen: &Chosen, slot: u32, sizes: Sizes, camera: [i64; 2], edges: u32) -> Result<GpuTile> {
    let (id, m) = (chosen.id, sizes.patches());
    if u32::from(chosen.exponent) + sizes.tile.ilog2() > 30 {
        return Err(wrong(format!("the lattice of tile {id} has the exponent {}", chosen.exponent)));
    }
    for side in &chosen.sides {
        let last = |shift: u8| (u64::from(side.local) * u64::from(m) + u64::from(m - 1)) >> shift;
        if side.shift > 31
            || side.local > u32::MAX / m - 1
            || u64::from(side.first) + last(side.shift) >= u64::from(edges)
        {
            return Err(wrong(format!("a side of tile {id} has edges of no tile of the selection")));
        }
    }
    // Farther away than this nothing of a tile can be seen.
    let far = |at: u32, camera: i64| {
        let origin = (i64::from(at) * i64::from(sizes.tile)) << chosen.exponent;
        origin.saturating_sub(camera).clamp(-(1 << 30), 1 << 30) as i32
    };
    let parity = (id.x ^ id.y) & 1;
    Ok(GpuTile {
        column: far(id.x, camera[0]),
        row: far(id.y, camera[1]),
        kind: u32::from(chosen.exponent) | u32::from(id.level) << 8 | parity << 16,
        slot,
        first: chosen.sides.map(|side| side.first),
        local: chosen.sides.map(|side| side.local),
        side: chosen.sides.map(|side| u32::from(side.shift) | u32::from(side.limit) << 8),
    })
}

/// Returns how the tile's columns and rows become texels of the image's slot: scale, left, top.
fn texels(draw: &Draw, chosen: &Chosen, sizes: Sizes) -> [f32; 4] {
    let Some(image) = draw.image else { return [0.0; 4] };
    let inner = f64::from(sizes.image_side - 2 * sizes.gutter);
    // A tile's side in sides of the image.
    let ratio = (f64::from(image.level) - f64::from(chosen.id.level)).exp2();
    let start = |tile: u32, image: u32| {
        f64::from(sizes.gutter) + (f64::from(tile) * ratio - f64::from(image)) * inner
    };
    let (left, top) = (start(chosen.id.x, image.x), start(chosen.id.y, image.y));
    [(ratio * inner / f64::from(sizes.tile)) as f32, left as f32, top as f32, 0.0]
}

fn draw(draw: &Draw, image: Option<u32>, tiles: &[Chosen], atlas: &Atlas, sizes: Sizes) -> Result<GpuDraw> {
    let Some(chosen) = tiles.get(draw.tile as usize) else {
        return Err(wrong(format!("tile {} of {} is to be drawn", draw.tile, tiles.len())));
    };
    let [west, north, east, south] = draw.window;
    if west > east || north > south || east > sizes.tile || south > sizes.tile {
        return Err(wrong(format!("tile {} has no window {:?}", chosen.id, draw.window)));
    }
    if let Some(slot) = image.filter(|&slot| !atlas.has_image(slot)) {
        return Err(wrong(format!("image slot {slot} of {} holds none", sizes.images)));
    }
    Ok(GpuDraw {
        tile: draw.tile,
        image: image.filter(|_| draw.image.is_some()).map_or(0, |slot| slot + 1),
        west_east: west | east << 16,
        north_south: north | south << 16,
        texel: texels(draw, chosen, sizes),
    })
}

/// Returns the number of patches of a tile that meet a window.
fn parts(window: [u32; 4], p: u8) -> u64 {
    let along = |low: u32, high: u32| u64::from(high.div_ceil(1 << p).saturating_sub(low >> p));
    along(window[0], window[2]) * along(window[1], window[3])
}

fn levels(levels: &Levels, tiles: &[Chosen], sizes: Sizes, edges: u32) -> Result<(Vec<u32>, Vec<u32>)> {
    let parts = (sizes.patches() as usize).pow(2);
    if levels.inner.len() != tiles.len() * parts || levels.edges.len() != edges as usize {
        return Err(wrong("its levels are not those of its selection"));
    }
    for (chosen, inner) in tiles.iter().zip(levels.inner.chunks_exact(parts)) {
        let steps = chosen.exponent..=chosen.exponent + sizes.patch_log2;
        if let Some(bad) = inner.iter().find(|inner| !steps.contains(inner)) {
            return Err(wrong(format!("tile {} has no step of exponent {bad}", chosen.id)));
        }
    }
    let inner = levels.inner.iter().map(|&inner| inner.into()).collect();
    Ok((inner, levels.edges.iter().map(|&edge| u32::from(255 - edge)).collect()))
}

impl Packed {
    /// Packs the input of a frame; `srgb` is true if the target converts to sRGB.
    pub fn new(
        input: &FrameInput<'_>,
        atlas: &Atlas,
        sizes: Sizes,
        srgb: bool,
        buckets: u32,
    ) -> Result<Self> {
        let chosen = &input.selection.tiles;
        if input.slots.len() != chosen.len() || input.images.len() != input.draws.len() {
            return Err(wrong(format!(
                "{} slots for {} tiles, {} images for {} draws",
                input.slots.len(),
                chosen.len(),
                input.images.len(),
                input.draws.len()
            )));
        }
        if !chosen.is_empty()
            && (input.selection.patches != sizes.patches() || input.selection.patch_log2 != sizes.patch_log2)
        {
            return Err(wrong("its patches are not those of the renderer"));
        }
        let each = u64::from(sizes.patches()).pow(2);
        if input.draws.len() as u64 * each > MOST_PARTS || chosen.len() as u64 * each > MOST_PARTS {
            return Err(wrong(format!("{} draws of {each} patches are too many", input.draws.len())));
        }
        if chosen.len() > sizes.tiles as usize {
            return Err(wrong(format!("{} tiles are drawn, {} fit", chosen.len(), sizes.tiles)));
        }
        if let Some(slot) = input.slots.iter().find(|&&slot| !atlas.has_tile(slot)) {
            return Err(wrong(format!("tile slot {slot} of {} holds none", sizes.tiles)));
        }
        let (whole, fraction) = camera(input)?;
        let frame = GpuFrame::new(input, sizes, fraction, srgb, buckets);
        let edges = frame.counts[2];
        let tiles =
            chosen.iter().zip(input.slots).map(|(chosen, &slot)| tile(chosen, slot, sizes, whole, edges));
        let draws =
            input.draws.iter().zip(input.images).map(|(it, &image)| draw(it, image, chosen, atlas, sizes));
        Ok(Self {
            frame,
            tiles: tiles.collect::<Result<_>>()?,
            draws: draws.collect::<Result<_>>()?,
            parts: input.draws.iter().map(|draw| parts(draw.window, sizes.patch_log2)).sum(),
            levels: input.levels.map(|it| levels(it, chosen, sizes, edges)).transpose()?,
        })
    }
}
