//! Does a damaged, truncated or lying TIFF end in an error, and never in a panic or a hunt for
//! memory?

use std::io::Cursor;
use std::path::Path;

use relevo::Error;
use relevo::limits::Limits;
use relevo::source;
use tiff::encoder::{Compression, DeflateLevel, Predictor, TiffEncoder, colortype};
use tiff::tags::Tag;

/// A raster of 40 x 30 with all the tags that the reader looks at.
fn small(compression: Compression, predictor: Predictor, big: bool) -> Vec<u8> {
    let samples: Vec<i16> = (0..1200_i32).map(|index| (index * index / 77) as i16).collect();
    let mut file = Cursor::new(Vec::new());
    macro_rules! write {
        ($encoder:expr) => {{
            let mut encoder =
                $encoder.expect("header").with_compression(compression).with_predictor(predictor);
            let mut image = encoder.new_image::<colortype::GrayI16>(40, 30).expect("image");
            image.rows_per_strip(7).expect("strips");
            let tags = image.encoder();
            let keys = [1_u16, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 2, 2048, 0, 1, 4326];
            tags.write_tag(Tag::GeoKeyDirectoryTag, &keys[..]).expect("tag");
            tags.write_tag(Tag::ModelPixelScaleTag, &[0.1_f64, 0.1, 0.0][..]).expect("tag");
            tags.write_tag(Tag::ModelTiepointTag, &[0.0_f64, 0.0, 0.0, 10.0, 50.0, 0.0][..]).expect("tag");
            tags.write_tag(Tag::GdalNodata, "-32768").expect("tag");
            let xml = "<GDALMetadata><Item name=\"s\" sample=\"0\" role=\"scale\">0.5</Item></GDALMetadata>";
            tags.write_tag(Tag::Unknown(42112), xml).expect("tag");
            image.write_data(&samples).expect("samples");
        }};
    }
    if big {
        write!(TiffEncoder::new_big(&mut file));
    } else {
        write!(TiffEncoder::new(&mut file));
    }
    file.into_inner()
}

/// Opens and reads a file as far as a small machine would.
fn read(path: &Path) -> Result<(), Error> {
    let mut limits = Limits::default();
    limits.raster_side = 1 << 20;
    limits.block_bytes = 1 << 20;
    let source = source::open(path, &limits)?;
    let info = source.info();
    let rows = ((1 << 22) / info.width).clamp(1, 64);
    for start in [0, info.height.saturating_sub(rows)] {
        let rows = start..info.height.min(start + rows);
        let window = source.read_rows(rows.clone())?;
        assert_eq!(window.samples.len(), rows.len() * info.width as usize);
    }
    Ok(())
}

fn variants() -> Vec<Vec<u8>> {
    let mut all = Vec::new();
    for big in [false, true] {
        for predictor in [Predictor::None, Predictor::Horizontal] {
            all.push(small(Compression::Lzw, predictor, big));
            all.push(small(Compression::Deflate(DeflateLevel::Fast), predictor, big));
        }
        all.push(small(Compression::Uncompressed, Predictor::None, big));
        all.push(small(Compression::Packbits, Predictor::None, big));
    }
    all
}

#[test]
fn whole_files_are_read() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("whole.tif");
    for bytes in variants() {
        std::fs::write(&path, bytes).expect("write");
        read(&path).expect("a good file");
        let source = source::open(&path, &Limits::default()).expect("open");
        assert_eq!(source.info().nodata, Some(-32768.0));
        assert_eq!(source.info().band_scale, 0.5);
        assert_eq!(source.info().geo.crs.epsg, Some(4326));
        assert_eq!(source.info().geo.transform, Some([9.95, 0.1, 0.0, 50.05, 0.0, -0.1]));
    }
}

#[test]
fn every_prefix_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("prefix.tif");
    for bytes in variants() {
        // The encoder puts the directory last: without its end there is nothing.
        for length in 0..bytes.len() {
            if length > 32 && length + 100 < bytes.len() && length % 37 != 0 {
                continue;
            }
            std::fs::write(&path, &bytes[..length]).expect("write");
            if is_whole_but_for_its_link(&bytes, length) {
                read(&path).expect("all but the offset of the next directory, of which there is none");
                continue;
            }
            let error = read(&path).expect_err("a prefix");
            let refused = matches!(error, Error::Format { .. } | Error::Io { .. });
            // Less than a signature may be any format.
            assert!(refused || length < 4 && matches!(error, Error::Unsupported { .. }), "{length}: {error}");
            assert!(error.to_string().contains("prefix.tif"), "{error}");
        }
    }
}

