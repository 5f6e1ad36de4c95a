//! Files to look at, and the program that looks at them.

#![allow(dead_code, reason = "every test file uses another part")]

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use relevo::geo::Geo;
use relevo::limits::Limits;
use relevo::pipeline::imagery::{Imagery, LayerOptions};
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::sample::SampleType;
use relevo::source::picture::{Picture, PictureInfo, PictureNote, Pixels};
use relevo::source::{self, Fingerprint, Samples, Source, SourceInfo, Window};
use relevo::texel::Colour;

/// The software adapter, where it is installed.
const LAVAPIPE: &str = "/usr/share/vulkan/icd.d/lvp_icd.x86_64.json";

/// Builds a fixture into a folder.
pub fn fixture(folder: &Path, name: &str, tile: u32, patch: u32) -> PathBuf {
    let dem = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/dem").join(name);
    let source = source::open(&dem, &Limits::default()).expect("fixture");
    let output = folder.join("fixture.rlv");
    let options = BuildOptions { tile, patch, ..BuildOptions::default() };
    pipeline::build(&*source, &output, &options, &Silent).expect("build");
    output
}

/// A square of float32 samples that no file holds, `spacing` metres apart.
pub fn info(side: u32, spacing: f64, name: &str) -> SourceInfo {
    SourceInfo {
        width: side,
        height: side,
        sample_type: SampleType::Float32,
        nodata: None,
        band_scale: 1.0,
        band_offset: 0.0,
        vertical_unit: (1.0, String::new()),
        geo: Geo { transform: Some([500_000.0, spacing, 0.0, 4_000_000.0, 0.0, -spacing]), ..Geo::default() },
        description: name.into(),
        parts: Vec::new(),
        footprint: None,
        overlap: None,
        block_rows: 64,
        reading: relevo::source::ReadMemory::default(),
        warnings: Vec::new(),
        origins: relevo::source::Origins::default(),
    }
}

/// Hills of ten metres a sample.
pub struct Hills(SourceInfo);

impl Hills {
    /// `side` samples on a side.
    pub fn new(side: u32) -> Self {
        Self(info(side, 10.0, "hills"))
    }

    /// Builds the file.
    pub fn build(&self, folder: &Path, tile: u32, patch: u32) -> PathBuf {
        let output = folder.join("hills.rlv");
        let options = BuildOptions { tile, patch, ..BuildOptions::default() };
        pipeline::build(self, &output, &options, &Silent).expect("build");
        output
    }
}

impl Source for Hills {
    fn info(&self) -> &SourceInfo {
        &self.0
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> relevo::Result<Window> {
        let height = |x: u32, y: u32| {
            let (u, v) = (x as f32 / 37.0, y as f32 / 29.0);
            let noise = (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(40_503_001)) >> 24;
            600.0
                + 250.0 * (u / 3.0).sin() * (v / 4.0).cos()
                + 30.0 * (u * 2.3).sin() * (v * 1.7).sin()
                + noise as f32 / 64.0
        };
        let heights = rows.flat_map(|y| columns.clone().map(move |x| height(x, y)));
        Ok(Window { samples: Samples::Float32(heights.collect()), mask: None })
    }

    fn fingerprint(&self) -> relevo::Result<Fingerprint> {
        Ok(Fingerprint { files: Vec::new() })
    }
}

/// The program, on the software adapter where it is installed.
pub fn viewer() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_relevo-viewer"));
    if Path::new(LAVAPIPE).exists() {
        command.env("VK_ICD_FILENAMES", LAVAPIPE);
    }
    // Mesa complains on standard error where there is none.
    command.env("XDG_RUNTIME_DIR", std::env::temp_dir());
    command
}

