//! TIFFs that are odd and read all the same: types, tags and byte counts that are missing, short or
//! said twice, chains of directories that lead nowhere, of both byte orders, classic and big.
//! Samples are held against what was written.

mod writer;

use std::path::{Path, PathBuf};

use relevo::limits::Limits;
use relevo::source::tiff::TiffSource;
use relevo::source::{self, Samples, Source};

use self::writer::{Entry, FORMS, Form, LINKS, Link, deflate, entry, kind, lzw, pack_bits, text};

const WIDTH: usize = 37;
const HEIGHT: usize = 23;

const WIDTH_TAG: u16 = 256;
const HEIGHT_TAG: u16 = 257;
const ROWS_PER_STRIP: u16 = 278;
const COMPRESSION: u16 = 259;
const TILE_WIDTH: u16 = 322;
const NODATA: u16 = 42113;
const PIXEL_SCALE: u16 = 33550;

/// The sample at a place.
fn height(x: usize, y: usize) -> i16 {
    ((x * 7919 + y * 104_729) % 30_011) as i16 - 9000
}

/// How the raster is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Cut {
    OneStrip,
    Strips,
    Tiles,
    /// Tiles of which offsets and counts stand under the tags of strips.
    TilesAsStrips,
}

/// How the byte counts are.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Counts {
    Right,
    Zero,
    Missing,
    /// The first one only.
    One,
    TooLarge,
}

/// How the blocks are packed: the number of tag 259, and for LZW whether it is the old one.
type Packing = (f64, bool);

const PACKINGS: [Packing; 5] = [(1.0, false), (5.0, false), (5.0, true), (8.0, false), (32773.0, false)];

#[derive(Clone, Copy, Debug)]
struct Case {
    form: Form,
    cut: Cut,
    counts: Counts,
    packing: Packing,
    link: Link,
    /// Type of whole numbers.
    integers: u16,
    /// Bits of a byte from the lowest to the highest.
    reversed: bool,
}

impl Case {
    fn block(self) -> (usize, usize) {
        match self.cut {
            Cut::OneStrip => (WIDTH, HEIGHT),
            Cut::Strips => (WIDTH, 5),
            Cut::Tiles | Cut::TilesAsStrips => (16, 8),
        }
    }

    /// The blocks, packed, in rising order of their places, and which of them stands where.
    fn blocks(self) -> Vec<Vec<u8>> {
        let (width, rows) = self.block();
        let mut blocks = Vec::new();
        for top in (0..HEIGHT).step_by(rows) {
            for left in (0..WIDTH).step_by(width) {
                let is_tile = width < WIDTH;
                let end = if is_tile { top + rows } else { HEIGHT.min(top + rows) };
                let places = (top..end).flat_map(|y| (left..left + width).map(move |x| (x, y)));
                let bytes: Vec<u8> =
                    places.flat_map(|(x, y)| self.form.int(height(x, y).into(), 2)).collect();
                let mut block = match self.packing {
                    (5.0, old) => lzw(&bytes, old),
                    (8.0, _) => deflate(&bytes),
                    (32773.0, _) => pack_bits(&bytes),
                    _ => bytes,
                };
                if self.reversed {
                    for byte in &mut block {
                        *byte = byte.reverse_bits();
                    }
                }
                blocks.push(block);
            }
        }
        blocks
    }

    fn file(self) -> Vec<u8> {
        // From the last to the first: the next block in the raster is not the next one in the file.
        let blocks: Vec<Vec<u8>> = self.blocks().into_iter().rev().collect();
        self.form.file(&blocks, self.link, |offsets| self.entries(&blocks, offsets))
    }

