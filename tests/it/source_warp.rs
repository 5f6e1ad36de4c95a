//! Rasters on another grid: is every sample what `gdalwarp` makes of the same request, whatever
//! window is read?
//!
//! These tests fail without the GDAL command line tools: a check that is skipped proves nothing.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem").join(name)
}

fn relevo(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_relevo")).args(args).output().expect("the binary runs")
}

/// Fails with exit code 2 and one line that has all of `words`.
#[cfg(not(feature = "gdal"))]
fn refused(args: &[&str], words: &[&str]) {
    let output = relevo(args);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{args:?}: {message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{message}");
    for word in words {
        assert!(message.contains(word), "{word:?} is not in {message:?}");
    }
}

#[test]
fn nonsense_is_refused_when_it_is_typed() {
    for args in [
        ["--resolution", "0"],
        ["--resolution", "1,2,3"],
        ["--resolution", "-30"],
        ["--resampling", "nearest"],
        ["--vertical-unit", "cubit"],
        ["--vertical-unit", "-1"],
    ] {
        let output = relevo(&["build", "x.tif", args[0], args[1]]);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("expected"), "{args:?}");
    }
}

#[cfg(not(feature = "gdal"))]
#[test]
fn without_gdal_it_says_what_to_install() {
    let folder = tempfile::tempdir().expect("folder");
    let dem = fixture("rmnp_dem_uint16.tif");
    let (dem, out) = (dem.to_str().expect("path"), folder.path().join("out.rlv"));
    let out = out.to_str().expect("path");
    let install = ["libgdal-dev", "cargo install relevo --features gdal"];
    for option in [["--crs", "EPSG:32613"], ["--resolution", "0.01"], ["--resampling", "near"]] {
        refused(&["build", dem, option[0], option[1], "-o", out], &install);
        refused(&["build", dem, option[0], option[1], "-o", out], &["rmnp_dem_uint16.tif: warping"]);
    }
    let grid = folder.path().join("grid.asc");
    std::fs::write(&grid, "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3 4\n")
        .expect("write");
    refused(&["build", grid.to_str().expect("path"), "-o", out], &install);
    for name in ["/vsizip/a.zip/b.tif", "/vsicurl/http://localhost/b.tif", "NETCDF:\"a.nc\":Band1"] {
        refused(&["build", name, "-o", out], &install);
        refused(&["build", name, "-o", out], &[name]);
    }
    assert!(!Path::new(out).exists());
}

#[cfg(feature = "gdal")]
#[expect(clippy::panic, reason = "helpers of tests")]
mod through_gdal {
    use super::*;
    use proptest::prelude::*;
    use relevo::limits::Limits;
    use relevo::sample::SampleType;
    use relevo::source::warp::{Resampling, Warp};
    use relevo::source::{self, OpenOptions, Source};

    fn run(tool: &str, arguments: &[&str]) -> String {
        let output = Command::new(tool)
            .args(arguments)
            .env("GDAL_PAM_ENABLED", "NO")
            .output()
            .unwrap_or_else(|error| {
                panic!(
                    "cannot run {tool} ({error}): these tests need GDAL's tools (apt-get install gdal-bin)"
                )
            });
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{tool} {}: {message}", arguments.join(" "));
        String::from_utf8(output.stdout).expect("text")
    }

    fn translate(options: &str, from: &Path, to: &Path) {
        let mut arguments: Vec<&str> = options.split_whitespace().collect();
        arguments.extend(["-q", from.to_str().expect("path"), to.to_str().expect("path")]);
        run("gdal_translate", &arguments);
    }

    fn options(crs: Option<&str>, resolution: Option<(f64, f64)>, resampling: Resampling) -> OpenOptions {
        let warp = Warp { crs: crs.map(str::to_owned), resolution, resampling };
        OpenOptions { warp: Some(warp), ..OpenOptions::default() }
    }

    fn open(path: &Path, options: &OpenOptions) -> Box<dyn Source> {
        source::open_all(&[path.to_owned()], options, &Limits::default())
            .unwrap_or_else(|error| panic!("{error}"))
    }

    fn error(paths: &[PathBuf], options: &OpenOptions) -> String {
        source::open_all(paths, options, &Limits::default()).err().expect("refused").to_string()
    }

