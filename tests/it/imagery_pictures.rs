//! Pictures as they are read, held against what GDAL reads of the same files, which it also writes.
//!
//! Where `gdal_translate` or the shared data is missing only what needs neither is tested.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use relevo::geo::{Crs, CrsKind};
use relevo::limits::Limits;
use relevo::source::picture::{self, Picture, PictureOptions, Pixels, Stretch};
use relevo::texel::Colour;

fn shared(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("{name} is not there: not tested");
    None
}

/// Runs a program of GDAL's; false if it is not installed.
fn run(program: &str, words: &[&str], from: &Path, to: &Path) -> bool {
    let mut command = Command::new(program);
    let Ok(output) = command.arg("-q").args(words).arg(from).arg(to).output() else {
        eprintln!("{program} is not there: not tested");
        return false;
    };
    assert!(output.status.success(), "{program} {words:?}: {}", String::from_utf8_lossy(&output.stderr));
    true
}

fn open_with(path: &Path, options: &PictureOptions) -> relevo::Result<Box<dyn Picture>> {
    let crs = Crs { epsg: Some(4326), kind: CrsKind::Geographic, unit: 1_f64.to_radians(), ..Crs::default() };
    let all = picture::open_all(&[path.to_owned()], options, &crs, &Limits::default())?;
    Ok(all.into_iter().next().expect("one"))
}

fn read(path: &Path, options: &PictureOptions) -> (Box<dyn Picture>, Pixels) {
    let picture = open_with(path, options).expect("picture");
    let (width, height) = (picture.info().width, picture.info().height);
    let pixels = picture.read_window(0..width, 0..height).expect("pixels");
    (picture, pixels)
}

/// What GDAL reads of these bands, pixel by pixel.
fn gdal(path: &Path, words: &[&str]) -> Vec<u8> {
    let raw = path.with_extension("raw");
    let words: Vec<&str> =
        ["-of", "ENVI", "-co", "INTERLEAVE=BIP"].into_iter().chain(words.iter().copied()).collect();
    assert!(run("gdal_translate", &words, path, &raw));
    fs::read(&raw).expect("raw")
}

fn largest_difference(a: &[u8], b: &[u8]) -> u8 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
}

fn mean_difference(a: &[u8], b: &[u8]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
}

#[test]
fn lossless_variants_are_what_gdal_reads() {
    let Some(source) = shared("rmnp_rgb.tif") else { return };
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("variant.tif");
    let tiled = ["-co", "TILED=YES", "-co", "BLOCKXSIZE=64", "-co", "BLOCKYSIZE=48"];
    let variants: [(&[&str], bool); 10] = [
        (&["-co", "COMPRESS=NONE"], false),
        (&["-co", "COMPRESS=NONE", "-co", "BLOCKYSIZE=373"], false),
        (&["-co", "COMPRESS=NONE", "-co", "INTERLEAVE=BAND", "-co", "BLOCKYSIZE=60"], false),
        (&["-co", "COMPRESS=LZW", "-co", "PREDICTOR=2", "-co", "INTERLEAVE=BAND"], false),
        (&["-co", "COMPRESS=DEFLATE", "-co", "PREDICTOR=2"], true),
        (&["-co", "COMPRESS=ZSTD", "-co", "INTERLEAVE=BAND"], true),
        (&["-co", "COMPRESS=PACKBITS", "-co", "PHOTOMETRIC=MINISBLACK"], false),
        (&["-co", "COMPRESS=DEFLATE", "-co", "ENDIANNESS=BIG", "-co", "BIGTIFF=YES"], true),
        (&["-co", "COMPRESS=DEFLATE", "-ot", "UInt16", "-co", "PREDICTOR=2", "-co", "ENDIANNESS=BIG"], true),
        (&["-co", "COMPRESS=NONE", "-ot", "UInt16", "-co", "INTERLEAVE=BAND"], true),
    ];
    let expected = fs::read(&source).is_ok().then(|| gdal_copy(&source, folder.path())).flatten();
    let Some(expected) = expected else { return };
    for (words, tiles) in variants {
        let words: Vec<&str> = words.iter().chain(if tiles { &tiled[..] } else { &[] }).copied().collect();
        assert!(run("gdal_translate", &words, &source, &path));
        // 16 bits hold the same values: a stretch from 0 to 255 gives them back.
        let wide = words.contains(&"UInt16");
        let stretch = wide.then_some(Stretch::Range(0.0, 255.0));
        let (picture, pixels) = read(&path, &PictureOptions { bands: None, stretch });
        assert_eq!(
            (picture.info().kind, picture.info().width, picture.info().height),
            (Colour::Rgb, 485, 373)
        );
        assert!(pixels.colour == expected, "{words:?}");
        let alpha = pixels.alpha.expect("nodata");
        let hidden = |pixel: &[u8]| if pixel == [255; 3] { 0 } else { 255 };
        assert!(expected.chunks_exact(3).map(hidden).eq(alpha), "{words:?}");
        // Windows are parts of the whole.
        for (columns, rows) in
            [(0..1, 0..1), (63..65, 47..49), (100..485, 7..200), (484..485, 372..373), (5..5, 3..9)]
        {
            let part = picture.read_window(columns.clone(), rows.clone()).expect("window").colour;
            let whole =
                rows.flat_map(|y| &expected[(y * 485 + columns.start) as usize * 3..][..columns.len() * 3]);
            assert!(whole.copied().eq(part), "{words:?}");
        }
        assert!(picture.read_window(0..486, 0..1).is_err());
    }
}