    fn entries(self, blocks: &[Vec<u8>], offsets: &[f64]) -> Vec<Entry> {
        let offsets: Vec<f64> = offsets.iter().rev().copied().collect();
        let mut counts: Vec<f64> = blocks.iter().rev().map(|block| block.len() as f64).collect();
        match self.counts {
            Counts::Right => {}
            Counts::Zero | Counts::Missing => counts.fill(0.0),
            Counts::One => counts.truncate(1),
            Counts::TooLarge => counts.iter_mut().for_each(|count| *count += 5.0),
        }
        let (width, rows) = self.block();
        let whole = |tag, value: f64| entry(tag, self.integers, &[value]);
        let (at, long) = match self.cut {
            Cut::Tiles => (324, 325),
            _ => (273, 279),
        };
        let wide = if self.form.big { kind::LONG8 } else { kind::LONG };
        let mut entries = vec![
            whole(WIDTH_TAG, WIDTH as f64),
            whole(HEIGHT_TAG, HEIGHT as f64),
            entry(258, kind::SHORT, &[16.0]),
            entry(COMPRESSION, kind::SHORT, &[self.packing.0]),
            entry(at, wide, &offsets),
            entry(339, kind::SHORT, &[2.0]),
            entry(PIXEL_SCALE, kind::DOUBLE, &[10.0, 10.0, 0.0]),
            entry(33922, kind::DOUBLE, &[0.0, 0.0, 0.0, 500_000.0, 4_400_000.0, 0.0]),
            text(NODATA, "-32768"),
        ];
        if self.reversed {
            entries.push(entry(266, kind::SHORT, &[2.0]));
        }
        if self.counts != Counts::Missing {
            entries.push(entry(long, wide, &counts));
        }
        if width < WIDTH {
            entries.extend([whole(TILE_WIDTH, width as f64), whole(323, rows as f64)]);
        } else if self.cut == Cut::Strips {
            entries.push(whole(ROWS_PER_STRIP, rows as f64));
        }
        entries
    }
}

/// The plainest of all.
const PLAIN: Case = Case {
    form: FORMS[0],
    cut: Cut::Strips,
    counts: Counts::Right,
    packing: (1.0, false),
    link: Link::None,
    integers: kind::SHORT,
    reversed: false,
};

fn open(path: &Path, bytes: &[u8]) -> Result<Box<dyn Source>, relevo::Error> {
    std::fs::write(path, bytes).expect("write");
    source::open(path, &Limits::default())
}

/// Without GDAL, if it is built in.
fn native(path: &Path, bytes: &[u8]) -> Result<TiffSource, relevo::Error> {
    std::fs::write(path, bytes).expect("write");
    TiffSource::open(path, &Limits::default())
}

/// Holds all samples, and those of a window that begins and ends inside blocks.
fn check(source: &dyn Source, case: &dyn std::fmt::Debug) {
    assert_eq!((source.info().width, source.info().height), (WIDTH as u32, HEIGHT as u32), "{case:?}");
    for (columns, rows) in [(0..WIDTH, 0..HEIGHT), (3..20, 4..17)] {
        let window = source
            .read_window(columns.start as u32..columns.end as u32, rows.start as u32..rows.end as u32)
            .unwrap_or_else(|error| panic!("{case:?}: {error}"));
        let expected = rows.flat_map(|y| columns.clone().map(move |x| height(x, y))).collect();
        assert_eq!(window.samples, Samples::Int16(expected), "{case:?}");
    }
}

#[test]
fn odd_files_are_read_as_they_were_meant() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("odd.tif");
    let mut files = 0;
    for form in FORMS {
        for cut in [Cut::OneStrip, Cut::Strips, Cut::Tiles, Cut::TilesAsStrips] {
            for counts in [Counts::Right, Counts::Zero, Counts::Missing, Counts::One, Counts::TooLarge] {
                for packing in PACKINGS {
                    let types = [
                        kind::BYTE,
                        kind::SHORT,
                        kind::LONG,
                        kind::SBYTE,
                        kind::SSHORT,
                        kind::SLONG,
                        kind::LONG8,
                        kind::SLONG8,
                    ];
                    // Types and links take turns.
                    let (integers, link) = (types[files % types.len()], LINKS[files % LINKS.len()]);
                    let reversed = files % 3 == 2;
                    let case = Case { form, cut, counts, packing, link, integers, reversed };
                    let source =
                        open(&path, &case.file()).unwrap_or_else(|error| panic!("{case:?}: {error}"));
                    check(&*source, &case);
                    assert_eq!(source.info().nodata, Some(-32768.0), "{case:?}");
                    files += 1;
                }
            }
        }
    }
    assert_eq!(files, 400);
}

