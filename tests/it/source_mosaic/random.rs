//! Random files on one grid, against a plain loop over all of them.

use super::*;
use SampleType::{Float32, Float64, Int8, Int16, Int32, Uint8, Uint16, Uint32};

/// Small, repeatable chances.
struct Chance(u64);

impl Chance {
    fn below(&mut self, most: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % most
    }
}

const RULES: [Overlap; 5] = [Overlap::First, Overlap::Last, Overlap::Min, Overlap::Max, Overlap::Mean];

/// Lowest and highest whole number of a type that all of its neighbours hold exactly.
fn range(kind: SampleType) -> (f64, f64) {
    match kind {
        SampleType::Int8 => (-128.0, 127.0),
        SampleType::Uint8 => (0.0, 255.0),
        SampleType::Int16 => (-32768.0, 32767.0),
        SampleType::Uint16 => (0.0, 65535.0),
        SampleType::Int32 => (-2_147_483_648.0, 2_147_483_647.0),
        SampleType::Uint32 => (0.0, 4_294_967_295.0),
        SampleType::Float32 | SampleType::Float64 => (-500.0, 9000.0),
    }
}

fn tile(chance: &mut Chance, kinds: &[SampleType]) -> Tile {
    let kind = kinds[chance.below(kinds.len() as u64) as usize];
    let at = (chance.below(60) as i64 - 30, chance.below(50) as i64 - 20);
    let size = (1 + chance.below(40) as u32, 1 + chance.below(40) as u32);
    let (low, high) = range(kind);
    // Few values, so that they meet the nodata values of other files.
    let ends = [low, high, 0.0, 1.0, 7.0, 100.0];
    let nodata = [None, Some(7.0), Some(0.0), Some(low), Some(-9999.0)][chance.below(5) as usize];
    let values = (0..size.0 * size.1).map(|_| {
        let fraction = if kind.is_float() { chance.below(8) as f64 / 8.0 } else { 0.0 };
        match chance.below(12) {
            pick @ 0..6 => ends[pick as usize],
            6 if kind.is_float() => f64::NAN,
            _ => (low + chance.below((high - low) as u64) as f64) + fraction,
        }
    });
    let values = values.collect();
    Tile { at, size, kind, nodata, scale: (1.0, 0.0), unit: "", epsg: Some(32632), values }
}

/// The narrowest type that holds all, by trying the ends of the ranges.
fn expected_type(tiles: &[Tile]) -> SampleType {
    let holds = |wide: SampleType, kind: SampleType| match (wide.is_float(), kind.is_float()) {
        (false, true) => false,
        (true, true) => wide.bytes() >= kind.bytes(),
        (true, false) => wide == SampleType::Float64 || kind.bytes() <= 2,
        (false, false) => range(wide).0 <= range(kind).0 && range(kind).1 <= range(wide).1,
    };
    SampleType::ALL.into_iter().find(|&wide| tiles.iter().all(|tile| holds(wide, tile.kind))).expect("one")
}

/// What the rule makes of the valid samples of one place, in the order of the files.
fn expected(tiles: &[Tile], kind: SampleType, rule: Overlap, x: i64, y: i64) -> Option<f64> {
    let found: Vec<f64> = tiles.iter().filter_map(|tile| tile.sample(x, y)).collect();
    let first = *found.first()?;
    Some(match rule {
        Overlap::First => first,
        Overlap::Last => *found.last()?,
        Overlap::Min => found.into_iter().fold(first, f64::min),
        Overlap::Max => found.into_iter().fold(first, f64::max),
        Overlap::Mean => {
            let mean = found.iter().skip(1).fold(first, |sum, value| sum + value) / found.len() as f64;
            match kind {
                SampleType::Float64 => mean,
                SampleType::Float32 => f64::from(mean as f32),
                _ => mean.round(),
            }
        }
    })
}

