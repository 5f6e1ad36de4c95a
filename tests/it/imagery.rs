//! The imagery layer from texels on: writer, reader, `relevo add`, exports, damage. Tiles are cut
//! from a picture that is known as a whole.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use assert_cmd::Command;
use relevo::codec::imagery::{self, Codec, ImageryChunks};
use relevo::container::metadata::ImageryNote;
use relevo::container::{ImageryHeader, Reader};
use relevo::geotiff_write::{GeotiffSpec, GeotiffWriter};
use relevo::limits::Limits;
use relevo::pipeline::imagery::{Imagery, LayerOptions};
use relevo::pipeline::{self, BuildOptions, Silent, column_passes, memory};
use relevo::sample::{SampleType, VALID};
use relevo::source::Samples;
use relevo::source::picture::{PictureOptions, open_all};
use relevo::texel::{Colour, Texels};
use relevo::verify::{VerifyOptions, verify};
use relevo::work_folder::{Earlier, WorkFolder};
use relevo::writer::amend::put_imagery;
use relevo::writer::{ImagerySections, ImageryWriter};
use relevo::{Error, TileId, source};
use sha2::{Digest, Sha256};
use tempfile::TempDir;

use crate::support::progress::While;

const TILE: usize = 64;
const GUTTER: usize = 2;
const SIDE: usize = TILE + 2 * GUTTER;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem").join(name)
}

/// A file of heights.
fn heights(path: &Path) {
    let source = source::open(&fixture("rmnp_dem_uint16.tif"), &Limits::default()).expect("source");
    let options = BuildOptions { tile: 64, patch: 16, force: true, ..BuildOptions::default() };
    pipeline::build(&*source, path, &options, &Silent).expect("build");
}

/// A picture over the whole root square at any level; its south-east corner is transparent.
struct World {
    kind: Colour,
    clear: bool,
    leaf: u8,
}

impl World {
    fn colour(&self, level: u8, x: i64, y: i64) -> Vec<u8> {
        let side = (TILE << level) as i64;
        let (x, y) = (x.clamp(0, side - 1), y.clamp(0, side - 1));
        let (u, v) = (x as f64 / side as f64, y as f64 / side as f64);
        let wave = |f: f64, g: f64| (127.0 + 60.0 * (f * u).sin() + 60.0 * (g * v).cos()) as u8;
        let all = [wave(21.0, 9.0), wave(3.0, 17.0), wave(9.0, 5.0)];
        all[..self.kind.channels()].to_vec()
    }

    /// Wholly transparent beyond a diagonal, which a column of the finest tiles lies behind.
    fn alpha(&self, level: u8, x: i64, y: i64) -> u8 {
        let side = (TILE << level) as f64;
        let gone = self.clear && (x as f64 + y as f64) / side > 1.3;
        if gone { 0 } else { 255 }
    }

    fn tile(&self, id: TileId) -> Texels {
        let (mut colour, mut alpha) = (Vec::new(), Vec::new());
        for row in 0..SIDE as i64 {
            for column in 0..SIDE as i64 {
                let x = i64::from(id.x) * TILE as i64 + column - GUTTER as i64;
                let y = i64::from(id.y) * TILE as i64 + row - GUTTER as i64;
                colour.extend(self.colour(id.level, x, y));
                alpha.push(self.alpha(id.level, x, y));
            }
        }
        let alpha = alpha.iter().any(|&a| a != 255).then_some(alpha);
        Texels { side: SIDE, kind: self.kind, colour, alpha }
    }

    fn exists(&self, id: TileId) -> bool {
        let corner = |along: u32| i64::from(along) * TILE as i64;
        id.level <= self.leaf && self.alpha(id.level, corner(id.x), corner(id.y)) > 0
    }

    fn tiles(&self) -> Vec<(TileId, u8)> {
        let mut tiles = Vec::new();
        for level in 0..=self.leaf {
            for place in 0..1_u32 << (2 * level) {
                let id = TileId::new(level, place >> level, place & ((1 << level) - 1));
                if self.exists(id) {
                    let children =
                        (0..4).filter(|&q| self.exists(id.child(q))).fold(0, |bits, q| bits | 1 << q);
                    tiles.push((id, children));
                }
            }
        }
        tiles
    }

    fn header(&self, codec: Codec) -> ImageryHeader {
        let quality = if codec == Codec::Jpeg { 85 } else { 0 };
        let (tile, gutter) = (TILE as u32, GUTTER as u8);
        ImageryHeader { tile, gutter, codec, quality, colour: self.kind, alpha: false, leaf: 0, tiles: 1 }
    }