    /// All samples, as numbers that hold them exactly; voids as NaN.
    fn samples(source: &dyn Source) -> Vec<f64> {
        let window = source.read_rows(0..source.info().height).expect("rows");
        let nodata = source.info().voids();
        let value = |at| if window.is_void(at, nodata) { f64::NAN } else { window.samples.value(at) };
        (0..window.samples.len()).map(value).collect()
    }

    /// What a raster holds by GDAL's own word; `nodata` and what is not finite as NaN.
    fn dump(path: &Path, nodata: Option<f64>) -> Vec<f64> {
        let raw = path.with_extension("raw");
        translate("-of ENVI -ot Float64", path, &raw);
        let bytes = std::fs::read(&raw).expect("dump");
        let value = |bytes: &[u8; 8]| f64::from_ne_bytes(*bytes);
        let values = bytes.as_chunks::<8>().0.iter().map(value);
        values
            .map(|value| if value.is_finite() && nodata != Some(value) { value } else { f64::NAN })
            .collect()
    }

    fn one(path: &Path) -> Vec<PathBuf> {
        vec![path.to_owned()]
    }

    fn differences(ours: &[f64], theirs: &[f64]) -> usize {
        assert_eq!(ours.len(), theirs.len());
        ours.iter().zip(theirs).filter(|(a, b)| a != b && !(a.is_nan() && b.is_nan())).count()
    }

    /// Words of a command line in which single quotes keep blanks.
    fn words(command: &str) -> Vec<String> {
        let quoted = command.split('\'').enumerate();
        let words = quoted.flat_map(
            |(at, text)| {
                if at % 2 == 1 { vec![text] } else { text.split_whitespace().collect() }
            },
        );
        words.map(str::to_owned).collect()
    }

    /// Runs the command that the source records, which must be the whole recipe.
    fn recorded(path: &Path, source: &dyn Source, to: &Path) {
        let part = &source.info().parts[0];
        let (_, command) = part.description.split_once("gdalwarp ").expect("a command is recorded");
        let command = words(command);
        let mut arguments: Vec<&str> = command.iter().map(String::as_str).collect();
        arguments.extend(["-q", "-overwrite", path.to_str().expect("path"), to.to_str().expect("path")]);
        run("gdalwarp", &arguments);
    }

    /// Size and geotransform of a VRT, with all digits.
    fn grid(path: &Path) -> (String, String) {
        let vrt = std::fs::read_to_string(path).expect("VRT");
        let between = |start: &str, end: &str| {
            let (_, rest) = vrt.split_once(start).unwrap_or_else(|| panic!("{vrt}"));
            rest.split_once(end).expect("end").0.trim().to_owned()
        };
        (between("<VRTDataset ", ">"), between("<GeoTransform>", "</GeoTransform>"))
    }

    /// The grid of the plain request and the samples of the recorded one, compared with `gdalwarp`.
    fn equals_gdalwarp(path: &Path, crs: Option<&str>, resolution: Option<(f64, f64)>, method: Resampling) {
        let folder = tempfile::tempdir().expect("folder");
        let source = open(path, &options(crs, resolution, method));
        let name = format!("{} to {crs:?} {resolution:?} {}", path.display(), method.name());

        let plain = folder.path().join("plain.vrt");
        let mut arguments = vec!["-q".to_owned(), "-of".to_owned(), "VRT".to_owned()];
        arguments.extend(crs.iter().flat_map(|crs| ["-t_srs".to_owned(), (*crs).to_owned()]));
        arguments
            .extend(resolution.iter().flat_map(|(x, y)| ["-tr".to_owned(), x.to_string(), y.to_string()]));
        arguments.extend([path.display().to_string(), plain.display().to_string()]);
        run("gdalwarp", &arguments.iter().map(String::as_str).collect::<Vec<_>>());
        let (size, transform) = grid(&plain);
        let info = source.info();
        let wanted = format!("rasterXSize=\"{}\" rasterYSize=\"{}\"", info.width, info.height);
        assert!(size.contains(&wanted), "{name}: {size}, ours {wanted}");
        let theirs: Vec<f64> =
            transform.split(',').map(|word| word.trim().parse().expect("number")).collect();
        assert_eq!(info.geo.transform.expect("transform").to_vec(), theirs, "{name}");

        let warped = folder.path().join("warped.tif");
        recorded(path, &*source, &warped);
        let theirs = dump(&warped, info.nodata);
        let ours = samples(&*source);
        let valid = ours.iter().filter(|value| !value.is_nan()).count();
        assert!(valid > 0, "{name}: all void");
        // The command has the edges as decimals: a coordinate may differ in its last bit, and a
        // height with it.
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a.abs().max(1.0) || a.is_nan() && b.is_nan();
        let far = ours.iter().zip(&theirs).filter(|&(&a, &b)| !close(a, b)).count();
        assert_eq!(
            far,
            0,
            "{name}: of {} samples, {} not bit for bit",
            ours.len(),
            differences(&ours, &theirs)
        );
    }