fn check(tiles: &[Tile], paths: &[PathBuf], rule: Overlap, chance: &mut Chance) {
    let source = join(paths, rule);
    let info = source.info();
    let west = tiles.iter().map(|tile| tile.at.0).min().expect("tiles");
    let north = tiles.iter().map(|tile| tile.at.1).min().expect("tiles");
    let east = tiles.iter().map(|tile| tile.at.0 + i64::from(tile.size.0)).max().expect("tiles");
    let south = tiles.iter().map(|tile| tile.at.1 + i64::from(tile.size.1)).max().expect("tiles");
    assert_eq!((i64::from(info.width), i64::from(info.height)), (east - west, south - north));
    let transform = info.geo.transform.expect("place");
    assert_eq!(
        (transform[0], transform[3]),
        (400_000.0 + 30.0 * west as f64, 5_000_000.0 - 30.0 * north as f64)
    );
    assert_eq!(info.sample_type, expected_type(tiles));
    assert_eq!(info.overlap, Some(rule));
    let wanted = |columns: &Range<u32>, rows: &Range<u32>| -> Vec<Option<f64>> {
        let places = rows
            .clone()
            .flat_map(|y| columns.clone().map(move |x| (i64::from(x) + west, i64::from(y) + north)));
        places.map(|(x, y)| expected(tiles, info.sample_type, rule, x, y)).collect()
    };
    let all = (0..info.width, 0..info.height);
    let valid = wanted(&all.0, &all.1);
    assert_eq!(values(&*source, all.0.clone(), all.1.clone()), valid, "{tiles:?} {rule:?}");
    // Outside the footprint is nothing.
    if let Some(rects) = &info.footprint {
        for (at, valid) in valid.iter().enumerate() {
            let (x, y) = ((at % info.width as usize) as u32, (at / info.width as usize) as u32);
            let inside = rects.iter().any(|rect| rect.columns.contains(&x) && rect.rows.contains(&y));
            assert!(inside || valid.is_none());
        }
    }
    let some = |chance: &mut Chance, most: u32| {
        let (a, b) = (chance.below(u64::from(most) + 1) as u32, chance.below(u64::from(most) + 1) as u32);
        a.min(b)..a.max(b)
    };
    for _ in 0..12 {
        let (columns, rows) = (some(chance, info.width), some(chance, info.height));
        assert_eq!(
            values(&*source, columns.clone(), rows.clone()),
            wanted(&columns, &rows),
            "{columns:?} {rows:?}"
        );
    }
    for start in (0..info.height).step_by(9) {
        let rows = start..(start + 10).min(info.height);
        assert_eq!(values(&*source, all.0.clone(), rows.clone()), wanted(&all.0, &rows), "band {rows:?}");
    }
}

#[test]
fn random_files_in_every_order_by_every_rule() {
    let folder = tempfile::tempdir().expect("folder");
    let mut chance = Chance(20);
    let families: [&[SampleType]; 9] = [
        &[Int16],
        &[Int16, Float32],
        &[Int16, Uint16],
        &[Uint8, Int8],
        &[Uint8, Uint16],
        &[Int32, Float32],
        &[Uint32],
        &[Float64, Float32],
        &[Int16, Uint8, Int32, Uint32],
    ];
    for turn in 0..45 {
        let kinds = families[turn % families.len()];
        let count = 2 + chance.below(6);
        let mut tiles: Vec<Tile> = (0..count).map(|_| tile(&mut chance, kinds)).collect();
        if turn % 3 == 0 {
            // One nodata value for all, of which no mask need tell.
            for tile in &mut tiles {
                tile.nodata = Some(7.0);
            }
        }
        let paths: Vec<PathBuf> =
            (0..tiles.len()).map(|index| folder.path().join(format!("{turn}_{index}.tif"))).collect();
        tiles.iter().zip(&paths).for_each(|(tile, path)| tile.write(path));
        check(&tiles, &paths, RULES[turn % 5], &mut chance);
        let (tiles, paths): (Vec<_>, Vec<_>) = tiles.into_iter().zip(paths).rev().unzip();
        check(&tiles, &paths, RULES[(turn + 1) % 5], &mut chance);
    }
}

#[test]
fn a_nodata_value_given_counts_for_all() {
    let folder = tempfile::tempdir().expect("folder");
    let mut tiles = [
        Tile::new((0, 0), (5, 4), SampleType::Int16, |x, _| f64::from(x)),
        Tile::new((2, 1), (5, 4), SampleType::Float32, |x, _| f64::from(x + 1)),
    ];
    tiles[0].nodata = Some(3.0);
    let paths = ["a.tif", "b.tif"].map(|name| folder.path().join(name));
    tiles.iter().zip(&paths).for_each(|(tile, path)| tile.write(path));
    let options = OpenOptions { nodata: Some(2.0), ..OpenOptions::default() };
    let source = source::open_all(&paths, &options, &Limits::default()).expect("open");
    assert_eq!(source.info().nodata, Some(2.0));
    for tile in &mut tiles {
        tile.nodata = Some(2.0);
    }
    let wanted = (0..5).flat_map(|y| (0..7).map(move |x| (x, y)));
    let wanted: Vec<_> =
        wanted.map(|(x, y)| expected(&tiles, SampleType::Float32, Overlap::Last, x, y)).collect();
    assert_eq!(values(&*source, 0..7, 0..5), wanted);
}

