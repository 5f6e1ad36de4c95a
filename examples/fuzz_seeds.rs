//! Writes the seeds of the fuzz targets into `fuzz/corpus`: small files of every kind, taken apart
//! as the targets want them. `cargo run --example fuzz_seeds`, then `fuzz/README.md`.

#![expect(clippy::expect_used, reason = "a program for the makers of this crate")]

use std::fs;
use std::path::{Path, PathBuf};

use relevo::limits::Limits;
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::source;

#[path = "../fuzz/targets.rs"]
#[allow(clippy::pedantic, clippy::expect_used, missing_docs)]
mod targets;

/// Bytes of a seed: large ones are slow, and all of them are to stay below 2 MB.
const MOST: usize = 8 << 10;

/// Virtual rasters of `a.tif`, which the target lays beside them: bands, sources, what they mean.
const VRTS: [&str; 7] = [
    r#"<VRTDataset rasterXSize="20" rasterYSize="20"><SRS dataAxisToSRSAxisMapping="1,2">EPSG:32613</SRS><GeoTransform>400000, 10, 0, 4500000, 0, -10</GeoTransform><Metadata><MDI key="AREA_OR_POINT">Point</MDI></Metadata><VRTRasterBand dataType="Int16" band="1"><NoDataValue>-999</NoDataValue><UnitType>ft</UnitType><Offset>1</Offset><Scale>0.1</Scale><ColorInterp>Gray</ColorInterp><SimpleSource><SourceFilename relativeToVRT="1">a.tif</SourceFilename><SourceBand>1</SourceBand><SourceProperties RasterXSize="20" RasterYSize="20" DataType="Int16" BlockXSize="20" BlockYSize="20"/><SrcRect xOff="0" yOff="0" xSize="20" ySize="20"/><DstRect xOff="0" yOff="0" xSize="20" ySize="20"/></SimpleSource></VRTRasterBand></VRTDataset>"#,
    r#"<VRTDataset rasterXSize="35" rasterYSize="20"><VRTRasterBand dataType="Float32" band="1"><NoDataValue>nan</NoDataValue><ComplexSource><SourceFilename relativeToVRT="1">a.tif</SourceFilename><SourceBand>1</SourceBand><SrcRect xOff="0" yOff="0" xSize="20" ySize="20"/><DstRect xOff="0" yOff="0" xSize="20" ySize="20"/><NODATA>-999</NODATA><ScaleOffset>3</ScaleOffset><ScaleRatio>0.5</ScaleRatio></ComplexSource><ComplexSource><SourceFilename relativeToVRT="1">a.tif</SourceFilename><SourceBand>1</SourceBand><SrcRect xOff="2" yOff="1" xSize="18" ySize="19"/><DstRect xOff="17" yOff="0" xSize="18" ySize="19"/><NODATA>0</NODATA></ComplexSource></VRTRasterBand></VRTDataset>"#,
    r#"<VRTDataset rasterXSize="20" rasterYSize="20"><VRTRasterBand dataType="Int16" band="1"><SimpleSource><SourceFilename relativeToVRT="1">a.tif</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand><MaskBand><VRTRasterBand dataType="Byte"><SimpleSource><SourceFilename relativeToVRT="1">a.tif</SourceFilename><SourceBand>mask,1</SourceBand></SimpleSource></VRTRasterBand></MaskBand></VRTDataset>"#,
    r#"<VRTDataset rasterXSize="20" rasterYSize="20"><VRTRasterBand dataType="Int16" band="1"><SimpleSource><SourceFilename relativeToVRT="1">x.vrt</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"#,
    r#"<VRTDataset rasterXSize="30" rasterYSize="30"><SRS>GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4326"]]</SRS><GeoTransform>-105, 0.001, 0.0001, 40, 0.0001, -0.001</GeoTransform><VRTRasterBand dataType="Float64" band="1"><SimpleSource><SourceFilename relativeToVRT="1">a.tif</SourceFilename><SourceBand>1</SourceBand><SrcRect xOff="0" yOff="0" xSize="20" ySize="20"/><DstRect xOff="5.004" yOff="4.996" xSize="20" ySize="20"/></SimpleSource></VRTRasterBand></VRTDataset>"#,
    r#"<VRTDataset rasterXSize="9" rasterYSize="9"><SRS>PROJCS["unknown",GEOGCS["unknown",DATUM["North_American_Datum_1983",SPHEROID["GRS 1980",6378137,298.257222101]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Lambert_Conformal_Conic_2SP"],PARAMETER["latitude_of_origin",39],PARAMETER["central_meridian",-96],PARAMETER["standard_parallel_1",33],PARAMETER["standard_parallel_2",45],PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["US survey foot",0.304800609601219]]</SRS><VRTRasterBand dataType="UInt16" band="1"><SimpleSource><SourceFilename relativeToVRT="1">a.tif</SourceFilename><SourceBand>1</SourceBand><SrcRect xOff="0" yOff="0" xSize="9" ySize="9"/><DstRect xOff="0" yOff="0" xSize="9" ySize="9"/></SimpleSource></VRTRasterBand></VRTDataset>"#,
    r#"<VRTDataset rasterXSize="9" rasterYSize="9"><SRS>COMPD_CS["WGS 84 + EGM96",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],VERT_CS["EGM96 height",VERT_DATUM["EGM96 geoid",2005],UNIT["metre",1],AXIS["Up",UP],AUTHORITY["EPSG","5773"]]]</SRS><VRTRasterBand dataType="Int16" band="1"><SimpleSource resampling="nearest"><SourceFilename relativeToVRT="1">a.tif</SourceFilename><SourceBand>1</SourceBand><SrcRect xOff="0" yOff="0" xSize="9" ySize="9"/><DstRect xOff="0" yOff="0" xSize="9" ySize="9"/></SimpleSource></VRTRasterBand><VRTRasterBand dataType="Byte" band="2"><ColorInterp>Alpha</ColorInterp></VRTRasterBand></VRTDataset>"#,
];

