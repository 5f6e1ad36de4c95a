//! Composites pictures over one another.
//!
//! Transparent texels of a picture show the pictures below. Where two pictures each cover a part of
//! a texel, the parts are taken to be disjoint: pictures that abut along a slanted edge join
//! without a seam.

use super::light::TABLES;
use super::square::Layer;
use crate::texel::Colour;

/// The texels of a square, composited so far.
#[derive(Debug)]
pub(super) struct Canvas {
    pub(super) kind: Colour,
    pub(super) side: usize,
    pub(super) colour: Vec<u8>,
    /// Alpha, one byte a texel.
    pub(super) alpha: Vec<u8>,
}

impl Canvas {
    /// A wholly transparent canvas.
    pub(super) fn new(kind: Colour, side: usize) -> Self {
        let count = side * side;
        Self { kind, side, colour: vec![0; count * kind.channels()], alpha: vec![0; count] }
    }

    /// True if all texels are opaque.
    pub(super) fn is_opaque(&self) -> bool {
        self.alpha.iter().all(|&alpha| alpha == 255)
    }

    /// Composites a layer below the canvas. Returns true if a texel of it shows, `gutter` texels on
    /// each side not counted.
    pub(super) fn below(&mut self, layer: Layer, gutter: usize) -> bool {
        let colour = match (layer.kind, self.kind) {
            (Colour::Grey, Colour::Rgb) => layer.colour.iter().flat_map(|&grey| [grey; 3]).collect(),
            _ => layer.colour,
        };
        let (channels, side) = (self.kind.channels(), self.side);
        let inner = gutter..side - gutter;
        if self.alpha.iter().all(|&alpha| alpha == 0) {
            self.colour = colour;
            self.alpha = layer.alpha.unwrap_or_else(|| vec![255; side * side]);
            let mut rows = self.alpha.chunks_exact(side).take(inner.end).skip(gutter);
            return rows.any(|row| row[inner.clone()].iter().any(|&alpha| alpha > 0));
        }
        let mut shows = false;
        for (index, over) in self.alpha.iter_mut().enumerate() {
            let under = layer.alpha.as_ref().map_or(255, |alpha| alpha[index]).min(255 - *over);
            if under == 0 {
                continue;
            }
            let at = index * channels..(index + 1) * channels;
            let (top, bottom) = (&mut self.colour[at.clone()], &colour[at]);
            let (a, b) = (u32::from(*over), u32::from(under));
            for (top, &bottom) in top.iter_mut().zip(bottom) {
                let light = |byte: u8| u32::from(TABLES.light16[usize::from(byte)]);
                *top = TABLES.byte16(a * light(*top) + b * light(bottom), a + b);
            }
            *over += under;
            shows |= inner.contains(&(index % side)) && inner.contains(&(index / side));
        }
        shows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(colour: &[u8], alpha: &[u8]) -> Layer {
        Layer { kind: Colour::Grey, colour: colour.to_vec(), alpha: Some(alpha.to_vec()) }
    }

    #[test]
    fn parts_of_a_texel_add_up() {
        let mut canvas = Canvas::new(Colour::Grey, 2);
        assert!(canvas.below(layer(&[10, 20, 30, 0], &[255, 100, 128, 0]), 0));
        assert!(canvas.below(layer(&[90, 20, 30, 70], &[255, 155, 127, 60]), 0));
        assert_eq!(canvas.colour, [10, 20, 30, 70]);
        assert_eq!(canvas.alpha, [255, 255, 255, 60]);
        // Nothing shows below what is opaque.
        assert!(!canvas.below(layer(&[1; 4], &[255, 255, 255, 0]), 0));
    }

    #[test]
    fn the_gutter_does_not_count() {
        let mut canvas = Canvas::new(Colour::Rgb, 3);
        let mut alpha = [255; 9];
        alpha[4] = 0;
        assert!(!canvas.below(layer(&[5; 9], &alpha), 1));
        assert_eq!(canvas.colour, [5; 27]);
        assert!(canvas.below(layer(&[6; 9], &[255; 9]), 1));
        assert_eq!(canvas.colour[12..15], [6; 3]);
    }
}
