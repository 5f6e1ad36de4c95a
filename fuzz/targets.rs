//! What the fuzzers feed, one function a target. `tests/it/fuzz_corpus.rs` runs the same functions
//! over the corpus.
//!
//! Each takes any bytes. It must return: a panic, an overflow, an endless loop or gigabytes of
//! memory are findings. An error is the right answer to most inputs.

#![allow(dead_code)]

use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};

use relevo::Rect;
use relevo::TileId;
use relevo::codec::imagery::{Codec, Form, JpegTables};
use relevo::codec::mask::Occupancy;
use relevo::codec::{Scratch, height, imagery, mask, table};
use relevo::container::{ChunkKind, Reader, ReaderOptions};
use relevo::limits::Limits;
use relevo::mesh_file;
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::sample::{Coding, Lattice};
use relevo::source::{self, Source};
use relevo::texel::{Colour, Texels};
use relevo::verify::{self, VerifyOptions};
use relevo::{geo, surface};

/// Columns, rows or texels above which a target looks no further: larger ones take longer and show
/// nothing new.
const SMALL: u32 = 300;

thread_local! {
    static FOLDER: RefCell<tempfile::TempDir> = RefCell::new(tempfile::tempdir().expect("a temporary folder"));
}

/// Runs `look` in this thread's folder.
fn in_folder(look: impl FnOnce(&Path)) {
    FOLDER.with(|folder| look(folder.borrow().path()));
}

/// A container put together from parts, with checksums that fit: so that a fuzzer comes past them.
///
/// The input is a list of parts, each a `u32` length and bytes: the header up to its checksum,
/// metadata, root page (decoded), statistics (decoded), tiles, a list of further index pages
/// (decoded), and of imagery: the fixed fields, its root page (decoded), JPEG prefix, tiles.
pub fn container(data: &[u8]) {
    let Some(file) = assemble(data) else { return };
    in_folder(|folder| {
        let path = folder.join("x.rlv");
        fs::write(&path, file).expect("write");
        let Ok(reader) = Reader::open_with(&path, ReaderOptions::default()) else { return };
        let _ = reader.statistics();
        if reader.header().tile() > 64 {
            return;
        }
        let mut ids = Vec::new();
        let _ = reader.walk(&mut |entry| {
            ids.push(entry.id);
            Ok(())
        });
        for &id in ids.iter().take(8) {
            let _ = reader.read_tile_alone(id, &mut Lattice::default());
            let _ = reader.read_tile(id);
            let _ = reader.read_errors(id);
        }
        for at in 0..8 {
            let (x, y) = reader.geo().world_from_sample(f64::from(at) * 3.7, f64::from(at) * 1.3);
            let _ = surface::height_at(&reader, x, y);
        }
        imagery_tiles(&reader);
        let options = VerifyOptions { deep: true, max_deep_samples: 1 << 10, ..VerifyOptions::default() };
        if ids.len() < 32 {
            let _ = verify::verify(&reader, None, &options, &Silent);
        }
    });
}

fn imagery_tiles(reader: &Reader) {
    let Some(layer) = reader.imagery() else { return };
    if layer.header().tile > SMALL {
        return;
    }
    let mut ids = Vec::new();
    let _ = layer.walk(&mut |entry| {
        ids.push(entry.id);
        Ok(())
    });
    for &id in ids.iter().take(4) {
        let _ = layer.read_tile(id);
    }
}

/// The parts of an input: each a `u32` length and bytes; a length beyond the end takes what is
/// there.
fn parts(mut data: &[u8]) -> Vec<&[u8]> {
    let mut found = Vec::new();
    while let Some((length, rest)) = data.split_first_chunk::<4>() {
        let (part, rest) = rest.split_at((u32::from_le_bytes(*length) as usize).min(rest.len()));
        found.push(part);
        data = rest;
    }
    found
}

fn zstd(bytes: &[u8]) -> Vec<u8> {
    zstd::bulk::compress(bytes, 1).expect("zstd")
}

