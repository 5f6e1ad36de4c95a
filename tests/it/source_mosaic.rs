//! Do many files read as one? Against a plain loop over all files, against GDAL, and with files
//! that do not fit.
//!
//! The comparisons with GDAL fail without its command line tools: a check that is skipped proves
//! nothing.

mod random;
mod refused;
mod vrt;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;

use assert_cmd::cargo::cargo_bin_cmd;
use relevo::geo::{Crs, CrsKind, Geo};
use relevo::geotiff_write::{Compression, GeotiffSpec, GeotiffWriter};
use relevo::limits::Limits;
use relevo::sample::SampleType;
use relevo::source::{self, OpenOptions, Overlap, Samples, Source, Window};

/// A file to be written.
#[derive(Clone, Debug)]
struct Tile {
    /// Column and row of its first sample on the common grid.
    at: (i64, i64),
    size: (u32, u32),
    kind: SampleType,
    nodata: Option<f64>,
    scale: (f64, f64),
    unit: &'static str,
    epsg: Option<u32>,
    values: Vec<f64>,
}

impl Tile {
    fn new(at: (i64, i64), size: (u32, u32), kind: SampleType, value: impl Fn(u32, u32) -> f64) -> Self {
        let values =
            (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect();
        Self { at, size, kind, nodata: None, scale: (1.0, 0.0), unit: "", epsg: Some(32632), values }
    }

    fn write(&self, path: &Path) {
        let transform = [
            400_000.0 + 30.0 * self.at.0 as f64,
            30.0,
            0.0,
            5_000_000.0 - 30.0 * self.at.1 as f64,
            0.0,
            -30.0,
        ];
        self.write_at(path, transform);
    }

    fn write_at(&self, path: &Path, transform: [f64; 6]) {
        let kind = if self.epsg.is_some() { CrsKind::Projected } else { CrsKind::Engineering };
        let crs = Crs { kind, epsg: self.epsg, ..Crs::default() };
        let geo = Geo { transform: Some(transform), crs, ..Geo::default() };
        let spec = GeotiffSpec {
            nodata: self.nodata,
            band_scale: self.scale.0,
            band_offset: self.scale.1,
            unit: self.unit,
            compression: if self.size.0.is_multiple_of(2) { Compression::Deflate } else { Compression::None },
            tile: self.size.1.is_multiple_of(2).then_some(16),
            force: true,
            ..GeotiffSpec::new(self.size.0, self.size.1, self.kind, &geo)
        };
        let mut writer = GeotiffWriter::create(path, &spec).expect("create");
        writer.write_rows(&pack(self.kind, &self.values)).expect("write");
        writer.finish().expect("finish");
    }

    /// The real value at a place of the common grid, if this file has a valid one.
    fn sample(&self, x: i64, y: i64) -> Option<f64> {
        let (x, y) = (x - self.at.0, y - self.at.1);
        if x < 0 || y < 0 || x >= self.size.0.into() || y >= self.size.1.into() {
            return None;
        }
        let value = self.values[y as usize * self.size.0 as usize + x as usize];
        (value.is_finite() && self.nodata != Some(value)).then_some(value)
    }
}

fn pack(kind: SampleType, values: &[f64]) -> Samples {
    let all = values.iter();
    match kind {
        SampleType::Int8 => Samples::Int8(all.map(|&v| v as i8).collect()),
        SampleType::Uint8 => Samples::Uint8(all.map(|&v| v as u8).collect()),
        SampleType::Int16 => Samples::Int16(all.map(|&v| v as i16).collect()),
        SampleType::Uint16 => Samples::Uint16(all.map(|&v| v as u16).collect()),
        SampleType::Int32 => Samples::Int32(all.map(|&v| v as i32).collect()),
        SampleType::Uint32 => Samples::Uint32(all.map(|&v| v as u32).collect()),
        SampleType::Float32 => Samples::Float32(all.map(|&v| v as f32).collect()),
        SampleType::Float64 => Samples::Float64(all.copied().collect()),
    }
}

fn join(paths: &[PathBuf], overlap: Overlap) -> Box<dyn Source> {
    let options = OpenOptions { overlap, ..OpenOptions::default() };
    source::open_all(paths, &options, &Limits::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Why files are refused.
fn refusal(paths: &[PathBuf]) -> String {
    let opened = source::open_all(paths, &OpenOptions::default(), &Limits::default());
    opened.err().expect("refused").to_string()
}

fn run(tool: &str, arguments: &[&str]) -> String {
    let output = Command::new(tool).args(arguments).env("GDAL_PAM_ENABLED", "NO").output().unwrap_or_else(|error| {
        panic!("cannot run {tool} ({error}): these tests need the GDAL command line tools (apt-get install gdal-bin)")
    });
    let messages = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{tool} {}: {messages}", arguments.join(" "));
    String::from_utf8(output.stdout).expect("text")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("path")
}

/// What GDAL reads, every sample as a float64, which holds all types.
fn gdal_values(path: &Path, folder: &Path) -> Vec<f64> {
    // In its own type first: a VRT computes in that of the buffer.
    let [own, raw] = ["own.bin", "dump.bin"].map(|name| folder.join(name));
    run("gdal_translate", &["-q", "-of", "ENVI", "-b", "1", text(path), text(&own)]);
    run("gdal_translate", &["-q", "-of", "ENVI", "-ot", "Float64", text(&own), text(&raw)]);
    let bytes = std::fs::read(&raw).expect("raw dump");
    bytes.as_chunks::<8>().0.iter().map(|&eight| f64::from_ne_bytes(eight)).collect()
}

/// Values of a window; `None` where void.
fn values(source: &dyn Source, columns: Range<u32>, rows: Range<u32>) -> Vec<Option<f64>> {
    let window = source.read_window(columns, rows).expect("window");
    assert_eq!(window.samples.sample_type(), source.info().sample_type);
    let value = |at: usize| (!void(&window, at, source)).then(|| window.samples.value(at));
    (0..window.samples.len()).map(value).collect()
}

fn void(window: &Window, at: usize, source: &dyn Source) -> bool {
    window.is_void(at, source.info().voids())
}

fn shared(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("{name} is not there: not tested");
    None
}

/// Kind of the metadata section.
const METADATA: u32 = 1;

/// Builds with the program itself.
fn build(dems: &[&Path], options: &[&str], output: &Path) -> Vec<u8> {
    cargo_bin_cmd!("relevo").arg("build").args(dems).args(options).arg("-o").arg(output).assert().success();
    std::fs::read(output).expect("output")
}

#[test]
fn a_vrt_and_its_tiles_give_the_same_bytes() {
    let folder = tempfile::tempdir().expect("folder");
    let names = ["georgia_pair.vrt", "N49W124_srtm3_int16_voids.tif", "N49W123_srtm3_int16_voids.tif"];
    let [Some(vrt), Some(west), Some(east)] = names.map(shared) else { return };
    let one = build(&[&vrt], &[], &folder.path().join("vrt.rlv"));
    let two = build(&[&west, &east], &[], &folder.path().join("tiles.rlv"));
    // All but the metadata, which say where each thing was found: in the VRT, in the keys of the
    // tiles.
    let parts = |file: &[u8], name: &str| {
        let reader = relevo::container::Reader::open(folder.path().join(name)).expect("container");
        let part = |section: &relevo::container::sections::SectionEntry| {
            (section.kind, file[section.offset as usize..section.end() as usize].to_vec())
        };
        let mut parts: Vec<_> =
            reader.sections().iter().map(part).filter(|(kind, _)| *kind != METADATA).collect();
        parts.sort_unstable_by_key(|(kind, _)| *kind);
        parts
    };
    assert!(parts(&one, "vrt.rlv") == parts(&two, "tiles.rlv"), "{} and {} bytes", one.len(), two.len());
    // The seam column is the same in both: the order matters to the record of sources alone.
    let turned = join(&[east.clone(), west.clone()], Overlap::First);
    let straight = join(&[west, east], Overlap::Last);
    assert_eq!(turned.info().geo.transform, straight.info().geo.transform);
    let all = |source: &dyn Source| values(source, 0..2401, 0..1201);
    assert_eq!(all(&*turned), all(&*straight));
    let reader = relevo::container::Reader::open(folder.path().join("vrt.rlv")).expect("open");
    assert_eq!(reader.metadata().options["overlap"], "last");
}

#[test]
fn one_file_is_not_a_mosaic() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("one.tif");
    Tile::new((0, 0), (40, 30), SampleType::Int16, |x, y| f64::from(x * y)).write(&path);
    let source = join(std::slice::from_ref(&path), Overlap::Max);
    assert_eq!(source.info().overlap, None);
    assert_eq!(source.info().footprint, None);
    let bytes = build(&[&path], &[], &folder.path().join("one.rlv"));
    let reader = relevo::container::Reader::open(folder.path().join("one.rlv")).expect("open");
    assert!(reader.metadata().options.get("overlap").is_none(), "{} bytes", bytes.len());
}

#[test]
fn an_srtm_tile_is_what_gdal_reads() {
    let folder = tempfile::tempdir().expect("folder");
    let mut tiles: Vec<PathBuf> = shared("N44W072.hgt").into_iter().collect();
    for (name, side) in [("S03e179.SRTMGL1.HGT", 1201_u32), ("n60W001.hgt", 3601)] {
        let path = folder.path().join(name);
        let height = |index: u32| if index.is_multiple_of(97) { -32768 } else { (index % 9000) as i16 - 400 };
        let bytes: Vec<u8> = (0..side * side).flat_map(|index| height(index).to_be_bytes()).collect();
        std::fs::write(&path, bytes).expect("write");
        tiles.push(path);
    }
    for path in tiles {
        let source = source::open(&path, &Limits::default()).expect("open");
        let info = source.info();
        let json: serde_json::Value =
            serde_json::from_str(&run("gdalinfo", &["-json", text(&path)])).expect("JSON");
        assert_eq!(json["size"], serde_json::json!([info.width, info.height]));
        let vrt = run("gdal_translate", &["-q", "-of", "VRT", text(&path), "/vsistdout/"]);
        let six = vrt.split("<GeoTransform>").nth(1).and_then(|rest| rest.split('<').next()).expect("six");
        let six: Vec<f64> = six.split(',').map(|number| number.trim().parse().expect("number")).collect();
        assert_eq!(info.geo.transform.expect("transform").to_vec(), six, "{}", path.display());
        assert_eq!((info.geo.crs.epsg, info.geo.pixel_is_point), (Some(4326), true));
        assert_eq!((info.nodata, info.vertical_unit.1.as_str()), (Some(-32768.0), "m"));
        let theirs = gdal_values(&path, folder.path());
        let ours = source.read_rows(0..info.height).expect("rows");
        assert!((0..theirs.len()).all(|at| ours.samples.value(at) == theirs[at]), "{}", path.display());
        let window = source.read_window(7..30, 11..19).expect("window");
        let expected = (11..19_usize).flat_map(|y| (7..30).map(move |x| (x, y)));
        let expected: Vec<f64> = expected.map(|(x, y)| theirs[y * info.width as usize + x]).collect();
        assert!((0..expected.len()).all(|at| window.samples.value(at) == expected[at]));
    }
}
