//! Which samples of a file are valid, which band is taken, and what is warned of: files written
//! byte by byte, read, built, verified and exported; what is exported is held against GDAL's own
//! reading.
//!
//! The comparisons with GDAL fail without its command line tools: a check that is skipped proves
//! nothing.

mod plain_tiff;
mod warned;

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use self::plain_tiff::{Kind, Tiff};
use relevo::container::reader::Reader;
use relevo::limits::Limits;
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::source::{self, OpenOptions, Source};
use relevo::verify::{VerifyOptions, verify};

/// Columns and rows of all files here.
const SIZE: (u32, u32) = (9, 7);

fn relevo(folder: &Path, args: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_relevo");
    Command::new(program).current_dir(folder).args(args).output().expect("the binary runs")
}

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn open(path: &Path, options: &OpenOptions) -> Box<dyn Source> {
    source::open_all(&[path.to_owned()], options, &Limits::default()).expect("open")
}

/// Values of valid samples, `None` for voids.
fn samples(source: &dyn Source) -> Vec<Option<f64>> {
    let info = source.info();
    let window = source.read_rows(0..info.height).expect("rows");
    let count = info.width as usize * info.height as usize;
    let voids = info.voids();
    (0..count).map(|at| (!window.is_void(at, voids)).then(|| window.samples.value(at))).collect()
}

/// Samples of a ramp that begins at a value.
fn ramp(first: f64) -> Vec<f64> {
    (0..SIZE.0 * SIZE.1).map(|index| first + f64::from(index)).collect()
}

fn tiff(kind: Kind, bands: &[Vec<f64>]) -> Tiff {
    Tiff::new(SIZE, kind, bands.to_vec())
}

/// What is expected of a band where only samples at some places are void.
fn but(values: &[f64], void: &[usize]) -> Vec<Option<f64>> {
    let sample = |(index, &value): (usize, &f64)| (!void.contains(&index)).then_some(value);
    values.iter().enumerate().map(sample).collect()
}

/// Builds a file, verifies it against its source, and exports it to `out.tif`, whose samples it
/// gives back.
fn round_trip(folder: &Path, path: &Path, options: &OpenOptions) -> Vec<Option<f64>> {
    let source = open(path, options);
    let (output, exported) = (folder.join("out.rlv"), folder.join("out.tif"));
    let build =
        BuildOptions { tile: 16, patch: 4, force: true, nodata: options.nodata, ..BuildOptions::default() };
    pipeline::build(&*source, &output, &build, &Silent).expect("build");
    let reader = Reader::open(&output).expect("reader");
    let report = verify(&reader, Some(&*source), &VerifyOptions::default(), &Silent).expect("verify");
    assert!(report.is_good(), "{}: {:?}", path.display(), report.checks);
    let to = relevo(folder, &["export", "out.rlv", "-o", "out.tif", "--force"]);
    assert!(to.status.success(), "{}", told(&to));
    samples(&*open(&exported, &OpenOptions::default()))
}

/// True where GDAL's mask of band 1 says valid.
fn gdal_mask(folder: &Path, name: &str) -> Vec<bool> {
    let to = folder.join("mask.bin");
    let made = Command::new("gdal_translate")
        .current_dir(folder)
        .args(["-q", "-b", "mask", "-of", "ENVI", name, "mask.bin"])
        .output()
        .expect("gdal_translate runs");
    assert!(made.status.success(), "{}", told(&made));
    fs::read(to).expect("mask").into_iter().map(|byte| byte != 0).collect()
}