/// The bytes of a container, `None` if there is not even a header.
fn assemble(data: &[u8]) -> Option<Vec<u8>> {
    let parts = parts(data);
    let at = |index: usize| parts.get(index).copied().unwrap_or_default();
    let mut head = at(0).to_vec();
    head.resize(252, 0);
    let (mut root, tiles) = (at(2).to_vec(), at(4));
    chunk_checksums(&mut root, tiles);
    let (mut pages, mut places) = (Vec::new(), Vec::new());
    for page in self::parts(at(5)) {
        let mut page = page.to_vec();
        chunk_checksums(&mut page, tiles);
        let frame = zstd(&page);
        places.push((pages.len() as u64, frame.len() as u32, crc32fast::hash(&frame)));
        pages.extend(frame);
    }
    page_places(&mut root, &places);
    // Kind, flags, bytes.
    let mut sections: Vec<(u32, u32, Vec<u8>)> = vec![(2, 3, zstd(&root)), (1, 2, at(1).to_vec())];
    if parts.len() > 6 {
        sections.push((16, 2, imagery_section(at(6), at(7), at(8), at(9))));
    }
    sections.push((3, 2, zstd(at(3))));
    sections.push((5, 1, tiles.to_vec()));
    sections.push((4, 1, pages));
    if parts.len() > 6 {
        sections.push((17, 0, Vec::new()));
        sections.push((18, 0, at(9).to_vec()));
    }
    Some(file(head, &sections))
}

/// Header, section table and sections.
fn file(mut head: Vec<u8>, sections: &[(u32, u32, Vec<u8>)]) -> Vec<u8> {
    let mut offset = 256 + 32 * sections.len() as u64;
    let mut table = Vec::new();
    for (kind, flags, bytes) in sections {
        let crc = if flags & 2 == 0 { 0 } else { crc32fast::hash(bytes) };
        table.extend(kind.to_le_bytes());
        table.extend(flags.to_le_bytes());
        table.extend(offset.to_le_bytes());
        table.extend((bytes.len() as u64).to_le_bytes());
        table.extend(crc.to_le_bytes());
        table.extend([0; 4]);
        offset += bytes.len() as u64;
    }
    head[20..24].copy_from_slice(&(sections.len() as u32).to_le_bytes());
    head[24..32].copy_from_slice(&offset.to_le_bytes());
    let mut crc = crc32fast::Hasher::new();
    crc.update(&head);
    crc.update(&table);
    let mut file = head;
    file.extend(crc.finalize().to_le_bytes());
    file.extend(table);
    for (_, _, bytes) in sections {
        file.extend(bytes);
    }
    file
}

fn imagery_section(fields: &[u8], root: &[u8], prefix: &[u8], tiles: &[u8]) -> Vec<u8> {
    let mut section = fields.to_vec();
    section.resize(16, 0);
    let mut root = root.to_vec();
    imagery_checksums(&mut root, tiles);
    let root = zstd(&root);
    section.extend((root.len() as u32).to_le_bytes());
    section.extend((prefix.len() as u32).to_le_bytes());
    section.extend(root);
    section.extend(prefix);
    section
}

/// The number at an offset, 0 beyond the end.
fn number<const N: usize>(bytes: &[u8], at: usize) -> u64 {
    let mut wide = [0; 8];
    if let Some(found) = bytes.get(at..at + N) {
        wide[..N].copy_from_slice(found);
    }
    u64::from_le_bytes(wide)
}

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    if let Some(place) = bytes.get_mut(at..at + value.len()) {
        place.copy_from_slice(value);
    }
}

/// Tiles of a page, at most as many as its bytes can hold.
fn count(page: &[u8]) -> usize {
    (number::<4>(page, 12) as usize).min(page.len())
}

/// Writes the checksums of all chunks that lie in `tiles` into a decoded page of heights (section
/// 6).
fn chunk_checksums(page: &mut [u8], tiles: &[u8]) {
    let n = count(page);
    let (offsets, lengths, sums) = (16 + 14 * n, 16 + 22 * n, 16 + 34 * n);
    for row in 0..n {
        let mut start = number::<8>(page, offsets + 8 * row) as usize;
        for chunk in 0..3 {
            let length = number::<4>(page, lengths + 4 * (chunk * n + row)) as usize;
            let end = start.saturating_add(length);
            if let Some(bytes) = tiles.get(start..end) {
                put(page, sums + 4 * (chunk * n + row), &crc32fast::hash(bytes).to_le_bytes());
            }
            start = end;
        }
    }
}

/// The same for a page of imagery (section 16.2).
fn imagery_checksums(page: &mut [u8], tiles: &[u8]) {
    let n = count(page);
    let (offsets, lengths, sums) = (16 + n, 16 + 9 * n, 16 + 17 * n);
    for row in 0..n {
        let mut start = number::<8>(page, offsets + 8 * row) as usize;
        for chunk in 0..2 {
            let length = number::<4>(page, lengths + 4 * (chunk * n + row)) as usize;
            let end = start.saturating_add(length);
            if let Some(bytes) = tiles.get(start..end) {
                put(page, sums + 4 * (chunk * n + row), &crc32fast::hash(bytes).to_le_bytes());
            }
            start = end;
        }
    }
}