    /// The layer, from tiles that come in an order of their own from several threads.
    fn layer(&self, codec: Codec, folder: &Path, seed: usize) -> ImagerySections {
        let writer = ImageryWriter::create(folder, self.header(codec)).expect("writer");
        let mut tiles = self.tiles();
        tiles.sort_by_key(|(id, _)| {
            (id.hilbert() as usize * 31 + seed * 17 + usize::from(id.level) * 7) % 101
        });
        std::thread::scope(|scope| {
            for part in tiles.chunks(tiles.len().div_ceil(1 + seed % 3)) {
                let writer = &writer;
                scope.spawn(move || {
                    for &(id, children) in part {
                        let chunks = imagery::encode(&writer.form(), &self.tile(id)).expect("encode");
                        writer.append(id, children, &chunks).expect("append");
                    }
                });
            }
        });
        writer.finish(&Silent).expect("finish")
    }
}

fn note() -> ImageryNote {
    ImageryNote { tool: "test".into(), pictures: 1, ..ImageryNote::default() }
}

/// Puts a layer into a file.
fn put(path: &Path, world: &World, codec: Codec, seed: usize) {
    let mut work = WorkFolder::take(path, true, Earlier::Refuse).expect("work folder");
    let layer = world.layer(codec, work.folder(), seed);
    put_imagery(&mut work, &layer, &note(), &|_| Ok(()), &Silent).expect("put");
}

fn section(path: &Path, kind: u32) -> Option<Vec<u8>> {
    let bytes = fs::read(path).expect("file");
    let reader = Reader::open(path).expect("open");
    let section = reader.sections().iter().find(|section| section.kind == kind)?;
    Some(bytes[section.offset as usize..section.end() as usize].to_vec())
}

fn begin() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("a.rlv");
    heights(&path);
    (folder, path)
}

fn psnr(a: &[u8], b: &[u8]) -> f64 {
    let square = |(a, b): (&u8, &u8)| (f64::from(*a) - f64::from(*b)).powi(2);
    let error = a.iter().zip(b).map(square).sum::<f64>() / a.len() as f64;
    10.0 * (255.0_f64.powi(2) / error.max(1e-9)).log10()
}

#[test]
fn a_layer_comes_back_and_the_heights_stay() {
    let (_folder, path) = begin();
    let before: Vec<_> = [2, 3, 4, 5].map(|kind| section(&path, kind)).into_iter().collect();
    for (codec, kind) in
        Codec::ALL.into_iter().flat_map(|codec| [(codec, Colour::Rgb), (codec, Colour::Grey)])
    {
        let world = World { kind, clear: codec != Codec::Webp, leaf: 4 };
        put(&path, &world, codec, 1);
        let reader = Reader::open(&path).expect("open");
        let layer = reader.imagery().expect("layer");
        let tiles = world.tiles();
        let header = layer.header();
        assert_eq!((header.codec, header.colour, header.leaf), (codec, kind, 4));
        assert_eq!((header.tiles, header.alpha), (tiles.len() as u64, world.clear));
        assert_eq!(reader.metadata().imagery, Some(note()));
        for &(id, children) in &tiles {
            assert_eq!(layer.entry(id).expect("index").expect("tile").children, children);
            let (texels, expected) = (layer.read_tile(id).expect("tile"), world.tile(id));
            assert!(texels.alpha == expected.alpha, "{codec} {id}");
            if codec.is_lossless() {
                assert!(texels.colour == expected.colour, "{codec} {id}");
            } else {
                let db = psnr(&texels.colour, &expected.colour);
                assert!(db > 30.0, "{codec} {id}: {db} dB");
            }
            if let Some(bytes) = codec.block_bytes() {
                assert_eq!(layer.read_blocks(id).expect("blocks").len(), (SIDE / 4).pow(2) * bytes);
            }
        }
        let level: Vec<_> = tiles.iter().map(|tile| tile.0).filter(|id| id.level == 3).collect();
        let mut listed = layer.tiles(3).expect("tiles");
        listed.sort_unstable();
        assert_eq!(listed, {
            let mut level = level;
            level.sort_unstable();
            level
        });
        assert_eq!(layer.entry(TileId::new(5, 0, 0)).expect("index"), None);
        let report = verify(&reader, None, &VerifyOptions::default(), &Silent).expect("verify");
        assert!(report.is_good(), "{codec}: {:?}", report.checks);
        assert_eq!(report.check("imagery tiles").map(|check| check.looked_at), Some(tiles.len() as u64));
        let after: Vec<_> = [2, 3, 4, 5].map(|kind| section(&path, kind)).into_iter().collect();
        assert!(before == after, "{codec}: the heights changed");
    }
    assert!(!path.with_extension("rlv.work").exists());
}