fn gdal_copy(source: &Path, folder: &Path) -> Option<Vec<u8>> {
    let copy = folder.join("copy.tif");
    run("gdal_translate", &[], source, &copy).then(|| gdal(&copy, &[]))
}

#[test]
fn bands_are_chosen() {
    let Some(source) = shared("rmnp_rgb.tif") else { return };
    let folder = tempfile::tempdir().expect("folder");
    let Some(all) = gdal_copy(&source, folder.path()) else { return };
    let with = |bands: &[u32]| read(&source, &PictureOptions { bands: Some(bands.to_vec()), stretch: None });
    let (picture, pixels) = with(&[3, 1, 2]);
    assert!(all.chunks_exact(3).flat_map(|p| [p[2], p[0], p[1]]).eq(pixels.colour));
    assert_eq!(picture.info().note.bands, [3, 1, 2]);
    let (picture, pixels) = with(&[2]);
    assert!(all.chunks_exact(3).map(|p| p[1]).eq(pixels.colour) && picture.info().kind == Colour::Grey);
    // The last of two or four is alpha; 255 is nodata of grey as well.
    let (_, pixels) = with(&[2, 3]);
    let alpha = all.chunks_exact(3).map(|p| if p[1] == 255 { 0 } else { p[2] });
    assert!(alpha.eq(pixels.alpha.expect("alpha")));
    for wrong in [&[4][..], &[1, 2, 3, 1, 2], &[0], &[]] {
        assert!(open_with(&source, &PictureOptions { bands: Some(wrong.to_vec()), stretch: None }).is_err());
    }
}

#[test]
fn jpeg_is_close_to_libjpeg() {
    let Some(source) = shared("rmnp_rgb.tif") else { return };
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("variant.tif");
    let jpeg = ["-a_nodata", "none", "-co", "COMPRESS=JPEG", "-co", "JPEG_QUALITY=90"];
    let variants: [&[&str]; 6] = [
        &["-co", "PHOTOMETRIC=YCBCR", "-co", "TILED=YES"],
        &["-co", "PHOTOMETRIC=YCBCR"],
        &["-co", "PHOTOMETRIC=RGB", "-co", "TILED=YES", "-co", "BLOCKXSIZE=128", "-co", "BLOCKYSIZE=80"],
        &["-co", "INTERLEAVE=BAND", "-co", "TILED=YES"],
        &["-b", "1", "-co", "BLOCKYSIZE=40"],
        &["-b", "1", "-b", "2", "-b", "3", "-b", "3", "-co", "ALPHA=YES", "-co", "PHOTOMETRIC=RGB"],
    ];
    for words in variants {
        let words: Vec<&str> = jpeg.iter().chain(words).copied().collect();
        if !run("gdal_translate", &words, &source, &path) {
            return;
        }
        let (picture, pixels) = read(&path, &PictureOptions::default());
        let channels = picture.info().kind.channels();
        let mut own = pixels.colour;
        if let Some(alpha) = pixels.alpha {
            own = own.chunks_exact(3).zip(alpha).flat_map(|(p, a)| [p[0], p[1], p[2], a]).collect();
        }
        let expected = gdal(&path, &[]);
        // Decoders may differ in the last bits, and in how they enlarge colour between its samples.
        let (most, mean) = (largest_difference(&own, &expected), mean_difference(&own, &expected));
        let ycbcr = words.contains(&"PHOTOMETRIC=YCBCR");
        assert!(
            if ycbcr { mean < 0.6 && most < 30 } else { most <= 2 },
            "{words:?}, {channels}: {most} {mean}"
        );
    }
}