/// Writes where pages are into the root page.
fn page_places(root: &mut [u8], places: &[(u64, u32, u32)]) {
    let n = count(root);
    let (start, m) = (16 + 46 * n, places.len());
    for (at, &(offset, length, crc)) in places.iter().enumerate() {
        put(root, start + 8 * at, &offset.to_le_bytes());
        put(root, start + 8 * m + 4 * at, &length.to_le_bytes());
        put(root, start + 12 * m + 4 * at, &crc.to_le_bytes());
    }
}

/// The three chunks of a tile, whatever its parent was: five bytes of shape, then mask, heights and
/// errors as parts.
pub fn tiles(data: &[u8]) {
    let Some((&[size, flags, seed, shape, steps], rest)) = data.split_first_chunk::<5>() else { return };
    let n = 2 << (size % 6);
    let root = flags & 1 != 0;
    let coding = match flags >> 1 & 3 {
        0 => Coding::Integer { scale: 1.0, offset: 0.0 },
        1 => Coding::Float32,
        _ => Coding::Float64,
    };
    let parts = parts(rest);
    let at = |index: usize| parts.get(index).copied().unwrap_or_default();
    let mut lattice = Lattice::new(n, coding);
    let mut value = u32::from(seed);
    for (code, state) in lattice.code.iter_mut().zip(&mut lattice.state) {
        value = value.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *code = (value as i32) >> (shape % 32);
        *state = if value >> 28 < u32::from(shape >> 5) { 0 } else { 2 };
    }
    let occupancy = Occupancy { has_valid: flags & 8 != 0, has_void: flags & 16 != 0 };
    let mut scratch = Scratch::default();
    let known = mask::decode(at(0), occupancy, &mut lattice, root, &mut scratch);
    if known.is_ok() || flags & 32 != 0 {
        let _ = height::decode(at(1), &mut lattice, coding, root, &mut scratch);
    }
    let _ = table::decode(at(2), usize::from(shape), usize::from(steps % 8));
}

/// The chunks of an imagery tile: two bytes of form, then JPEG prefix, colour and alpha as parts.
pub fn imagery(data: &[u8]) {
    let Some((&[kind, side], rest)) = data.split_first_chunk::<2>() else { return };
    let Some(codec) = Codec::from_number(kind % 8) else { return };
    let colour = if kind & 8 == 0 { Colour::Rgb } else { Colour::Grey };
    let quality = if codec == Codec::Jpeg { 80 } else { 0 };
    let form = Form { codec, quality, colour, side: 4 * (1 + usize::from(side % 32)) };
    let parts = parts(rest);
    let at = |index: usize| parts.get(index).copied().unwrap_or_default();
    let tables = JpegTables::parse(&form, at(0)).ok();
    let _ = imagery::decode(&form, tables.as_ref(), at(1), at(2));
    let _ = imagery::unpack_blocks(&form, at(1));
}

/// Reads a small raster whole.
fn read_whole(source: &dyn Source) {
    let info = source.info();
    let _ = info.geo.bounds(info.width, info.height);
    if info.width <= SMALL && info.height <= SMALL {
        let _ = source.read_rows(0..info.height);
        let _ = source.read_window(0..info.width / 2, info.height / 2..info.height);
    }
}

/// A TIFF, as heights and as a picture.
pub fn tiff(data: &[u8]) {
    in_folder(|folder| {
        let path = folder.join("x.tif");
        fs::write(&path, data).expect("write");
        if let Ok(source) = source::open(&path, &Limits::default()) {
            read_whole(&*source);
        }
        let options = source::picture::PictureOptions::default();
        let crs = geo::Crs::default();
        if let Ok(pictures) = source::picture::open_all(&[path], &options, &crs, &Limits::default()) {
            for picture in pictures {
                let (width, height) = (picture.info().width, picture.info().height);
                if width <= SMALL && height <= SMALL {
                    let _ = picture.read_window(0..width, 0..height);
                }
            }
        }
    });
}

/// A virtual raster beside a small TIFF of the name `a.tif`.
pub fn vrt(data: &[u8]) {
    in_folder(|folder| {
        let beside = folder.join("a.tif");
        if !beside.exists() {
            fs::write(&beside, small_tiff(20)).expect("write");
        }
        let path = folder.join("x.vrt");
        fs::write(&path, data).expect("write");
        if let Ok(source) = source::open(&path, &Limits::default()) {
            read_whole(&*source);
        }
    });
}