#[test]
fn nodata_is_void_from_end_to_end_however_it_is_written() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("a.tif");
    let lowest = f64::from(f32::MIN);
    let close = f64::from((-9999.9_f32).next_up());
    let cases = [
        (Kind::F32, "-3.4e+38", lowest),
        (Kind::F32, "-3.40282e+38", lowest),
        (Kind::F32, "-3.4028234663852886e+38", lowest),
        (Kind::F32, "-3.40282306073709652508e+38", lowest),
        (Kind::F32, "1.175494351e-38", f64::from(f32::MIN_POSITIVE)),
        (Kind::F32, "-9999.9", close),
        (Kind::F64, "-3.4028235e+38", lowest),
        (Kind::F64, "-9999.90", close),
        (Kind::I16, "-32768.4", -32768.0),
        (Kind::I32, "-9999.7", -9999.0),
        (Kind::U8, "254.9", 254.0),
        (Kind::U16, " 65535 m", 65535.0),
    ];
    for (kind, text, void) in cases {
        let mut values = ramp(100.0);
        values[5] = void;
        values[40] = void;
        Tiff { nodata: Some(text.to_owned()), ..tiff(kind, &[values.clone()]) }.write(&path);
        let expected = but(&values, &[5, 40]);
        let options = OpenOptions::default();
        assert_eq!(samples(&*open(&path, &options)), expected, "{text} of {kind:?}");
        assert_eq!(round_trip(folder.path(), &path, &options), expected, "{text} of {kind:?}, exported");
        let valid: Vec<bool> = expected.iter().map(Option::is_some).collect();
        assert_eq!(gdal_mask(folder.path(), "a.tif"), valid, "{text} of {kind:?}, to GDAL");
        assert_eq!(gdal_mask(folder.path(), "out.tif"), valid, "{text} of {kind:?}, exported, to GDAL");
        // The same said by the user.
        tiff(kind, &[values.clone()]).write(&path);
        let nodata = text.trim().trim_end_matches(" m").parse().ok();
        let options = OpenOptions { nodata, ..OpenOptions::default() };
        assert_eq!(round_trip(folder.path(), &path, &options), expected, "--nodata {text} of {kind:?}");
    }
}

#[test]
fn a_mask_alone_counts_inside_and_beside() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("a.tif");
    let mut values = ramp(100.0);
    values[3] = -9999.0;
    let mask: Vec<bool> = (0..values.len()).map(|index| index != 20).collect();
    for inside in [true, false] {
        let nodata = Some("-9999".to_owned());
        let tiff = Tiff { nodata, ..tiff(Kind::I16, &[values.clone()]) };
        if inside {
            Tiff { mask: Some(mask.clone()), ..tiff }.write(&path);
        } else {
            tiff.write(&path);
            let metadata = Some(flags(1, 2));
            let bytes = mask.iter().map(|&valid| f64::from(u8::from(valid) * 255)).collect();
            let beside = Tiff { metadata, ..self::tiff(Kind::U8, &[bytes]) };
            beside.write(&folder.path().join("a.tif.msk"));
        }
        let source = open(&path, &OpenOptions::default());
        assert_eq!(samples(&*source), but(&values, &[20]), "inside: {inside}");
        assert_eq!(gdal_mask(folder.path(), "a.tif"), mask, "inside: {inside}, to GDAL");
        let warnings = source.info().warnings.join("\n");
        assert!(warnings.contains("-9999") && warnings.contains("mask alone counts"), "{warnings}");
        assert_eq!(round_trip(folder.path(), &path, &OpenOptions::default()), but(&values, &[20]));
        assert_eq!(gdal_mask(folder.path(), "out.tif"), mask, "inside: {inside}, exported");
        // What the user says comes on top.
        let both = OpenOptions { nodata: Some(-9999.0), ..OpenOptions::default() };
        assert_eq!(round_trip(folder.path(), &path, &both), but(&values, &[3, 20]));
        assert!(open(&path, &both).info().warnings.is_empty());
    }
}