#[test]
fn the_same_tiles_in_any_order_give_the_same_bytes() {
    let (_folder, path) = begin();
    for codec in [Codec::Jpeg, Codec::Png] {
        let mut first = None;
        for seed in 0..4 {
            put(&path, &World { kind: Colour::Rgb, clear: true, leaf: 3 }, codec, seed);
            let bytes = fs::read(&path).expect("file");
            assert!(*first.get_or_insert_with(|| bytes.clone()) == bytes, "{codec}, order {seed}");
        }
    }
}

/// Bilinear filtering at a place in texels, whose centres stand at halves.
fn bilinear(x: f64, y: f64, texel: impl Fn(i64, i64) -> Vec<u8>) -> Vec<f64> {
    let (x, y) = (x - 0.5, y - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let (u, v) = (x - left, y - top);
    let at = |dx: i64, dy: i64| texel(left as i64 + dx, top as i64 + dy);
    let corners = [
        (at(0, 0), (1.0 - u) * (1.0 - v)),
        (at(1, 0), u * (1.0 - v)),
        (at(0, 1), (1.0 - u) * v),
        (at(1, 1), u * v),
    ];
    let channels = corners[0].0.len();
    (0..channels).map(|c| corners.iter().map(|(texel, weight)| f64::from(texel[c]) * weight).sum()).collect()
}

#[test]
fn neighbours_filtered_each_by_itself_are_one_picture() {
    let (_folder, path) = begin();
    let world = World { kind: Colour::Rgb, clear: false, leaf: 3 };
    for (codec, tolerance) in [(Codec::Png, 1e-9), (Codec::Webp, 1e-9), (Codec::Jpeg, 10.0)] {
        put(&path, &world, codec, 0);
        let reader = Reader::open(&path).expect("open");
        let layer = reader.imagery().expect("layer");
        let (west, east) = (TileId::new(3, 3, 5), TileId::new(3, 4, 5));
        let tiles = [west, east].map(|id| (id, layer.read_tile(id).expect("tile")));
        let border = f64::from(east.x) * TILE as f64;
        for step in 0..200 {
            let y = f64::from(west.y) * TILE as f64 + TILE as f64 * f64::from(step) / 199.0;
            for offset in [-0.49, -0.25, 0.0, 0.1, 0.5] {
                let x = border + offset;
                let whole = bilinear(x, y, |x, y| world.colour(3, x, y));
                for (id, texels) in &tiles {
                    let local = |x: f64, tile: u32| x - f64::from(tile) * TILE as f64 + GUTTER as f64;
                    let part = bilinear(local(x, id.x), local(y, id.y), |x, y| {
                        let at = 3 * (y as usize * SIDE + x as usize);
                        texels.colour[at..at + 3].to_vec()
                    });
                    for (a, b) in whole.iter().zip(&part) {
                        assert!((a - b).abs() <= tolerance, "{codec} {id} at {x} {y}: {a} and {b}");
                    }
                }
            }
        }
    }
}

#[test]
fn tiles_that_are_no_tree_are_refused() {
    let folder = tempfile::tempdir().expect("folder");
    let world = World { kind: Colour::Grey, clear: false, leaf: 1 };
    let begin = || ImageryWriter::create(folder.path(), world.header(Codec::Png)).expect("writer");
    let chunks = imagery::encode(&begin().form(), &world.tile(TileId::ROOT)).expect("encode");
    let writer = begin();
    writer.append(TileId::ROOT, 1, &chunks).expect("append");
    assert!(writer.append(TileId::ROOT, 1, &chunks).is_err(), "twice");
    assert!(writer.append(TileId::new(1, 2, 0), 0, &chunks).is_err(), "outside");
    assert!(writer.finish(&Silent).is_err(), "a child that did not come");
    let writer = begin();
    writer.append(TileId::ROOT, 0, &chunks).expect("append");
    writer.append(TileId::ROOT.child(0), 0, &chunks).expect("append");
    assert!(writer.finish(&Silent).is_err(), "a child that is not named");
    assert!(begin().finish(&Silent).is_err(), "no root");
    let stopped = begin();
    stopped.append(TileId::ROOT, 0, &chunks).expect("append");
    assert!(matches!(stopped.finish(&While::new(|_, _| false)), Err(Error::Interrupted)));
    let odd = ImageryHeader { tile: 62, ..world.header(Codec::Png) };
    assert!(ImageryWriter::create(folder.path(), odd).is_err());
    let other = ImageryChunks { colour: vec![1], ..ImageryChunks::default() };
    let jpeg = ImageryWriter::create(folder.path(), world.header(Codec::Jpeg)).expect("writer");
    assert!(jpeg.append(TileId::ROOT, 0, &other).is_ok_and(|()| true) || jpeg.finish(&Silent).is_err());
}

#[test]
fn an_add_that_fails_leaves_the_old_file() {
    let (_folder, path) = begin();
    let world = World { kind: Colour::Rgb, clear: true, leaf: 2 };
    put(&path, &world, Codec::Png, 0);
    let before = fs::read(&path).expect("file");
    let work_path = PathBuf::from(format!("{}.work", path.display()));
    for stop_at in 0..2 {
        let mut work = WorkFolder::take(&path, true, Earlier::Refuse).expect("work folder");
        let layer = world.layer(Codec::Jpeg, work.folder(), 0);
        let calls = AtomicU32::new(0);
        let progress = While::new(|_, _| calls.fetch_add(1, Ordering::Relaxed) < stop_at);
        let stopped = put_imagery(&mut work, &layer, &note(), &|_| Ok(()), &progress);
        assert!(matches!(stopped, Err(Error::Interrupted)), "{stop_at}");
        assert!(WorkFolder::take(&path, true, Earlier::Refuse).is_err(), "two at a time");
        drop(work);
        assert!(fs::read(&path).expect("file") == before && !work_path.exists());
    }
    // Metadata that would not fit into the first 64 KiB.
    let mut work = WorkFolder::take(&path, true, Earlier::Refuse).expect("work folder");
    let layer = world.layer(Codec::Jpeg, work.folder(), 0);
    let long = ImageryNote { tool: "x".repeat(70_000), ..note() };
    assert!(matches!(put_imagery(&mut work, &layer, &long, &|_| Ok(()), &Silent), Err(Error::Limit { .. })));
    drop(work);
    assert!(fs::read(&path).expect("file") == before && !work_path.exists());
}

/// What becomes of a changed file.
fn attempt(path: &Path, bytes: &[u8]) -> relevo::Result<()> {
    fs::write(path, bytes).expect("write");
    let reader = Reader::open(path)?;
    for section in reader.sections() {
        reader.check_section(section)?;
    }
    reader
        .walk(&mut |entry| reader.read_tile(entry.id).and_then(|_| reader.read_errors(entry.id)).map(drop))?;
    let Some(layer) = reader.imagery() else { return Ok(()) };
    layer.walk(&mut |entry| layer.read_tile(entry.id).map(drop))
}

#[test]
fn every_flipped_bit_is_noticed_and_nothing_panics() {
    let (folder, path) = begin();
    put(&path, &World { kind: Colour::Rgb, clear: true, leaf: 1 }, Codec::Jpeg, 0);
    let good = fs::read(&path).expect("file");
    let changed = folder.path().join("changed.rlv");
    attempt(&changed, &good).expect("good");
    let reader = Reader::open(&path).expect("open");
    let sections: Vec<_> = reader.sections().iter().filter(|section| section.kind >= 16).copied().collect();
    assert_eq!(sections.len(), 3);
    let mut seed = 1_u64;
    let mut random = |n: u64| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (seed >> 33) % n
    };
    for _ in 0..150 {
        let section = sections[random(3) as usize];
        if section.length == 0 {
            continue;
        }
        let mut bytes = good.clone();
        bytes[(section.offset + random(section.length)) as usize] ^= 1 << random(8);
        assert!(attempt(&changed, &bytes).is_err(), "a flipped bit in {}", section.name());
    }
    // Nasty numbers in the imagery section under right checksums.
    let header = sections[0];
    for section in reader.sections() {
        assert!(section.kind != 16 || section.end() < 65_536);
    }
    let at = header.offset as usize;
    for _ in 0..400 {
        let mut bytes = good.clone();
        for _ in 0..=random(3) {
            let range = if random(2) == 0 { 24 } else { header.length };
            let place = at + random(range) as usize;
            bytes[place] = random(256) as u8;
        }
        repair(&mut bytes, at..at + header.length as usize);
        let _ = attempt(&changed, &bytes);
    }
}