/// True if a prefix lacks nothing but (a part of) the last four bytes, or eight of a big file: no
/// next directory.
fn is_whole_but_for_its_link(file: &[u8], length: usize) -> bool {
    let link = if file[2] == b'+' { 8 } else { 4 };
    length + link >= file.len()
}

#[test]
fn truncated_real_file_names_the_block() {
    let folder = tempfile::tempdir().expect("folder");
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem/rmnp_dem_uint16.tif");
    let bytes = std::fs::read(fixture).expect("fixture");
    let path = folder.path().join("short.tif");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("write");
    let error = read(&path).expect_err("half a file").to_string();
    assert!(error.contains("strip ") && error.contains("at offset") && error.contains("expected"), "{error}");
}

#[test]
fn random_damage_never_panics() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("damaged.tif");
    let mut seed = 0x9E37_79B9_7F4A_7C15_u64;
    let mut random = move |below: usize| {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        (seed % below as u64) as usize
    };
    let (mut refused, mut accepted) = (0, 0);
    for bytes in variants() {
        for _ in 0..400 {
            let mut bytes = bytes.clone();
            for _ in 0..=random(4) {
                // Half of the hits in the directory at the end, where they hurt most.
                let from = if random(2) == 0 { bytes.len().saturating_sub(700) } else { 0 };
                let at = from + random(bytes.len() - from);
                bytes[at] = match random(3) {
                    0 => bytes[at] ^ 1 << random(8),
                    1 => [0, 255, 127, 1][random(4)],
                    _ => random(256) as u8,
                };
            }
            std::fs::write(&path, bytes).expect("write");
            match read(&path) {
                Ok(()) => accepted += 1,
                Err(_) => refused += 1,
            }
        }
    }
    assert!(
        refused > 500 && accepted > 500,
        "{refused} refused, {accepted} accepted: the damage is one-sided"
    );
}

/// Replaces the value of a 32-bit or 16-bit tag in a classic little-endian file.
fn with_tag(bytes: &[u8], tag: u16, value: u32) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let at = u32::from_le_bytes(bytes[4..8].try_into().expect("4")) as usize;
    let count = usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
    let entry = (0..count).map(|index| at + 2 + 12 * index);
    let entry = entry.into_iter().find(|&entry| bytes[entry..entry + 2] == tag.to_le_bytes()).expect("tag");
    bytes[entry + 2..entry + 4].copy_from_slice(&4_u16.to_le_bytes());
    bytes[entry + 8..entry + 12].copy_from_slice(&value.to_le_bytes());
    bytes
}

#[test]
fn large_claims_meet_a_limit() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("huge.tif");
    let good = small(Compression::Lzw, Predictor::None, false);
    for (tag, value, what) in [(256, u32::MAX, "width"), (257, 1 << 31, "height")] {
        std::fs::write(&path, with_tag(&good, tag, value)).expect("write");
        let error = source::open(&path, &Limits::default()).err().expect("too large");
        assert!(matches!(error, Error::Limit { .. }) && error.to_string().contains(what), "{error}");
    }
    // Within the limits, but far from what the file can hold.
    let tall = with_tag(&with_tag(&good, 257, 1 << 24), 278, 1 << 24);
    std::fs::write(&path, &tall).expect("write");
    let error = read(&path).expect_err("a strip of 2^24 rows");
    assert!(matches!(error, Error::Limit { .. }), "{error}");
    let wide = with_tag(&good, 256, 1 << 19);
    std::fs::write(&path, &wide).expect("write");
    assert!(matches!(read(&path), Err(Error::Limit { .. } | Error::Format { .. })));
}

#[test]
fn what_is_not_a_tiff_is_named_and_not_quoted() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("dem.asc");
    std::fs::write(&path, "ncols 4\nnrows 3\n").expect("write");
    let error = source::tiff::TiffSource::open(&path, &Limits::default()).err().expect("not a TIFF");
    let message = error.to_string();
    assert!(matches!(error, Error::Unsupported { .. }) && message.contains("as text"), "{message}");
    assert!(!message.contains("ncols"), "{message}");
    let missing = folder.path().join("missing.tif");
    assert!(matches!(source::open(&missing, &Limits::default()), Err(Error::Io { .. })));
}