/// PNG, WebP and JPEG: the pixels that GDAL reads, where the sidecar or a world file says.
#[test]
fn encoded_pictures_are_what_gdal_reads() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/imagery/rmnp_rgb.tif");
    let folder = tempfile::tempdir().expect("folder");
    let rgb = ["-b", "1", "-b", "2", "-b", "3"];
    let wide = ["-ot", "UInt16", "-scale", "0", "255", "0", "65535"];
    let variants: [(&str, Vec<&str>); 8] = [
        ("png", rgb.to_vec()),
        ("png", vec!["-b", "2"]),
        ("png", vec!["-b", "1", "-b", "2", "-b", "3", "-b", "2", "-colorinterp_4", "alpha"]),
        ("png", vec!["-b", "1", "-b", "2", "-colorinterp_2", "alpha"]),
        ("png", [&rgb[..], &wide].concat()),
        ("webp", [&rgb[..], &["-co", "LOSSLESS=YES"]].concat()),
        ("jpg", [&rgb[..], &["-co", "QUALITY=90"]].concat()),
        ("jpg", vec!["-b", "3", "-co", "QUALITY=90"]),
    ];
    for (extension, words) in variants {
        let path = folder.path().join(format!("picture.{extension}"));
        let words: Vec<&str> = ["-a_nodata", "none", "-mask", "none"].into_iter().chain(words).collect();
        if !run("gdal_translate", &words, &source, &path) {
            return;
        }
        let options = PictureOptions { stretch: Some(Stretch::Range(0.0, 65535.0)), ..Default::default() };
        let is_wide = words.contains(&"UInt16");
        let options = if is_wide { options } else { PictureOptions::default() };
        let (picture, pixels) = read(&path, &options);
        let transform = picture.info().geo.transform.expect("the sidecar's place");
        let mut own = pixels.colour;
        if let Some(alpha) = pixels.alpha {
            let channels = picture.info().kind.channels();
            let with = |(colour, &alpha): (&[u8], &u8)| [colour, &[alpha]].concat();
            own = own.chunks_exact(channels).zip(&alpha).flat_map(with).collect();
        }
        let mut expected = gdal(&path, &[]);
        if is_wide {
            let samples = expected.chunks_exact(2).map(|b| f64::from(u16::from_le_bytes([b[0], b[1]])));
            expected = samples.map(|sample| (sample / 257.0).round() as u8).collect();
        }
        let (most, mean) = (largest_difference(&own, &expected), mean_difference(&own, &expected));
        let is_close = if extension == "jpg" { mean < 0.6 && most < 30 } else { most == 0 };
        assert!(is_close, "{words:?}: {most} {mean}");
        assert!(picture.info().note.description.to_lowercase().contains(&extension[..2]));
        // Without the sidecar a world file is enough, whose letters are those of the extension.
        fs::remove_file(folder.path().join(format!("picture.{extension}.aux.xml"))).expect("sidecar");
        assert!(open_with(&path, &options).is_err(), "nowhere");
        let letters = extension.as_bytes();
        let world = format!("{}{}w", letters[0] as char, letters[letters.len() - 1] as char);
        let [west, dx, _, north, _, dy] = transform;
        let text = format!("{dx}\n0\n0\n{dy}\n{}\n{}\n", west + dx / 2.0, north + dy / 2.0);
        let world = path.with_extension(world);
        fs::write(&world, text).expect("world file");
        let again = open_with(&path, &options).expect("placed").info().geo.transform.expect("place");
        assert!(again.iter().zip(transform).all(|(a, b)| (a - b).abs() < 1e-9), "{again:?} {transform:?}");
        fs::remove_file(&path).expect("done");
        fs::remove_file(&world).expect("done");
    }
}

