//! The memory of a renderer, and the tiles and images that fit a budget.

use relevo_core::select::neighbours::edges_of_tile;
use relevo_core::{Error, Result};

use super::device::Gpu;
use super::input::{DRAW_BYTES, TILE_BYTES};

/// The sizes that a [`super::Renderer`] is made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Intervals of a tile, T.
    pub tile: u32,
    /// Binary logarithm of the patch size.
    pub patch_log2: u8,
    /// Tiles of heights that fit at once.
    pub tiles: u32,
    /// Images that fit at once; 0 without imagery.
    pub images: u32,
    /// Texels along an image, gutters included.
    pub image_side: u32,
    /// Texels of its gutter.
    pub gutter: u32,
}

/// Least number of tiles for a file that has more.
const FEWEST: u32 = 8;

/// Squares of one size in the layers of a texture array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Packing {
    /// Squares along a side of a layer.
    pub across: u32,
    /// Layers.
    pub layers: u32,
    /// Texels along a square.
    pub side: u32,
}

impl Packing {
    /// Returns the packing with the smallest layers of which 256, which every device has, hold
    /// `count` squares.
    pub fn new(count: u32, side: u32) -> Self {
        let across = (1..=4096_u32).find(|k| count.div_ceil(k * k) <= 256).unwrap_or(1);
        // OpenGL does not know an array of one layer from a plain texture, nor squares in sixes
        // from cubes.
        let layers = count.div_ceil(across * across).max(2);
        Self { across, layers: layers + u32::from(layers.is_multiple_of(6)), side }
    }

    pub fn texels(&self) -> u64 {
        u64::from(self.layers) * (u64::from(self.across) * u64::from(self.side)).pow(2)
    }

    /// Returns column, row and layer of a slot's first texel.
    pub fn origin(&self, slot: u32) -> wgpu::Origin3d {
        let at = slot % (self.across * self.across);
        let (x, y) = (at % self.across * self.side, at / self.across * self.side);
        wgpu::Origin3d { x, y, z: slot / (self.across * self.across) }
    }
}

impl Sizes {
    /// Returns the number of patches along a tile.
    pub(crate) fn patches(&self) -> u32 {
        self.tile >> self.patch_log2
    }

    /// Returns the count of numbers in a tile's table on the device.
    pub(crate) fn table_words(&self) -> u64 {
        u64::from(self.patches()).pow(2) * (2 * u64::from(self.patch_log2) + 5)
    }

    pub(crate) fn height_packing(&self) -> Packing {
        Packing::new(self.tiles, self.tile + 1)
    }

    pub(crate) fn image_packing(&self) -> Packing {
        if self.images == 0 { Packing::new(1, 1) } else { Packing::new(self.images, self.image_side) }
    }

    /// Returns the bytes of the buffers of a frame for each tile.
    fn frame_bytes(&self) -> u64 {
        let patches = u64::from(self.patches()).pow(2);
        TILE_BYTES + 2 * DRAW_BYTES + patches * (2 * 4 + 5 * 8) + u64::from(edges_of_tile(self.patches())) * 8
    }

    /// Returns the bytes of graphics memory for each slot of heights: heights, validity, table, and
    /// its share of the buffers of a frame.
    pub fn tile_bytes(&self) -> u64 {
        u64::from(self.tile + 1).pow(2) * 5 + self.table_words() * 4 + self.frame_bytes()
    }

    /// Returns the bytes for each slot of images.
    pub fn image_bytes(&self) -> u64 {
        u64::from(self.image_side).pow(2) * 4
    }

    /// Returns the bytes of a renderer of these sizes that draws on `target` pixels.
    pub fn bytes(&self, (width, height): (u32, u32)) -> u64 {
        let tiles = u64::from(self.tiles);
        let slots = self.height_packing().texels() * 5 + self.image_packing().texels() * 4;
        slots
            + tiles * (self.table_words() * 4 + self.frame_bytes())
            + u64::from(width) * u64::from(height) * 4
            + FIXED_BYTES
    }

    /// Returns the sizes with as many tiles and images as fit `budget` bytes, at most those of
    /// `self`. Half of the memory is for images where there are any, and what one side does not
    /// need is for the other. Fails if too few fit.
    #[must_use = "the sizes that fit are returned"]
    pub fn within(self, gpu: &Gpu, budget: u64, target: (u32, u32)) -> Result<Self> {
        self.check()?;
        let limits = gpu.device.limits();
        let storage = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let widest = |side: u32| u64::from(limits.max_texture_dimension_2d / side.max(1)).pow(2) * 256;
        let parts = u64::from(self.patches()).pow(2);
        let most =
            widest(self.tile + 1).min(storage / (self.table_words() * 4)).min(storage / (parts * 5 * 8));
        let wanted = Self {
            tiles: self.tiles.min(u32::try_from(most).unwrap_or(u32::MAX)),
            images: self.images.min(u32::try_from(widest(self.image_side)).unwrap_or(u32::MAX)),
            ..self
        };
        wanted.shared_out(budget, target)
    }

