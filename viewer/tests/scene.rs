//! Scene, slots and loader together, on a store that only remembers.
#![expect(clippy::expect_used, reason = "a test that cannot go on says why")]

mod common;

use std::collections::HashMap;

use common::Hills;
use relevo::TileId;
use relevo::select::tile::TileData;
use relevo::select::{EdgeRule, View};
use relevo::texel::Texels;
use relevo_viewer::camera::Pose;
use relevo_viewer::gpu::Sizes;
use relevo_viewer::residency::Store;
use relevo_viewer::scene::{FramePlan, Scene, Terrain};

/// Which tile lies in which slot.
#[derive(Default)]
struct Slots(HashMap<u32, TileId>);

impl Store for Slots {
    fn put_tile(&mut self, slot: u32, data: &TileData) -> relevo::Result<()> {
        self.0.insert(slot, data.table.id);
        Ok(())
    }

    fn put_image(&mut self, _: u32, _: &Texels) -> relevo::Result<()> {
        Ok(())
    }
}

impl Slots {
    /// Every tile of a plan lies where the plan says.
    fn check(&self, plan: &FramePlan) {
        for (tile, slot) in plan.selection.tiles.iter().zip(&plan.slots) {
            assert_eq!(self.0.get(slot), Some(&tile.id), "slot {slot}");
        }
    }
}

fn scene(side: u32, tiles: u32, ram_cache: u64) -> (tempfile::TempDir, Scene) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = Hills::new(side).build(folder.path(), 32, 8);
    let terrain = Terrain::open(&file, ram_cache).expect("open");
    let sizes = Sizes { tiles, ..terrain.sizes() };
    (folder, Scene::new(terrain, sizes, EdgeRule::Shared, 1.0).expect("scene"))
}

fn view(scene: &Scene, column: f64, row: f64, height: f64) -> View {
    let pose = Pose { eye: [column, row, height], target: [column + 1.0, row - 60.0, 400.0] };
    pose.view(scene.frame(), 50.0, (400, 300))
}

#[test]
fn what_is_drawn_lies_in_its_slot_whatever_the_camera_does() {
    let (_folder, mut scene) = scene(1025, 60, 8 << 20);
    let mut slots = Slots::default();
    let mut drawn = 0;
    for frame in 0..400_u32 {
        // Flies, and jumps every now and then.
        let (leg, step) = (f64::from(frame / 40), f64::from(frame % 40));
        let (column, row) =
            (100.0 + (leg * 377.0) % 800.0 + step, 1000.0 - (leg * 211.0) % 700.0 - 4.0 * step);
        let view = view(&scene, column, row, 900.0 + 20.0 * step);
        let plan = scene.stream(&mut slots, &view, 1.0).expect("a frame");
        slots.check(&plan);
        assert!(slots.0.keys().all(|&slot| slot < 60) && scene.resident().0 <= 60);
        drawn += plan.selection.tiles.len();
        if frame % 100 == 99 {
            let plan = scene.settle(&mut slots, &view, 1.0).expect("a frame");
            slots.check(&plan);
            assert!(!plan.selection.tiles.is_empty());
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert!(drawn > 1000, "{drawn}");
}

#[test]
fn a_tile_that_left_the_card_comes_back_without_being_decoded() {
    // The reader has a quarter of the cache; what is decoded has the rest, and all of the file fits
    // there.
    let (_folder, mut scene) = scene(513, 70, 12 << 20);
    let mut slots = Slots::default();
    let places = [(100.0, 480.0), (400.0, 480.0), (120.0, 150.0), (400.0, 150.0)];
    let mut round = |scene: &mut Scene| {
        for (column, row) in places {
            let view = view(scene, column, row, 900.0);
            let plan = scene.settle(&mut slots, &view, 2.0).expect("a frame");
            slots.check(&plan);
            assert_eq!(plan.pending, 0);
        }
    };
    round(&mut scene);
    let decoded = scene.reader().decoded_tiles();
    assert!(decoded > 70, "{decoded} tiles: more than there are slots");
    round(&mut scene);
    assert_eq!(scene.reader().decoded_tiles(), decoded);
}

#[test]
fn the_view_ahead_is_loaded_when_the_current_one_has_all() {
    let (_folder, mut scene) = scene(1025, 2_000, 64 << 20);
    let mut slots = Slots::default();
    // Turning at a steady pace: the next views need other tiles.
    let look = |scene: &Scene, angle: f64| {
        let target = [512.0 + 100.0 * angle.sin(), 512.0 - 100.0 * angle.cos(), 500.0];
        Pose { eye: [512.0, 512.0, 1000.0], target }.view(scene.frame(), 40.0, (400, 300))
    };
    let (still, now) = (look(&scene, 0.0), look(&scene, 0.02));
    // What both views need.
    scene.settle(&mut slots, &still, 2.0).expect("a frame");
    scene.settle(&mut slots, &now, 2.0).expect("a frame");
    let before = scene.resident().0;
    for frame in 0..2 {
        let view = look(&scene, 0.02 * f64::from(frame));
        scene.stream(&mut slots, &view, 2.0).expect("a frame");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let begun = std::time::Instant::now();
    while scene.resident().0 < before + 10 && begun.elapsed().as_secs() < 10 {
        std::thread::sleep(std::time::Duration::from_millis(5));
        let plan = scene.stream(&mut slots, &now, 2.0).expect("a frame");
        slots.check(&plan);
    }
    assert!(scene.resident().0 >= before + 10, "{} tiles, {before} before", scene.resident().0);
}
