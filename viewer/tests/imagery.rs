//! Imagery in the program: many images on a tile, a budget for both, an image that cannot be read.
#![expect(clippy::expect_used, reason = "a test that cannot go on says why")]

mod common;

use std::fs;
use std::path::Path;

use common::{Table, chequered, png, run, viewer};
use relevo::TileId;
use relevo::container::{Reader, sections};

const FROM_ABOVE: [&str; 6] = ["--size", "300x300", "--eye", "128,128,3500", "--target", "128,127,500"];

/// Shares of the pixels that are red and green.
fn shares(path: &Path) -> (f64, f64) {
    let (_, _, bytes, channels) = png(path);
    let count = (bytes.len() / channels) as f64;
    let share = |a: usize, b: usize| {
        bytes.chunks_exact(channels).filter(|pixel| f64::from(pixel[a]) > 1.6 * f64::from(pixel[b])).count()
            as f64
            / count
    };
    (share(0, 1), share(1, 0))
}

#[test]
fn images_lie_on_the_terrain_within_the_budget() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = chequered(folder.path(), 257);
    let shot = folder.path().join("shot.png");
    run(viewer().arg(&file).args(FROM_ABOVE).arg("--shot").arg(&shot), 0);
    let (red, green) = shares(&shot);
    assert!(red > 0.3 && green > 0.3, "red {red}, green {green}");
    run(
        viewer().arg(&file).args(FROM_ABOVE).args(["--paint", "tint", "--force"]).arg("--shot").arg(&shot),
        0,
    );
    assert!(shares(&shot).0 < 0.1, "a tint is no chequerboard");
    let csv = folder.path().join("out.csv");
    for mode in [&[][..], &["--streaming"]] {
        let mut command = viewer();
        command
            .arg(&file)
            .args(["--headless", "--count", "30", "--size", "320x200", "--gpu-memory", "3MiB", "--force"])
            .args(mode);
        run(command.arg("--metrics").arg(&csv), 0);
        let table = Table::read(&csv);
        let bytes = table.column("gpu_bytes");
        assert!(bytes.iter().all(|&bytes| bytes <= f64::from(3 << 20)), "{mode:?}: {bytes:?}");
        let (tiles, draws) = (table.column("tiles"), table.column("draws"));
        assert!(
            tiles.iter().zip(&draws).any(|(tiles, draws)| draws > tiles),
            "several images on a tile: {draws:?}"
        );
        if mode.is_empty() {
            let pending = table.column("loads_pending");
            assert!(pending.iter().all(|&pending| pending == 0.0), "{pending:?}");
        }
    }
}

#[test]
fn a_damaged_image_is_reported_once_and_its_parent_is_seen() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = chequered(folder.path(), 257);
    let reader = Reader::open(&file).expect("open");
    let section =
        reader.sections().iter().find(|section| section.kind == sections::IMAGERY_TILES).expect("images");
    let layer = reader.imagery().expect("a layer");
    // Two levels above the finest: near enough to be wanted, and its own children are not wanted
    // any more.
    let half = 1 << (layer.header().leaf - 3);
    let id = TileId::new(layer.header().leaf - 2, half, half);
    let at = (section.offset + layer.entry(id).expect("row").expect("image").chunks.offset + 5) as usize;
    let mut bytes = fs::read(&file).expect("read");
    bytes[at] ^= 0x40;
    fs::write(&file, bytes).expect("write");
    let shot = folder.path().join("shot.png");
    let low = ["--size", "300x300", "--eye", "130,130,1200", "--target", "130,129,500"];
    let (_, errors) = run(viewer().arg(&file).args(low).arg("--shot").arg(&shot), 0);
    assert_eq!(errors.lines().count(), 1, "{errors}");
    assert!(errors.contains(&format!("imagery tile {id}")) && errors.contains("parent"), "{errors}");
    let (red, green) = shares(&shot);
    assert!(red + green > 0.5, "red {red}, green {green}");
}
