//! Makes large, realistic terrain as a GeoTIFF, to try the builder on rasters of any size.
//!
//! ```text
//! cargo run --release --example synth -- 16385 out.tif [--height N] [--type int16|float32]
//!     [--sea] [--voids]
//!                                        [--seed N] [--compress none|deflate|zstd] [--force]
//! ```
//!
//! Samples stand 30 m apart in EPSG:32632. Every height is a function of its column, row and the
//! seed alone, so that rows are made in parallel and written as they come: memory holds some of
//! them, and the bytes do not depend on the number of threads. A larger raster with the same seed
//! goes on where a smaller one ends.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use rayon::prelude::*;
use relevo::geo::{Crs, CrsKind, Geo};
use relevo::geotiff_write::{Compression, GeotiffSpec, GeotiffWriter};
use relevo::sample::SampleType;
use relevo::source::Samples;

const USAGE: &str = "usage: synth WIDTH OUT.tif [--height N] [--type int16|float32] [--sea] [--voids] [--seed N] \
                     [--compress none|deflate|zstd] [--force]";
/// Metres between samples.
const SPACING: f64 = 30.0;
/// The value of a void.
const NODATA: f32 = -32768.0;
/// Samples made before they are handed to the writer.
const BATCH: usize = 4 << 20;

/// What was typed.
#[derive(Debug)]
struct Args {
    width: u32,
    height: u32,
    out: PathBuf,
    sample_type: SampleType,
    sea: bool,
    voids: bool,
    seed: u32,
    compression: Compression,
    force: bool,
}

fn main() -> ExitCode {
    let made =
        parse(std::env::args().skip(1)).and_then(|args| make(&args).map_err(|error| error.to_string()));
    match made {
        Ok(summary) => {
            println!("{summary}");
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("synth: {message}");
            ExitCode::from(2)
        }
    }
}

fn parse(mut typed: impl Iterator<Item = String>) -> Result<Args, String> {
    let (mut places, mut height) = (Vec::new(), None);
    let mut args = Args {
        width: 0,
        height: 0,
        out: PathBuf::new(),
        sample_type: SampleType::Int16,
        sea: false,
        voids: false,
        seed: 1,
        compression: Compression::Deflate,
        force: false,
    };
    while let Some(word) = typed.next() {
        let mut value = || typed.next().ok_or_else(|| format!("{word} needs a value"));
        match word.as_str() {
            "--height" => height = Some(number(&value()?)?),
            "--seed" => args.seed = number(&value()?)?,
            "--type" => {
                args.sample_type = match value()?.as_str() {
                    "int16" => SampleType::Int16,
                    "float32" => SampleType::Float32,
                    other => return Err(format!("--type is int16 or float32, not {other}")),
                }
            }
            "--compress" => {
                args.compression = match value()?.as_str() {
                    "none" => Compression::None,
                    "deflate" => Compression::Deflate,
                    "zstd" => Compression::Zstd,
                    other => return Err(format!("--compress is none, deflate or zstd, not {other}")),
                }
            }
            "--sea" => args.sea = true,
            "--voids" => args.voids = true,
            "--force" => args.force = true,
            other if other.starts_with('-') => return Err(format!("unknown option {other}\n{USAGE}")),
            _ => places.push(word),
        }
    }
    let [width, out] = places.as_slice() else { return Err(USAGE.to_owned()) };
    args.width = number(width)?;
    args.height = height.unwrap_or(args.width);
    args.out = PathBuf::from(out);
    Ok(args)
}

fn number(text: &str) -> Result<u32, String> {
    text.parse().map_err(|_| format!("{text} is not a whole number\n{USAGE}"))
}

/// Makes the file and says what it is.
fn make(args: &Args) -> relevo::Result<String> {
    let start = Instant::now();
    let geo = Geo {
        transform: Some([300_000.0, SPACING, 0.0, 5_400_000.0, 0.0, -SPACING]),
        crs: Crs { kind: CrsKind::Projected, epsg: Some(32632), ..Crs::default() },
        ..Geo::default()
    };
    let spec = GeotiffSpec {
        nodata: args.voids.then_some(f64::from(NODATA)),
        unit: "m",
        compression: args.compression,
        force: args.force,
        ..GeotiffSpec::new(args.width, args.height, args.sample_type, &geo)
    };
    let mut writer = GeotiffWriter::create(&args.out, &spec)?;
    let terrain = Terrain { seed: args.seed, sea: args.sea, voids: args.voids };
    let width = args.width as usize;
    let rows_at_once = (BATCH / width).max(1) as u32;
    let mut facts = Facts::default();
    for top in (0..args.height).step_by(rows_at_once as usize) {
        let rows = rows_at_once.min(args.height - top);
        let mut heights = vec![0.0_f32; width * rows as usize];
        heights.par_chunks_exact_mut(width).zip(top..top + rows).for_each(|(row, y)| {
            terrain.row(y, row);
        });
        facts.add(&heights);
        writer.write_rows(&if args.sample_type.is_float() {
            Samples::Float32(heights)
        } else {
            Samples::Int16(heights.par_iter().map(|z| z.round() as i16).collect())
        })?;
    }
    let bytes = writer.finish()?;
    let seconds = start.elapsed().as_secs_f64();
    let samples = f64::from(args.width) * f64::from(args.height);
    Ok(format!(
        "{}: {} x {} {}, {:.0} to {:.0} m, {:.2} % void, seed {}, {:.1} MB ({:.2} bits a sample), {seconds:.1} s",
        args.out.display(),
        args.width,
        args.height,
        args.sample_type.gdal_name(),
        facts.lowest,
        facts.highest,
        100.0 * facts.voids as f64 / samples,
        args.seed,
        bytes as f64 / 1e6,
        8.0 * bytes as f64 / samples,
    ))
}