/// Makes the CRC of the imagery section and those of the opening right again.
fn repair(bytes: &mut [u8], section: std::ops::Range<usize>) {
    let count = u32::from_le_bytes(bytes[20..24].try_into().expect("4 bytes")) as usize;
    let crc = crc32fast::hash(&bytes[section]);
    for entry in 0..count {
        let place = 256 + 32 * entry;
        if bytes[place] == 16 {
            bytes[place + 24..place + 28].copy_from_slice(&crc.to_le_bytes());
        }
    }
    let mut crc = crc32fast::Hasher::new();
    crc.update(&bytes[..252]);
    crc.update(&bytes[256..256 + 32 * count]);
    bytes[252..256].copy_from_slice(&crc.finalize().to_le_bytes());
}

fn export(folder: &TempDir, args: &[&str]) {
    let mut command = Command::cargo_bin("relevo").expect("binary");
    command.args(["export", "a.rlv"]).args(args).current_dir(folder.path()).assert().success();
}

fn decode_png(folder: &TempDir, name: &str) -> (png::OutputInfo, Vec<u8>) {
    let file = std::io::BufReader::new(fs::File::open(folder.path().join(name)).expect("file"));
    let mut png = png::Decoder::new(file).read_info().expect("PNG");
    let mut pixels = vec![0; png.output_buffer_size().expect("size")];
    let info = png.next_frame(&mut pixels).expect("pixels");
    (info, pixels)
}