/// Two pieces of a build (folders of files) with one of their files replaced, merged. The first
/// byte chooses the file, the others are what it holds: checksums are made to fit, frames are given
/// decoded (see [`piece_file`]).
pub fn work(data: &[u8]) {
    let Some((&which, content)) = data.split_first() else { return };
    in_folder(|folder| {
        let files = PIECES.with(Clone::clone);
        let which = usize::from(which) % files.len();
        for (at, (name, bytes)) in files.iter().enumerate() {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().expect("a piece")).expect("folder");
            let changed = (at == which).then(|| piece_file(name, content));
            fs::write(path, changed.as_ref().unwrap_or(bytes)).expect("write");
        }
        let pieces = ["a.piece", "b.piece"].map(|name| folder.join(name));
        let output = folder.join("y.rlv");
        let Ok(_) = pipeline::merge(&pieces, &output, Some(1), true, &Silent) else { return };
        // A state or a row of the list that lies under a checksum that fits is believed; damaged
        // chunks are not.
        let name = &files[which].0;
        let must_be_good =
            !["state", "records"].iter().any(|own| name.ends_with(own)) && !name.contains("seam");
        let report = Reader::open(&output).and_then(|reader| {
            let source = source::open(&folder.join("dem.tif"), &Limits::default())?;
            verify::verify(&reader, Some(&*source), &VerifyOptions::default(), &Silent)
        });
        assert!(!must_be_good || report.is_ok_and(|report| report.is_good()), "a damaged piece was merged");
    });
}

thread_local! {
    /// The files of two pieces, by folder and name, as a build made them.
    static PIECES: std::rc::Rc<Vec<(String, Vec<u8>)>> = std::rc::Rc::new(make_pieces());
}

/// Two windows of a raster of 40 x 40 samples: three by three tiles, and seams between.
fn make_pieces() -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    in_folder(|folder| {
        let dem = folder.join("dem.tif");
        fs::write(&dem, small_tiff(40)).expect("write");
        let source = source::open(&dem, &Limits::default()).expect("a raster");
        let options =
            BuildOptions { tile: 16, patch: 4, force: true, jobs: Some(1), ..BuildOptions::default() };
        for (name, columns) in [("a.piece", 0..2), ("b.piece", 2..3)] {
            let window = Rect { columns, rows: 0..3 };
            pipeline::build_window(&*source, &folder.join(name), &window, &options, &Silent)
                .expect("a piece");
            for path in files(&folder.join(name)) {
                let file = path.file_name().expect("name").to_string_lossy().into_owned();
                found.push((format!("{name}/{file}"), fs::read(path).expect("file")));
            }
        }
    });
    found
}

/// Bytes of the head of a state, and of one of its rows in the list of tiles.
const STATE_HEAD: usize = 20;
const ROW: usize = 59;

/// What a file of a piece holds: a state as its body (a part) and items, a seam file as items, a
/// list of tiles as it is; all with checksums that fit. Chunks are as they are.
fn piece_file(name: &str, content: &[u8]) -> Vec<u8> {
    if name.ends_with("/state") {
        let (body, rest) = first_part(content);
        let mut out = b"RLVSTATE".to_vec();
        for word in [5, body.len() as u32, crc32fast::hash(body)] {
            out.extend(word.to_le_bytes());
        }
        out.extend(body);
        out.extend(items(rest));
        return out;
    }
    if name.contains("/seam") {
        return items(content);
    }
    let mut out = content.to_vec();
    if name.ends_with("/records") {
        for row in out.chunks_exact_mut(ROW) {
            let crc = crc32fast::hash(&row[..ROW - 4]);
            put(row, ROW - 4, &crc.to_le_bytes());
        }
    }
    out
}

/// A `u32` length and so many bytes, and what follows.
fn first_part(data: &[u8]) -> (&[u8], &[u8]) {
    match data.split_first_chunk::<4>() {
        Some((length, rest)) => rest.split_at((u32::from_le_bytes(*length) as usize).min(rest.len())),
        None => (&[], &[]),
    }
}

/// Seam items of ten bytes of head and a part each: the part is packed, length and checksum are put
/// between.
fn items(mut data: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    while let Some((head, rest)) = data.split_first_chunk::<10>() {
        let (plain, rest) = first_part(rest);
        let frame = zstd(plain);
        out.extend(head);
        out.extend((frame.len() as u32).to_le_bytes());
        out.extend(crc32fast::hash(&frame).to_le_bytes());
        out.extend(frame);
        data = rest;
    }
    out
}