#[test]
fn encoded_pictures_that_are_damaged_are_refused() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/imagery/rmnp_rgb.tif");
    let folder = tempfile::tempdir().expect("folder");
    for (extension, least) in [("png", 60), ("webp", 60), ("jpg", 700)] {
        let path = folder.path().join(format!("picture.{extension}"));
        let words =
            ["-a_nodata", "none", "-mask", "none", "-b", "1", "-b", "2", "-b", "3", "-outsize", "60", "50"];
        if !run("gdal_translate", &words, &source, &path) {
            return;
        }
        let whole = fs::read(&path).expect("bytes");
        for end in (0..least).chain((least..whole.len() / 2).step_by(97)) {
            fs::write(&path, &whole[..end]).expect("cut");
            let read = open_with(&path, &PictureOptions::default()).and_then(|picture| {
                let info = picture.info().clone();
                picture.read_window(0..info.width, 0..info.height)
            });
            let message = read.err().unwrap_or_else(|| panic!("{extension} cut at {end}")).to_string();
            assert!(message.contains("picture."), "{message}");
        }
    }
}

/// A JPEG block whose byte count is too small: GDAL warns and reads grey, here it is an error.
#[test]
fn jpeg_blocks_that_are_cut_off_are_refused() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/imagery/rmnp_rgb.tif");
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("cut.tif");
    for words in [
        &["-a_nodata", "none", "-co", "COMPRESS=JPEG", "-co", "TILED=YES"][..],
        &["-a_nodata", "none", "-co", "COMPRESS=JPEG", "-co", "PHOTOMETRIC=YCBCR"],
    ] {
        if !run("gdal_translate", words, &source, &path) {
            return;
        }
        read(&path, &PictureOptions::default());
        let mut bytes = fs::read(&path).expect("bytes");
        let u32_at = |bytes: &[u8], at: usize| {
            u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize
        };
        let directory = u32_at(&bytes, 4);
        let entries = usize::from(u16::from_le_bytes([bytes[directory], bytes[directory + 1]]));
        let tag = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        let counts = (0..entries).map(|n| directory + 2 + 12 * n).find(|&at| matches!(tag(at), 279 | 325));
        let counts = counts.expect("byte counts");
        let size = if bytes[counts + 2] == 3 { 2 } else { 4 };
        let (at, first) = (u32_at(&bytes, counts + 8), u32_at(&bytes, u32_at(&bytes, counts + 8)));
        let first = if size == 2 { first & 0xFFFF } else { first };
        bytes[at..at + size].copy_from_slice(&(first as u32 / 2).to_le_bytes()[..size]);
        fs::write(&path, &bytes).expect("written");
        let picture = open_with(&path, &PictureOptions::default()).expect("its tags are good");
        let read = picture.read_window(0..10, 0..10);
        assert!(read.is_err_and(|error| error.to_string().contains("cut.tif")), "{words:?}");
    }
}

#[test]
fn the_world_in_ycbcr() {
    let Some(source) = shared("bmng_world_5400x2700_geo.tif") else { return };
    let folder = tempfile::tempdir().expect("folder");
    let copy = folder.path().join("part.tif");
    if !run("gdal_translate", &["-srcwin", "2500", "600", "700", "500"], &source, &copy) {
        return;
    }
    let expected = gdal(&copy, &[]);
    let picture = open_with(&source, &PictureOptions::default()).expect("picture");
    let own = picture.read_window(2500..3200, 600..1100).expect("window");
    assert!(own.alpha.is_none());
    let (most, mean) = (largest_difference(&own.colour, &expected), mean_difference(&own.colour, &expected));
    assert!(mean < 0.6 && most < 30, "{most} {mean}");
}