fn write(target: &str, name: &str, bytes: &[u8]) {
    if bytes.len() > MOST {
        return;
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target);
    fs::create_dir_all(&folder).expect("folder");
    fs::write(folder.join(name), bytes).expect("write");
}

/// Files with an extension below a folder of the project.
fn below(folder: &str, extension: &str) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)) else {
        return Vec::new();
    };
    let mut found: Vec<_> = entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).collect();
    found.retain(|path| path.extension().is_some_and(|own| own == extension));
    found.sort();
    found
}

fn name(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

fn main() {
    let small = |path: &PathBuf| fs::metadata(path).is_ok_and(|file| file.len() < 60_000);
    let folder = tempfile::tempdir().expect("folder");
    let dems = [below("fixtures/failing", "tif"), below("fixtures/dem", "tif")].concat();
    for dem in dems.iter().filter(|path| small(path)) {
        write("tiff", &name(dem), &fs::read(dem).expect("read"));
        let output = folder.path().join(name(dem) + ".rlv");
        let options = BuildOptions { tile: 16, patch: 4, force: true, ..BuildOptions::default() };
        let built = source::open(dem, &Limits::default())
            .and_then(|source| pipeline::build(&*source, &output, &options, &Silent));
        if built.is_ok() && small(&output) {
            seeds_of(&output);
        }
    }
    for file in below("fixtures/vectors", "rlv").iter().filter(|path| small(path)) {
        seeds_of(file);
    }
    for vrt in below("fixtures/failing", "vrt") {
        write("vrt", &name(&vrt), &fs::read(&vrt).expect("read"));
    }
    for (at, vrt) in VRTS.iter().enumerate() {
        write("vrt", &format!("kind{at}"), vrt.as_bytes());
    }
    write("tiff", "small", &targets::small_tiff(20));
    write("container", "small", &targets::take_apart(&small_container(folder.path())));
    for (at, seed) in targets::imagery_seeds().iter().enumerate() {
        write("imagery", &format!("codec{at}"), seed);
    }
    for (at, seed) in targets::piece_seeds().iter().enumerate() {
        write("work", &format!("file{at}"), seed);
    }
}

/// A container of few tiles.
fn small_container(folder: &Path) -> PathBuf {
    let (dem, output) = (folder.join("small.tif"), folder.join("small.rlv"));
    fs::write(&dem, targets::small_tiff(24)).expect("write");
    let source = source::open(&dem, &Limits::default()).expect("a raster");
    let options = BuildOptions { tile: 16, patch: 4, force: true, ..BuildOptions::default() };
    pipeline::build(&*source, &output, &options, &Silent).expect("built");
    output
}

/// A container as a seed of `container`, its first tiles as seeds of `tiles`.
fn seeds_of(file: &Path) {
    write("container", &name(file), &targets::take_apart(file));
    for (at, seed) in targets::chunks_of(file).iter().enumerate() {
        write("tiles", &format!("{}-{at}", name(file)), seed);
    }
}