    /// [`Self::within`] on a device that could hold all of `self`.
    fn shared_out(self, budget: u64, target: (u32, u32)) -> Result<Self> {
        let fewest = Self { tiles: self.tiles.min(FEWEST), images: self.images.min(FEWEST), ..self };
        let least = fewest.bytes(target);
        if least > budget {
            return Err(Error::usage(format!(
                "{} MiB of graphics memory are too little for this file: give at least {} MiB (--gpu-memory)",
                budget >> 20,
                least.div_ceil(1 << 20)
            )));
        }
        let free = budget.saturating_sub(Self { tiles: 0, images: 0, ..self }.bytes(target));
        let of = |bytes: u64, each: u64, (few, most): (u32, u32)| {
            u32::try_from(bytes / each.max(1)).unwrap_or(u32::MAX).clamp(few, most)
        };
        let (tiles, images) = ((fewest.tiles, self.tiles), (fewest.images, self.images));
        let left = |count: u32, each: u64| free.saturating_sub(u64::from(count) * each);
        let mut fits = fewest;
        if self.images > 0 {
            let for_tiles = of(free / 2, self.tile_bytes(), tiles);
            fits.images = of(left(for_tiles, self.tile_bytes()), self.image_bytes(), images);
        }
        fits.tiles = of(left(fits.images, self.image_bytes()), self.tile_bytes(), tiles);
        // Layers are whole, so a few slots less may fit than the bytes would hold; the fewest do.
        while fits.bytes(target) > budget && fits != fewest {
            fits.tiles = fits.tiles.saturating_sub(1).max(fewest.tiles);
            if fits.bytes(target) > budget {
                fits.images = fits.images.saturating_sub(1).max(fewest.images);
            }
        }
        Ok(fits)
    }

    /// Fails if no file has these sizes.
    pub(crate) fn check(&self) -> Result<()> {
        let power = self.tile.is_power_of_two() && (4..=1024).contains(&self.tile);
        let patch = (2..=6).contains(&self.patch_log2) && self.patches() > 0;
        let image = self.images == 0 || self.image_side > 2 * self.gutter;
        if power && patch && image {
            return Ok(());
        }
        Err(Error::usage(format!("no renderer has these sizes: {self:?}")))
    }
}

/// Bytes of uniforms, index meshes and counters, rounded up.
const FIXED_BYTES: u64 = 1 << 20;

#[cfg(test)]
mod tests {
    use super::*;

    /// The MiB that a refusal names.
    fn named(refusal: &Error) -> u64 {
        let text = refusal.to_string();
        let number = text.split("at least ").nth(1).and_then(|rest| rest.split(' ').next());
        number.and_then(|number| number.parse().ok()).expect("a number of MiB")
    }

    #[test]
    fn a_refusal_names_the_least_memory_that_is_accepted() {
        for (tile, patch_log2) in [(32, 3), (64, 4), (256, 5), (1024, 6)] {
            for (tiles, images, image_side) in [
                (1, 0, 0),
                (3, 1, 260),
                (6, 6, 66),
                (5000, 0, 0),
                (5000, 3, 516),
                (40, 900, 260),
                (9000, 9000, 516),
            ] {
                let all = Sizes { tile, patch_log2, tiles, images, image_side, gutter: 2 };
                for target in [(64, 64), (1280, 720), (1921, 1081)] {
                    let least = named(&all.shared_out(0, target).expect_err("no memory"));
                    let refusal = all.shared_out((least << 20) - (1 << 20), target);
                    assert_eq!(named(&refusal.expect_err("too little")), least, "{all:?}");
                    for budget in [least << 20, (least << 20) + 4321, least << 21, (9 * least) << 20] {
                        let fits = all.shared_out(budget, target).expect("enough");
                        assert!(fits.bytes(target) <= budget, "{fits:?}");
                        assert!(
                            fits.tiles >= tiles.min(FEWEST) && fits.images >= images.min(FEWEST),
                            "{fits:?}"
                        );
                        assert!(fits.tiles <= tiles && fits.images <= images, "{fits:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn slots_of_a_packing_do_not_meet() {
        for count in [1, 2, 255, 256, 257, 1000, 3000] {
            let packing = Packing::new(count, 17);
            assert!(packing.layers <= 256 && packing.layers * packing.across.pow(2) >= count);
            let places: std::collections::BTreeSet<_> = (0..count)
                .map(|slot| packing.origin(slot))
                .inspect(|o| {
                    let last = o.x.max(o.y) + 17;
                    assert!(o.z < packing.layers && last <= 17 * packing.across);
                })
                .map(|o| (o.x, o.y, o.z))
                .collect();
            assert_eq!(places.len(), count as usize);
        }
    }
}
