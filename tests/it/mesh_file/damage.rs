//! Damaged files: an error or another mesh, never a panic, and never more memory than they warrant.

use std::fs;

use proptest::prelude::*;
use relevo::mesh_file::{Format, read};

use super::{adorned, grid, usual, write};

const FORMATS: [Format; 4] = [Format::Glb, Format::Obj, Format::Ply, Format::Stl];

#[test]
fn every_truncation_is_an_error_or_a_smaller_mesh() {
    for format in FORMATS {
        let folder = tempfile::tempdir().expect("folder");
        let (path, stored) = write(&adorned(grid(format, usual(), false, 3)), folder.path());
        let bytes = fs::read(&path).expect("file");
        for length in 0..bytes.len() {
            fs::write(&path, &bytes[..length]).expect("write");
            match read(&path, None) {
                // Text has no end that could be missing.
                Ok(mesh) => assert!(format == Format::Obj && mesh.vertices.len() <= stored.len(), "{length}"),
                Err(error) => assert!(error.to_string().starts_with(&path.display().to_string()), "{error}"),
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn changed_bytes_never_panic(
        format in prop::sample::select(FORMATS.to_vec()),
        short in any::<bool>(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let folder = tempfile::tempdir().expect("folder");
        let given = adorned(grid(format, usual(), short && format == Format::Glb, 3));
        let (path, _) = write(&given, folder.path());
        let mut bytes = fs::read(&path).expect("file");
        for (index, byte) in changes {
            let at = index.index(bytes.len());
            bytes[at] = byte;
        }
        fs::write(&path, &bytes).expect("write");
        if let Ok(mesh) = read(&path, None) {
            let held = mesh.vertices.len() * 24 + mesh.triangles.len() * 12;
            prop_assert!(held <= 70_000 + 65 * bytes.len());
        }
    }
}