    #[test]
    fn every_method_up_and_down() {
        let dem = fixture("rmnp_dem_uint16.tif");
        for method in Resampling::ALL {
            equals_gdalwarp(&dem, Some("EPSG:32613"), None, method);
            equals_gdalwarp(&dem, Some("EPSG:32613"), Some((60.0, 45.0)), method);
            equals_gdalwarp(&dem, Some("EPSG:3857"), Some((5000.0, 3000.0)), method);
            equals_gdalwarp(&dem, None, Some((0.0123, 0.0123)), method);
        }
        let laea = "+proj=laea +lat_0=40 +lon_0=-105 +datum=WGS84 +units=us-ft";
        equals_gdalwarp(&dem, Some(laea), None, Resampling::Bilinear);
        equals_gdalwarp(
            &fixture("co_elevation_float32_lzw.tif"),
            Some("EPSG:26913"),
            None,
            Resampling::Bilinear,
        );
        // It has overviews, which gdalwarp would take for this one unless told otherwise.
        let coarse = Some((100.0, 100.0));
        equals_gdalwarp(
            &fixture("co_elevation_float32_lzw.tif"),
            Some("EPSG:26913"),
            coarse,
            Resampling::Average,
        );
    }

    #[test]
    fn every_type_with_and_without_nodata() {
        let folder = tempfile::tempdir().expect("folder");
        let dem = fixture("rmnp_dem_uint16.tif");
        for (kind, nodata, expected) in [
            ("Byte", "none", SampleType::Int16),
            ("Byte", "3", SampleType::Uint8),
            ("Int16", "none", SampleType::Int32),
            ("Int16", "-1", SampleType::Int16),
            ("UInt16", "none", SampleType::Int32),
            ("UInt16", "2800", SampleType::Uint16),
            ("Int32", "none", SampleType::Float64),
            ("Int32", "2800", SampleType::Int32),
            ("UInt32", "none", SampleType::Float64),
            ("Float32", "none", SampleType::Float32),
            ("Float32", "2800", SampleType::Float32),
            ("Float64", "nan", SampleType::Float64),
        ] {
            let path = folder.path().join("typed.tif");
            let scale = if kind == "Byte" { "-scale 2281 4261 0 255" } else { "" };
            translate(&format!("-ot {kind} {scale} -a_nodata {nodata}"), &dem, &path);
            let source = open(&path, &options(Some("EPSG:32613"), None, Resampling::Bilinear));
            assert_eq!(source.info().sample_type, expected, "{kind} {nodata}");
            // The corners of a turned raster lie outside the original: void, and nothing else is
            // there.
            let all = samples(&*source);
            assert!(all[0].is_nan() && all.iter().any(|value| !value.is_nan()), "{kind} {nodata}");
            equals_gdalwarp(&path, Some("EPSG:32613"), None, Resampling::Bilinear);
        }
    }

