//! Converts between sRGB bytes and linear light.
//!
//! Texels are averaged in linear light: a white line on black keeps its brightness however coarse
//! the level; the mean of the bytes would be a darker grey. All filters follow this rule: bilinear
//! ones, area averages and parents.

use std::sync::LazyLock;

/// Linear light of white, in the unit of [`Tables::light`]: codes of neighbouring bytes are at
/// least 4.9 apart.
const WHITE: f32 = 16384.0;

/// Adding this to a number of up to 22 bits leaves the nearest integer in the low bits.
const ROUND: f32 = 8_388_608.0;

/// Tables for both directions.
pub(super) struct Tables {
    /// Linear light of a byte, 0 to 16384.
    pub(super) light: [f32; 256],
    /// Linear light of a byte, 0 to 65535.
    pub(super) light16: [u16; 256],
    /// Byte of linear light 0 to 16384; the table is longer so that no index of 15 bits is outside.
    bytes: Box<[u8; 32768]>,
}

/// The tables, computed once.
pub(super) static TABLES: LazyLock<Tables> = LazyLock::new(|| {
    let mut bytes = Box::new([255; 32768]);
    for (index, byte) in bytes.iter_mut().enumerate().take(WHITE as usize) {
        *byte = (255.0 * coded(index as f64 / f64::from(WHITE)) + 0.5) as u8;
    }
    let mut light = [0.0; 256];
    let mut light16 = [0; 256];
    for byte in 0..256 {
        let value = linear(byte as f64 / 255.0);
        light[byte] = (value * f64::from(WHITE)) as f32;
        light16[byte] = (value * 65535.0 + 0.5) as u16;
    }
    Tables { light, light16, bytes }
});

/// Linear light of an sRGB value, both 0 to 1.
pub(super) fn linear(coded: f64) -> f64 {
    if coded <= 0.04045 { coded / 12.92 } else { ((coded + 0.055) / 1.055).powf(2.4) }
}

/// sRGB value of linear light, both 0 to 1.
pub(super) fn coded(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

impl Tables {
    /// The byte of linear light 0 to 16384 (and a little more).
    #[inline(always)]
    pub(super) fn byte(&self, light: f32) -> u8 {
        self.bytes[((light + ROUND).to_bits() & 0x7FFF) as usize]
    }

    /// The byte of a sum of linear light, `weights` times 0 to 65535.
    #[inline(always)]
    pub(super) fn byte16(&self, sum: u32, weights: u32) -> u8 {
        self.bytes[(((sum + 2 * weights) / (4 * weights)) & 0x7FFF) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_byte_comes_back_from_either_table() {
        for byte in 0..=255_u8 {
            let at = usize::from(byte);
            assert_eq!(TABLES.byte(TABLES.light[at]), byte);
            assert_eq!(TABLES.byte16(u32::from(TABLES.light16[at]), 1), byte);
            assert_eq!(TABLES.byte16(1020 * u32::from(TABLES.light16[at]), 1020), byte);
        }
    }

    #[test]
    fn no_entry_hangs_on_the_last_bits_of_a_power() {
        // The tables must be the same whatever library computes the powers.
        let far = |value: f64| ((value - value.floor()) - 0.5).abs() > 1e-7;
        assert!((0..256).all(|byte| far(linear(f64::from(byte) / 255.0) * 65535.0)));
        assert!((0..16384).all(|light| far(255.0 * coded(f64::from(light) / 16384.0))));
    }

    #[test]
    fn black_and_white_make_a_bright_grey() {
        assert_eq!(TABLES.byte16(65535, 2), 188);
        assert_eq!(TABLES.byte(8192.0), 188);
    }
}