#[test]
fn alpha_and_masks_hide() {
    let Some(source) = shared("rmnp_rgb.tif") else { return };
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("variant.tif");
    let Some(all) = gdal_copy(&source, folder.path()) else { return };
    let bands = ["-b", "1", "-b", "2", "-b", "3"];
    let deflate = ["-co", "COMPRESS=DEFLATE", "-co", "TILED=YES"];
    // A fourth band as alpha, of 8 and of 16 bits.
    let alpha = ["-a_nodata", "none", "-b", "1", "-co", "ALPHA=YES", "-colorinterp_4", "alpha"];
    for more in [&[][..], &["-co", "INTERLEAVE=BAND"]] {
        let words: Vec<&str> = bands.iter().chain(&deflate).chain(&alpha).chain(more).copied().collect();
        run("gdal_translate", &words, &source, &path);
        let (picture, pixels) = read(&path, &PictureOptions::default());
        assert_eq!((picture.info().kind, pixels.colour == all), (Colour::Rgb, true));
        assert!(all.chunks_exact(3).map(|p| p[0]).eq(pixels.alpha.expect("alpha")));
    }
    // A mask of the third band, in the file and beside it.
    for inside in ["YES", "NO"] {
        let mask = ["-a_nodata", "none", "-mask", "3", "--config", "GDAL_TIFF_INTERNAL_MASK", inside];
        let words: Vec<&str> = bands.iter().chain(&deflate).chain(&mask).copied().collect();
        let path = folder.path().join(format!("mask_{inside}.tif"));
        run("gdal_translate", &words, &source, &path);
        let (picture, pixels) = read(&path, &PictureOptions::default());
        assert_eq!(picture.fingerprint().expect("files").files.len(), if inside == "NO" { 2 } else { 1 });
        let alpha = pixels.alpha.expect("mask");
        let hidden = all.chunks_exact(3).map(|p| p[2] == 0);
        assert!(hidden.eq(alpha.iter().map(|&a| a == 0)), "{inside}");
    }
}

#[test]
fn palettes_and_bits() {
    let folder = tempfile::tempdir().expect("folder");
    if let Some(source) = shared("zion_nlcd_classes.tif") {
        let crs = Crs { epsg: Some(26912), kind: CrsKind::Projected, ..Crs::default() };
        let all = picture::open_all(
            std::slice::from_ref(&source),
            &PictureOptions::default(),
            &crs,
            &Limits::default(),
        );
        let picture = &all.expect("picture")[0];
        let pixels = picture.read_window(0..1073, 0..1359).expect("pixels");
        let copy = folder.path().join("zion.tif");
        if run("gdal_translate", &["-expand", "rgb", "-a_nodata", "none"], &source, &copy) {
            assert!(pixels.colour == gdal(&copy, &[]));
            assert_eq!(picture.info().kind, Colour::Rgb);
        }
    }
    let Some(source) = shared("rmnp_rgb.tif") else { return };
    for photometric in ["PHOTOMETRIC=MINISBLACK", "PHOTOMETRIC=MINISWHITE"] {
        let path = folder.path().join("bits.tif");
        let words = [
            "-b",
            "1",
            "-a_nodata",
            "none",
            "-scale",
            "0",
            "254",
            "0",
            "1.99",
            "-co",
            "NBITS=1",
            "-co",
            photometric,
        ];
        if !run("gdal_translate", &words, &source, &path) {
            return;
        }
        let (_, pixels) = read(&path, &PictureOptions::default());
        let white_is_zero = photometric.ends_with("WHITE");
        let byte = |bit: u8| if (bit > 0) == white_is_zero { 0 } else { 255 };
        assert!(gdal(&path, &[]).into_iter().map(byte).eq(pixels.colour), "{photometric}");
    }
}

