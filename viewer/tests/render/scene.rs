//! Scenes made by hand: tiles of a terrain that is a function of the lattice, with the sides of a
//! selection.

use std::sync::Arc;

use relevo::TileId;
use relevo::select::imagery::Draw;
use relevo::select::neighbours::edges_of_tile;
use relevo::select::{Chosen, EdgeRule, Frame, Levels, Selection, Side, TileData, TileTable, View};
use relevo_viewer::gpu::{FrameInput, Gpu, Look, Paint, RenderTarget, Renderer, Sizes, target};

/// A software adapter, so that every machine draws the same.
pub fn gpu() -> Gpu {
    Gpu::headless(true).expect("a software adapter: install mesa-vulkan-drivers")
}

/// Numbers without a pattern.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }

    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn noise(column: i64, row: i64) -> f32 {
    let mut random = Random((column as u64) << 32 ^ (row as u64 & 0xFFFF_FFFF));
    random.unit() as f32
}

/// Hills with noise on every sample: no edge is straight.
pub fn rough(column: i64, row: i64) -> f32 {
    let (x, y) = (column as f32 / 23.0, row as f32 / 31.0);
    6.0 * (x.sin() + y.cos()) + 3.0 * noise(column, row)
}

pub fn flat(_: i64, _: i64) -> f32 {
    0.0
}

/// Tiles of a scene, and how they lie.
pub struct Scene {
    pub sizes: Sizes,
    pub selection: Selection,
    pub data: Vec<TileData>,
    pub frame: Frame,
    pub slots: Vec<u32>,
    /// One for each tile.
    pub draws: Vec<Draw>,
}

/// A square with tiles of three levels around one corner of the finest: 17 of level 3, 8 of level
/// 2, one of level 1.
pub fn mixed() -> Vec<TileId> {
    let mut out = vec![TileId::new(1, 1, 1)];
    let fine = [(0, 0), (1, 0), (0, 1), (1, 1)];
    let of_level_2 = |x: u32, y: u32| x / 2 != 1 || y / 2 != 1;
    let split = |x: u32, y: u32| fine.contains(&(x, y)) && (x, y) != (1, 1);
    for (y, x) in (0..4).flat_map(|y| (0..4).map(move |x| (y, x))) {
        if of_level_2(x, y) && !split(x, y) {
            out.push(TileId::new(2, x, y));
        }
    }
    for (y, x) in (0..8).flat_map(|y| (0..8).map(move |x| (y, x))) {
        if split(x / 2, y / 2) {
            out.push(TileId::new(3, x, y));
        }
    }
    out
}

/// All tiles of a level.
pub fn grid(level: u8) -> Vec<TileId> {
    let n = 1_u32 << level;
    (0..n * n).map(|i| TileId::new(level, i % n, i / n)).collect()
}

fn table(id: TileId, exponent: u8, (n, p): (u32, u8), heights: &[f32]) -> TileTable {
    let m = n >> p;
    let mut random = Random(u64::from(id.x) << 40 ^ u64::from(id.y) << 8 ^ u64::from(id.level));
    let parts = (m * m) as usize;
    let steps = usize::from(p) + 1;
    let mut table = TileTable {
        id,
        patches: m,
        steps: steps as u32,
        vertical: vec![0.0; parts * steps],
        horizontal: vec![0.0; parts * steps],
        low: Vec::new(),
        high: Vec::new(),
        drawable: vec![true; parts],
    };
    for part in 0..parts {
        let rough = 0.2 + random.unit() as f32;
        for step in 0..steps {
            let spacing = (1_u32 << (usize::from(exponent) + step)) as f32;
            let at = step * parts + part;
            table.vertical[at] = if exponent == 0 && step == 0 { 0.0 } else { 0.15 * rough * spacing };
            table.horizontal[at] = table.vertical[at] * 0.3 * rough;
        }
        let (x, y) = (part as u32 % m, part as u32 / m);
        let rows = (y << p..=(y + 1) << p)
            .flat_map(|row| (x << p..=(x + 1) << p).map(move |c| (row * (n + 1) + c) as usize));
        let (low, high) =
            rows.fold((f32::MAX, f32::MIN), |(low, high), i| (low.min(heights[i]), high.max(heights[i])));
        table.low.push(low - 1.0);
        table.high.push(high + 1.0);
    }
    table
}

fn tile(id: TileId, exponent: u8, (n, p): (u32, u8), height: fn(i64, i64) -> f32) -> TileData {
    let origin = |at: u32| (i64::from(at) * i64::from(n)) << exponent;
    let heights: Vec<f32> = (0..=n)
        .flat_map(|row| (0..=n).map(move |column| (column, row)))
        .map(|(c, r)| {
            height(origin(id.x) + (i64::from(c) << exponent), origin(id.y) + (i64::from(r) << exponent))
        })
        .collect();
    let valid = vec![1; heights.len()];
    TileData { table: table(id, exponent, (n, p), &heights), n, heights, valid }
}

/// First edge of a side (north, east, south, west) of a tile.
fn first(tile: usize, m: u32, side: usize) -> u32 {
    tile as u32 * edges_of_tile(m) + [0, m * (m + 1) + m * m, m * m, m * (m + 1)][side]
}