#[test]
fn a_level_and_a_tile_of_imagery_are_exported() {
    let (folder, path) = begin();
    let world = World { kind: Colour::Rgb, clear: true, leaf: 2 };
    put(&path, &world, Codec::Png, 0);
    let reader = Reader::open(&path).expect("open");
    let header = reader.header();
    export(&folder, &["--imagery", "--level", "2", "-o", "level.png"]);
    let (info, whole) = decode_png(&folder, "level.png");
    let intervals = u64::from(header.tile()) << header.levels;
    let texels = |samples: u32| (u64::from(samples - 1) * (TILE as u64 * 4)).div_ceil(intervals) as u32;
    assert_eq!((info.width, info.height), (texels(header.width), texels(header.height)));
    for (i, pixel) in whole.chunks_exact(4).enumerate() {
        let (x, y) = (i as i64 % i64::from(info.width), i as i64 / i64::from(info.width));
        let id = TileId::new(2, (x / TILE as i64) as u32, (y / TILE as i64) as u32);
        if world.exists(id) {
            assert_eq!((&pixel[..3], pixel[3]), (&*world.colour(2, x, y), world.alpha(2, x, y)), "{x} {y}");
        }
    }
    export(&folder, &["--imagery", "--tile", "2/1/1", "-o", "tile.png"]);
    let (info, pixels) = decode_png(&folder, "tile.png");
    assert_eq!((info.width, info.height), (TILE as u32, TILE as u32));
    assert_eq!(pixels[..3], world.colour(2, TILE as i64, TILE as i64)[..]);
    // As GeoTIFFs: the same texels, at the right place.
    let open = |name: &str| {
        let (paths, options) = ([folder.path().join(name)], PictureOptions::default());
        open_all(&paths, &options, &reader.geo().crs, &Limits::default()).expect("a GeoTIFF").remove(0)
    };
    export(&folder, &["--imagery", "--level", "2", "-o", "level.tif"]);
    let level = open("level.tif");
    let read = level.read_window(0..level.info().width, 0..level.info().height).expect("pixels");
    let (colour, alpha): (Vec<_>, Vec<_>) = whole.chunks_exact(4).map(|p| (&p[..3], p[3])).unzip();
    assert!(read.colour == colour.concat() && read.alpha == Some(alpha), "the GeoTIFF is not the PNG");
    export(&folder, &["--imagery", "--tile", "2/1/1", "-o", "tile.tif"]);
    let (whole, tile) =
        (header.transform.expect("place"), open("tile.tif").info().geo.transform.expect("place"));
    let step = intervals as f64 / (TILE as f64 * 4.0);
    let west = whole[0] + (0.5 + TILE as f64 * step) * whole[1];
    let north = whole[3] + (0.5 + TILE as f64 * step) * whole[5];
    for (got, expected) in
        [(tile[0], west), (tile[1], step * whole[1]), (tile[3], north), (tile[5], step * whole[5])]
    {
        assert!((got - expected).abs() < 1e-9 * expected.abs(), "{got}, expected {expected}");
    }
}

