//! The memory budget is a hard bound, and what it allows is enough to go on.
#![expect(clippy::expect_used, reason = "a test that cannot go on says why")]

mod common;

use common::{Hills, Table, run, viewer};
use relevo::container::Reader;

const BUDGET: f64 = 3.0 * 1024.0 * 1024.0;

#[test]
fn a_path_over_a_file_ten_times_the_budget_stays_within_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = Hills::new(2049).build(folder.path(), 32, 8);
    let header = Reader::open(&file).expect("open").header().clone();
    // Heights, validity and tables of all tiles, as they would lie on the card.
    let tile = 33.0 * 33.0 * 5.0 + 16.0 * 2.0 * 4.0 * 4.0;
    let all = header.tile_count as f64 * tile;
    assert!(all > 10.0 * BUDGET, "{all} bytes");
    for mode in [&[][..], &["--streaming"]] {
        let csv = folder.path().join("out.csv");
        let mut command = viewer();
        command.arg(&file).args(["--headless", "--count", "60", "--size", "160x120", "--tolerance", "2"]);
        command.args(["--gpu-memory", "3MiB", "--ram-cache", "4MiB", "--force"]).args(mode);
        let (_, errors) = run(command.arg("--metrics").arg(&csv), 0);
        assert!(errors.is_empty(), "{errors}");
        let table = Table::read(&csv);
        let bytes = table.column("gpu_bytes");
        assert_eq!(bytes.len(), 60);
        assert!(bytes.iter().all(|&bytes| bytes > 0.0 && bytes <= BUDGET), "{mode:?}: {bytes:?}");
        let tiles = table.column("tiles");
        let promised = table.column("promised_px");
        // Few tiles are drawn only where few are good enough.
        let mut late = tiles.iter().zip(&promised).skip(20);
        assert!(
            late.all(|(&tiles, &pixels)| tiles >= 4.0 || pixels <= 2.001),
            "{mode:?}: {tiles:?}, {promised:?}"
        );
        if mode.is_empty() {
            let good = promised.iter().filter(|&&pixels| pixels <= 2.001).count();
            assert!(good >= 45, "the budget pays for most frames: {promised:?}");
        }
    }
}
