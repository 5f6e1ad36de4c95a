//! VRTs as GDAL reads them.

use super::*;

/// Valid samples are GDAL's, unless they show below one that is nodata to GDAL; voids are GDAL's
/// nodata, or 0 where the VRT has no nodata value.
fn compare(vrt: &Path, folder: &Path) -> Box<dyn Source> {
    let source = source::open(vrt, &Limits::default()).unwrap_or_else(|error| panic!("{error}"));
    let info = source.info();
    assert!(info.description.starts_with("VRT"), "{}", info.description);
    let theirs = gdal_values(vrt, folder);
    let ours = values(&*source, 0..info.width, 0..info.height);
    assert_eq!(ours.len(), theirs.len());
    let json: serde_json::Value =
        serde_json::from_str(&run("gdalinfo", &["-json", text(vrt)])).expect("JSON");
    let nodata = json["bands"][0]["noDataValue"].as_f64();
    assert_eq!(json["bands"][0]["type"], info.sample_type.gdal_name());
    for (at, (&own, &gdal)) in ours.iter().zip(&theirs).enumerate() {
        match own {
            Some(value) => {
                let same = value == gdal || Some(gdal) == nodata;
                assert!(same, "sample {at} of {}: {value}, {gdal} to GDAL", vrt.display());
            }
            None => assert!(gdal == nodata.unwrap_or(0.0), "sample {at}: void, {gdal} to GDAL"),
        }
    }
    source
}

fn tiles(folder: &Path, kind: SampleType, nodata: Option<f64>) -> Vec<PathBuf> {
    let places = [(0, 0), (17, 4), (-6, 15), (60, 40)];
    let value = |index: usize, x: u32, y: u32| f64::from((x * 7 + y * 5 + index as u32 * 11) % 120);
    let write = |(index, at): (usize, (i64, i64))| {
        let path = folder.join(format!("{index}.tif"));
        let tile = Tile::new(at, (25, 20), kind, |x, y| value(index, x, y));
        Tile { nodata, ..tile }.write(&path);
        path
    };
    places.into_iter().enumerate().map(write).collect()
}

#[test]
fn mosaics_of_gdalbuildvrt() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    let kinds =
        [SampleType::Int16, SampleType::Float32, SampleType::Uint8, SampleType::Uint16, SampleType::Int32];
    for (turn, kind) in kinds.into_iter().enumerate() {
        for (case, (nodata, options)) in [
            (Some(50.0), &[][..]),
            (None, &[]),
            (Some(50.0), &["-vrtnodata", "77"]),
            (Some(50.0), &["-srcnodata", "33", "-vrtnodata", "44"]),
            (None, &["-te", "400100", "4999000", "401000", "4999950", "-tr", "30", "30", "-tap"]),
        ]
        .into_iter()
        .enumerate()
        {
            // Types and cases take turns.
            if case > 0 && case % 2 != turn % 2 {
                continue;
            }
            let paths = tiles(folder, kind, nodata);
            let vrt = folder.join("all.vrt");
            let names: Vec<&str> = paths.iter().map(|path| text(path)).collect();
            run("gdalbuildvrt", &[&["-q", "-overwrite"], options, &[text(&vrt)], &names].concat());
            let source = compare_if_whole(&vrt, folder, options);
            let Some(source) = source else { continue };
            assert_eq!(source.info().overlap, Some(Overlap::Last));
            if options.is_empty() {
                let joined = join(&paths, Overlap::Last);
                let (one, two) = (source.info(), joined.info());
                assert_eq!((one.width, one.height, one.nodata), (two.width, two.height, two.nodata));
                assert_eq!((&one.geo, &one.parts), (&two.geo, &two.parts));
                assert_eq!((&one.vertical_unit, &one.footprint), (&two.vertical_unit, &two.footprint));
                let all = |source: &dyn Source| values(source, 0..one.width, 0..one.height);
                assert_eq!(all(&*source), all(&*joined));
            }
        }
    }
}

/// A grid that `-tap` has moved off the samples is GDAL's business.
fn compare_if_whole(vrt: &Path, folder: &Path, options: &[&str]) -> Option<Box<dyn Source>> {
    if !options.contains(&"-tap") {
        return Some(compare(vrt, folder));
    }
    let opened = source::open(vrt, &Limits::default());
    if cfg!(feature = "gdal") {
        assert!(opened.is_ok());
    } else {
        let message = opened.err().expect("parts of samples").to_string();
        assert!(message.contains("all.vrt") && message.contains("parts of samples"), "{message}");
        assert!(message.contains("--features gdal"), "{message}");
    }
    None
}

