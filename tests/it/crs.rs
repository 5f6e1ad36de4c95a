//! Coordinate systems as their owners meant them: what files say of themselves, and what becomes of
//! it in a build and an export. What is right is what GDAL 3.6.2 reads.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use relevo::geo::CrsKind;
use relevo::limits::Limits;
use relevo::source::{self, OpenOptions, Source};

fn failing(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/failing").join(name)
}

fn open(names: &[&str]) -> relevo::error::Result<Box<dyn Source>> {
    let paths: Vec<PathBuf> = names.iter().map(|name| failing(name)).collect();
    source::open_all(&paths, &OpenOptions::default(), &Limits::default())
}

fn relevo(arguments: &[&str]) -> (bool, String, String) {
    let output = Command::cargo_bin("relevo").expect("binary").args(arguments).output().expect("run");
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    (output.status.success(), text(output.stdout), text(output.stderr))
}

#[test]
fn a_geographic_key_beside_a_text_is_not_the_system() {
    for (name, wanted) in [
        ("crs-model-user-defined-mollweide.tif", "Mollweide"),
        ("crs-model-user-defined-web-mercator-proj4.tif", "Pseudo Mercator"),
    ] {
        let source = open(&[name]).expect(name);
        let (info, crs) = (source.info(), &source.info().geo.crs);
        assert_eq!((crs.kind, crs.unit), (CrsKind::Projected, 1.0), "{name}");
        assert!(crs.wkt.contains(wanted), "{name}: {}", crs.wkt);
        let spacing = info.geo.spacing((0, 1), (0, 1));
        let pixel = info.geo.transform.expect("place")[1];
        assert!((spacing.dx / pixel - 1.0).abs() < 1e-6, "{name}: {spacing:?}");
    }
}

#[test]
fn metres_and_degrees_do_not_join() {
    let error =
        open(&["crs-mosaic-epsg4326-east.tif", "crs-mosaic-mollweide-west.tif"]).err().expect("refused");
    let text = error.to_string();
    assert!(text.contains("World_Mollweide") && text.contains("EPSG:4326"), "{text}");
}

#[test]
fn a_virtual_raster_says_itself_where_it_is() {
    let vrt = open(&["vrt-unknown-other-srs.vrt"]).expect("VRT");
    let own = open(&["unk_a.tif"]).expect("its source");
    let (vrt, own) = (&vrt.info().geo.crs, &own.info().geo.crs);
    assert_eq!(vrt.name, own.name);
    let parallels = |wkt: &str| {
        wkt.contains("1st standard parallel\",20,") && wkt.contains("2nd standard parallel\",60,")
    };
    assert!(parallels(&vrt.wkt) && !parallels(&own.wkt), "{}\n{}", vrt.wkt, own.wkt);
}

#[test]
fn keys_behind_their_count_say_nothing_in_an_export_either() {
    let folder = tempfile::tempdir().expect("folder");
    let [rlv, tif] = ["a.rlv", "a.tif"].map(|name| folder.path().join(name).to_string_lossy().into_owned());
    let input = failing("export-half-pixel-key-behind-count.tif");
    let (good, _, error) = relevo(&["build", &input.to_string_lossy(), "-o", &rlv]);
    assert!(good, "{error}");
    let (good, _, error) = relevo(&["export", &rlv, "-o", &tif]);
    assert!(good, "{error}");
    let place = |path: &Path| source::open(path, &Limits::default()).expect("TIFF").info().geo.transform;
    assert_eq!(place(&input), place(Path::new(&tif)));
}

#[test]
fn numbers_that_are_none_are_left_out_or_refused_by_name() {
    let source = open(&["tiff-geokey-nan.tif"]).expect("as GDAL");
    let (info, crs) = (source.info(), &source.info().geo.crs);
    assert_eq!((crs.epsg, crs.ellipsoid.a), (Some(32613), 6_378_137.0));
    assert!(crs.keys.as_ref().expect("keys").doubles.iter().all(|value| value.is_finite()));
    assert!(info.warnings.iter().any(|warning| warning.contains("2057")), "{:?}", info.warnings);
    let error = open(&["tiff-pixel-scale-1e308.tif"]).err().expect("refused").to_string();
    assert!(error.contains("geotransform") && error.contains("tiff-pixel-scale-1e308.tif"), "{error}");
}