/// What is known of the heights made so far.
struct Facts {
    lowest: f32,
    highest: f32,
    voids: u64,
}

impl Default for Facts {
    fn default() -> Self {
        Self { lowest: f32::INFINITY, highest: f32::NEG_INFINITY, voids: 0 }
    }
}

impl Facts {
    fn add(&mut self, heights: &[f32]) {
        for &z in heights {
            if z == NODATA {
                self.voids += 1;
            } else {
                self.lowest = self.lowest.min(z);
                self.highest = self.highest.max(z);
            }
        }
    }
}

/// Samples in a row that share what changes slowly, interpolated between its ends.
const STRETCH: u32 = 8;

/// The landscape: mountain ranges cut by valleys, hills, plains, a sea, and a radar's voids.
struct Terrain {
    seed: u32,
    sea: bool,
    voids: bool,
}

/// Noises with wavelengths of kilometres at one place.
#[derive(Clone, Copy)]
struct Slow {
    /// By how many kilometres the plane is bent, so that nothing follows the axes of the noise:
    /// valleys meander.
    bend: [f64; 2],
    /// Plains below 0, mountains above.
    region: f32,
    /// Of the plains.
    swell: f32,
    /// Where voids are likely.
    patch: f32,
}

impl Slow {
    fn between(&self, other: &Self, part: f32) -> Self {
        let mix = |a: f32, b: f32| a + (b - a) * part;
        let bend = |i: usize| self.bend[i] + (other.bend[i] - self.bend[i]) * f64::from(part);
        Self {
            bend: [bend(0), bend(1)],
            region: mix(self.region, other.region),
            swell: mix(self.swell, other.swell),
            patch: mix(self.patch, other.patch),
        }
    }
}

/// Kilometres of a sample from the north-west corner.
fn kilometres(index: u32) -> f64 {
    f64::from(index) * (SPACING / 1000.0)
}

impl Terrain {
    /// Heights of a row from column 0 on, in metres, or [`NODATA`].
    fn row(&self, row: u32, heights: &mut [f32]) {
        let y = kilometres(row);
        let mut end = self.slow(0.0, y);
        for (stretch, part) in (0..).zip(heights.chunks_mut(STRETCH as usize)) {
            let first = stretch * STRETCH;
            let begin = end;
            end = self.slow(kilometres(first) + kilometres(STRETCH), y);
            for (i, z) in (0..STRETCH).zip(part) {
                let slow = begin.between(&end, i as f32 / STRETCH as f32);
                let column = first + i;
                *z = self.height(column, row, &slow);
                if self.voids && self.is_void(column, row, &slow) {
                    *z = NODATA;
                }
            }
        }
    }

    fn slow(&self, x: f64, y: f64) -> Slow {
        let bend = [1, 2].map(|kind| self.noise(x / 31.0, y / 31.0, kind).value);
        let [bx, by] = bend.map(|bend| 9.0 * f64::from(bend));
        let region = self.noise((x + bx) / 83.0 + 0.37, (y + by) / 83.0 + 0.71, 3).value;
        Slow {
            bend: [bx, by],
            region: region + 0.5 * bend[0],
            swell: self.noise(x / 5.3, y / 5.3, 40).value,
            patch: self.noise(x / 7.0, y / 7.0, 50).value,
        }
    }

    /// Height in metres.
    fn height(&self, column: u32, row: u32, slow: &Slow) -> f32 {
        let (x, y) = (kilometres(column) + slow.bend[0], kilometres(row) + slow.bend[1]);
        let mountain = smooth_step(-0.22, 0.55, slow.region);
        let relief = 60.0 + 300.0 * mountain + 4600.0 * mountain * mountain;
        let field = self.noise(x / 0.41, y / 0.41, 41).value * (0.5 + slow.swell.abs());
        let plain = 26.0 * slow.swell + 4.0 * field;
        let land =
            240.0 + 420.0 * slow.region + relief * self.eroded(x, y, mountain) + plain * (1.0 - mountain);
        // Grain: trees, boulders, and the noise of the instrument.
        let grain = (self.hash(i64::from(column), i64::from(row), 60) >> 8) as f32 / (1 << 24) as f32 - 0.5;
        let z = land + grain * (1.0 + 4.0 * mountain);
        if self.sea { (z - 270.0).max(0.0) } else { z }
    }