#[test]
fn a_vrt_has_the_masks_of_its_files() {
    let folder = tempfile::tempdir().expect("folder");
    let mut values = ramp(100.0);
    values[3] = -9999.0;
    let mask: Vec<bool> = (0..values.len()).map(|index| index != 20).collect();
    let tiff = Tiff { nodata: Some("-9999".to_owned()), ..tiff(Kind::I16, &[values.clone()]) };
    for masked in [true, false] {
        let mask = masked.then(|| mask.clone());
        Tiff { mask, ..tiff.clone() }.write(&folder.path().join("a.tif"));
        let source = |band: &str| {
            format!(
                "<SimpleSource><SourceFilename relativeToVRT=\"1\">a.tif</SourceFilename><SourceBand>{band}</SourceBand>\
                 <SrcRect xOff=\"0\" yOff=\"0\" xSize=\"9\" ySize=\"7\"/><DstRect xOff=\"0\" yOff=\"0\" xSize=\"9\" ySize=\"7\"/>\
                 </SimpleSource></VRTRasterBand>"
            )
        };
        let vrt = |of_mask: &str| {
            format!(
                "<VRTDataset rasterXSize=\"9\" rasterYSize=\"7\"><VRTRasterBand dataType=\"Int16\" band=\"1\">\
                 <NoDataValue>-9999</NoDataValue>{}<MaskBand><VRTRasterBand dataType=\"Byte\">{}</MaskBand></VRTDataset>",
                source("1"),
                source(of_mask)
            )
        };
        let path = folder.path().join("a.vrt");
        fs::write(&path, vrt("mask,1")).expect("write");
        let void = if masked { 20 } else { 3 };
        let expected = but(&values, &[void]);
        assert_eq!(samples(&*open(&path, &OpenOptions::default())), expected, "masked: {masked}");
        let valid: Vec<bool> = expected.iter().map(Option::is_some).collect();
        assert_eq!(gdal_mask(folder.path(), "a.vrt"), valid, "masked: {masked}, to GDAL");
        // A mask of other samples is left to GDAL.
        fs::write(&path, vrt("1")).expect("write");
        let refused = relevo(folder.path(), &["build", "a.vrt", "-o", "b.rlv"]);
        assert!(cfg!(feature = "gdal") || told(&refused).contains("mask"), "{}", told(&refused));
    }
}

/// The metadata of a mask beside a file.
fn flags(band: u32, flags: u32) -> String {
    format!("<GDALMetadata>\n  <Item name=\"INTERNAL_MASK_FLAGS_{band}\">{flags}</Item>\n</GDALMetadata>\n")
}

#[test]
fn a_mask_beside_a_file_counts_for_the_bands_that_it_names() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("a.tif");
    let bands = [ramp(100.0), ramp(5000.0)];
    tiff(Kind::I16, &bands).write(&path);
    let half = |first: bool| {
        (0..63).map(|index| f64::from(u8::from((index < 30) == first) * 255)).collect::<Vec<f64>>()
    };
    let lower: Vec<usize> = (0..30).collect();
    let upper: Vec<usize> = (30..63).collect();
    let band = |band| OpenOptions { band: Some(band), ..OpenOptions::default() };
    // Flags, then what they make void of band 1 and of band 2.
    for (metadata, one, two) in [
        (Some(flags(2, 0)), &[][..], &lower[..]),
        (Some(flags(1, 0)), &upper[..], &[][..]),
        (Some(flags(1, 2)), &upper[..], &[][..]),
        (None, &[][..], &[][..]),
    ] {
        Tiff { metadata: metadata.clone(), ..tiff(Kind::U8, &[half(true), half(false)]) }
            .write(&folder.path().join("a.tif.msk"));
        assert_eq!(samples(&*open(&path, &band(1))), but(&bands[0], one), "{metadata:?}");
        assert_eq!(samples(&*open(&path, &band(2))), but(&bands[1], two), "{metadata:?}");
        let valid: Vec<bool> = (0..63).map(|index| !one.contains(&index)).collect();
        assert_eq!(gdal_mask(folder.path(), "a.tif"), valid, "{metadata:?}, to GDAL");
    }
}