#[test]
fn a_tile_of_heights_is_exported() {
    let (folder, path) = begin();
    let reader = Reader::open(&path).expect("open");
    export(&folder, &["--tile", "1/0/1", "-o", "heights.tif"]);
    export(&folder, &["--tile", "1/0/1", "-o", "heights.png"]);
    let exported = source::open(&folder.path().join("heights.tif"), &Limits::default()).expect("heights");
    let (columns, rows) = (exported.info().width, exported.info().height);
    let (info, greys) = decode_png(&folder, "heights.png");
    assert_eq!((info.width, info.height, info.bit_depth), (columns, rows, png::BitDepth::Sixteen));
    let tile = reader.read_tile(TileId::new(1, 0, 1)).expect("tile");
    let all = (0..rows as usize).flat_map(|row| (0..columns as usize).map(move |column| (column, row)));
    let values: Vec<_> = all
        .map(|(column, row)| tile.at(column, row))
        .map(|at| (tile.state[at] == VALID).then(|| tile.value(at, reader.header().coding)))
        .collect();
    let low = values.iter().flatten().copied().fold(f64::INFINITY, f64::min);
    let samples = exported.read_rows(0..rows).expect("samples").samples;
    for (i, value) in values.iter().enumerate() {
        let grey = u16::from_be_bytes([greys[2 * i], greys[2 * i + 1]]);
        assert_eq!(f64::from(grey), value.map_or(0.0, |value| value - low + 1.0));
        if let (Some(value), Samples::Uint16(samples)) = (value, &samples) {
            assert_eq!(f64::from(samples[i]), *value);
        }
    }
}

#[test]
fn what_is_not_there_is_an_error_of_usage() {
    let (folder, path) = begin();
    let mut wrong: Vec<Vec<&str>> = vec![vec!["export", "--imagery", "-o", "x.tif"]];
    wrong.push(vec!["export", "--tile", "9/0/0", "-o", "x.png"]);
    wrong.push(vec!["export", "--tile", "1/0", "-o", "x.png"]);
    wrong.push(vec!["add"]);
    for mut args in wrong {
        args.insert(1, path.to_str().expect("path"));
        let mut command = Command::cargo_bin("relevo").expect("binary");
        command.args(&args).current_dir(folder.path()).assert().code(2);
        assert!(!folder.path().join("x.tif").exists() && !folder.path().join("x.png").exists());
    }
}

/// What the independent reader says of the imagery: lines of tiles and of hashes, `-` for what it
/// could not decode.
#[test]
fn an_independent_reader_agrees() {
    let (_folder, path) = begin();
    let sum = |bytes: &[u8]| {
        Sha256::digest(bytes).iter().fold(String::new(), |mut hex, byte| {
            write!(hex, "{byte:02x}").expect("a string");
            hex
        })
    };
    for codec in Codec::ALL {
        for (kind, clear) in [(Colour::Grey, true), (Colour::Rgb, false)] {
            let world = World { kind, clear, leaf: 3 };
            put(&path, &world, codec, 0);
            let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/spec_reader.py");
            let output = std::process::Command::new("python3").arg(script).arg(&path).output();
            let output =
                output.expect("python3 runs: install python3 and its module zstandard, as ./test.sh does");
            let talk = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{codec}: {talk}");
            let said = String::from_utf8(output.stdout).expect("text");
            let mut lines = said.lines().filter_map(|line| line.strip_prefix("imagery "));
            let reader = Reader::open(&path).expect("open");
            let layer = reader.imagery().expect("layer");
            let (number, channels, clear) = (codec as u8, kind.channels(), u8::from(clear));
            let first = format!("{TILE} {GUTTER} {number} {channels} {clear} 3 {}", layer.header().tiles);
            assert_eq!(lines.next(), Some(&*first));
            for level in 0..=3 {
                for id in layer.tiles(level).expect("tiles") {
                    let texels = layer.read_tile(id).expect("tile");
                    let children = layer.entry(id).expect("index").expect("tile").children;
                    let line = lines.next().expect("a line");
                    let words: Vec<_> = line.split(' ').collect();
                    assert_eq!(words[..2], [&*id.to_string(), &*children.to_string()]);
                    let alpha = texels.alpha.unwrap_or_else(|| vec![255; SIDE * SIDE]);
                    if words[3] != "-" {
                        assert_eq!(words[3], sum(&alpha), "{codec} {id}");
                    }
                    // Decoders of JPEG round in their own ways.
                    if words[2] != "-" && codec != Codec::Jpeg {
                        assert_eq!(words[2], sum(&texels.colour), "{codec} {id}");
                    }
                    assert!(codec != Codec::Png || words[2] != "-", "{id}");
                }
            }
            assert_eq!(lines.next(), None);
        }
    }
}