const HEAD: &str = "<VRTDataset rasterXSize=\"30\" rasterYSize=\"24\">\n  <GeoTransform>400000, 30, 0, 5000000, 0, -30</GeoTransform>\n";

/// A VRT of one band with these elements.
fn written(folder: &Path, kind: &str, inside: &str) -> PathBuf {
    let path = folder.join("hand.vrt");
    let band = format!(
        "  <VRTRasterBand dataType=\"{kind}\" band=\"1\">\n{inside}  </VRTRasterBand>\n</VRTDataset>\n"
    );
    std::fs::write(&path, format!("{HEAD}{band}")).expect("write");
    path
}

fn element(kind: &str, file: &str, from: [i32; 4], to: [i32; 4], more: &str) -> String {
    let rect = |name: &str, [x, y, w, h]: [i32; 4]| {
        format!("<{name} xOff=\"{x}\" yOff=\"{y}\" xSize=\"{w}\" ySize=\"{h}\"/>")
    };
    format!(
        "    <{kind}><SourceFilename relativeToVRT=\"1\">{file}</SourceFilename><SourceBand>1</SourceBand>{}{}{more}</{kind}>\n",
        rect("SrcRect", from),
        rect("DstRect", to)
    )
}

#[test]
fn written_by_hand() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    tiles(folder, SampleType::Int16, Some(50.0));
    let simple = |file: &str, from, to| element("SimpleSource", file, from, to, "");
    let complex = |file: &str, from, to, more: &str| element("ComplexSource", file, from, to, more);
    let window = ([3, 2, 12, 9], [10, 11, 12, 9]);
    let mut turn = 0;
    let scale = "<ScaleOffset>-12.375</ScaleOffset><ScaleRatio>0.3048</ScaleRatio>";
    for inside in [
        simple("0.tif", window.0, window.1) + &simple("1.tif", [0, 0, 25, 20], [5, 4, 25, 20]),
        // What lies outside a file or the VRT is cut away.
        simple("0.tif", [-4, -3, 20, 20], [-2, 1, 20, 20])
            + &simple("1.tif", [10, 10, 25, 20], [20, 10, 25, 20]),
        complex("0.tif", window.0, window.1, "<NODATA>50</NODATA>")
            + &simple("1.tif", [0, 0, 3, 3], [11, 12, 3, 3]),
        complex("0.tif", window.0, window.1, scale),
        complex("0.tif", window.0, window.1, &format!("<NODATA>50</NODATA>{scale}")),
        complex("0.tif", window.0, window.1, "<UseMaskBand>false</UseMaskBand>"),
    ] {
        for kind in ["Int16", "Int32", "Float32", "Float64"] {
            turn += 1;
            let nodata = if turn % 3 == 0 { "" } else { "    <NoDataValue>-9</NoDataValue>\n" };
            compare(&written(folder, kind, &format!("{nodata}{inside}")), folder);
        }
    }
}

/// A simple source that has the void value hides nothing here, and does so in GDAL.
#[test]
fn a_void_hides_nothing() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    tiles(folder, SampleType::Int16, Some(50.0));
    let whole = ([0, 0, 25, 20], [0, 0, 25, 20]);
    let both = element("SimpleSource", "0.tif", whole.0, whole.1, "")
        + &element("SimpleSource", "1.tif", whole.0, whole.1, "");
    let path = written(folder, "Int16", &format!("<NoDataValue>50</NoDataValue>{both}"));
    let ours = values(&*source::open(&path, &Limits::default()).expect("open"), 0..25, 0..20);
    let theirs = gdal_values(&path, folder);
    let first = gdal_values(&folder.join("0.tif"), folder);
    let mut filled = 0;
    for (at, own) in ours.iter().enumerate() {
        let gdal = theirs[at / 25 * 30 + at % 25];
        if gdal == 50.0 {
            assert_eq!(*own, (first[at] != 50.0).then_some(first[at]));
            filled += usize::from(own.is_some());
        } else {
            assert_eq!(*own, Some(gdal));
        }
    }
    assert!(filled > 0, "a void of the second over a sample of the first");
}