    /// Mountains, about -0.3 to 0.6. Ridges give the main crests a direction; octaves that fade
    /// where those before them are steep leave smooth slopes and rough crests and floors, as
    /// erosion does.
    fn eroded(&self, x: f64, y: f64, mountain: f32) -> f32 {
        const TURN: (f64, f64) = (0.8 * 2.03, 0.6 * 2.03);
        let (mut px, mut py) = (x / 13.0, y / 13.0);
        let (mut sum, mut amplitude) = (0.0, 0.5);
        let (mut slope_x, mut slope_y) = (0.0_f32, 0.0_f32);
        // From 13 km down to 90 m, three samples.
        for octave in 0..8 {
            let noise = self.noise(px, py, 10 + octave);
            slope_x += noise.slope_x;
            slope_y += noise.slope_y;
            // The first octaves are ridged, folded at zero: crests, and valleys between them. Later
            // ones fade on slopes.
            sum += amplitude
                * if octave < 3 {
                    0.42 - 1.3 * noise.value.abs()
                } else {
                    1.3 * noise.value / (1.0 + 0.4 * (slope_x * slope_x + slope_y * slope_y))
                };
            // Plains are smooth: their small octaves fade faster.
            amplitude *= 0.40 + 0.10 * mountain;
            (px, py) = (TURN.0 * px - TURN.1 * py, TURN.1 * px + TURN.0 * py);
        }
        1.2 * sum
    }

    /// Where a radar saw nothing: patches on steep ground, and thin streaks along the flight path.
    fn is_void(&self, column: u32, row: u32, slow: &Slow) -> bool {
        let (x, y) = (kilometres(column), kilometres(row));
        if slow.patch + 0.8 * slow.region > 0.15 {
            let shape = self.noise(x / 0.9, y / 0.9, 51).value + 0.5 * self.noise(x / 0.3, y / 0.3, 52).value;
            if shape > 0.5 {
                return true;
            }
        }
        // A streak: one of few bands along the path, for some of its length, 1 to 3 samples wide.
        let along = f64::from(row) * 0.98 + f64::from(column) * 0.2;
        let across = f64::from(column) * 0.98 - f64::from(row) * 0.2;
        let (band, piece) = ((across / 61.0).floor(), (along / 700.0).floor());
        let dice = self.hash(band as i64, piece as i64, 53);
        let wide = f64::from(1 + dice % 3);
        let (inside, far) = (across - 61.0 * band - 20.0, along - 700.0 * piece);
        dice >> 8 < 1 << 20 && (0.0..wide).contains(&inside) && far < 100.0 + f64::from(dice % 500)
    }

    /// Gradient noise, about -0.7 to 0.7, with its slope. `kind` tells noises of one seed apart.
    #[inline]
    fn noise(&self, x: f64, y: f64, kind: u32) -> Noise {
        // Truncation of a number made positive is floor, and several times as fast without SSE 4.1.
        const POSITIVE: i64 = 1 << 30;
        let floor = |v: f64| (v + POSITIVE as f64) as i64 - POSITIVE;
        let (cx, cy) = (floor(x), floor(y));
        let (fx, fy) = ((x - cx as f64) as f32, (y - cy as f64) as f32);
        let gradient = |dx: i64, dy: i64| {
            let hash = self.hash(cx + dx, cy + dy, kind);
            let part = |bits: u32| (bits & 0xffff) as f32 / 32768.0 - 1.0;
            (part(hash), part(hash >> 16))
        };
        let [a, b, c, d] = [gradient(0, 0), gradient(1, 0), gradient(0, 1), gradient(1, 1)];
        let dot = |g: (f32, f32), dx: f32, dy: f32| g.0 * (fx - dx) + g.1 * (fy - dy);
        let [va, vb, vc, vd] = [dot(a, 0.0, 0.0), dot(b, 1.0, 0.0), dot(c, 0.0, 1.0), dot(d, 1.0, 1.0)];
        let fade = |t: f32| (t * t * t * (t * (t * 6.0 - 15.0) + 10.0), 30.0 * t * t * (t * (t - 2.0) + 1.0));
        let ((u, du), (v, dv)) = (fade(fx), fade(fy));
        let twist = va - vb - vc + vd;
        let blend = |a: f32, b: f32, c: f32, d: f32| a + u * (b - a) + v * (c - a) + u * v * (a - b - c + d);
        Noise {
            value: blend(va, vb, vc, vd),
            slope_x: blend(a.0, b.0, c.0, d.0) + du * (v * twist + vb - va),
            slope_y: blend(a.1, b.1, c.1, d.1) + dv * (u * twist + vc - va),
        }
    }

    /// 32 well-mixed bits of a lattice point.
    #[inline]
    fn hash(&self, x: i64, y: i64, kind: u32) -> u32 {
        let mut h = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77);
        h ^= self.seed.wrapping_mul(0xc2b2_ae3d).wrapping_add(kind.wrapping_mul(0x27d4_eb2f));
        h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
        h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
        h ^ (h >> 16)
    }
}

/// Noise at a point, and how fast it changes for one cell.
struct Noise {
    value: f32,
    slope_x: f32,
    slope_y: f32,
}

/// 0 below `low`, 1 above `high`, smooth between.
fn smooth_step(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