/// A picture over the heights of [`heights`], as a GeoTIFF that this library writes.
fn picture_file(path: &Path, like: &Path, seed: u8) {
    let reader = Reader::open(like).expect("open");
    let header = reader.header();
    let mut spec = GeotiffSpec::new(header.width, header.height, SampleType::Uint8, reader.geo());
    (spec.bands, spec.force) = (3, true);
    let mut writer = GeotiffWriter::create(path, &spec).expect("create");
    let pixels =
        (0..header.height).flat_map(|y| (0..header.width).flat_map(move |x| [x as u8, y as u8, seed]));
    writer.write_rows(&Samples::Uint8(pixels.collect())).expect("rows");
    writer.finish().expect("finish");
}

#[test]
fn add_puts_and_replaces_a_layer() {
    let (folder, path) = begin();
    let picture = folder.path().join("picture.tif");
    picture_file(&picture, &path, 7);
    let before = section(&path, 5);
    let relevo = |args: &[&str]| {
        let mut command = Command::cargo_bin("relevo").expect("binary");
        let out = command.args(args).current_dir(folder.path()).assert();
        (out.get_output().status.code(), String::from_utf8_lossy(&out.get_output().stdout).into_owned())
    };
    let add = |codec: &str, jobs: &str| {
        let args =
            ["add", "a.rlv", "--imagery", "picture.tif", "--imagery-codec", codec, "--imagery-tile", "64"];
        relevo(&[&args[..], &["--jobs", jobs]].concat())
    };
    let (code, said) = add("png", "1");
    assert_eq!(code, Some(0), "{said}");
    let first = fs::read(&path).expect("file");
    assert!(section(&path, 5) == before && section(&path, 16).is_some());
    let (code, info) = relevo(&["info", "a.rlv"]);
    assert!(code == Some(0) && info.contains("picture.tif") && info.contains("RGB and alpha, png"), "{info}");
    assert_eq!(relevo(&["verify", "a.rlv"]).0, Some(0));
    assert_eq!(add("jpeg", "3").0, Some(0));
    assert!(section(&path, 5) == before);
    assert_eq!(relevo(&["verify", "a.rlv"]).0, Some(0));
    assert_eq!(add("png", "4").0, Some(0));
    assert!(
        fs::read(&path).expect("file") == first,
        "another number of threads, and what was replaced, show"
    );
    // A picture that is none: the file stays.
    fs::write(&picture, b"no picture").expect("write");
    assert_eq!(add("png", "1").0, Some(2));
    assert!(fs::read(&path).expect("file") == first);
    assert!(!folder.path().join("a.rlv.work").exists());
    assert_eq!(relevo(&["add", "none.rlv", "--imagery", "picture.tif"]).0, Some(2));
}

/// A picture with a band of alpha in degrees, or with a nodata value along a slanted edge.
fn clear_picture(path: &Path, like: &Path, alpha_band: bool) {
    let reader = Reader::open(like).expect("open");
    let (header, mut geo) = (reader.header(), reader.geo().clone());
    // A third of a pixel off the texels: edges fall between them.
    let transform = geo.transform.as_mut().expect("placed");
    transform[0] += transform[1] / 3.0;
    let mut spec = GeotiffSpec::new(header.width, header.height, SampleType::Uint8, &geo);
    (spec.bands, spec.force) = (if alpha_band { 4 } else { 3 }, true);
    spec.nodata = (!alpha_band).then_some(0.0);
    let mut writer = GeotiffWriter::create(path, &spec).expect("create");
    let mut pixels = Vec::new();
    for y in 0..header.height {
        for x in 0..header.width {
            let inside = 2 * x + y > 40;
            let colour = if inside { [x as u8 | 1, y as u8 | 1, 90] } else { [0; 3] };
            pixels.extend(colour);
            if alpha_band {
                pixels.push((x * 3 + y) as u8);
            }
        }
    }
    writer.write_rows(&Samples::Uint8(pixels)).expect("rows");
    writer.finish().expect("finish");
}