/// The side of a tile that meets others of the selection.
fn side(ids: &[TileId], finest: u8, m: u32, index: usize, at: usize) -> Side {
    let id = ids[index];
    let own = Side { first: first(index, m, at), local: 0, shift: 0, limit: finest - id.level };
    let (dx, dy) = [(0, -1), (1, 0), (0, 1), (-1, 0)][at];
    let (x, y) = (i64::from(id.x) + dx, i64::from(id.y) + dy);
    if x < 0 || y < 0 {
        return own;
    }
    let opposite = (at + 2) % 4;
    for shift in 0..=id.level {
        let other = TileId::new(id.level - shift, x as u32 >> shift, y as u32 >> shift);
        let Some(found) = ids.iter().position(|&of| of == other) else { continue };
        if shift == 0 && found > index {
            return own;
        }
        let along = if at.is_multiple_of(2) { id.x } else { id.y };
        let local = along & ((1 << shift) - 1);
        return Side { first: first(found, m, opposite), local, shift, limit: finest - other.level };
    }
    own
}

impl Scene {
    /// Tiles of `n` intervals with patches of `2^p`; the finest samples are a metre apart.
    pub fn new(ids: &[TileId], (n, p): (u32, u8), finest: u8, height: fn(i64, i64) -> f32) -> Self {
        let m = n >> p;
        let data: Vec<_> = ids.iter().map(|&id| tile(id, finest - id.level, (n, p), height)).collect();
        let chosen = |(index, data): (usize, &TileData)| Chosen {
            id: data.table.id,
            exponent: finest - data.table.id.level,
            sides: std::array::from_fn(|at| side(ids, finest, m, index, at)),
            table: Arc::new(data.table.clone()),
        };
        let tiles = data.iter().enumerate().map(chosen).collect();
        let count = ids.len() as u32;
        Self {
            sizes: Sizes { tile: n, patch_log2: p, tiles: count + 3, images: 0, image_side: 0, gutter: 0 },
            selection: Selection {
                tiles,
                patches: m,
                patch_log2: p,
                rounds: u32::from(finest) + 7,
                ..Selection::default()
            },
            data,
            frame: Frame { dx: 1.0, dy: 1.0, exaggeration: 1.0 },
            // Not the order of the selection.
            slots: (0..count).map(|i| count + 1 - i).collect(),
            draws: (0..count).map(|tile| Draw { tile, window: [0, 0, n, n], image: None }).collect(),
        }
    }

    /// Every tile in its slot.
    pub fn renderer(&self, gpu: &Gpu, format: wgpu::TextureFormat) -> Renderer {
        let mut renderer = Renderer::new(gpu, self.sizes, format).expect("a renderer");
        for (data, &slot) in self.data.iter().zip(&self.slots) {
            renderer.upload_tile(gpu, slot, data).expect("room for a tile");
        }
        renderer
    }
}

/// Magenta where nothing is drawn.
pub const LOOK: Look = Look {
    paint: Paint::Tint,
    wireframe: false,
    borders: false,
    clear: [1.0, 0.0, 1.0],
    sun: [0.0, 0.0, 1.0],
    range: [-12.0, 16.0],
};

/// A picture that is asked for.
#[derive(Clone, Copy)]
pub struct Shot<'a> {
    pub view: &'a View,
    pub tolerance: f64,
    pub rule: EdgeRule,
    pub levels: Option<&'a Levels>,
    pub look: Look,
    pub images: &'a [Option<u32>],
}

impl<'a> Shot<'a> {
    pub fn new(view: &'a View) -> Self {
        Self { view, tolerance: 1.0, rule: EdgeRule::Shared, levels: None, look: LOOK, images: &[] }
    }

    pub fn input(&self, scene: &'a Scene, none: &'a [Option<u32>]) -> FrameInput<'a> {
        FrameInput {
            selection: &scene.selection,
            slots: &scene.slots,
            draws: &scene.draws,
            images: if self.images.is_empty() { none } else { self.images },
            view: self.view,
            frame: &scene.frame,
            tolerance: self.tolerance,
            rule: self.rule,
            levels: self.levels,
            look: self.look,
        }
    }

    /// Draws it; RGBA.
    pub fn draw(
        &self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        scene: &Scene,
        format: wgpu::TextureFormat,
    ) -> Vec<u8> {
        let size = (self.view.width, self.view.height);
        let target = RenderTarget::new(gpu, size, format).expect("a target");
        let none = vec![None; scene.draws.len()];
        renderer.render(gpu, &self.input(scene, &none), target.view(), size).expect("drawn");
        if let Ok(folder) = std::env::var("RELEVO_TEST_PICTURES") {
            let name = std::thread::current().name().unwrap_or("picture").replace("::", "-");
            let path = std::path::Path::new(&folder).join(format!("{name}.png"));
            target.save(gpu, &path, true).expect("written");
        }
        target.read(gpu).expect("read back")
    }

    /// Draws it as people see it.
    pub fn seen(&self, gpu: &Gpu, renderer: &mut Renderer, scene: &Scene) -> Vec<u8> {
        self.draw(gpu, renderer, scene, target::FORMAT)
    }
}

pub fn magenta(pixels: &[u8]) -> usize {
    pixels.chunks_exact(4).filter(|p| p[0] == 255 && p[1] == 0 && p[2] == 255).count()
}

/// Views that the square of 256 metres with [`mixed`] tiles fills.
pub fn views() -> Vec<View> {
    let look = |eye, target| View::look_at(eye, target, 0.7, (400, 300), 0.5);
    vec![
        look([120.3, -190.2, 60.0], [124.0, -150.0, 0.0]),
        look([60.0, -200.7, 45.0], [70.0, -165.0, 0.0]),
        look([128.4, -40.0, 60.0], [100.0, -70.0, 5.0]),
        look([50.1, -120.0, 40.0], [64.0, -85.0, 0.0]),
        look([127.9, -128.2, 120.0], [128.0, -128.1, 0.0]),
    ]
}
