//! What a raster is, by its tags and by the files beside it: every pair of places that can say the
//! same, in GDAL's order.
//!
//! The expected values are the readings of GDAL 3.6.2 (`gdalinfo`), but for those of `.prj`, which
//! it passes over.

mod pictures;
mod tiff;

use std::path::Path;

use relevo::geo::{Crs, CrsKind};
use relevo::limits::Limits;
use relevo::source::{OpenOptions, Origin, Source, SourceInfo, open, open_all};

use self::tiff::{Raster, Spec, Tag};

const TAGS: [f64; 6] = [100.0, 2.0, 0.0, 200.0, 0.0, -2.0];
const AUX: [f64; 6] = [500.0, 3.0, 0.0, 600.0, 0.0, -3.0];
const WORLD: [f64; 6] = [1000.0, 10.0, 0.0, 2000.0, 0.0, -10.0];
const AUX_PLACE: &str = "<GeoTransform>500,3,0,600,0,-3</GeoTransform>";
const AUX_SRS: &str = "<SRS dataAxisToSRSAxisMapping=\"1,2\">EPSG:32611</SRS>";
const TFW: &str = "10\n0\n0\n-10\n1005\n1995\n";
const ESRI: &str = "PROJCS[\"WGS_1984_UTM_Zone_13N\",GEOGCS[\"GCS_WGS_1984\",DATUM[\"D_WGS_1984\",\
    SPHEROID[\"WGS_1984\",6378137.0,298.257223563]],PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]],\
    PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"False_Easting\",500000.0],PARAMETER[\"False_Northing\",0.0],\
    PARAMETER[\"Central_Meridian\",-105.0],PARAMETER[\"Scale_Factor\",0.9996],PARAMETER[\"Latitude_Of_Origin\",0.0],\
    UNIT[\"Meter\",1.0]]";

fn source(raster: &Raster) -> Box<dyn Source> {
    open(raster.path(), &Limits::default()).unwrap_or_else(|error| panic!("{error}"))
}

fn info(raster: &Raster) -> SourceInfo {
    source(raster).info().clone()
}

fn place(raster: &Raster) -> (Option<[f64; 6]>, Option<Origin>) {
    let info = info(raster);
    (info.geo.transform, info.origins.place)
}

fn crs(raster: &Raster) -> (Option<u32>, Option<Origin>) {
    let info = info(raster);
    (info.geo.crs.epsg, info.origins.crs)
}

fn scale(raster: &Raster) -> (f64, f64, Option<Origin>) {
    let info = info(raster);
    assert_eq!(info.origins.scale, info.origins.offset);
    (info.band_scale, info.band_offset, info.origins.scale)
}

fn unit(raster: &Raster) -> (f64, String, Option<Origin>) {
    let info = info(raster);
    (info.vertical_unit.0, info.vertical_unit.1, info.origins.unit)
}

fn nodata(raster: &Raster) -> (Option<f64>, Option<Origin>) {
    let info = info(raster);
    (info.nodata, info.origins.nodata)
}

#[expect(clippy::unnecessary_wraps, reason = "as it is compared")]
fn aux() -> Option<Origin> {
    Some(Origin::AuxXml("dem.tif.aux.xml".to_owned()))
}

#[expect(clippy::unnecessary_wraps, reason = "as it is compared")]
fn world(name: &str) -> Option<Origin> {
    Some(Origin::WorldFile(name.to_owned()))
}

#[test]
fn nothing_says_nothing() {
    let info = info(&Spec::default().write());
    assert_eq!(info.origins, relevo::source::Origins::default());
    assert_eq!((info.geo.transform, info.nodata, info.band_scale, info.band_offset), (None, None, 1.0, 0.0));
    assert!(info.warnings.is_empty() && info.geo.crs.kind == CrsKind::Engineering);
}

#[test]
fn a_sidecar_alone_says_everything() {
    let band = "<NoDataValue>-5</NoDataValue><UnitType>ft</UnitType><Offset>7</Offset><Scale>0.5</Scale>";
    let point = "<Metadata><MDI key=\"AREA_OR_POINT\">Point</MDI></Metadata>";
    let raster = Spec::default().write().aux(&[AUX_PLACE, AUX_SRS, point].concat(), band);
    assert_eq!(place(&raster), (Some(AUX), aux()));
    assert_eq!(crs(&raster), (Some(32611), aux()));
    assert_eq!(nodata(&raster), (Some(-5.0), aux()));
    assert_eq!(unit(&raster), (0.3048, "ft".to_owned(), aux()));
    assert_eq!(scale(&raster), (0.5, 7.0, aux()));
    assert!(info(&raster).geo.pixel_is_point && info(&raster).warnings.is_empty());
}