#[test]
fn vrts_within_vrts_and_among_files() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    let paths = tiles(folder, SampleType::Int16, Some(50.0));
    let [inner, outer] = ["inner.vrt", "outer.vrt"].map(|name| folder.join(name));
    run("gdalbuildvrt", &["-q", text(&inner), text(&paths[0]), text(&paths[1])]);
    run("gdalbuildvrt", &["-q", text(&outer), text(&inner), text(&paths[2]), text(&paths[3])]);
    let nested = compare(&outer, folder);
    let names: Vec<_> = nested.info().parts.iter().map(|part| part.name.as_str()).collect();
    assert_eq!(names, ["0.tif", "1.tif", "2.tif", "3.tif"]);
    let files = nested.fingerprint().expect("fingerprint").files;
    let names: Vec<_> = files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(names, ["outer.vrt", "inner.vrt", "0.tif", "1.tif", "2.tif", "3.tif"]);
    let (all, flat) = ([inner, paths[2].clone(), paths[3].clone()], join(&paths, Overlap::Last));
    let among = join(&all, Overlap::Last);
    let (width, height) = (flat.info().width, flat.info().height);
    let wanted = values(&*flat, 0..width, 0..height);
    assert_eq!(values(&*nested, 0..width, 0..height), wanted);
    assert_eq!(values(&*among, 0..width, 0..height), wanted);
    assert_eq!(among.info().parts, flat.info().parts);
    assert_eq!(among.info().footprint, flat.info().footprint);
    // A rule of one's own needs the files.
    let options = OpenOptions { overlap: Overlap::Max, ..OpenOptions::default() };
    let error = source::open_all(&[outer], &options, &Limits::default()).err().expect("refused");
    assert!(error.to_string().contains("one by one"), "{error}");
}

#[test]
fn what_only_gdal_reads() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    tiles(folder, SampleType::Int16, Some(50.0));
    let whole = ([0, 0, 25, 20], [0, 0, 25, 20]);
    let plain = element("SimpleSource", "0.tif", whole.0, whole.1, "");
    for (kind, inside, what) in [
        (
            "Int16",
            element("SimpleSource", "0.tif", whole.0, [0, 0, 30, 24], ""),
            "resampled from 25 x 20 to 30 x 24",
        ),
        ("Byte", plain.clone(), "Int16 samples of"),
        ("CFloat32", plain.clone(), "CFloat32"),
        ("Int16", plain.replace("SimpleSource", "KernelFilteredSource"), "KernelFilteredSource"),
        ("Int16", plain.replace("<SourceBand>1", "<SourceBand>mask,1"), "mask,1"),
        ("Int16", element("ComplexSource", "0.tif", whole.0, whole.1, "<LUT>0:0,1:9</LUT>"), "LUT"),
        ("Int16", plain.replace("0.tif", "/vsizip/0.zip/0.tif"), "/vsizip"),
    ] {
        let path = written(folder, kind, &inside);
        let opened = source::open(&path, &Limits::default());
        if cfg!(not(feature = "gdal")) {
            let error = opened.err().expect("unsupported");
            let message = error.to_string();
            assert!(matches!(error, relevo::Error::Unsupported { .. }), "{message}");
            assert!(message.contains("hand.vrt") && message.contains(what), "{message}");
            assert!(message.contains("--features gdal"), "{message}");
        }
    }
    let derived = folder.join("derived.vrt");
    let text = format!(
        "{HEAD}<VRTRasterBand dataType=\"Int16\" band=\"1\" subClass=\"VRTDerivedRasterBand\">{plain}</VRTRasterBand></VRTDataset>"
    );
    std::fs::write(&derived, text).expect("write");
    if cfg!(not(feature = "gdal")) {
        assert!(refusal(&[derived]).contains("VRTDerivedRasterBand"));
    }
}

#[test]
fn heights_in_two_units_are_refused_in_a_vrt_too() {
    let folder = tempfile::tempdir().expect("folder");
    let folder = folder.path();
    let paths = tiles(folder, SampleType::Int16, Some(50.0));
    let feet = Tile::new((17, 4), (25, 20), SampleType::Int16, |x, _| f64::from(x));
    Tile { unit: "ft", ..feet }.write(&paths[1]);
    let vrt = folder.join("all.vrt");
    run("gdalbuildvrt", &["-q", text(&vrt), text(&paths[0]), text(&paths[1])]);
    let message = refusal(&[vrt]);
    assert!(message.contains("1.tif") && message.contains("0.tif") && message.contains("ft"), "{message}");
}
