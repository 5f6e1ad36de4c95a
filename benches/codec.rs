//! Speed of one thread on one tile of 257 x 257 samples, counted in newborn samples.

#![allow(missing_docs, clippy::unwrap_used, reason = "macros of criterion; a bench stops at a defect")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use relevo::codec::{Scratch, height, mask};
use relevo::sample::{Coding, Lattice, VALID, VOID, code_from_f32, code_from_f64};

/// Intervals on a side.
const N: usize = 256;

/// Rough hills of about 3 bits a sample, as SRTM has them; `void` cuts a lake out.
fn terrain(coding: Coding, void: bool, step: f64) -> Lattice {
    let mut lattice = Lattice::new(N, coding);
    let mut random = 1_u32;
    for y in 0..=N {
        for x in 0..=N {
            let at = lattice.at(x, y);
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = f64::from(random >> 16) / 65536.0 + f64::from(random >> 8 & 255) / 256.0;
            let (u, v) = (x as f64, y as f64);
            let hills = 400.0 * (u / 70.0).sin() * (v / 50.0).cos() + 40.0 * ((u + v) / 8.0).sin();
            let height = ((1500.0 + hills + 3.0 * noise) / step).round() * step;
            (lattice.code[at], _) = match coding {
                Coding::Integer { .. } => (height as i32, 0),
                Coding::Float32 => (code_from_f32(height as f32), 0),
                Coding::Float64 => code_from_f64(height),
            };
            if coding.has_low() {
                lattice.low[at] = code_from_f64(height).1;
            }
            let lake = (u - 128.0).hypot(v - 128.0) < 60.0;
            lattice.state[at] = if void && lake { VOID } else { VALID };
        }
    }
    lattice
}

fn tiles(criterion: &mut Criterion) {
    let int16 = Coding::Integer { scale: 1.0, offset: 0.0 };
    let cases = [
        ("int16", int16, false, 1.0),
        ("int16 with a lake", int16, true, 1.0),
        ("float32", Coding::Float32, false, 1e-4),
        ("float32 in cm", Coding::Float32, false, 0.01),
        ("float64", Coding::Float64, false, 1e-9),
    ];
    let samples = (N + 1) * (N + 1) - (N / 2 + 1) * (N / 2 + 1);
    for (name, coding, void, step) in cases {
        let lattice = terrain(coding, void, step);
        let mut scratch = Scratch::default();
        let mut group = criterion.benchmark_group(name);
        group.throughput(Throughput::Elements(samples as u64));
        let (mut heights, mut bits) = (Vec::new(), Vec::new());
        let mut encode = || {
            heights.clear();
            bits.clear();
            height::encode((&lattice, height::Fills::Any), coding, false, &mut scratch, &mut heights)
                .unwrap();
            mask::encode(&lattice, false, &mut scratch, &mut bits).unwrap()
        };
        group.bench_function("encode", |bencher| bencher.iter(&mut encode));
        let occupancy = encode();
        let mut decoded = lattice.clone();
        group.bench_function("decode", |bencher| {
            bencher.iter(|| {
                mask::decode(&bits, occupancy, &mut decoded, false, &mut scratch).unwrap();
                height::decode(&heights, &mut decoded, coding, false, &mut scratch).unwrap();
            });
        });
        group.finish();
    }
}

criterion_group!(benches, tiles);
criterion_main!(benches);