#[test]
fn place_of_sidecar_tags_and_world_file() {
    assert_eq!(place(&Spec::default().placed().write()), (Some(TAGS), Some(Origin::Tag(33550))));
    assert_eq!(place(&Spec::default().placed().write().aux(AUX_PLACE, "")), (Some(AUX), aux()));
    let identity = "<GeoTransform>0,1,0,0,0,1</GeoTransform>";
    let unmoved = Some([0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(place(&Spec::default().placed().write().aux(identity, "")), (unmoved, aux()));
    assert_eq!(place(&Spec::default().write().with("dem.tfw", TFW)), (Some(WORLD), world("dem.tfw")));
    let tags = Spec::default().placed().write().with("dem.tfw", TFW);
    assert_eq!(place(&tags), (Some(TAGS), Some(Origin::Tag(33550))));
    assert_eq!(place(&Spec::default().write().with("dem.tfw", TFW).aux(AUX_PLACE, "")), (Some(AUX), aux()));
    assert_eq!(
        place(&Spec::default().write().with("dem.tfw", TFW).aux(AUX_SRS, "")),
        (Some(WORLD), world("dem.tfw"))
    );
    // A world file names centres of pixels, whatever a pixel is to the keys.
    let point = Spec::default().keys(1, &[(1024, 1), (1025, 2), (3072, 32612)]).write().with("dem.tfw", TFW);
    assert_eq!(place(&point), (Some(WORLD), world("dem.tfw")));
    assert!(info(&point).geo.pixel_is_point);
}

#[test]
fn world_files_by_any_name() {
    for name in
        ["dem.tfw", "dem.TFW", "dem.Tfw", "dem.tifw", "dem.TIFW", "dem.wld", "dem.WLD", "dem.Wld", "DEM.tfw"]
    {
        assert_eq!(place(&Spec::default().write().with(name, TFW)), (Some(WORLD), world(name)), "{name}");
    }
    for name in ["dem.tiffw", "dem.tif.tfw", "dem.tif.wld", "dem.tfwx", "dem.jgw", "den.tfw"] {
        assert_eq!(place(&Spec::default().write().with(name, TFW)), (None, None), "{name}");
    }
    let other = TFW.replace("10\n", "20\n");
    let two = |first, second| Spec::default().write().with(first, TFW).with(second, &other);
    assert_eq!(place(&two("dem.tfw", "dem.wld")).1, world("dem.tfw"));
    assert_eq!(place(&two("dem.tifw", "dem.tfw")).1, world("dem.tfw"));
    for (raster, name) in [
        ("a.tiff", "a.tfw"),
        ("a.tiff", "a.tiffw"),
        ("a.TIF", "a.tfw"),
        ("a.dem", "a.dmw"),
        ("a", "a.wld"),
        ("a.b.tif", "a.b.tfw"),
    ] {
        assert_eq!(place(&Spec::default().write_as(raster).with(name, TFW)).1, world(name), "{raster}");
    }
}

#[test]
fn a_world_file_that_is_none_is_warned_of() {
    for text in ["", "10\n0\n0\n-10\n1005\n", "10\n0\n0\n0\n1005\n1995", "inf\n0\n0\n-10\n1005\n1995\n"] {
        let info = info(&Spec::default().write().with("dem.tfw", text));
        assert_eq!((info.geo.transform, info.warnings.len()), (None, 1), "{text:?}");
        assert!(info.warnings[0].contains("dem.tfw"), "{:?}", info.warnings);
    }
}

#[test]
fn coordinate_system_of_sidecar_keys_and_prj() {
    assert_eq!(crs(&Spec::default().placed().projected(32612).write()), (Some(32612), Some(Origin::GeoKeys)));
    assert_eq!(
        crs(&Spec::default().placed().projected(32612).write().aux(AUX_SRS, "")),
        (Some(32611), aux())
    );
    assert_eq!(
        crs(&Spec::default().placed().projected(32612).write().aux(AUX_PLACE, "")),
        (Some(32612), Some(Origin::GeoKeys))
    );
    assert_eq!(crs(&Spec::default().placed().projected(32612).write().aux("<SRS></SRS>", "")), (None, aux()));
    let esri = format!(
        "<Metadata domain=\"xml:ESRI\" format=\"xml\"><GeodataXform><SpatialReference><WKT>{ESRI}</WKT></SpatialReference></GeodataXform></Metadata>"
    );
    let by_esri = |more: &str| {
        let info = info(&Spec::default().placed().projected(32612).write().aux(&(esri.clone() + more), ""));
        (info.geo.crs.name, info.geo.crs.epsg, info.origins.crs)
    };
    let (name, _, origin) = by_esri("");
    assert!(name.contains("13N") && origin == aux(), "{name}");
    assert_eq!(by_esri(AUX_SRS).1, Some(32611));
    // Beyond GDAL: a `.prj` where nothing else names the coordinates of a place.
    let prj = Some(Origin::Prj("dem.prj".to_owned()));
    let utm = |crs: &Crs| crs.kind == CrsKind::Projected && crs.unit == 1.0 && crs.name.contains("13N");
    for raster in [Spec::default().write().with("dem.tfw", TFW), Spec::default().placed().write()] {
        let found = info(&raster.with("dem.prj", ESRI));
        assert!(found.origins.crs == prj && utm(&found.geo.crs), "{:?}", found.geo.crs);
    }
    assert_eq!(crs(&Spec::default().write().with("dem.prj", ESRI)), (None, None));
    assert_eq!(
        crs(&Spec::default().placed().projected(32612).write().with("dem.prj", ESRI)),
        (Some(32612), Some(Origin::GeoKeys))
    );
    assert_eq!(
        crs(&Spec::default().placed().write().with("dem.prj", ESRI).aux(AUX_SRS, "")),
        (Some(32611), aux())
    );
}

#[test]
fn a_coordinate_system_that_is_not_understood_is_refused_by_name() {
    for (raster, name) in [
        (Spec::default().placed().write().aux("<SRS>nonsense</SRS>", ""), "dem.tif.aux.xml"),
        (Spec::default().placed().write().with("dem.PRJ", "nonsense"), "dem.PRJ"),
        (
            Spec::default().write().with("dem.tab", "!table\nType \"RASTER\"\n(0,0) (0,0) Label \"Pt 1\",\n"),
            "dem.tab",
        ),
        (
            Spec::default().placed().write().aux("<SRS dataAxisToSRSAxisMapping=\"1,2\">EPSG:4326</SRS>", ""),
            "dem.tif.aux.xml",
        ),
    ] {
        if cfg!(feature = "gdal") {
            continue;
        }
        let error = open(raster.path(), &Limits::default()).err().expect("refused").to_string();
        assert!(error.contains(name), "{error}");
    }
}

#[test]
fn pixel_is_point_of_sidecar_and_keys() {
    let says = |word: &str| format!("<Metadata><MDI key=\"AREA_OR_POINT\">{word}</MDI></Metadata>");
    let keys =
        |kind: u16| Spec::default().placed().keys(1, &[(1024, 1), (1025, kind), (3072, 32612)]).write();
    let is_point = |raster: Raster| info(&raster).geo.pixel_is_point;
    assert!(is_point(Spec::default().write().aux(&says("Point"), "")));
    assert!(is_point(keys(2).aux(&says("Area"), "")) && !is_point(keys(1).aux(&says("Point"), "")));
    assert!(!is_point(keys(2).aux(&(says("Area") + AUX_SRS), "")) && !is_point(keys(2).aux(AUX_SRS, "")));
    assert!(is_point(keys(2).aux(AUX_PLACE, "")));
}

#[test]
fn nodata_of_sidecar_and_tag() {
    assert_eq!(nodata(&Spec::default().nodata("-9").write()), (Some(-9.0), Some(Origin::Tag(42113))));
    let said = |text: &str| {
        Spec::default().nodata("-9").write().aux("", &format!("<NoDataValue>{text}</NoDataValue>"))
    };
    assert_eq!(nodata(&said("-5")), (Some(-5.0), aux()));
    assert_eq!(nodata(&said(" -9.99900000000000E+03 ")), (Some(-9999.0), aux()));
    assert_eq!(nodata(&said("")), (Some(-9.0), Some(Origin::Tag(42113))));
    assert!(nodata(&said("nan")).0.is_some_and(f64::is_nan));
    let exact = "<NoDataValue le_hex_equiv=\"0000000000C05EC0\">-5</NoDataValue>";
    assert_eq!(nodata(&Spec::default().write().aux("", exact)), (Some(-123.0), aux()));
    let warned = info(&said("none"));
    assert_eq!((warned.nodata, warned.warnings.len()), (Some(-9.0), 1));
    let options = OpenOptions { nodata: Some(3.0), ..OpenOptions::default() };
    let raster = said("-5");
    let stated = open_all(&[raster.path().to_owned()], &options, &Limits::default()).expect("raster");
    assert_eq!(stated.info().origins.nodata, Some(Origin::User));
}

#[test]
fn scale_and_offset_of_tie_point_metadata_and_sidecar() {
    let metadata = Some(Origin::GdalMetadata);
    let both = "<Offset>7</Offset><Scale>5</Scale>";
    let items = |items: &[(&str, &str)]| Spec::default().items(items).write();
    assert_eq!(scale(&items(&[("scale", "2"), ("offset", "3")]).aux("", both)), (2.0, 3.0, metadata.clone()));
    assert_eq!(scale(&items(&[("offset", "3")]).aux("", both)), (1.0, 3.0, metadata.clone()));
    assert_eq!(scale(&items(&[("scale", "3")]).aux("", both)), (3.0, 0.0, metadata.clone()));
    assert_eq!(scale(&items(&[("unittype", "m")]).aux("", both)), (5.0, 7.0, aux()));
    assert_eq!(scale(&Spec::default().write().aux("", "<Offset>7</Offset>")), (1.0, 7.0, aux()));
    assert_eq!(scale(&Spec::default().write().aux("", "<Scale>5</Scale>")), (5.0, 0.0, aux()));
    let tied = |minor, vertical: &[(u16, u16)]| {
        let keys = [&[(1024, 1), (1025, 1), (3072, 32611)], vertical].concat();
        let tie = vec![0.0, 0.0, 0.0, 100.0, 200.0, 100.0];
        let spec = Spec::default().keys(minor, &keys).tag(33550, Tag::Double(vec![2.0, 2.0, 0.5]));
        spec.tag(33922, Tag::Double(tie))
    };
    let navd = &[(4096, 5703)];
    let tie = Some(Origin::Tag(33922));
    assert_eq!(scale(&tied(1, navd).write()), (0.5, 100.0, tie.clone()));
    assert_eq!(scale(&tied(1, navd).items(&[("scale", "9")]).write()), (0.5, 100.0, tie.clone()));
    assert_eq!(scale(&tied(1, navd).write().aux("", both)), (0.5, 100.0, tie));
    assert_eq!(scale(&tied(1, &[]).write()), (1.0, 0.0, None));
    assert_eq!(scale(&tied(0, navd).write()), (1.0, 0.0, None));
    assert_eq!(scale(&tied(0, navd).items(&[("scale", "9")]).write()), (9.0, 0.0, metadata));
}

#[test]
fn scales_that_are_no_numbers_are_refused_by_name() {
    for raster in [
        Spec::default().items(&[("scale", "nan")]).write(),
        Spec::default().items(&[("offset", "inf")]).write(),
        Spec::default().items(&[("scale", "two")]).write(),
        Spec::default().write().aux("", "<Scale>nan</Scale>"),
    ] {
        let error = open(raster.path(), &Limits::default()).err().expect("refused").to_string();
        assert!(error.contains("band 1") && error.contains("finite") && error.contains("dem.tif"), "{error}");
    }
}

#[test]
fn unit_of_metadata_sidecar_and_vertical_system() {
    let metadata = Some(Origin::GdalMetadata);
    let feet = "<UnitType>ft</UnitType>";
    let is = |metres: f64, name: &str, origin| (metres, name.to_owned(), origin);
    let vertical = |code, unit: &[(u16, u16)]| {
        Spec::default()
            .placed()
            .keys(1, &[&[(1024, 1), (1025, 1), (3072, 32611), (4096, code)], unit].concat())
    };
    let us_foot = 1200.0 / 3937.0;
    assert_eq!(
        unit(&Spec::default().items(&[("unittype", "m")]).write().aux("", feet)),
        is(1.0, "m", metadata.clone())
    );
    assert_eq!(
        unit(&Spec::default().items(&[("scale", "2")]).write().aux("", feet)),
        is(0.3048, "ft", aux())
    );
    assert_eq!(unit(&vertical(6360, &[]).write()), is(us_foot, "US survey foot", Some(Origin::GeoKeys)));
    assert_eq!(unit(&vertical(6360, &[]).write().aux("", "<UnitType>m</UnitType>")), is(1.0, "m", aux()));
    assert_eq!(unit(&vertical(5703, &[]).write().aux("", feet)), is(0.3048, "ft", aux()));
    assert_eq!(unit(&vertical(6360, &[]).items(&[("unittype", "m")]).write()), is(1.0, "m", metadata));
    assert_eq!(
        unit(&vertical(6360, &[]).write().aux(AUX_SRS, "")),
        is(us_foot, "US survey foot", Some(Origin::GeoKeys))
    );
    // Beyond GDAL, which has no unit here.
    let (metres, _, origin) =
        unit(&Spec::default().placed().projected(32612).write().aux("<SRS>EPSG:32611+6360</SRS>", ""));
    assert_eq!((metres, origin), (us_foot, aux()));
    for (code, key, expected, warnings) in [
        (5703, 9003, 1.0, 1),
        (6360, 9001, us_foot, 1),
        (5703, 9001, 1.0, 0),
        (32767, 9003, us_foot, 0),
        (5103, 9003, 1.0, 1),
        (5030, 9003, 1.0, 1),
    ] {
        let info = info(&vertical(code, &[(4099, key)]).write());
        assert_eq!((info.vertical_unit.0, info.warnings.len()), (expected, warnings), "{code} {key}");
    }
}

#[test]
fn control_points_hide_what_else_places_the_raster() {
    let points =
        "<GCPList Projection=\"EPSG:32611\"><GCP Id=\"1\" Pixel=\"0\" Line=\"0\" X=\"1\" Y=\"2\"/></GCPList>";
    let ties =
        || Spec::default().tag(33922, Tag::Double(vec![0.0, 0.0, 0.0, 100.0, 200.0, 0.0])).projected(32611);
    for raster in [
        Spec::default().placed().projected(32612).write().aux(points, ""),
        Spec::default().write().with("dem.tfw", TFW).aux(points, ""),
        ties().write(),
    ] {
        let info = info(&raster);
        assert_eq!(
            (info.geo.transform, info.geo.crs.kind, info.warnings.len()),
            (None, CrsKind::Engineering, 1)
        );
        assert!(info.warnings[0].contains("control points"));
    }
    assert_eq!(place(&Spec::default().write().aux(&(points.to_owned() + AUX_PLACE), "")), (Some(AUX), aux()));
    assert_eq!(place(&ties().write().with("dem.tfw", TFW)), (Some(WORLD), world("dem.tfw")));
    assert_eq!(crs(&ties().write().with("dem.tfw", TFW)), (Some(32611), Some(Origin::GeoKeys)));
}

#[test]
fn sidecars_that_are_broken_are_passed_over_with_a_warning() {
    for text in [
        "",
        "<PAMDataset>",
        "<other/>",
        "<PAMDataset><PAMRasterBand band=\"1\"><NoDataValue>-5</NoDataValue></PAMRasterBand>",
    ] {
        let info = info(&Spec::default().nodata("-9").write().with("dem.tif.aux.xml", text));
        assert_eq!((info.nodata, info.warnings.len()), (Some(-9.0), 1), "{text}");
        assert!(info.warnings[0].contains("dem.tif.aux.xml"), "{:?}", info.warnings);
    }
    let info = info(&Spec::default().tag(42112, Tag::Text("<GDALMetadata><Item".to_owned())).write());
    assert!(info.warnings.len() == 1 && info.warnings[0].contains("42112"), "{:?}", info.warnings);
}

#[test]
fn every_file_that_says_something_is_listed_and_watched() {
    let raster =
        Spec::default().write().with("dem.tfw", TFW).with("dem.prj", ESRI).aux("", "<UnitType>ft</UnitType>");
    let files: Vec<String> = names(source(&raster).as_ref());
    assert_eq!(files, ["dem.tif", "dem.tif.aux.xml", "dem.tfw", "dem.prj"]);
    let before = source(&raster).fingerprint().expect("files");
    assert_eq!(before.files.len(), 4);
    let raster = raster.aux("", "<UnitType>m</UnitType>");
    assert_ne!(source(&raster).fingerprint().expect("files"), before);
    std::fs::remove_file(raster.path().with_file_name("dem.tif.aux.xml")).expect("remove");
    assert_ne!(source(&raster).fingerprint().expect("files"), before);
}

#[test]
fn a_sidecar_of_statistics_is_nothing_to_watch() {
    let raster =
        Spec::default().write().aux("", "<Metadata><MDI key=\"STATISTICS_MAXIMUM\">4</MDI></Metadata>");
    assert_eq!(names(source(&raster).as_ref()), ["dem.tif"]);
    assert_eq!(info(&raster).origins, relevo::source::Origins::default());
}

fn names(source: &dyn Source) -> Vec<String> {
    source.files().iter().map(|path| relevo::source::file_name(path)).collect()
}

#[test]
fn an_srtm_tile_takes_scale_and_offset_alone() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("N44W072.hgt");
    std::fs::write(&path, [0, 1, 0, 2, 0, 3, 0, 4]).expect("write");
    let aux = "<NoDataValue>-5</NoDataValue><UnitType>ft</UnitType><Offset>7</Offset><Scale>0.5</Scale>";
    let aux = format!(
        "<PAMDataset>{AUX_PLACE}{AUX_SRS}<PAMRasterBand band=\"1\">{aux}</PAMRasterBand></PAMDataset>"
    );
    std::fs::write(folder.path().join("N44W072.hgt.aux.xml"), aux).expect("write");
    let source = open(&path, &Limits::default()).expect("tile");
    let info = source.info();
    assert_eq!((info.band_scale, info.band_offset, info.nodata), (0.5, 7.0, Some(-32768.0)));
    assert_eq!((info.vertical_unit.0, info.geo.crs.epsg), (1.0, Some(4326)));
    assert_eq!(info.origins.place, Some(Origin::FileName));
    assert_eq!(info.origins.scale, Some(Origin::AuxXml("N44W072.hgt.aux.xml".to_owned())));
    assert_eq!(names(source.as_ref()), ["N44W072.hgt", "N44W072.hgt.aux.xml"]);
}

#[test]
fn virtual_rasters_and_mosaics_hand_on_what_is_beside_their_files() {
    let raster = Spec::default()
        .write()
        .aux(&[AUX_PLACE, AUX_SRS].concat(), "<NoDataValue>-5</NoDataValue><UnitType>ft</UnitType>");
    let vrt = "<VRTDataset rasterXSize=\"4\" rasterYSize=\"3\"><GeoTransform>500,3,0,600,0,-3</GeoTransform>\
        <VRTRasterBand dataType=\"Float32\" band=\"1\"><SimpleSource>\
        <SourceFilename relativeToVRT=\"1\">dem.tif</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>";
    // What lies beside a virtual raster does not count.
    let aux_of_vrt =
        "<PAMDataset><PAMRasterBand band=\"1\"><UnitType>km</UnitType></PAMRasterBand></PAMDataset>";
    let raster = raster.with("a.vrt", vrt).with("a.vrt.aux.xml", aux_of_vrt);
    let path = raster.path().with_file_name("a.vrt");
    let source = open(&path, &Limits::default()).expect("VRT");
    let info = source.info();
    assert_eq!((info.vertical_unit.0, info.geo.crs.epsg), (0.3048, Some(32611)));
    assert_eq!((&info.origins.unit, &info.origins.crs), (&aux(), &aux()));
    assert_eq!(info.origins.place, Some(Origin::Vrt("a.vrt".to_owned())));
    assert_eq!(names(source.as_ref()), ["a.vrt", "dem.tif", "dem.tif.aux.xml"]);
    let both = [raster.path().to_owned(), path];
    let joined = open_all(&both, &OpenOptions::default(), &Limits::default()).expect("mosaic");
    assert_eq!(
        (joined.info().origins.unit.clone(), joined.info().origins.place.clone()),
        (aux(), Some(Origin::Several))
    );
    assert_eq!(names(joined.as_ref()), ["dem.tif", "dem.tif.aux.xml", "a.vrt", "dem.tif", "dem.tif.aux.xml"]);
}

#[test]
fn rasters_that_went_wrong_before() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/failing");
    let of = |name: &str| open(&folder.join(name), &Limits::default()).expect("raster").info().clone();
    let place = Some([500_000.0, 10.0, 0.0, 4_400_000.0, 0.0, -10.0]);
    let all = of("side-aux-all.tif");
    assert_eq!((all.geo.transform, all.geo.crs.epsg), (place, Some(32613)));
    assert_eq!(
        (all.nodata, all.vertical_unit.0, all.band_scale, all.band_offset),
        (Some(-9999.0), 0.3048, 0.5, 3.0)
    );
    let placed = of("side-tfw-prj.tif");
    assert_eq!((placed.geo.transform, placed.geo.crs.kind), (place, CrsKind::Projected));
    assert_eq!(of("gdal-metadata-comment.tif").band_scale, 1.0);
    assert_eq!(of("gdal-metadata-entities.tif").band_scale, 0.5);
    let vertical = of("vertical-5703-unit-9003.tif");
    assert_eq!((vertical.vertical_unit.0, vertical.warnings.len()), (1.0, 1));
}