    #[test]
    fn every_shared_dem_equals_gdalwarp() {
        let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
        let projected = Some("EPSG:3857");
        let geographic = Some("EPSG:4326");
        let cylindrical = Some("EPSG:6933");
        let mut seen = 0;
        for (name, crs, resolution, method) in [
            ("N44W072.hgt", Some("EPSG:32619"), None, Resampling::Bilinear),
            ("n44_w072.dt1", Some("EPSG:32619"), None, Resampling::Cubic),
            ("SainteHelens.dem", geographic, None, Resampling::Bilinear),
            ("cairns_topobathy_int.asc", None, Some((500.0, 500.0)), Resampling::Average),
            ("bigtujunga_utm11_int16.tif", geographic, None, Resampling::Lanczos),
            ("co_elevation_float32_lzw.tif", projected, None, Resampling::CubicSpline),
            ("etopo20_world_bathymetry_float32.tif", cylindrical, None, Resampling::Bilinear),
            ("everest_srtm3_int16_voids.tif", Some("EPSG:32645"), None, Resampling::Bilinear),
            ("exploradores_aster_float32_nodata.tif", geographic, None, Resampling::Cubic),
            ("georgia_pair.vrt", Some("EPSG:32610"), None, Resampling::Bilinear),
            (
                "mt_rainier_srtm3_int16_voids.tif",
                Some("EPSG:32610"),
                Some((30.0, 30.0)),
                Resampling::Bilinear,
            ),
            ("N49W123_srtm3_int16_voids.tif", projected, Some((900.0, 900.0)), Resampling::Average),
            ("nz_elev_float32_nan.tif", Some("EPSG:2193"), None, Resampling::Bilinear),
            ("rainier_var_bigendian_lzw.tif", Some("EPSG:32610"), None, Resampling::Near),
            ("zion_nlcd_classes.tif", geographic, None, Resampling::Near),
        ] {
            let path = shared.join(name);
            if path.exists() {
                equals_gdalwarp(&path, crs, resolution, method);
                seen += 1;
            } else {
                eprintln!("{name} is not there: not compared");
            }
        }
        assert!(seen == 0 || seen == 15, "{seen} of 15 files");
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

        #[test]
        fn a_sample_does_not_depend_on_the_window(
            method in 0..6_usize,
            coarser in 0.2_f64..6.0,
            windows in prop::collection::vec((0.0..1.0_f64, 0.0..1.0_f64, 0.0..1.0_f64, 0.0..1.0_f64), 8),
        ) {
            let dem = fixture("rmnp_dem_uint16.tif");
            let step = 200.0 * coarser;
            let options = options(Some("EPSG:32613"), Some((step, step)), Resampling::ALL[method]);
            let (source, other) = (open(&dem, &options), open(&dem, &options));
            let (width, height) = (source.info().width, source.info().height);
            let whole = source.read_rows(0..height).expect("rows").samples;
            // At once, on a source of their own that has read nothing yet.
            std::thread::scope(|scope| {
                for (left, right, top, bottom) in windows {
                    let range = |a: f64, b: f64, most: u32| {
                        let (a, b) = (a * f64::from(most), b * f64::from(most));
                        a.min(b) as u32..a.max(b).ceil() as u32
                    };
                    let (columns, rows) = (range(left, right, width), range(top, bottom, height));
                    let (other, whole) = (&other, &whole);
                    scope.spawn(move || {
                        let window = other.read_window(columns.clone(), rows.clone()).expect("window");
                        for (at, row) in rows.enumerate() {
                            for (to, column) in columns.clone().enumerate() {
                                let ours = window.samples.value(at * columns.len() + to);
                                let all = whole.value((row * width + column) as usize);
                                assert_eq!(ours.to_bits(), all.to_bits(), "column {column}, row {row}");
                            }
                        }
                    });
                }
            });
        }
    }

    #[test]
    fn the_build_is_the_same_on_any_threads_and_in_strips() {
        let folder = tempfile::tempdir().expect("folder");
        let dem = fixture("co_elevation_float32_lzw.tif");
        let dem = dem.to_str().expect("path");
        let mut first = None;
        for more in [&["--jobs", "1"][..], &["--jobs", "3"], &["--memory", "36MiB"]] {
            let out = folder.path().join("out.rlv");
            let mut args = vec!["build", dem, "--crs", "EPSG:32613", "--tile", "64", "-f"];
            args.extend(["-o", out.to_str().expect("path")]);
            args.extend(more);
            // The check against the source takes more than that; the bytes are those of builds that
            // were checked.
            if !more.contains(&"--memory") {
                args.push("--verify");
            }
            let output = relevo(&args);
            assert!(output.status.success(), "{more:?}: {}", String::from_utf8_lossy(&output.stderr));
            let bytes = std::fs::read(&out).expect("file");
            assert!(first.get_or_insert_with(|| bytes.clone()) == &bytes, "{more:?}: other bytes");
        }
    }

    /// Two files in two projections, as one.
    fn neighbours(folder: &Path) -> Vec<PathBuf> {
        let halves = [("west.tif", "0 0 80 187", "EPSG:32612"), ("east.tif", "72 0 80 187", "EPSG:32613")];
        let cut = folder.join("cut.tif");
        let make = |(name, window, crs): (&str, &str, &str)| {
            translate(&format!("-srcwin {window}"), &fixture("rmnp_dem_uint16.tif"), &cut);
            let path = folder.join(name);
            let (from, to) = (cut.to_str().expect("path"), path.to_str().expect("path"));
            run("gdalwarp", &["-q", "-t_srs", crs, "-r", "bilinear", from, to]);
            path
        };
        halves.map(make).into()
    }

