//! The files that a mesh takes: its own, and those beside it.

use std::path::{Path, PathBuf};

use super::{Content, Format};

/// All files that a [`super::Writer`] makes, the mesh first: none may be an input.
pub fn files(path: &Path, format: Format, content: &Content) -> Vec<PathBuf> {
    let mut files = vec![path.to_owned()];
    let beside = |name: String| path.with_file_name(name);
    if let (Some(picture), Format::Obj | Format::Ply) = (&content.picture, format) {
        files.push(beside(picture_name(path, picture.ending())));
    }
    if content.picture.is_some() && format == Format::Obj {
        files.push(beside(material_name(path)));
    }
    files
}

/// The name of the picture of a mesh.
pub(super) fn picture_name(path: &Path, ending: &str) -> String {
    format!("{}.{ending}", stem(path))
}

/// The name of the material file of a mesh.
pub(super) fn material_name(path: &Path) -> String {
    format!("{}.mtl", stem(path))
}

/// The name of a mesh without its ending. Readers of OBJ and PLY split lines at spaces and know no
/// quotes, so that other characters than letters, digits and a few signs become `_`.
fn stem(path: &Path) -> String {
    let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let is_plain = |c: &char| c.is_ascii_alphanumeric() || ['-', '.', '_'].contains(c);
    stem.chars().map(|c| if is_plain(&c) { c } else { '_' }).collect()
}