#[test]
fn alpha_is_a_mask_in_every_type_and_arrangement() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("a.tif");
    let mut alpha = vec![255.0; 63];
    (alpha[7], alpha[8], alpha[9]) = (0.0, 1.0, 100.0);
    let heights = ramp(100.0);
    for kind in [Kind::U8, Kind::U16, Kind::I16, Kind::F32, Kind::F64] {
        for planar in [false, true] {
            for meaning in [1, 2] {
                let extra = vec![meaning];
                let two = Tiff { planar, extra, ..tiff(kind, &[heights.clone(), alpha.clone()]) };
                two.write(&path);
                let source = open(&path, &OpenOptions::default());
                let place = format!("{kind:?}, planar: {planar}");
                assert_eq!(samples(&*source), but(&heights, &[7]), "{place}");
                assert!(source.info().warnings.is_empty(), "{place}: {:?}", source.info().warnings);
                assert_eq!(round_trip(folder.path(), &path, &OpenOptions::default()), but(&heights, &[7]));
                // GDAL knows alpha of these two types only.
                if matches!(kind, Kind::U8 | Kind::U16) {
                    let valid: Vec<bool> = alpha.iter().map(|&alpha| alpha != 0.0).collect();
                    assert_eq!(gdal_mask(folder.path(), "a.tif"), valid, "{place}, to GDAL");
                }
                // A nodata value goes before, as in GDAL.
                Tiff { nodata: Some("110".to_owned()), ..two.clone() }.write(&path);
                let source = open(&path, &OpenOptions::default());
                assert_eq!(samples(&*source), but(&heights, &[10]), "{place}");
                assert!(source.info().warnings.iter().any(|text| text.contains("alpha")), "{place}");
            }
        }
    }
    // No alpha: a band of something else.
    Tiff { extra: vec![0], ..tiff(Kind::U16, &[heights.clone(), alpha.clone()]) }.write(&path);
    assert_eq!(samples(&*open(&path, &OpenOptions::default())), but(&heights, &[]));
    // Nor one before others, which to GDAL says nothing of them.
    let bands = [heights.clone(), alpha, heights.clone()];
    Tiff { extra: vec![2, 0], ..tiff(Kind::U16, &bands) }.write(&path);
    assert_eq!(samples(&*open(&path, &OpenOptions::default())), but(&heights, &[]));
    assert_eq!(gdal_mask(folder.path(), "a.tif"), [true; 63]);
}

