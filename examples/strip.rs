//! A survey of a pipeline (paper 001, section 6.3): overlapping square DEMs of 1 m along a winding
//! diagonal, and the VRT that places them in a virtual raster.
//!
//! `cargo run --release --example strip -- FOLDER [--count 300] [--side 1000] [--raster 4194304]
//! [--square]` writes `FOLDER/part-NNN.tif` and `FOLDER/strip.vrt`. With `--square` the same
//! squares stand side by side, as near to one square as they can: the same samples, for comparison.

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use relevo::geo::Geo;
use relevo::geotiff_write::{GeotiffSpec, GeotiffWriter};
use relevo::sample::SampleType;
use relevo::source::Samples;

struct Options {
    folder: PathBuf,
    count: u32,
    side: u32,
    raster: u32,
    square: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let options = options()?;
    fs::create_dir_all(&options.folder)?;
    let mut vrt = format!(
        "<VRTDataset rasterXSize=\"{0}\" rasterYSize=\"{0}\">\n  <SRS>EPSG:32633</SRS>\n  \
         <GeoTransform>0, 1, 0, {0}, 0, -1</GeoTransform>\n  <VRTRasterBand dataType=\"Float32\" band=\"1\">\n    \
         <NoDataValue>-9999</NoDataValue>\n",
        options.raster
    );
    for i in 0..options.count {
        let (x, y) = options.place(i);
        let name = format!("part-{i:03}.tif");
        options.write(&name, x, y)?;
        write!(
            vrt,
            "    <ComplexSource>\n      <SourceFilename relativeToVRT=\"1\">{name}</SourceFilename>\n      \
             <SourceBand>1</SourceBand>\n      <SrcRect xOff=\"0\" yOff=\"0\" xSize=\"{0}\" ySize=\"{0}\"/>\n      \
             <DstRect xOff=\"{x}\" yOff=\"{y}\" xSize=\"{0}\" ySize=\"{0}\"/>\n      <NODATA>-9999</NODATA>\n    \
             </ComplexSource>\n",
            options.side
        )?;
    }
    vrt.push_str("  </VRTRasterBand>\n</VRTDataset>\n");
    fs::write(options.folder.join("strip.vrt"), vrt)?;
    Ok(())
}

fn options() -> Result<Options, Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let folder = args.next().ok_or("expected a folder")?.into();
    let mut options = Options { folder, count: 300, side: 1000, raster: 1 << 22, square: false };
    while let Some(name) = args.next() {
        let mut number = || args.next().and_then(|word| word.parse().ok()).ok_or("expected a number");
        match name.as_str() {
            "--count" => options.count = number()?,
            "--side" => options.side = number()?,
            "--raster" => options.raster = number()?,
            "--square" => options.square = true,
            _ => return Err(format!("unknown option {name}").into()),
        }
    }
    Ok(options)
}

impl Options {
    /// North-west sample of a square. Along the diagonal each overlaps the next by about a third,
    /// and the line swings to both sides.
    fn place(&self, i: u32) -> (u32, u32) {
        if self.square {
            let columns = f64::from(self.count).sqrt().ceil() as u32;
            return (i % columns * self.side, i / columns * self.side);
        }
        let side = f64::from(self.side);
        let along = f64::from(i) * side * 0.5;
        let across = side * 4.0 * (f64::from(i) / 15.0).sin();
        let middle = f64::from(self.raster) / 2.0 - f64::from(self.count) * side * 0.25;
        let place = |v: f64| v.clamp(0.0, f64::from(self.raster - self.side)) as u32;
        (place(middle + along + across), place(middle + along - across))
    }

    fn write(&self, name: &str, x: u32, y: u32) -> Result<(), Box<dyn Error>> {
        let transform = [f64::from(x), 1.0, 0.0, f64::from(self.raster) - f64::from(y), 0.0, -1.0];
        let mut geo = Geo { transform: Some(transform), ..Geo::default() };
        geo.crs.epsg = Some(32633);
        geo.crs.kind = relevo::geo::CrsKind::Projected;
        let mut spec = GeotiffSpec::new(self.side, self.side, SampleType::Float32, &geo);
        spec.nodata = Some(-9999.0);
        let mut writer = GeotiffWriter::create(self.folder.join(name), &spec)?;
        for row in y..y + self.side {
            let samples = (x..x + self.side).map(|column| height(column, row)).collect();
            writer.write_rows(&Samples::Float32(samples))?;
        }
        writer.finish()?;
        Ok(())
    }
}

/// Hills, gullies and a rough ground in centimetres: the same wherever two squares overlap.
fn height(column: u32, row: u32) -> f32 {
    let (x, y) = (f64::from(column), f64::from(row));
    let hills = 120.0 * ((x / 1900.0).sin() * (y / 2300.0).cos() + 1.0);
    let gullies = 8.0 * ((x + 0.4 * y) / 83.0).sin() + 5.0 * ((0.3 * x - y) / 37.0).cos();
    let hash = (column.wrapping_mul(0x9E37_79B9) ^ row.wrapping_mul(0x85EB_CA6B)).wrapping_mul(0xC2B2_AE35);
    let rough = f64::from(hash >> 24) / 255.0 * 0.3;
    (((hills + gullies + rough) * 100.0).round() / 100.0) as f32
}
