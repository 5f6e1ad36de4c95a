//! What a writer refuses, and that nothing stays of it.

use std::path::Path;

use relevo::mesh_file::{Affine, Encoding, Format, Up, Writer, files, size};

use super::{Given, adorned, grid, usual, write};

fn refused(given: &Given, change: impl Fn(&mut Given), said: &str) {
    let mut given = given.clone();
    change(&mut given);
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("a");
    let tried = || {
        let mut writer = Writer::create(&path, given.format, given.content.clone(), false)?;
        writer.vertices(&given.vertices)?;
        writer.triangles(&given.triangles)?;
        writer.finish()
    };
    let error = tried().expect_err(said).to_string();
    assert!(error.contains(said), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("folder").count(), 0);
}

#[test]
fn what_was_not_announced_is_refused() {
    for format in [Format::Glb, Format::Obj, Format::Ply, Format::Stl] {
        let given = grid(format, usual(), false, 1);
        refused(&given, |given| given.vertices.truncate(19), "were announced");
        refused(&given, |given| given.vertices.push(given.vertices[0]), "were announced");
        refused(&given, |given| given.triangles.truncate(23), "were announced");
        refused(&given, |given| given.triangles.push([0, 1, 2]), "were announced");
        refused(&given, |given| given.triangles[0][1] = 20, "vertex 20 of 20");
        refused(&given, |given| given.vertices[3].place[0] = f64::NAN, "outside");
        refused(&given, |given| given.vertices[3].place[0] = 9.0, "outside");
        refused(&given, |given| given.content.bounds.1[2] += 1.0, "were announced");
        let flat = Affine { matrix: [[1.0; 3]; 3], offset: [0.0; 3] };
        refused(&given, |given| given.content.map = flat, "cannot be inverted");
    }
    let given = grid(Format::Glb, usual(), true, 1);
    refused(&given, |given| given.format = Format::Ply, "16 bits");
    refused(&given, |given| given.content.up = Up::Z, "z cannot be up");
    let narrow = Encoding::Short { origin: [0.0; 3], step: [1.0; 3] };
    refused(&given, |given| given.content.encoding = narrow, "outside");
    let stl = grid(Format::Stl, usual(), false, 1);
    refused(
        &stl,
        |given| given.content.picture = adorned(grid(Format::Ply, usual(), false, 1)).content.picture,
        "picture",
    );
}

#[test]
fn what_a_format_cannot_hold_is_refused_before_the_work() {
    for (format, vertices, triangles, said) in [
        (Format::Glb, 1 << 28, 1 << 28, "less than 4 GiB"),
        (Format::Glb, 1 << 33, 4, "vertices"),
        (Format::Ply, (1 << 31) + 1, 4, "vertices"),
        (Format::Stl, 3, 1 << 32, "triangles"),
        (Format::Obj, 1 << 32, 1, "vertices"),
        (Format::Obj, 0, 0, "without triangles"),
    ] {
        let mut content = grid(format, usual(), false, 1).content;
        (content.vertices, content.triangles) = (vertices, triangles);
        let error = size(format, &content).expect_err(said).to_string();
        assert!(error.contains(said), "{error}");
    }
}

#[test]
fn every_file_is_named_and_none_is_replaced() {
    for format in [Format::Obj, Format::Ply, Format::Glb] {
        let folder = tempfile::tempdir().expect("folder");
        let given = adorned(grid(format, usual(), false, 1));
        let (path, _) = write(&given, folder.path());
        let mut named = files(&path, format, &given.content);
        let entries = std::fs::read_dir(folder.path()).expect("folder");
        let mut there: Vec<_> = entries.map(|entry| entry.expect("entry").path()).collect();
        named.sort();
        there.sort();
        assert_eq!(named, there);
        for name in &named {
            let new = folder.path().join("new");
            std::fs::create_dir(&new).expect("folder");
            let file = |path: &Path| new.join(path.file_name().expect("name"));
            std::fs::write(file(name), "mine").expect("write");
            assert!(Writer::create(file(&path), format, given.content.clone(), false).is_err());
            assert_eq!(std::fs::read_dir(&new).expect("folder").count(), 1);
            std::fs::remove_dir_all(new).expect("remove");
        }
    }
}

#[test]
fn an_ending_says_the_format() {
    assert_eq!(Format::of(Path::new("a.b/c.GlB")).expect("GLB"), Format::Glb);
    let error = Format::of(Path::new("a.glb.gz")).expect_err("gz").to_string();
    assert!([".glb", ".obj", ".ply", ".stl"].iter().all(|end| error.contains(end)), "{error}");
}