#[test]
fn a_vertical_system_has_its_own_unit() {
    let source = open(&["vertical-5703-unit-9003.tif"]).expect("TIFF");
    let info = source.info();
    assert_eq!((info.geo.crs.vertical_epsg, info.vertical_unit.0), (Some(5703), 1.0));
    assert!(info.warnings.iter().any(|warning| warning.contains("US survey foot")), "{:?}", info.warnings);
}

#[test]
fn a_part_of_a_dem_and_of_a_file_by_a_box() {
    let folder = tempfile::tempdir().expect("folder");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let input = failing("export-half-pixel-key-behind-count.tif");
    let input = input.to_string_lossy();
    let whole = source::open(Path::new(&*input), &Limits::default()).expect("TIFF");
    let [x0, a, _, y0, _, e] = whole.info().geo.transform.expect("place");
    // Columns 10 to 29, rows 5 to 24.
    let bounds = [x0 + 10.0 * a, y0 + 25.0 * e, x0 + 30.0 * a, y0 + 5.0 * e].map(|x| x.to_string()).join(",");
    let all = whole.read_window(10..30, 5..25).expect("samples");
    let (good, _, error) = relevo(&["build", &input, "-o", &path("whole.rlv")]);
    assert!(good, "{error}");
    let (good, _, error) = relevo(&["build", &input, "-o", &path("part.rlv"), "--bbox", &bounds, "--verify"]);
    assert!(good, "{error}");
    let exports: [&[&str]; 2] = [
        &["export", &path("part.rlv"), "-o", &path("a.tif")],
        &["export", &path("whole.rlv"), "-o", &path("b.tif"), "--bbox", &bounds],
    ];
    for (arguments, name) in exports.iter().zip(["a.tif", "b.tif"]) {
        let (good, _, error) = relevo(arguments);
        assert!(good, "{error}");
        let part = source::open(Path::new(&path(name)), &Limits::default()).expect("TIFF");
        assert_eq!((part.info().width, part.info().height), (20, 20), "{name}");
        let [px, pa, _, py, _, pe] = part.info().geo.transform.expect("place");
        let near = |one: f64, other: f64| (one - other).abs() < 1e-6;
        assert!(near(px, x0 + 10.0 * a) && near(py, y0 + 5.0 * e) && (pa, pe) == (a, e), "{name}");
        let samples = part.read_window(0..20, 0..20).expect("samples").samples;
        assert_eq!(samples, all.samples, "{name}");
    }
    let (good, _, error) = relevo(&["build", &input, "-o", &path("c.rlv"), "--bbox", "0,0,1,1"]);
    assert!(!good && error.contains("outside of the raster"), "{error}");
    let (good, _, error) =
        relevo(&["build", &input, "-o", &path("c.rlv"), "--bbox", "-3,51,-2,52", "--bbox-crs", "EPSG:27700"]);
    assert!(!good && error.contains("Ordnance Survey"), "{error}");
}

#[test]
fn info_tells_longitude_and_latitude() {
    let folder = tempfile::tempdir().expect("folder");
    let rlv = folder.path().join("a.rlv").to_string_lossy().into_owned();
    let input = failing("export-half-pixel-key-behind-count.tif");
    assert!(relevo(&["build", &input.to_string_lossy(), "-o", &rlv]).0);
    let (good, text, error) = relevo(&["info", &rlv, "--json"]);
    assert!(good, "{error}");
    let facts: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let place = facts.get(0).unwrap_or(&facts)["place"].clone();
    let number = |point: &str, axis: usize| place["lon_lat"][point][axis].as_f64().expect("number");
    let geo = source::open(&input, &Limits::default()).expect("TIFF").info().geo.clone();
    let [x0, _, _, y0, ..] = geo.transform.expect("place");
    // cs2cs, zone 13: 500000 E is its middle meridian; a minute of the meridian has 1850 m here.
    assert!((number("north_west", 0) - (-105.0 + (x0 - 500_000.0) / 85_000.0)).abs() < 0.05, "{place}");
    assert!((number("north_west", 1) - y0 / 110_900.0).abs() < 0.2, "{place}");
    assert!(number("middle", 1) < number("north_west", 1) && number("middle", 0) > number("north_west", 0));
}
