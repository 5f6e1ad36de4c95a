//! The codec against a slow reader that follows the specification word by word, and against damaged
//! chunks.

use super::{Scratch, decimal, height, mask, oracle, table};
use crate::sample::{Coding, FILLED, Lattice, VALID, VOID, code_from_f32, code_from_f64};
use proptest::prelude::*;

/// A tile as its parent leaves it: even samples known, the rest blank.
fn blank(lattice: &Lattice, coding: Coding, root: bool) -> Lattice {
    let mut blank = Lattice::new(lattice.n, coding);
    // Nothing may depend on what was there.
    blank.code.fill(0x5A5A_5A5A);
    blank.low.fill(7);
    blank.state.fill(FILLED);
    for (x, y) in (0..=lattice.n).flat_map(|y| (0..=lattice.n).map(move |x| (x, y))) {
        if !root && x % 2 == 0 && y % 2 == 0 {
            let at = lattice.at(x, y);
            blank.code[at] = lattice.code[at];
            blank.state[at] = if lattice.state[at] == VALID { VALID } else { VOID };
            if coding.has_low() {
                blank.low[at] = lattice.low[at];
            }
        }
    }
    blank
}

/// Encodes a tile and checks what both readers make of it. Gives the chunks.
fn check(lattice: &Lattice, coding: Coding, root: bool, scratch: &mut Scratch) -> (Vec<u8>, Vec<u8>) {
    let (mut heights, mut bits) = (vec![1, 2, 3], vec![4]);
    height::encode((lattice, height::Fills::Any), coding, root, scratch, &mut heights).unwrap();
    let occupancy = mask::encode(lattice, root, scratch, &mut bits).unwrap();
    let (heights, bits) = (heights.split_off(3), bits.split_off(1));

    let mut decoded = blank(lattice, coding, root);
    let mut expected = decoded.clone();
    mask::decode(&bits, occupancy, &mut decoded, root, scratch).unwrap();
    if occupancy.has_valid && occupancy.has_void {
        oracle::mask(&bits, &mut expected, root);
    } else {
        assert!(bits.is_empty());
        expected.state.fill(if occupancy.has_valid { VALID } else { VOID });
    }
    assert!(decoded.state == expected.state, "mask and oracle differ");
    height::decode(&heights, &mut decoded, coding, root, scratch).unwrap();
    oracle::heights(&heights, &mut expected, coding, root);
    assert!(decoded.code == expected.code, "heights and oracle differ");
    assert!(decoded.low == expected.low, "lows and oracle differ");
    for (at, &state) in lattice.state.iter().enumerate() {
        assert_eq!(decoded.state[at] == VALID, state == VALID, "sample {at}");
        if state != VOID {
            assert_eq!(decoded.code[at], lattice.code[at], "sample {at}");
            assert_eq!(decoded.low_at(at), lattice.low_at(at), "sample {at}");
        }
    }
    (heights, bits)
}