#[test]
fn different_scales_become_real_values() {
    let folder = tempfile::tempdir().expect("folder");
    let mut tiles = [
        Tile::new((0, 0), (5, 4), SampleType::Int16, |x, y| f64::from(x * 10 + y)),
        Tile::new((4, 0), (5, 4), SampleType::Uint8, |x, y| f64::from(x * 10 + y)),
    ];
    (tiles[0].scale, tiles[0].nodata) = ((0.1, 100.0), Some(20.0));
    let paths = ["a.tif", "b.tif"].map(|name| folder.path().join(name));
    tiles.iter().zip(&paths).for_each(|(tile, path)| tile.write(path));
    let source = join(&paths, Overlap::First);
    let info = source.info();
    assert_eq!((info.sample_type, info.band_scale, info.band_offset), (SampleType::Float64, 1.0, 0.0));
    let got = values(&*source, 0..9, 0..1);
    assert_eq!(got[..4], [Some(100.0), Some(100.0 + 0.1 * 10.0), None, Some(100.0 + 0.1 * 30.0)]);
    assert_eq!(got[4..6], [Some(100.0 + 0.1 * 40.0), Some(10.0)]);
}

#[test]
fn pixels_may_be_written_with_few_digits_or_turned() {
    let folder = tempfile::tempdir().expect("folder");
    let tile = Tile::new((0, 0), (30, 20), SampleType::Int16, |x, y| f64::from(x + 100 * y));
    let paths = ["a.tif", "b.tif", "c.tif"].map(|name| folder.path().join(name));
    let third = 1.0 / 3.0;
    tile.write_at(&paths[0], [10.0, third, 0.0, 50.0, 0.0, -third]);
    tile.write_at(&paths[1], [10.0 + 29.0 * third, 0.333_333, 0.0, 43.333_33, 0.0, -0.333_33]);
    let source = join(&paths[..2], Overlap::First);
    assert_eq!((source.info().width, source.info().height), (59, 40));
    assert_eq!(source.info().geo.transform, Some([10.0, third, 0.0, 50.0, 0.0, -third]));
    assert_eq!(
        values(&*source, 28..31, 19..21)[..],
        [Some(1928.0), Some(1929.0), None, None, Some(0.0), Some(1.0)]
    );
    // A turned grid: the third lies south-west of the first, and neither is in the corner.
    let turned =
        |column: f64, row: f64| [10.0 + 3.0 * column - row, 3.0, -1.0, 50.0 - column - 3.0 * row, -1.0, -3.0];
    tile.write_at(&paths[0], turned(0.0, 0.0));
    tile.write_at(&paths[1], turned(-12.0, 7.0));
    let source = join(&paths[..2], Overlap::Last);
    assert_eq!((source.info().width, source.info().height), (42, 27));
    assert_eq!(source.info().geo.transform, Some(turned(-12.0, 0.0)));
    assert_eq!(values(&*source, 11..13, 6..8), [None, Some(600.0), Some(11.0), Some(12.0)]);
}

/// More files side by side than are kept open, and the number of open ones.
#[test]
fn hundreds_of_files_side_by_side() {
    let folder = tempfile::tempdir().expect("folder");
    let count = 450_u32;
    let paths: Vec<PathBuf> = (0..count)
        .map(|index| {
            let path = folder.path().join(format!("{index}.tif"));
            Tile::new((i64::from(index) * 3, i64::from(index % 2)), (4, 6), SampleType::Int16, |x, y| {
                f64::from((index * 3 + x) * 10 + y)
            })
            .write(&path);
            path
        })
        .collect();
    let source = join(&paths, Overlap::Last);
    let open = || std::fs::read_dir("/proc/self/fd").map(Iterator::count).ok();
    let before = open();
    let window = source.read_rows(1..6).expect("rows");
    // The last of two files that share a column counts.
    for x in 0..count * 3 {
        let shift = (x / 3) % 2;
        assert_eq!(window.samples.value(x as usize), f64::from(x * 10 + 1 - shift), "column {x}");
    }
    if let (Some(before), Some(now)) = (before, open()) {
        assert!(now < before + 250, "{before} files open, then {now}");
    }
    source.release();
    assert_eq!(source.read_rows(1..6).expect("again"), window);
}