    #[test]
    fn unlike_files_become_one_lattice() {
        let folder = tempfile::tempdir().expect("folder");
        let paths = neighbours(folder.path());
        let message = error(&paths, &OpenOptions::default());
        assert!(message.contains("east.tif") && message.contains("`crs`"), "{message}");
        for (method, step) in
            [(Resampling::Near, 0.003), (Resampling::Bilinear, 0.001), (Resampling::Cubic, 0.001)]
        {
            let options = options(Some("EPSG:4326"), Some((step, step)), method);
            let source = source::open_all(&paths, &options, &Limits::default()).expect("one source");
            let info = source.info();
            assert_eq!(info.parts.len(), 2);
            // One call of gdalwarp for both files, which makes the same grid of them. Its kernels
            // are as wide as they must be for finer grids.
            let to = folder.path().join("both.tif");
            let step = step.to_string();
            let mut words = vec!["-q", "-overwrite", "-t_srs", "EPSG:4326", "-tr", &step, &step, "-et", "0"];
            words.extend(["-r", method.name(), "-wo", "XSCALE=1", "-wo", "YSCALE=1"]);
            words.extend(paths.iter().map(|path| path.to_str().expect("path")));
            words.push(to.to_str().expect("path"));
            run("gdalwarp", &words);
            let (ours, theirs) = (samples(&*source), dump(&to, Some(65535.0)));
            assert_eq!(ours.len(), theirs.len(), "{}", method.name());
            assert_eq!(differences(&ours, &theirs), 0, "{} of {}", method.name(), ours.len());
        }
        // Without a system, that of the first; without a resolution, the finest.
        let own = source::open_all(&paths, &options(None, None, Resampling::Near), &Limits::default());
        assert_eq!(own.expect("one source").info().geo.crs.epsg, Some(32612));
    }

    #[test]
    fn unlike_heights_are_refused() {
        let folder = tempfile::tempdir().expect("folder");
        let feet = folder.path().join("feet.tif");
        let metres = folder.path().join("metres.tif");
        translate("-a_srs EPSG:4326+6360", &fixture("rmnp_dem_uint16.tif"), &feet);
        translate("-a_srs EPSG:4326", &fixture("rmnp_dem_uint16.tif"), &metres);
        let paths = [metres, feet];
        let to = options(Some("EPSG:32613"), None, Resampling::Bilinear);
        let message = error(&paths, &to);
        assert!(message.contains("feet.tif") && message.contains("`vertical_unit`"), "{message}");
        let stated = OpenOptions { vertical_unit: Some((0.3048, "ft".to_owned())), ..to };
        let source = source::open_all(&paths, &stated, &Limits::default()).expect("one source");
        assert_eq!(source.info().vertical_unit, (0.3048, "ft".to_owned()));
        // The same without warping.
        let stated = OpenOptions { warp: None, ..stated };
        let source = source::open_all(&paths, &stated, &Limits::default()).expect("one source");
        assert_eq!(source.info().vertical_unit, (0.3048, "ft".to_owned()));
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_name() {
        let folder = tempfile::tempdir().expect("folder");
        let dem = fixture("rmnp_dem_uint16.tif");
        let path = folder.path().join("case.tif");
        let to = |crs: &str| options(Some(crs), None, Resampling::Bilinear);

        let message = error(&one(&dem), &to("EPSG:99999999"));
        assert!(message.contains("`crs` EPSG:99999999"), "{message}");
        let message = error(&one(&dem), &to("EPSG:5703"));
        assert!(message.contains("projected or a geographic"), "{message}");
        translate("-co PROFILE=BASELINE", &dem, &path);
        let message = error(&one(&path), &to("EPSG:32613"));
        assert!(message.contains("case.tif: it has no geotransform"), "{message}");
        let asc = folder.path().join("bare.asc");
        std::fs::write(&asc, "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3 4\n")
            .expect("write");
        let message = error(&one(&asc), &to("EPSG:32613"));
        assert!(
            message.contains("bare.asc: it has no coordinate system") && message.contains("gdal_edit"),
            "{message}"
        );
        // Its own grid can still be made finer.
        let finer = open(&asc, &options(None, Some((0.5, 0.5)), Resampling::Bilinear));
        assert_eq!((finer.info().width, finer.info().height), (4, 4));

        let message = error(&one(&dem), &options(None, Some((1e9, 1e9)), Resampling::Average));
        assert!(message.contains("rmnp_dem_uint16.tif"), "{message}");
        let message = error(&one(&dem), &options(None, Some((1e-12, 1e-12)), Resampling::Average));
        assert!(message.contains("rmnp_dem_uint16.tif"), "{message}");
    }

    #[test]
    fn heights_keep_their_unit_and_their_datum() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("feet.tif");
        translate("-a_srs EPSG:4269+6360", &fixture("rmnp_dem_uint16.tif"), &path);
        let source = open(&path, &options(Some("EPSG:26913"), None, Resampling::Near));
        let info = source.info();
        assert_eq!(info.vertical_unit, (1200.0 / 3937.0, "US survey foot".to_owned()));
        assert_eq!((info.geo.crs.epsg, info.geo.crs.vertical_epsg), (Some(26913), Some(6360)));
        assert!(info.geo.crs.vertical_name.contains("NAVD88"), "{}", info.geo.crs.vertical_name);
        // The same heights, not moved: those of the plain horizontal system.
        let plain = folder.path().join("plain.tif");
        translate("-a_srs EPSG:4269", &fixture("rmnp_dem_uint16.tif"), &plain);
        let plain = open(&plain, &options(Some("EPSG:26913"), None, Resampling::Near));
        assert_eq!(differences(&samples(&*source), &samples(&*plain)), 0);
        assert_eq!(
            open(&path, &options(Some("EPSG:26913+6360"), None, Resampling::Near)).info().geo,
            info.geo
        );

        let message = error(&one(&path), &options(Some("EPSG:26913+5703"), None, Resampling::Near));
        assert!(
            message.contains("feet.tif: its heights are in NAVD88") && message.contains("NAVD88 height"),
            "{message}"
        );
        let stated = OpenOptions {
            vertical_unit: Some((1.0, "m".to_owned())),
            ..options(Some("EPSG:26913"), None, Resampling::Near)
        };
        assert_eq!(open(&path, &stated).info().vertical_unit, (1.0, "m".to_owned()));
        // A system with heights for a file that is silent: the user says what they are.
        let silent = fixture("rmnp_dem_uint16.tif");
        let source = open(&silent, &options(Some("EPSG:32613+6360"), None, Resampling::Near));
        assert_eq!(source.info().vertical_unit.0, 1200.0 / 3937.0);
        assert_eq!(source.info().geo.crs.vertical_epsg, Some(6360));
    }