#[test]
fn wide_samples_are_stretched_by_one_rule() {
    let Some(source) = shared("rmnp_rgb.tif") else { return };
    let folder = tempfile::tempdir().expect("folder");
    let Some(all) = gdal_copy(&source, folder.path()) else { return };
    // Values 1000 + 13 v, of nodata as well; two halves.
    let plain = folder.path().join("plain.tif");
    run("gdal_translate", &["-a_nodata", "none"], &source, &plain);
    let words = ["-ot", "UInt16", "-scale", "0", "254", "1000", "4302", "-co", "COMPRESS=DEFLATE"];
    let whole = folder.path().join("wide.tif");
    run("gdal_translate", &words, &plain, &whole);
    let halves = [("west.tif", "0"), ("east.tif", "240")].map(|(name, left)| {
        let path = folder.path().join(name);
        run("gdal_translate", &["-srcwin", left, "0", "240", "373"], &whole, &path);
        path
    });
    let with = |stretch| read(&whole, &PictureOptions { bands: None, stretch });
    let (picture, pixels) = with(Some(Stretch::Range(1000.0, 1000.0 + 255.0 * 13.0)));
    assert!(largest_difference(&pixels.colour, &all) <= 1);
    assert_eq!(picture.info().note.stretch, [(1000.0, 4315.0); 3]);
    let (picture, _) = with(Some(Stretch::MinMax));
    let ends = |band: usize| {
        let values = || all.iter().skip(band).step_by(3).map(|&v| f64::from(v));
        (1000.0 + 13.0 * values().fold(255.0, f64::min), 1000.0 + 13.0 * values().fold(0.0, f64::max))
    };
    for (band, got) in picture.info().note.stretch.iter().enumerate() {
        assert!(
            (got.0 - ends(band).0).abs() < 14.0 && (got.1 - ends(band).1).abs() < 14.0,
            "{band}: {got:?}"
        );
    }
    // Two per cent at either end, unless told otherwise; counted on a part of the values, and at
    // the white border.
    let (picture, pixels) = with(None);
    let low = picture.info().note.stretch[0].0;
    let below = all.iter().step_by(3).filter(|&&v| 1000.0 + 13.0 * f64::from(v) < low).count();
    assert!((0.0..0.03).contains(&(below as f64 / (485.0 * 373.0))));
    assert!(pixels.colour.contains(&0) && pixels.colour.contains(&255));
    // Both halves get the same ranges.
    let crs = picture.info().geo.crs.clone();
    let both =
        picture::open_all(&halves, &PictureOptions::default(), &crs, &Limits::default()).expect("both");
    assert_eq!(both[0].info().note.stretch, both[1].info().note.stretch);
    assert_eq!(both[0].info().note.stretch.len(), 3);
    for wrong in [Stretch::Percent(50.0, 20.0), Stretch::Range(3.0, 3.0)] {
        assert!(open_with(&whole, &PictureOptions { bands: None, stretch: Some(wrong) }).is_err());
    }
}

#[test]
fn sparse_files_are_known_to_be_empty() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("sparse.tif");
    let Some(source) = shared("rmnp_rgb.tif") else { return };
    let words = ["-co", "SPARSE_OK=TRUE", "-co", "TILED=YES", "-co", "BLOCKXSIZE=64", "-co", "BLOCKYSIZE=64"];
    let nodata = ["-a_nodata", "0", "-srcwin", "-1000", "-1000", "3000", "3000"];
    if !run("gdal_translate", &[&words[..], &nodata].concat(), &source, &path) {
        return;
    }
    let (picture, pixels) = read(&path, &PictureOptions::default());
    assert!(!picture.may_show(0..900, 0..900) && picture.may_show(0..3000, 0..3000));
    let alpha = pixels.alpha.expect("nodata");
    assert!(alpha[..3000 * 900].iter().all(|&a| a == 0) && alpha[3000 * 1100 + 1100] == 255);
}

