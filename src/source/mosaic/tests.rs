use super::*;
use crate::error::Error;
use crate::geo::{Crs, Geo};
use crate::limits::Limits;
use crate::source::{OpenOptions, Part, Samples};

/// A raster with one sample value, held open or reopened.
struct Flat(SourceInfo, i16);

impl Source for Flat {
    fn info(&self) -> &SourceInfo {
        &self.0
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        check_window(&self.0, &columns, &rows)?;
        Ok(Window { samples: Samples::Int16(vec![self.1; columns.len() * rows.len()]), mask: None })
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        Ok(Fingerprint { files: Vec::new() })
    }
}

fn flat(x: f64, y: f64, side: u32, value: i16) -> Flat {
    let info = SourceInfo {
        width: side,
        height: side,
        sample_type: SampleType::Int16,
        nodata: None,
        band_scale: 1.0,
        band_offset: 0.0,
        vertical_unit: (1.0, String::new()),
        geo: Geo { transform: Some([x, 1.0, 0.0, -y, 0.0, -1.0]), crs: Crs::default(), ..Geo::default() },
        description: "flat".into(),
        parts: vec![Part::default()],
        footprint: None,
        overlap: None,
        block_rows: 1,
        reading: crate::source::ReadMemory::plain(2),
        warnings: Vec::new(),
        origins: crate::source::Origins::default(),
    };
    Flat(info, value)
}

fn grid(side: u32, count: u32) -> Mosaic {
    let pieces = (0..count * count).map(|index| {
        let (x, y) = (f64::from(index % count * side), f64::from(index / count * side));
        let now = flat(x, y, side, 0);
        Piece::lazy(PathBuf::new(), &now, Box::new(move || Ok(Box::new(flat(x, y, side, index as i16)))))
    });
    Mosaic::of(pieces.collect(), &OpenOptions::default(), &Limits::default()).expect("mosaic")
}

#[test]
fn a_sweep_opens_every_file_once_and_closes_what_it_has_passed() {
    let mosaic = grid(10, 12);
    for start in (0..120).step_by(7) {
        for columns in [0..50, 50..120] {
            let rows = start..(start + 8).min(120);
            mosaic.read_window(columns, rows.clone()).expect("window");
            let rows_of_files = rows.start / 10..rows.end.div_ceil(10);
            assert!(mosaic.pool.kept() <= 12 * rows_of_files.len(), "{rows:?}: {}", mosaic.pool.kept());
        }
    }
    let opened = mosaic.pool.opened.load(std::sync::atomic::Ordering::Relaxed);
    assert_eq!(opened, 144);
    mosaic.release();
    assert_eq!(mosaic.pool.kept(), 0);
}

#[test]
fn a_window_asks_only_the_members_that_it_meets() {
    let mosaic = grid(10, 12);
    for (columns, rows, most) in [(3..7, 3..7, 1), (9..11, 9..11, 4), (0..120, 5..6, 12), (4..4, 0..9, 0)] {
        mosaic.release();
        mosaic.read_window(columns, rows).expect("window");
        assert_eq!(mosaic.pool.kept(), most);
    }
}

#[test]
fn a_lattice_of_four_million_columns_costs_what_is_occupied() {
    let corner = f64::from((1 << 22) - 10);
    let open =
        |x, y, value| -> (PathBuf, Box<dyn Source>) { (PathBuf::new(), Box::new(flat(x, y, 10, value))) };
    let parts = vec![open(0.0, 0.0, 1), open(corner, corner, 2), open(corner, 0.0, 3)];
    let mosaic = Mosaic::join(parts, &OpenOptions::default(), &Limits::default()).expect("mosaic");
    let info = mosaic.info();
    assert_eq!((info.width, info.height), (1 << 22, 1 << 22));
    assert_eq!(info.footprint.as_ref().map(Vec::len), Some(3));
    let window = mosaic.read_window((1 << 22) - 11..1 << 22, (1 << 22) - 10..(1 << 22) - 9).expect("window");
    assert_eq!(window.mask.map(|mask| mask.iter().map(|&valid| u32::from(valid)).sum()), Some(10));
    assert_eq!(window.samples.value(10), 2.0);
    let far = vec![open(0.0, 0.0, 1), open(2e9, 0.0, 2)];
    let error = Mosaic::join(far, &OpenOptions::default(), &Limits::default()).err().expect("too wide");
    assert!(matches!(error, Error::Limit { .. }), "{error}");
}

#[test]
fn the_narrowest_type_that_holds_all() {
    use SampleType::{Float32, Float64, Int8, Int16, Int32, Uint8, Uint16, Uint32};
    for (kinds, expected) in [
        (&[Int16][..], Int16),
        (&[Int8, Uint8], Int16),
        (&[Int16, Uint16], Int32),
        (&[Uint8, Uint32], Uint32),
        (&[Int16, Float32], Float32),
        (&[Int32, Float32], Float64),
        (&[Int32, Uint32], Float64),
    ] {
        assert_eq!(join::narrowest(kinds.iter().copied()), expected, "{kinds:?}");
    }
}

#[test]
fn the_mean_of_the_largest_numbers_is_finite() {
    let mut canvas = Canvas::<f64>::new(&(0..1), &(0..1), Overlap::Mean, Some(f64::NAN)).expect("memory");
    canvas.add(0, &[f64::MAX], &[1]);
    canvas.add(0, &[f64::MAX], &[1]);
    assert_eq!(canvas.finish().samples, Samples::Float64(vec![f64::MAX]));
}