#[test]
fn transparency_survives_in_every_codec() {
    let (folder, path) = begin();
    for (alpha_band, codec) in [false, true].into_iter().flat_map(|a| Codec::ALL.map(|codec| (a, codec))) {
        let picture = folder.path().join("clear.tif");
        clear_picture(&picture, &path, alpha_band);
        let codec = codec.as_str();
        let args =
            ["add", "a.rlv", "--imagery", "clear.tif", "--imagery-codec", codec, "--imagery-tile", "64"];
        Command::cargo_bin("relevo")
            .expect("binary")
            .args(args)
            .current_dir(folder.path())
            .assert()
            .success();
        let reader = Reader::open(&path).expect("open");
        let layer = reader.imagery().expect("layer");
        let mut degrees = [0_u32; 3];
        let tiles = (0..=layer.header().leaf).flat_map(|level| layer.tiles(level).expect("tiles"));
        for id in tiles {
            for &alpha in layer.read_tile(id).expect("tile").alpha.iter().flatten() {
                degrees[usize::from(alpha > 0) + usize::from(alpha == 255)] += 1;
            }
        }
        let [clear, between, opaque] = degrees;
        assert!(clear > 0 && opaque > 0, "{codec}, {alpha_band}: {degrees:?}");
        // A lossy codec keeps degrees where the picture has them; edges that only resampling has
        // softened are cut out.
        let cut_out = !alpha_band && matches!(codec, "jpeg" | "bc1");
        assert_eq!(between == 0, cut_out, "{codec}, {alpha_band}: {degrees:?}");
    }
}

#[test]
fn a_build_with_imagery_is_a_build_and_an_add() {
    let folder = tempfile::tempdir().expect("folder");
    let dem = fixture("co_elevation_float32_lzw.tif").to_string_lossy().into_owned();
    let relevo = |args: &[&str]| {
        let mut command = Command::cargo_bin("relevo").expect("binary");
        let out = command.args(args).current_dir(folder.path()).output().expect("run");
        (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
    };
    assert_eq!(relevo(&["build", &dem, "-o", "apart.rlv"]).0, Some(0));
    picture_file(&folder.path().join("picture.tif"), &folder.path().join("apart.rlv"), 3);
    let imagery = ["--imagery", "picture.tif", "--imagery-tile", "64"];
    assert_eq!(relevo(&[&["add", "apart.rlv"][..], &imagery].concat()).0, Some(0));
    let apart = fs::read(folder.path().join("apart.rlv")).expect("file");
    let build = [&["build", &dem, "-o", "one.rlv", "--force"][..], &imagery].concat();
    assert_eq!(relevo(&build), (Some(0), String::new()));
    assert_eq!(relevo(&["verify", "one.rlv", "--source", &dem]).0, Some(0));
    assert!(fs::read(folder.path().join("one.rlv")).expect("file") == apart);
    // As one, and in strips.
    let source = source::open(Path::new(&dem), &Limits::default()).expect("source");
    let crs = &source.info().geo.crs;
    let files = [folder.path().join("picture.tif")];
    let pictures = open_all(&files, &PictureOptions::default(), crs, &Limits::default()).expect("open");
    let layer =
        Imagery { pictures: &pictures, options: LayerOptions { tile: 64, ..LayerOptions::default() } };
    let options = BuildOptions { tile: 16, patch: 16, jobs: Some(1), force: true, ..BuildOptions::default() };
    let plan = pipeline::plan(source.info(), &options).expect("plan");
    // As little as strips, and joining them, and the imagery can do with.
    let wide = |columns: u32| (0..63 - columns).map(|x| memory::estimate(&plan, &(x..x + columns))).max();
    let memory = (4..63).map(wide).find(|&memory| column_passes::windows(&plan, memory).is_ok()).flatten();
    let least = *layer.memory(&plan.ground(), 1).expect("memory").start();
    let memory = memory.max(Some(least));
    assert!(column_passes::windows(&plan, memory).expect("strips").len() > 1);
    let built = |name: &str, options: &BuildOptions| {
        let path = folder.path().join(name);
        let report = pipeline::build_with(&*source, Some(&layer), &path, options, &Silent).expect("build");
        assert!(report.imagery.is_some_and(|layer| layer.header.tiles > 0));
        fs::read(path).expect("file")
    };
    assert!(built("whole.rlv", &options) == built("strips.rlv", &BuildOptions { memory, ..options.clone() }));
    // What is wrong with a picture is said before the heights are built.
    fs::remove_file(folder.path().join("one.rlv")).expect("remove");
    for (args, word) in [
        (vec!["build", &dem, "-o", "one.rlv", "--imagery", "gone.tif"], "gone.tif"),
        (
            vec!["build", &dem, "-o", "one.rlv", "--imagery", "picture.tif", "--imagery-tile", "66"],
            "multiple of 4",
        ),
        (vec!["build", &dem, "--each", "out", "--imagery", "picture.tif"], "relevo add"),
    ] {
        let (code, told) = relevo(&args);
        assert!(code == Some(2) && told.contains(word), "{told}");
        assert!(!folder.path().join("one.rlv").exists() && !folder.path().join("one.rlv.work").exists());
    }
}