/// Numbers that look random, the same every time.
fn hash(seed: u64, x: usize, y: usize) -> u64 {
    let mut z = seed
        ^ (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Hills of several sizes, in metres.
fn hills(seed: u64, x: usize, y: usize) -> f64 {
    let (x, y, phase) = (x as f64, y as f64, (seed % 100) as f64);
    300.0 * (x / 40.0 + phase).sin() * (y / 31.0).cos()
        + 60.0 * ((x + y) / 9.0).sin()
        + 9.0 * (x / 2.3 - y / 3.1).sin()
}

const KINDS: usize = 14;
const PATTERNS: usize = 8;

/// A tile whose heights are of one of [`KINDS`] and whose voids follow one of [`PATTERNS`].
fn tile(n: usize, kind: usize, pattern: usize, seed: u64) -> (Lattice, Coding) {
    let coding = match kind {
        0..=6 => Coding::Integer { scale: 1.0, offset: 0.0 },
        7..=11 => Coding::Float32,
        _ => Coding::Float64,
    };
    let mut lattice = Lattice::new(n, coding);
    for (x, y) in (0..=n).flat_map(|y| (0..=n).map(move |x| (x, y))) {
        let (at, random, h) = (lattice.at(x, y), hash(seed, x, y), hills(seed, x, y));
        let float = match kind {
            7 => h as f32,
            8 => ((f64::from((h * 100.0) as i32)) / 100.0) as f32,
            9 => ((h * 4.0).floor() / 4.0) as f32,
            10 => [-0.0, 0.0, 1e-42, -1e-42, f32::MAX, f32::MIN, f32::MIN_POSITIVE, 1.5][random as usize % 8],
            _ => f32::from_bits(random as u32 & 0xFF7F_FFFF),
        };
        let double = if kind == 12 { h } else { f64::from_bits(random & 0xFFEF_FFFF_FFFF_FFFF) };
        lattice.code[at] = match kind {
            0 => h as i32,
            1 => 123,
            2 => 7 * x as i32 - 3 * y as i32,
            3 => (random % 500) as i32,
            4 => random as i32,
            5 => [i32::MIN, i32::MAX, 0, -1][random as usize % 4],
            6 => (h * 1e6) as i32,
            7..=11 => code_from_f32(float),
            _ => code_from_f64(double).0,
        };
        if coding.has_low() {
            lattice.low[at] = code_from_f64(double).1;
        }
        let void = match pattern {
            0 => false,
            1 => true,
            2 => random >> 40 & 1 == 0,
            3 => (random >> 40).trailing_zeros() >= 6,
            4 => hills(seed / 7, x, y) > 100.0,
            5 => (y / 3) % 2 == 0,
            6 => (x + y) % 2 == 0,
            _ => x != n || y != n / 3,
        };
        let filled = if random >> 50 & 1 == 0 { FILLED } else { VOID };
        lattice.state[at] = if void { filled } else { VALID };
    }
    (lattice, coding)
}

#[test]
fn every_kind_and_pattern_comes_back() {
    let mut scratch = Scratch::default();
    for kind in 0..KINDS {
        for pattern in 0..PATTERNS {
            for root in [false, true] {
                let (lattice, coding) = tile(32, kind, pattern, 77);
                check(&lattice, coding, root, &mut scratch);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]
    #[test]
    fn tiles_come_back(
        size in 1_u32..=8, kind in 0..KINDS, pattern in 0..PATTERNS, seed: u64, root: bool
    ) {
        let (lattice, coding) = tile(1 << size, kind, pattern, seed);
        check(&lattice, coding, root, &mut Scratch::default());
    }

    #[test]
    fn any_numbers_come_back(
        samples in prop::collection::vec((any::<i32>(), any::<u32>(), 0..=VALID), 81), coding in 0..3, root: bool
    ) {
        let coding = [Coding::Integer { scale: 1.0, offset: 0.0 }, Coding::Float32, Coding::Float64][coding as usize];
        let mut lattice = Lattice::new(8, coding);
        lattice.code = samples.iter().map(|sample| sample.0).collect();
        if coding.has_low() {
            lattice.low = samples.iter().map(|sample| sample.1).collect();
        }
        lattice.state = samples.iter().map(|sample| sample.2).collect();
        check(&lattice, coding, root, &mut Scratch::default());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]
    #[test]
    fn rows_decoded_alone_are_rows_of_the_tile(
        size in 1_u32..=6, kind in 0..KINDS, seed: u64, (a, b) in (0_usize..65, 0_usize..65), dirt: i32
    ) {
        let n = 1_usize << size;
        let (mut lattice, coding) = tile(n, kind, 0, seed);
        lattice.state.fill(VALID);
        let (a, b) = (a % (n + 1), b % (n + 1));
        let rows = a.min(b)..a.max(b) + 1;
        let mut scratch = Scratch::default();
        let mut chunk = Vec::new();
        height::encode((&lattice, height::Fills::Any), coding, false, &mut scratch, &mut chunk).unwrap();
        // What need not be known holds dirt.
        let known = height::parent_rows(n, &rows);
        let mut decoded = lattice.clone();
        for at in 0..lattice.code.len() {
            let (x, y) = (at % (n + 1), at / (n + 1));
            if !(x % 2 == 0 && y % 2 == 0 && known.contains(&(y / 2))) {
                decoded.code[at] = dirt;
                decoded.state[at] = dirt as u8;
                decoded.low.iter_mut().skip(at).take(1).for_each(|low| *low = dirt as u32);
            }
        }
        mask::decode_rows(&[], &mut decoded, known, &mut scratch).unwrap();
        height::decode_rows(&chunk, &mut decoded, coding, rows.clone(), &mut scratch).unwrap();
        let range = rows.start * (n + 1)..rows.end * (n + 1);
        for at in range {
            prop_assert_eq!(decoded.state[at], VALID);
            prop_assert_eq!(decoded.code[at], lattice.code[at], "sample {}", at);
            prop_assert_eq!(decoded.low_at(at), lattice.low_at(at), "sample {}", at);
        }
    }
}

#[test]
fn the_largest_tile_comes_back() {
    let (lattice, coding) = tile(1024, 0, 4, 5);
    check(&lattice, coding, false, &mut Scratch::default());
}

/// Where in the range of i32 the codes of a test lie.
fn codes_at(place: usize, range: u64, next: &mut impl FnMut() -> u64) -> i32 {
    let away = (next() % range.max(1)) as i64;
    let base = match place {
        0 => i64::from(i32::MIN) + away,
        1 => i64::from(i32::MAX) - away,
        2 => away - (range / 2) as i64,
        _ => i64::from(next() as i32),
    };
    base.clamp(i32::MIN.into(), i32::MAX.into()) as i32
}

proptest! {
    /// Predictions of void samples leave the range of i32 at its ends: the oracle, which knows
    /// nothing of narrow tiles, agrees.
    #[test]
    fn a_reader_that_ignores_hints_agrees_at_the_ends_of_the_range(
        seed: u64, place in 0_usize..4, log_range in 0_u32..33, coding in 0_usize..3, voids in 0_u64..10, log_n in 1_u32..6,
        fills: bool, smooth: bool, root: bool,
    ) {
        let coding = [Coding::Integer { scale: 1.0, offset: 0.0 }, Coding::Float32, Coding::Float64][coding];
        let (n, range) = (1_usize << log_n, 1_u64 << log_range);
        let mut at = 0;
        let mut next = || { at += 1; hash(seed, at, 0) };
        let mut lattice = Lattice::new(n, coding);
        for i in 0..lattice.code.len() {
            let code = codes_at(place, range, &mut next);
            lattice.code[i] = if smooth && i > 0 && next() % 4 > 0 { lattice.code[i - 1] } else { code };
            let void = next() % 10 < voids;
            lattice.state[i] = if !void { VALID } else if fills && next() % 2 == 0 { FILLED } else { VOID };
            if coding.has_low() {
                lattice.low[i] = next() as u32;
            }
        }
        check(&lattice, coding, root, &mut Scratch::default());
    }
}

#[test]
fn ends_of_the_narrow_range_come_back() {
    let coding = Coding::Integer { scale: 1.0, offset: 0.0 };
    let mut scratch = Scratch::default();
    for base in [0, -5, i32::MIN, i32::MAX - (1 << 24)] {
        for range in [
            (1_u64 << 20) - 1,
            1 << 20,
            (1 << 22) - 1,
            1 << 22,
            (1 << 23) - 1,
            1 << 23,
            (1 << 23) + 1,
            (1 << 24) - 1,
        ] {
            for root in [false, true] {
                let (mut lattice, _) = tile(16, 0, 2, 3);
                for at in 0..lattice.code.len() {
                    let h = if hash(9, at, 0).is_multiple_of(2) {
                        hash(8, at, 0) % (range + 1)
                    } else {
                        hash(7, at, 1) % 2 * range
                    };
                    lattice.code[at] = base + h as i32;
                }
                check(&lattice, coding, root, &mut scratch);
            }
        }
    }
}

#[test]
fn a_smooth_tile_without_news_takes_no_bytes() {
    let mut scratch = Scratch::default();
    let (ramp, coding) = tile(64, 2, 0, 1);
    let mut even = ramp.clone();
    even.code.iter_mut().for_each(|code| *code *= 2);
    assert!(check(&even, coding, false, &mut scratch).0.is_empty());
    let (void, coding) = tile(64, 12, 0, 1);
    let void = Lattice { state: vec![VOID; void.state.len()], ..void };
    assert!(check(&void, coding, true, &mut scratch).0.is_empty());
}

#[test]
fn decimals_are_found_and_minus_zero_is_kept() {
    let mut scratch = Scratch::default();
    let (mut cents, coding) = tile(64, 8, 0, 3);
    let (chunk, _) = check(&cents, coding, false, &mut scratch);
    assert_eq!(chunk[2], 11);
    // One newborn sample of -0 is not f32(q / s) for any q.
    cents.code[1] = code_from_f32(-0.0);
    let (chunk, _) = check(&cents, coding, false, &mut scratch);
    assert_eq!(chunk[2], 0);
    let (quarters, coding) = tile(64, 9, 0, 3);
    let (chunk, _) = check(&quarters, coding, true, &mut scratch);
    assert_eq!(chunk[2], 3);
    let odd = [f32::MAX, f32::MIN, f32::NAN, f32::INFINITY, -0.0, 1e-40];
    for code in odd.map(code_from_f32).into_iter().chain([i32::MIN, i32::MAX]) {
        for scale in [1.0, 1000.0] {
            let _ = decimal::code_from_q(decimal::q_from_code(code, scale), scale);
        }
    }
}

/// Whatever the bytes, a decoder answers.
fn decode_all(
    heights: &[u8],
    bits: &[u8],
    lattice: &Lattice,
    coding: Coding,
    root: bool,
    scratch: &mut Scratch,
) -> [bool; 2] {
    let mut decoded = blank(lattice, coding, root);
    let occupancy = mask::Occupancy { has_valid: true, has_void: true };
    let mask = mask::decode(bits, occupancy, &mut decoded, root, scratch).is_ok();
    [height::decode(heights, &mut decoded, coding, root, scratch).is_ok(), mask]
}

#[test]
fn every_cut_chunk_is_refused() {
    let mut scratch = Scratch::default();
    for (kind, root) in [(0, false), (3, true), (8, false), (11, false), (12, true)] {
        let (lattice, coding) = tile(16, kind, 2, 4);
        let (heights, bits) = check(&lattice, coding, root, &mut scratch);
        for end in 1..heights.len() {
            assert!(!decode_all(&heights[..end], &bits, &lattice, coding, root, &mut scratch)[0], "{end}");
        }
        for end in 0..bits.len() {
            assert!(!decode_all(&heights, &bits[..end], &lattice, coding, root, &mut scratch)[1], "{end}");
        }
        for more in [&[0][..], &[0; 9]] {
            let (heights, bits) = ([&heights, more].concat(), [&bits, more].concat());
            assert_eq!(decode_all(&heights, &bits, &lattice, coding, root, &mut scratch), [false; 2]);
        }
    }
}

#[test]
fn changed_chunks_never_panic() {
    let mut scratch = Scratch::default();
    for (kind, root) in [(0, false), (3, true), (5, false), (8, true), (11, false), (12, false)] {
        let (lattice, coding) = tile(16, kind, 2, 4);
        let (heights, bits) = check(&lattice, coding, root, &mut scratch);
        for round in 0..2000 {
            let (mut heights, mut bits) = (heights.clone(), bits.clone());
            for change in 0..=round % 3 {
                let at = |length: usize| hash(round as u64, change, 1) as usize % length;
                let early = if round % 2 == 0 { heights.len() } else { 40.min(heights.len()) };
                let (in_heights, in_bits) = (at(early), at(bits.len()));
                heights[in_heights] ^= hash(round as u64, change, 2) as u8;
                bits[in_bits] ^= hash(round as u64, change, 3) as u8;
            }
            decode_all(&heights, &bits, &lattice, coding, root, &mut scratch);
        }
    }
}

#[test]
fn sound_frames_of_unsound_content_never_panic() {
    let mut scratch = Scratch::default();
    let (lattice, coding) = tile(16, 0, 2, 4);
    for round in 0..2000_u64 {
        let k = [0, 1, 7, 24][round as usize % 4];
        let count = 17 * 17 - 81;
        let mut plane: Vec<u8> = (0..count + round as usize % 600).map(|i| hash(round, i, 0) as u8).collect();
        if round % 3 == 0 {
            plane[..count].fill(1);
        }
        plane
            .iter_mut()
            .skip(round as usize % count)
            .for_each(|byte| *byte |= if round % 5 == 0 { 0xFF } else { 0x80 });
        let mut frame = Vec::new();
        super::frame::compress(&plane, &mut frame).unwrap();
        let mut chunk = vec![round as u8 % 2, k, 0, 0];
        chunk.extend_from_slice(&(frame.len() as u32).to_le_bytes());
        chunk.extend_from_slice(&[0; 4]);
        chunk.extend_from_slice(&frame);
        chunk.resize(chunk.len() + (count * usize::from(k)).div_ceil(8), 0xFF);
        decode_all(&chunk, &[], &lattice, coding, false, &mut scratch);
    }
}

#[test]
fn unknown_heads_are_refused() {
    let mut scratch = Scratch::default();
    let (lattice, coding) = tile(16, 0, 0, 4);
    let (heights, _) = check(&lattice, coding, false, &mut scratch);
    for (at, value) in
        [(0, 2), (0, 0x80), (1, 25), (2, 1), (2, 13), (3, 0x88), (3, 0x0F), (8, 1), (4, heights[4] + 1)]
    {
        let mut changed = heights.clone();
        changed[at] = value;
        assert!(!decode_all(&changed, &[], &lattice, coding, false, &mut scratch)[0], "byte {at} = {value}");
    }
}

#[test]
fn one_kind_of_samples_needs_no_mask() {
    let mut scratch = Scratch::default();
    let (lattice, coding) = tile(16, 0, 0, 4);
    let mut decoded = blank(&lattice, coding, true);
    let mut decode = |has_valid, has_void, chunk: &[u8]| {
        mask::decode(chunk, mask::Occupancy { has_valid, has_void }, &mut decoded, true, &mut scratch)
    };
    assert!(decode(true, false, &[]).is_ok());
    assert!(decode(false, true, &[]).is_ok());
    assert!(decode(false, false, &[]).is_err());
    assert!(decode(true, true, &[]).is_err());
    assert!(decode(true, false, &[0]).is_err());
}

/// Chunks of version 1: a 5 x 5 root with a void sample and a filled one. Whatever a later encoder
/// writes, these must be read as they are now.
#[test]
fn golden_chunks_of_version_1() {
    const HEIGHTS: [u8; 58] = [
        0x01, 0x00, 0x00, 0xD7, 0x2E, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, // head
        0x28, 0xB5, 0x2F, 0xFD, 0x20, 0x1C, 0x68, 0x00, 0x00, // frame of 28 bytes, first block
        0x00, 0x20, 0xFF, 0xFF, 0xCF, 0x07, 0x07, 0xC7, 0xC7, 0x00, 0x05, 0x05,
        0x05, // corners, stage 1, C
        0x30, 0x00, 0x00, 0x01, 0x01, 0x08, 0x08, 0x01, 0x01, // block of H
        0x30, 0x00, 0x00, 0x19, 0x1D, 0x19, 0x19, 0x00, 0x19, // block of V
        0x19, 0x00, 0x00, 0x81, 0x04, 0x61, // block of the escapes: 513 and 97
    ];
    const MASK: [u8; 13] = [0x28, 0xB5, 0x2F, 0xFD, 0x20, 0x04, 0x21, 0x00, 0x00, 0x00, 0x02, 0x10, 0x00];
    let coding = Coding::Integer { scale: 1.0, offset: 0.0 };
    let mut lattice = Lattice::new(4, coding);
    lattice.state.fill(VALID);
    lattice.code = (0..25).map(|at| at * at).collect();
    lattice.state[6] = VOID;
    lattice.state[7] = FILLED;
    let mut scratch = Scratch::default();
    let (heights, bits) = check(&lattice, coding, true, &mut scratch);
    // Same library, same bytes; a new zstd may compress in another way.
    assert_eq!(heights[..4], HEIGHTS[..4]);
    assert!(heights.len() <= HEIGHTS.len() + 8 && bits.len() <= MASK.len() + 8);

    let mut decoded = blank(&lattice, coding, true);
    let occupancy = mask::Occupancy { has_valid: true, has_void: true };
    mask::decode(&MASK, occupancy, &mut decoded, true, &mut scratch).unwrap();
    height::decode(&HEIGHTS, &mut decoded, coding, true, &mut scratch).unwrap();
    // The void sample: lower median of 0, 1, 4, 25, 100, 121, 144 around it, without the filled
    // one.
    lattice.code[6] = 25;
    lattice.state[7] = VOID;
    assert_eq!(decoded.code, lattice.code);
    lattice.state[6] = VOID;
    assert_eq!(decoded.state, lattice.state);
}

#[test]
fn tables_come_back_and_damaged_ones_do_not() {
    for (patches, steps) in [(1, 1), (4, 6), (16, 5), (64, 3)] {
        let count: usize = patches * patches;
        let mut original = table::ErrorTable { patches, steps, ..Default::default() };
        original.drawable = (0..count).map(|at| !hash(1, at, 0).is_multiple_of(3)).collect();
        for at in 0..count * steps {
            let before = |plane: &[u16]| if at < count { 0 } else { plane[at - count] };
            let more = |seed| (hash(seed, at, 1) % 9000) as u16;
            original.vertical.push(before(&original.vertical) + more(1));
            original.horizontal.push(before(&original.horizontal) + more(2));
        }
        let mut chunk = Vec::new();
        table::encode(&original, &mut chunk).unwrap();
        assert_eq!(table::decode(&chunk, patches, steps).unwrap(), original);
        assert!(table::decode(&chunk, patches, steps + 1).is_err());
        assert!(table::decode(&chunk, 2 * patches, steps).is_err());
        for end in 0..chunk.len().min(500) {
            assert!(table::decode(&chunk[..end], patches, steps).is_err());
        }
        for round in 0..1000 {
            let mut changed = chunk.clone();
            let at = hash(3, round, 0) as usize % chunk.len();
            changed[at] ^= hash(4, round, 0) as u8;
            let _ = table::decode(&changed, patches, steps);
        }
    }
}

#[test]
fn tables_must_be_monotone_and_whole() {
    let table = |vertical: Vec<u16>| table::ErrorTable {
        patches: 1,
        steps: 2,
        drawable: vec![true],
        vertical,
        horizontal: vec![0, 0xFF00],
    };
    let encode = |vertical| table::encode(&table(vertical), &mut Vec::new());
    assert!(encode(vec![5, 6]).is_ok());
    assert!(encode(vec![6, 5]).is_err());
    assert!(encode(vec![6]).is_err());
    assert!(encode(vec![0, 0xFF01]).is_err());
    let mut chunk = Vec::new();
    super::frame::compress(&[1, 0, 2, 0, 0xFF, 0, 0, 0, 0], &mut chunk).unwrap();
    assert!(table::decode(&chunk, 1, 2).is_err(), "0xFF02 is more than infinity");
    chunk.clear();
    super::frame::compress(&[2, 0, 0, 0, 0, 0, 0, 0, 0], &mut chunk).unwrap();
    assert!(table::decode(&chunk, 1, 2).is_err(), "an unused bit is set");
}