#[test]
fn numbers_of_any_type_and_tags_said_twice() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("odd.tif");
    for form in FORMS {
        for scale in [
            kind::BYTE,
            kind::SHORT,
            kind::LONG,
            kind::RATIONAL,
            kind::SBYTE,
            kind::SSHORT,
            kind::SLONG,
            kind::SRATIONAL,
            kind::FLOAT,
            kind::DOUBLE,
            kind::LONG8,
            kind::SLONG8,
        ] {
            let case = Case { form, ..PLAIN };
            let blocks = case.blocks();
            let file = form.file(&blocks, Link::None, |offsets| {
                let offsets: Vec<f64> = offsets.iter().rev().copied().collect();
                let blocks: Vec<Vec<u8>> = blocks.iter().rev().cloned().collect();
                let mut entries = case.entries(&blocks, &offsets);
                entries.retain(|entry| entry.tag != PIXEL_SCALE);
                entries.push(entry(PIXEL_SCALE, scale, &[20.0, 5.0, 0.0]));
                // The first of each counts, wherever it stands.
                entries.extend([text(NODATA, "7"), entry(WIDTH_TAG, kind::SHORT, &[4.0])]);
                entries.push(entry(PIXEL_SCALE, kind::DOUBLE, &[1.0, 1.0, 0.0]));
                entries
            });
            let source = open(&path, &file).expect("open");
            check(&*source, &(form, scale));
            assert_eq!(source.info().nodata, Some(-32768.0));
            let transform = source.info().geo.transform;
            assert_eq!(transform, Some([500_000.0, 20.0, 0.0, 4_400_000.0, 0.0, -5.0]), "{form:?}, {scale}");
        }
    }
}

#[test]
fn blocks_that_are_not_there_stay_so() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("sparse.tif");
    for packing in [(1.0, false), (8.0, false)] {
        for (offset, count) in [(0.0, 0.0), (f64::NAN, 0.0)] {
            let case = Case { packing, ..PLAIN };
            let blocks = case.blocks();
            let file = case.form.file(&blocks, Link::None, |offsets| {
                let mut entries = case.entries(
                    &blocks.iter().rev().cloned().collect::<Vec<_>>(),
                    &offsets.iter().rev().copied().collect::<Vec<_>>(),
                );
                for found in &mut entries {
                    // Strip 1 is nowhere, or has no bytes where strip 2 begins.
                    match found.tag {
                        273 => found.values[1] = if offset == 0.0 { 0.0 } else { offsets[2] },
                        279 => found.values[1] = count,
                        _ => {}
                    }
                }
                entries
            });
            let source = open(&path, &file).expect("open");
            let window = source.read_rows(0..HEIGHT as u32).expect("rows");
            let sample = |x, y| if (5..10).contains(&y) { -32768 } else { height(x, y) };
            let expected = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| sample(x, y))).collect();
            assert_eq!(window.samples, Samples::Int16(expected));
        }
    }
}

/// What cannot be right is refused, by tag and reason.
#[test]
fn what_is_wrong_is_named() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("wrong.tif");
    for (tag, changed, words) in [
        (WIDTH_TAG, entry(WIDTH_TAG, kind::SSHORT, &[-37.0]), &["256", "below 0", "-37"][..]),
        (HEIGHT_TAG, entry(HEIGHT_TAG, kind::FLOAT, &[23.0]), &["257", "integers", "FLOAT"]),
        (HEIGHT_TAG, entry(HEIGHT_TAG, kind::SHORT, &[]), &["257", "none"]),
        (273, entry(273, kind::LONG, &[64.0, 64.0]), &["273", "5 blocks", "2"]),
        (PIXEL_SCALE, text(PIXEL_SCALE, "ten"), &["33550", "numbers", "a text"]),
        (NODATA, entry(NODATA, kind::SHORT, &[7.0]), &["42113", "a text"]),
    ] {
        let blocks = PLAIN.blocks();
        let file = PLAIN.form.file(&blocks, Link::None, |offsets| {
            let mut entries = PLAIN.entries(&blocks, offsets);
            entries.iter_mut().filter(|entry| entry.tag == tag).for_each(|entry| *entry = changed.clone());
            entries
        });
        let message = native(&path, &file).err().expect("wrong").to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    }
    // 64-bit integers and complex samples are read by no build, and no GDAL is asked for.
    for (bits, format, words) in
        [(64.0, 2.0, "-ot Int32"), (64.0, 1.0, "-ot Float64"), (64.0, 6.0, "real parts")]
    {
        let blocks = PLAIN.blocks();
        let file = PLAIN.form.file(&blocks, Link::None, |offsets| {
            let mut entries = PLAIN.entries(&blocks, offsets);
            entries.retain(|entry| entry.tag != 258 && entry.tag != 339);
            entries.extend([entry(258, kind::SHORT, &[bits]), entry(339, kind::SHORT, &[format])]);
            entries
        });
        let message = open(&path, &file).err().expect("unsupported").to_string();
        assert!(message.contains(words) && !message.contains("install"), "{message}");
    }
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/failing").join(name)
}

