//! Pictures: roles of bands, nodata, alpha and place, by tags and by the files beside them.

use relevo::geo::{Crs, CrsKind};
use relevo::limits::Limits;
use relevo::source::picture::{Picture, PictureOptions, Pixels, open_all};

use super::tiff::{Raster, Spec, Tag};
use super::{AUX_PLACE, TFW, WORLD};

const RGB: u16 = 2;
const PLACE: &str = "<GeoTransform>100,2,0,200,0,-2</GeoTransform>";

fn utm() -> Crs {
    Crs { kind: CrsKind::Projected, epsg: Some(32612), ..Crs::default() }
}

fn open(raster: &Raster) -> relevo::Result<Box<dyn Picture>> {
    let all = open_all(&[raster.path().to_owned()], &PictureOptions::default(), &utm(), &Limits::default());
    all.map(|all| all.into_iter().next().expect("one"))
}

fn read(raster: &Raster) -> (Vec<u32>, Pixels) {
    let picture = open(raster).unwrap_or_else(|error| panic!("{error}"));
    (picture.info().note.bands.clone(), picture.read_window(0..4, 0..3).expect("pixels"))
}

/// Band 0, 1 and 2 are 10, 20 and 30 and the number of the pixel.
fn three() -> Spec {
    Spec::default()
        .placed()
        .projected(32612)
        .picture(8, 3, RGB, |pixel, band| (10 * (band + 1) + pixel) as u16)
}

fn roles(names: &[&str]) -> Tag {
    let item = |(at, name): (usize, &&str)| {
        format!("<Item name=\"COLORINTERP\" sample=\"{at}\" role=\"colorinterp\">{name}</Item>")
    };
    let items: String = names.iter().enumerate().map(item).collect();
    Tag::Text(format!("<GDALMetadata>{items}</GDALMetadata>"))
}

fn bands(inside: &[&str]) -> String {
    let band =
        |(at, inside): (usize, &&str)| format!("<PAMRasterBand band=\"{}\">{inside}</PAMRasterBand>", at + 1);
    format!("<PAMDataset>{}</PAMDataset>", inside.iter().enumerate().map(band).collect::<String>())
}

fn aux_roles(names: &[&str]) -> String {
    let inside: Vec<String> = names.iter().map(|name| format!("<ColorInterp>{name}</ColorInterp>")).collect();
    bands(&inside.iter().map(String::as_str).collect::<Vec<_>>())
}

#[test]
fn colours_stand_where_their_roles_say() {
    let (order, pixels) = read(&three().write());
    assert_eq!((order, &pixels.colour[..3], pixels.alpha), (vec![1, 2, 3], &[10, 20, 30][..], None));
    let swapped = ["Blue", "Green", "Red"];
    let of_metadata = three().tag(42112, roles(&swapped)).write();
    let of_sidecar = three().write().with("dem.tif.aux.xml", &aux_roles(&swapped));
    for raster in [of_metadata, of_sidecar] {
        let (order, pixels) = read(&raster);
        assert_eq!((order, &pixels.colour[..3]), (vec![3, 2, 1], &[30, 20, 10][..]));
    }
    // The sidecar goes before the metadata.
    let both = three().tag(42112, roles(&swapped)).write();
    let both = both.with("dem.tif.aux.xml", &aux_roles(&["Green", "Red", "Blue"]));
    assert_eq!(read(&both).0, [2, 1, 3]);
}

#[test]
fn alpha_is_what_is_called_so() {
    let four = |tag: Option<Tag>| {
        let spec = Spec::default().placed().projected(32612);
        let spec = spec.picture(8, 4, RGB, |pixel, band| if band == 0 { 50 * (pixel % 2) as u16 } else { 7 });
        let spec = spec.tag(338, Tag::Short(vec![0]));
        tag.into_iter().fold(spec, |spec, tag| spec.tag(42112, tag)).write()
    };
    assert_eq!(read(&four(None)).1.alpha, None);
    let (order, pixels) = read(&four(Some(roles(&["Alpha", "Blue", "Green", "Red"]))));
    assert_eq!(order, [4, 3, 2]);
    assert_eq!(pixels.alpha.expect("alpha")[..4], [0, 50, 0, 50]);
}

#[test]
fn alpha_of_sixteen_bits_may_be_bytes() {
    let of = |opaque: u16| {
        let value = move |pixel: usize, band: usize| match band {
            3 => [0, opaque, opaque, opaque / 2][pixel % 4],
            _ => 100,
        };
        let spec = Spec::default().placed().projected(32612).picture(16, 4, RGB, value);
        read(&spec.tag(338, Tag::Short(vec![2])).write()).1.alpha.expect("alpha")[..4].to_vec()
    };
    assert_eq!(of(255), [0, 255, 255, 127]);
    assert_eq!(of(65535), [0, 255, 255, 127]);
    // More than a byte holds: of 65 535.
    assert_eq!(of(2570), [0, 10, 10, 5]);
}

#[test]
fn nodata_hides_where_all_bands_have_theirs() {
    let pixels = |sidecar: &str| {
        let raster = three().write().with("dem.tif.aux.xml", sidecar);
        read(&raster).1.alpha.map(|alpha| alpha.iter().map(|&alpha| alpha == 0).collect::<Vec<_>>())
    };
    let nodata = |values: &[i32]| {
        let inside: Vec<String> =
            values.iter().map(|value| format!("<NoDataValue>{value}</NoDataValue>")).collect();
        bands(&inside.iter().map(String::as_str).collect::<Vec<_>>())
    };
    assert_eq!(pixels(&nodata(&[11, 11, 11])), None);
    let second = (0..12).map(|pixel| pixel == 1).collect();
    assert_eq!(pixels(&nodata(&[11, 21, 31])), Some(second));
    assert_eq!(pixels(&nodata(&[11])), None);
    let tagged = three().nodata("11").write().with(
        "dem.tif.aux.xml",
        &bands(&["", "<NoDataValue>21</NoDataValue>", "<NoDataValue>31</NoDataValue>"]),
    );
    assert_eq!(read(&tagged).1.alpha.map(|alpha| alpha[1]), Some(0));
}

#[test]
fn pictures_lie_where_the_same_files_say() {
    let bare = || Spec::default().picture(8, 3, RGB, |_, _| 9);
    let place = |raster: &Raster| open(raster).unwrap_or_else(|error| panic!("{error}")).info().geo.clone();
    let world = bare().write().with("dem.wld", TFW);
    assert_eq!((place(&world).transform, place(&world).crs.epsg), (Some(WORLD), Some(32612)));
    let files = open(&world).expect("picture").files();
    assert_eq!(files.len(), 2);
    let sidecar = bare().write().aux(&[PLACE, "<SRS>EPSG:32612</SRS>"].concat(), "");
    assert_eq!(
        (place(&sidecar).transform.map(|t| t[0]), place(&sidecar).crs.epsg),
        (Some(100.0), Some(32612))
    );
    let over_tags = three().write().aux(AUX_PLACE, "");
    assert_eq!(place(&over_tags).transform.map(|t| t[0]), Some(500.0));
    if cfg!(not(feature = "gdal")) {
        let error = |raster: &Raster| open(raster).err().expect("refused").to_string();
        assert!(error(&bare().write()).contains("does not say where it lies"));
        assert!(error(&bare().write().with("dem.tfw", "1\n2\n")).contains("dem.tfw"));
        // In another system than the heights.
        let elsewhere = bare().write().with("dem.wld", TFW).with("dem.prj", "EPSG:32613");
        assert!(error(&elsewhere).contains("32613"));
    }
}