/// The inverse of [`items`].
fn plain_items(mut data: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    while data.len() >= 18 {
        let length = number::<4>(data, 10) as usize;
        out.extend(&data[..10]);
        out = join(out, &zstd::stream::decode_all(&data[18..18 + length]).expect("a frame"));
        data = &data[18 + length..];
    }
    out
}

/// A square TIFF of 16-bit samples with a place, a nodata value and some void samples.
pub fn small_tiff(side: u16) -> Vec<u8> {
    let text = b"-999\0";
    let doubles: [f64; 9] = [10.0, 10.0, 0.0, 0.0, 0.0, 0.0, 400_000.0, 4_500_000.0, 0.0];
    let strip = u32::from(side) * u32::from(side) * 2;
    let after = 8 + 2 + 12 * 14 + 4;
    let (text_at, doubles_at) = (after, after + 8);
    let keys_at = doubles_at + 72;
    let keys: [u16; 16] = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 32_613];
    let data_at = keys_at + 32;
    let short = |value: u16| u32::from(value);
    let entries: [(u16, u16, u32, u32); 13] = [
        (256, 3, 1, short(side)),
        (257, 3, 1, short(side)),
        (258, 3, 1, 16),
        (259, 3, 1, 1),
        (262, 3, 1, 1),
        (273, 4, 1, data_at),
        (277, 3, 1, 1),
        (278, 3, 1, short(side)),
        (279, 4, 1, strip),
        (339, 3, 1, 2),
        (33_550, 12, 3, doubles_at),
        (33_922, 12, 6, doubles_at + 24),
        (34_735, 3, 16, keys_at),
    ];
    let mut out = b"II*\0\x08\0\0\0".to_vec();
    out.extend((entries.len() as u16 + 1).to_le_bytes());
    for (tag, kind, count, value) in entries.into_iter().chain([(42_113, 2, 5, text_at)]) {
        out.extend(tag.to_le_bytes());
        out.extend(kind.to_le_bytes());
        out.extend(count.to_le_bytes());
        out.extend(value.to_le_bytes());
    }
    out.extend([0; 4]);
    debug_assert_eq!(out.len() as u32, after);
    out.extend(text);
    out.resize(out.len() + 3, 0);
    out.extend(doubles.iter().flat_map(|value| value.to_le_bytes()));
    out.extend(keys.iter().flat_map(|value| value.to_le_bytes()));
    for at in 0..i32::from(side) * i32::from(side) {
        let (x, y) = (at % i32::from(side), at / i32::from(side));
        let height =
            if (x - 9) * (x - 9) + (y - 12) * (y - 12) < 20 { -999 } else { x * x + 3 * y + x * y % 7 };
        out.extend((height as i16).to_le_bytes());
    }
    out
}

/// The files of a folder, in the order of their names.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<_> =
        fs::read_dir(folder).expect("folder").map(|entry| entry.expect("entry").path()).collect();
    found.retain(|path| path.is_file());
    found.sort();
    found
}

/// The part format of [`container`] of a finished file: a seed.
pub fn take_apart(path: &Path) -> Vec<u8> {
    let file = fs::read(path).expect("file");
    let sections = number::<4>(&file, 20) as usize;
    let section = |kind: u64| {
        let entry = (0..sections).map(|at| 256 + 32 * at).find(|&at| number::<4>(&file, at) == kind)?;
        let start = number::<8>(&file, entry + 8) as usize;
        file.get(start..start + number::<8>(&file, entry + 16) as usize)
    };
    let plain = |bytes: &[u8]| zstd::stream::decode_all(bytes).expect("a frame");
    let root = plain(section(2).expect("root page"));
    let mut pages = Vec::new();
    let stored = section(4).unwrap_or_default();
    let n = count(&root);
    let start = 16 + 46 * n;
    let m = (root.len() - start) / 16;
    for at in 0..m {
        let offset = number::<8>(&root, start + 8 * at) as usize;
        let length = number::<4>(&root, start + 8 * m + 4 * at) as usize;
        pages.push(plain(&stored[offset..offset + length]));
    }
    let pages = pages.iter().fold(Vec::new(), |out, page| join(out, page));
    let mut out = Vec::new();
    for part in [
        &file[..252],
        section(1).unwrap_or_default(),
        &root,
        &plain(section(3).unwrap_or_default()),
        section(5).unwrap_or_default(),
        &pages,
    ] {
        out = join(out, part);
    }
    let Some(layer) = section(16) else { return out };
    let (r, q) = (number::<4>(layer, 16) as usize, number::<4>(layer, 20) as usize);
    for part in [
        &layer[..16],
        &plain(&layer[24..24 + r]),
        &layer[24 + r..24 + r + q],
        section(18).unwrap_or_default(),
    ] {
        out = join(out, part);
    }
    out
}