/// Files that were refused or misread once; their samples are those of the same terrain, as GDAL
/// 3.6.2 reads it.
#[test]
fn files_that_were_refused_or_misread() {
    let terrain = |name: &str| {
        let source =
            source::open(&fixture(name), &Limits::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!((source.info().width, source.info().height), (70, 50), "{name}");
        let transform = source.info().geo.transform;
        assert_eq!(transform, Some([500_000.0, 10.0, 0.0, 4_400_000.0, 0.0, -10.0]), "{name}");
        (source.read_rows(0..50).expect(name).samples, source.info().nodata)
    };
    let (expected, nodata) = terrain("tags-slong.tif");
    let Samples::Int16(samples) = &expected else { panic!("int16") };
    assert_eq!(nodata, None);
    let sum: i64 = samples.iter().map(|&sample| i64::from(sample)).sum();
    // GDAL: least 671, greatest 1381, mean 1055.960571.
    assert_eq!((samples.iter().min(), samples.iter().max(), sum), (Some(&671), Some(&1381), 3_695_862));
    for name in [
        "strip-count-0-uncompressed.tif",
        "strip-one-count-for-five.tif",
        "strips-rows-per-strip-missing.tif",
        "tiles-in-strip-tags.tif",
        "ifd-next-is-itself.tif",
    ] {
        assert_eq!(terrain(name), (expected.clone(), None), "{name}");
    }
    assert_eq!(terrain("tags-nodata-twice.tif"), (expected, Some(1000.0)));
    assert!(matches!(terrain("tags-pixel-scale-long.tif").0, Samples::Float32(_)));
}

/// Directories that lie over one another are not multiplied: 200 kB took 2.3 GB once.
#[cfg(target_os = "linux")]
#[test]
fn overlapping_directories_take_little_memory() {
    let most = 1 << 20;
    let file = fixture("tiff-overlapping-directories.tif");
    let command = format!("ulimit -v {most}; exec \"$0\" build --dry-run \"$1\"");
    let output = std::process::Command::new("sh")
        .args(["-c", &command, env!("CARGO_BIN_EXE_relevo")])
        .arg(&file)
        .output()
        .expect("sh");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    // Read or refused, but by this program, not by the system.
    assert!(matches!(output.status.code(), Some(0 | 2)), "{message}");
    assert!(!message.contains("memory"), "{message}");
}

/// Every prefix, and random bytes of every file changed: an error or a raster.
#[test]
fn damage_never_panics() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("damaged.tif");
    let mut limits = Limits::default();
    limits.raster_side = 1 << 16;
    limits.block_bytes = 1 << 20;
    let look = |bytes: &[u8]| {
        std::fs::write(&path, bytes).expect("write");
        let Ok(source) = source::open(&path, &limits) else { return false };
        let (columns, rows) = (0..source.info().width.min(64), 0..source.info().height.min(64));
        source.read_window(columns, rows).is_ok()
    };
    let mut seed = 0x9E37_79B9_7F4A_7C15_u64;
    let mut random = move |below: usize| {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        (seed % below as u64) as usize
    };
    let (mut read, mut refused) = (0, 0);
    for form in FORMS {
        for (cut, counts) in
            [(Cut::Strips, Counts::Right), (Cut::Tiles, Counts::Zero), (Cut::OneStrip, Counts::One)]
        {
            let packing = PACKINGS[random(PACKINGS.len())];
            let good = Case { form, cut, counts, packing, ..PLAIN }.file();
            for length in (0..good.len()).step_by(13) {
                look(&good[..length]);
            }
            for _ in 0..300 {
                let mut bad = good.clone();
                for _ in 0..=random(3) {
                    // Most of the hits in the directory and the values at the end.
                    let from = if random(4) > 0 { good.len().saturating_sub(400) } else { 0 };
                    let at = from + random(good.len() - from);
                    bad[at] = [random(256) as u8, 0, 255, bad[at] ^ (1 << random(8))][random(4)];
                }
                if look(&bad) { read += 1 } else { refused += 1 }
            }
        }
    }
    assert!(read > 300 && refused > 300, "{read} read, {refused} refused: the damage is one-sided");
}