#[test]
fn what_cannot_be_read_says_why() {
    let Some(source) = shared("rmnp_rgb.tif") else { return };
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("plain.tif");
    let message =
        |path: &Path| open_with(path, &PictureOptions::default()).err().expect("refused").to_string();
    if !run("gdal_translate", &["-co", "PROFILE=BASELINE"], &source, &path) {
        return;
    }
    fs::remove_file(path.with_extension("tif.aux.xml")).ok();
    fs::remove_file(path.with_extension("tfw")).ok();
    let refused = message(&path);
    assert!(refused.contains("plain.tif") && refused.contains("-a_ullr"), "{refused}");
    // A world file is enough.
    fs::write(path.with_extension("tfw"), "0.0015\n0\n0\n-0.0015\n-106.0\n40.5\n").expect("written");
    let geo = open_with(&path, &PictureOptions::default()).expect("placed").info().geo.clone();
    assert_eq!(geo.crs.epsg, Some(4326));
    assert!((geo.transform.expect("place")[0] + 106.00075).abs() < 1e-12);
    if cfg!(not(feature = "gdal")) {
        let other = shared("sfbay_landsat7_rgb_nodata.tif").expect("there like the other");
        let refused = message(&other);
        assert!(refused.contains("EPSG:3857") && refused.contains("EPSG:4326"), "{refused}");
        assert!(refused.contains("sfbay_landsat7") && refused.contains("--features gdal"), "{refused}");
        let jpeg = shared("bmng_world_5400x2700.jpg").expect("there like the other");
        assert!(message(&jpeg).contains("does not say where it lies"));
    }
    // Damage is an error, whatever it is.
    let mut bytes =
        fs::read(shared("bmng_world_5400x2700_geo.tif").expect("there like the other")).expect("bytes");
    let length = bytes.len();
    for at in (length / 2..length).step_by(997) {
        bytes[at] ^= 0x55;
    }
    let damaged = folder.path().join("damaged.tif");
    fs::write(&damaged, &bytes).expect("written");
    if let Ok(picture) = open_with(&damaged, &PictureOptions::default()) {
        let read = picture.read_window(0..5400, 0..2700);
        assert!(read.is_err_and(|error| error.to_string().contains("damaged.tif")));
    }
}

#[cfg(feature = "gdal")]
#[test]
fn other_formats_and_coordinate_systems_come_through_gdal() {
    let folder = tempfile::tempdir().expect("folder");
    if let Some(source) = shared("bmng_world_5400x2700.jpg") {
        let path = folder.path().join("world.jpg");
        fs::copy(&source, &path).expect("copy");
        let message = open_with(&path, &PictureOptions::default()).err().expect("nowhere").to_string();
        assert!(message.contains("world.jpg"), "{message}");
        let pixel = 360.0 / 5400.0;
        let place = format!("{pixel}\n0\n0\n-{pixel}\n{}\n{}\n", pixel / 2.0 - 180.0, 90.0 - pixel / 2.0);
        fs::write(path.with_extension("jgw"), place).expect("written");
        let picture = open_with(&path, &PictureOptions::default()).expect("placed");
        assert!((picture.info().geo.transform.expect("place")[0] + 180.0).abs() < 1e-9);
        let own = picture.read_window(1000..1900, 990..1100).expect("window");
        let part = folder.path().join("part.tif");
        if run("gdal_translate", &["-srcwin", "1000", "990", "900", "110"], &path, &part) {
            // Natively: decoders differ in the last bits.
            let expected = gdal(&part, &[]);
            assert!(mean_difference(&own.colour, &expected) < 0.6);
        }
    }
    if let Some(source) = shared("sfbay_landsat7_rgb_nodata.tif") {
        let (picture, pixels) = read(&source, &PictureOptions::default());
        let warped = folder.path().join("warped.tif");
        let words = ["-t_srs", "EPSG:4326", "-dstalpha", "-r", "bilinear", "-wo", "UNIFIED_SRC_NODATA=YES"];
        if run("gdalwarp", &words, &source, &warped) {
            let expected = gdal(&warped, &[]);
            let alpha = pixels.alpha.expect("nodata");
            let own = pixels.colour.chunks_exact(3).zip(alpha).flat_map(|(p, a)| [p[0], p[1], p[2], a]);
            let own: Vec<u8> = own.collect();
            // GDAL warps in chunks, between which it rounds in another way.
            assert!(mean_difference(&own, &expected) < 0.01);
        }
        assert_eq!(picture.info().geo.crs.epsg, Some(4326));
        assert!(picture.info().note.description.contains("warped"));
    }
}