/// A list of parts with one more.
pub fn join(mut out: Vec<u8>, part: &[u8]) -> Vec<u8> {
    out.extend((part.len() as u32).to_le_bytes());
    out.extend(part);
    out
}

/// The chunks of the first tiles of a file as inputs of [`tiles`].
pub fn chunks_of(path: &Path) -> Vec<Vec<u8>> {
    let reader = Reader::open(path).expect("container");
    let header = reader.header();
    let mut found = Vec::new();
    reader
        .walk(&mut |entry| {
            found.push((entry.id, entry.has_valid, entry.has_void));
            Ok(())
        })
        .expect("walk");
    let size = header.tile().ilog2() as u8 - 1;
    let seed = |(id, has_valid, has_void): (TileId, bool, bool)| {
        let flags = u8::from(id == TileId::ROOT) | u8::from(has_valid) << 3 | u8::from(has_void) << 4 | 32;
        let start = vec![size, flags, 1, header.patches() as u8, header.steps() as u8];
        [ChunkKind::Mask, ChunkKind::Heights, ChunkKind::Errors]
            .into_iter()
            .fold(start, |out, kind| join(out, &reader.raw_chunk(id, kind).expect("chunk")))
    };
    found.into_iter().take(3).map(seed).collect()
}

/// An imagery tile of each codec as inputs of [`imagery`].
pub fn imagery_seeds() -> Vec<Vec<u8>> {
    let mut seeds = Vec::new();
    for (number, colour) in (1..=5).flat_map(|number| [(number, Colour::Rgb), (number, Colour::Grey)]) {
        let codec = Codec::from_number(number).expect("codec");
        let quality = if codec == Codec::Jpeg { 80 } else { 0 };
        let form = Form { codec, quality, colour, side: 16 };
        let texels = Texels {
            side: 16,
            kind: colour,
            colour: (0..256 * colour.channels()).map(|at| (at * 7 % 251) as u8).collect(),
            alpha: Some((0..256).map(|at| if at % 9 == 0 { 0 } else { 255 }).collect()),
        };
        let chunks = imagery::encode(&form, &texels).expect("encoded");
        let tables = imagery::jpeg_tables(&form).expect("tables");
        let prefix = tables.as_ref().map_or(&[][..], JpegTables::prefix);
        let start = vec![number | if colour == Colour::Grey { 8 } else { 0 }, 3];
        seeds.push([prefix, &chunks.colour, &chunks.alpha].into_iter().fold(start, join));
    }
    seeds
}

/// The files of two pieces as inputs of [`work`].
pub fn piece_seeds() -> Vec<Vec<u8>> {
    let seed = |(which, (name, bytes)): (usize, &(String, Vec<u8>))| {
        let mut seed = vec![which as u8];
        if name.ends_with("/state") {
            let body = number::<4>(bytes, 12) as usize;
            seed = join(seed, &bytes[STATE_HEAD..STATE_HEAD + body]);
            seed.extend(plain_items(&bytes[STATE_HEAD + body..]));
        } else if name.contains("/seam") {
            seed.extend(plain_items(bytes));
        } else {
            seed.extend(bytes);
        }
        seed
    };
    PIECES.with(|files| files.iter().enumerate().map(seed).collect())
}

/// A mesh file; the first byte says which format.
pub fn meshes(data: &[u8]) {
    let Some((&which, content)) = data.split_first() else { return };
    let end = ["glb", "obj", "ply", "stl"][usize::from(which) % 4];
    in_folder(|folder| {
        let path = folder.join("m").with_extension(end);
        fs::write(&path, content).expect("write");
        let Ok(mesh) = mesh_file::read(&path, None) else { return };
        let count = mesh.vertices.len();
        assert!(mesh.triangles.iter().flatten().all(|&index| (index as usize) < count));
        assert!(mesh.vertices.iter().flatten().all(|value| value.is_finite()));
        assert!(count * 24 + mesh.triangles.len() * 12 <= (1 << 17) + 64 * content.len());
    });
}