#[test]
fn any_band_can_be_chosen() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("a.tif");
    let bands: Vec<Vec<f64>> = (0..4).map(|band| ramp(1000.0 * f64::from(band))).collect();
    let item = |band: u32, name: &str, text: &str| {
        format!("<Item name=\"{0}\" sample=\"{band}\" role=\"{name}\">{text}</Item>", name.to_uppercase())
    };
    let items =
        [item(0, "scale", "9"), item(2, "scale", "0.5"), item(2, "offset", "7"), item(2, "unittype", "ft")];
    let metadata = Some(format!("<GDALMetadata>{}</GDALMetadata>", items.concat()));
    for kind in [Kind::I16, Kind::F32] {
        for planar in [false, true] {
            Tiff { planar, metadata: metadata.clone(), ..tiff(kind, &bands) }.write(&path);
            for (index, values) in (1..).zip(&bands) {
                let options = OpenOptions { band: Some(index), ..OpenOptions::default() };
                let source = open(&path, &options);
                assert_eq!(samples(&*source), but(values, &[]), "band {index}, planar: {planar}");
                assert!(source.info().warnings.is_empty(), "{:?}", source.info().warnings);
                let info = source.info();
                let (scale, offset) =
                    if index == 3 { (0.5, 7.0) } else { (if index == 1 { 9.0 } else { 1.0 }, 0.0) };
                assert_eq!((info.band_scale, info.band_offset), (scale, offset), "band {index}");
                assert_eq!(info.vertical_unit.0, if index == 3 { 0.3048 } else { 1.0 }, "band {index}");
                // Part of the rows and columns of it.
                let window = source.read_window(2..5, 3..5).expect("window");
                let expected: Vec<f64> = [29, 30, 31, 38, 39, 40].map(|at| values[at]).to_vec();
                let got: Vec<f64> = (0..6).map(|at| window.samples.value(at)).collect();
                assert_eq!(got, expected, "band {index}, planar: {planar}");
            }
            assert!(!open(&path, &OpenOptions::default()).info().warnings.is_empty());
        }
    }
    let vrt = "<VRTDataset rasterXSize=\"9\" rasterYSize=\"7\"><VRTRasterBand dataType=\"Float32\" band=\"1\">\
               <SimpleSource><SourceFilename relativeToVRT=\"1\">a.tif</SourceFilename><SourceBand>4</SourceBand></SimpleSource>\
               </VRTRasterBand><VRTRasterBand dataType=\"Float32\" band=\"2\">\
               <SimpleSource><SourceFilename relativeToVRT=\"1\">a.tif</SourceFilename><SourceBand>2</SourceBand></SimpleSource>\
               </VRTRasterBand></VRTDataset>";
    fs::write(folder.path().join("a.vrt"), vrt).expect("write");
    for (index, values) in [(None, &bands[3]), (Some(1), &bands[3]), (Some(2), &bands[1])] {
        let source =
            open(&folder.path().join("a.vrt"), &OpenOptions { band: index, ..OpenOptions::default() });
        assert_eq!(samples(&*source), but(values, &[]), "{index:?}");
    }
    for (name, band, words) in
        [("a.tif", "5", "one of bands 1 to 4"), ("a.vrt", "3", "one of bands 1 to 2"), ("a.tif", "0", "1..")]
    {
        let refused = relevo(folder.path(), &["build", name, "-o", "b.rlv", "--band", band]);
        let message = told(&refused);
        assert_eq!(refused.status.code(), Some(2), "{message}");
        assert!(message.contains(words) && (band == "0" || message.contains(name)), "{message}");
    }
    let built = relevo(folder.path(), &["build", "a.tif", "-o", "b.rlv", "--band", "2", "--verify"]);
    assert!(built.status.success(), "{}", told(&built));
    let other = relevo(folder.path(), &["verify", "b.rlv", "--source", "a.tif"]);
    assert_eq!(other.status.code(), Some(1), "band 1 is not band 2");
}

#[test]
fn a_full_range_of_bytes_is_exported_with_a_mask() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("a.tif");
    let values: Vec<f64> = (0..300 * 40).map(|index| f64::from(index % 256)).collect();
    let mask: Vec<bool> = (0..values.len()).map(|index| index % 7 != 3 && index / 300 != 20).collect();
    let tiff = Tiff { mask: Some(mask.clone()), ..Tiff::new((300, 40), Kind::U8, vec![values.clone()]) };
    tiff.write(&path);
    let expected: Vec<Option<f64>> =
        values.iter().zip(&mask).map(|(&value, &valid)| valid.then_some(value)).collect();
    assert_eq!(round_trip(folder.path(), &path, &OpenOptions::default()), expected);
    assert_eq!(gdal_mask(folder.path(), "out.tif"), mask);
    // A tile of it too.
    let tile = relevo(folder.path(), &["export", "out.rlv", "--tile", "5/0/0", "-o", "tile.tif"]);
    if tile.status.success() {
        let valid = gdal_mask(folder.path(), "tile.tif");
        let own: Vec<bool> = (0..17 * 17).map(|at| mask[at / 17 * 300 + at % 17]).collect();
        assert_eq!(valid, own);
    } else {
        assert!(told(&tile).contains("tile"), "{}", told(&tile));
    }
}