    #[test]
    fn masks_and_nodata_given_by_the_user() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("masked.tif");
        let dem = fixture("rmnp_dem_uint16.tif");
        // A mask that hides about half: where heights are low.
        let alpha = folder.path().join("alpha.tif");
        translate("-ot Byte -scale 2800 2801 0 255 -a_nodata none", &dem, &alpha);
        let vrt = folder.path().join("masked.vrt");
        translate("-of VRT -a_nodata none", &dem, &vrt);
        let text = std::fs::read_to_string(&vrt).expect("VRT");
        let mask = format!(
            "<MaskBand><VRTRasterBand dataType=\"Byte\"><SimpleSource><SourceFilename>{}</SourceFilename>\
             <SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></MaskBand></VRTDataset>",
            alpha.display()
        );
        std::fs::write(&vrt, text.replace("</VRTDataset>", &mask)).expect("write");
        translate("--config GDAL_TIFF_INTERNAL_MASK YES", &vrt, &path);
        equals_gdalwarp_masked(&path);

        let options =
            OpenOptions { nodata: Some(3000.0), ..options(Some("EPSG:32613"), None, Resampling::Bilinear) };
        let source = open(&dem, &options);
        assert_eq!(source.info().nodata, Some(3000.0));
        assert!(source.info().parts[0].description.contains("-srcnodata 3000"));
    }

    /// Voids of a mask do not leak: heights under it are not in any sample.
    fn equals_gdalwarp_masked(path: &Path) {
        let source = open(path, &options(Some("EPSG:32613"), None, Resampling::Bilinear));
        let all = samples(&*source);
        let (valid, void): (Vec<f64>, Vec<f64>) = all.iter().partition(|value| !value.is_nan());
        assert!(valid.len() > 1000 && void.len() > 1000, "{} of {}", valid.len(), void.len());
        assert!(valid.iter().all(|&value| value > 2799.0), "a height under the mask");
        equals_gdalwarp(path, Some("EPSG:32613"), None, Resampling::Bilinear);
    }
}