/// Runs it; fails with its words unless it ends with this code.
pub fn run(command: &mut Command, code: i32) -> (String, String) {
    let Output { status, stdout, stderr } = command.output().expect("the program starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, errors) = (text(&stdout), text(&stderr));
    assert_eq!(status.code(), Some(code), "{command:?}\n{out}\n{errors}");
    assert!(!errors.contains("panicked"), "{errors}");
    (out, errors)
}

/// The rows of a CSV file; each a list of numbers, NaN where there is none.
pub struct Table {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    /// Reads a file.
    pub fn read(path: &Path) -> Self {
        let text = std::fs::read_to_string(path).expect("csv");
        let mut lines = text.lines().map(|line| line.split(',').map(String::from).collect::<Vec<_>>());
        let columns = lines.next().expect("a header");
        let number =
            |field: &String| if field.is_empty() { f64::NAN } else { field.parse().expect("a number") };
        let rows: Vec<Vec<f64>> = lines.map(|line| line.iter().map(number).collect()).collect();
        assert!(rows.iter().all(|row| row.len() == columns.len()), "{text}");
        Self { columns, rows }
    }

    /// A column by name.
    pub fn column(&self, name: &str) -> Vec<f64> {
        let at = self.columns.iter().position(|column| column == name).expect("a column of that name");
        self.rows.iter().map(|row| row[at]).collect()
    }
}

/// Width, height and the RGB or RGBA bytes of a PNG.
pub fn png(path: &Path) -> (u32, u32, Vec<u8>, usize) {
    let file = std::io::BufReader::new(std::fs::File::open(path).expect("a picture"));
    let mut reader = png::Decoder::new(file).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("its size")];
    let info = reader.next_frame(&mut bytes).expect("its pixels");
    bytes.truncate(info.buffer_size());
    let channels = info.color_type.samples();
    (info.width, info.height, bytes, channels)
}

/// Share of the pixels that differ from the one in the upper left corner, which is sky.
pub fn covered(path: &Path) -> f64 {
    let (_, _, bytes, channels) = png(path);
    let sky = bytes[..channels].to_vec();
    let pixels = bytes.chunks_exact(channels);
    let count = pixels.len() as f64;
    pixels.filter(|pixel| **pixel != sky[..]).count() as f64 / count
}

/// A red and green chequerboard over [`Hills`], four texels a sample; a field is 64 texels wide.
pub struct Chequers(PictureInfo);

impl Chequers {
    /// Over hills of `side` samples.
    pub fn new(side: u32) -> Self {
        let transform = Some([500_000.0, 2.5, 0.0, 4_000_000.0, 0.0, -2.5]);
        let geo = Geo { transform, ..Geo::default() };
        let (width, height) = (4 * side, 4 * side);
        let note = PictureNote::default();
        Self(PictureInfo {
            width,
            height,
            kind: Colour::Rgb,
            has_alpha: false,
            geo,
            note,
            warnings: Vec::new(),
        })
    }
}

impl Picture for Chequers {
    fn info(&self) -> &PictureInfo {
        &self.0
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> relevo::Result<Pixels> {
        let colour =
            |x: u32, y: u32| if (x / 64 + y / 64).is_multiple_of(2) { [220, 20, 20] } else { [20, 220, 20] };
        let pixels = rows.flat_map(|y| columns.clone().flat_map(move |x| colour(x, y)));
        Ok(Pixels { colour: pixels.collect(), alpha: None })
    }

    fn fingerprint(&self) -> relevo::Result<Fingerprint> {
        Ok(Fingerprint { files: Vec::new() })
    }
}

/// Hills under chequers.
pub fn chequered(folder: &Path, side: u32) -> PathBuf {
    let output = folder.join("chequers.rlv");
    let options = BuildOptions { tile: 32, patch: 8, ..BuildOptions::default() };
    let layer = LayerOptions { tile: 64, ..LayerOptions::default() };
    let pictures: Vec<Box<dyn Picture>> = vec![Box::new(Chequers::new(side))];
    let imagery = Imagery { pictures: &pictures, options: layer };
    pipeline::build_with(&Hills::new(side), Some(&imagery), &output, &options, &Silent).expect("build");
    output
}
