//! The Khronos validator has nothing to say of our GLB files.

use std::path::Path;
use std::process::Command;

use relevo::mesh_file::{Affine, Format};

use super::{adorned, grid, usual, write};

#[test]
fn the_khronos_validator_finds_nothing() {
    let folder = tempfile::tempdir().expect("folder");
    let (mut files, (s, c)) = (Vec::new(), 0.3_f64.sin_cos());
    let turned = [[c * 9.0, s * 9.0, 0.0], [s * 9.0, c * -9.0, 0.0], [0.0, 0.0, 1.0]];
    let sheared = [[3.0, 0.5, 0.0], [0.2, -4.0, 0.0], [0.0, 0.0, 1.0]];
    let mirrored = [[3.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 1.0]];
    for matrix in [usual().matrix, turned, sheared, mirrored] {
        for (short, full) in [(false, false), (false, true), (true, false), (true, true)] {
            if short && matrix == sheared {
                continue;
            }
            let map = Affine { matrix, offset: usual().offset };
            let given = grid(Format::Glb, map, short, 77 + files.len() as u64);
            let inside = folder.path().join(files.len().to_string());
            std::fs::create_dir(&inside).expect("folder");
            files.push(write(&if full { adorned(given) } else { given }, &inside).0);
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = Command::new("node")
        .arg(root.join("tests/gltf_validate.js"))
        .args(files)
        .env("NODE_PATH", root.join("target/node/node_modules"))
        .output()
        .expect("node runs");
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    assert!(output.status.success(), "the validator is installed by test.sh: {said}");
    assert_eq!(said, "");
}
