//! Geometric errors as 16-bit codes, rounded up: the upper half of a positive f32
//! (`format-spec.md`, section 10).

/// Code of infinity: the bound exceeds what an f32 holds.
pub const MAX_CODE: u16 = 0xFF00;

/// The smallest code whose value is at least `metres`. Negative numbers give 0, NaN gives infinity.
pub fn code_from_metres(metres: f64) -> u16 {
    if metres <= 0.0 {
        return 0;
    }
    if metres.is_nan() || metres > f64::from(f32::MAX) {
        return MAX_CODE;
    }
    let nearest = metres as f32;
    let up = if f64::from(nearest) < metres { nearest.next_up() } else { nearest };
    // 15 low bits are dropped; if one of them is set the code is the next.
    (up.to_bits().div_ceil(1 << 15)) as u16
}

/// Metres of a code.
pub fn metres_from_code(code: u16) -> f32 {
    f32::from_bits(u32::from(code) << 15)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn codes_round_up_by_at_most_one_part_in_256(metres in 1e-30_f64..1e30) {
            let back = f64::from(metres_from_code(code_from_metres(metres)));
            prop_assert!(back >= metres && back <= metres * (1.0 + 1.0 / 256.0));
        }

        #[test]
        fn codes_are_their_own_inverse(code in 0..=MAX_CODE) {
            prop_assert_eq!(code_from_metres(f64::from(metres_from_code(code))), code);
        }
    }

    #[test]
    fn ends_of_the_range() {
        assert_eq!(code_from_metres(0.0), 0);
        assert_eq!(code_from_metres(1e-300), 1);
        assert_eq!(code_from_metres(1e300), MAX_CODE);
        assert_eq!(code_from_metres(f64::NAN), MAX_CODE);
        assert!(metres_from_code(MAX_CODE).is_infinite());
    }
}
