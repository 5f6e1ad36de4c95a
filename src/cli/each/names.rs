//! Names of a batch's outputs: that of the input, preceded by as much of its path as makes it
//! unique.

use std::collections::HashMap;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use relevo::Error;
use relevo::source;

use crate::cli::shown;

/// The output path of every input in `folder`. Inputs of the same name get the names of their
/// folders in front (`north-n51.rlv`); if these are the same too, their extensions behind
/// (`n51-hgt.rlv`).
pub fn outputs(inputs: &[PathBuf], folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let mut names: Vec<OsString> = inputs.iter().map(|input| source::stem(input)).collect();
    let mut prefixes: Vec<Vec<OsString>> = inputs.iter().map(|input| folders(input)).collect();
    let mut suffixed = vec![false; inputs.len()];
    while let Some(group) = same_names(&names) {
        let mut changed = false;
        for &i in &group {
            let folder_differs = group.iter().any(|&j| prefixes[j] != prefixes[i]);
            if folder_differs {
                if let Some(folder) = prefixes[i].pop() {
                    names[i] = joined(&folder, "-", &names[i]);
                    changed = true;
                }
            } else if !suffixed[i] {
                suffixed[i] = true;
                if let Some(extension) = inputs[i].extension() {
                    names[i] = joined(&names[i], "-", extension);
                    changed = true;
                }
            }
        }
        if !changed {
            let name = |i: usize| shown(&inputs[i]);
            let (first, second) = (name(group[0]), name(group[1]));
            let output = folder.join(joined(&names[group[0]], ".", OsStr::new("rlv")));
            let what = format!("{first} and {second} would both become {}; give each once", shown(&output));
            return Err(Error::usage(what));
        }
    }
    Ok(names.iter().map(|name| folder.join(joined(name, ".", OsStr::new("rlv")))).collect())
}

/// Two parts of a name with a separator between them.
fn joined(first: &OsStr, between: &str, second: &OsStr) -> OsString {
    let mut name = first.to_owned();
    name.push(between);
    name.push(second);
    name
}

/// Indices of inputs whose outputs would have the same name, ignoring case as some file systems do.
fn same_names(names: &[OsString]) -> Option<Vec<usize>> {
    let mut groups: HashMap<OsString, Vec<usize>> = HashMap::with_capacity(names.len());
    for (i, name) in names.iter().enumerate() {
        let small =
            name.to_str().map_or_else(|| name.to_ascii_lowercase(), |name| name.to_lowercase().into());
        groups.entry(small).or_default().push(i);
    }
    groups.into_values().filter(|group| group.len() > 1).min()
}

/// Names of the folders that an input lies in, the nearest last.
fn folders(input: &Path) -> Vec<OsString> {
    let absolute = std::path::absolute(input).unwrap_or_else(|_| input.to_owned());
    let parts = absolute.parent().into_iter().flat_map(Path::components);
    let named = parts.filter_map(|part| match part {
        std::path::Component::Normal(name) => Some(name.to_owned()),
        _ => None,
    });
    named.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(inputs: &[&str]) -> Result<Vec<String>, String> {
        let inputs: Vec<PathBuf> = inputs.iter().map(PathBuf::from).collect();
        let outputs = outputs(&inputs, Path::new("out")).map_err(|error| error.to_string())?;
        let name = |path: &PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned());
        Ok(outputs.iter().filter_map(name).collect())
    }

    #[test]
    fn outputs_are_told_apart_by_their_folders() {
        let names = |inputs: &[&str]| named(inputs).expect("names");
        assert_eq!(names(&["/a/x.tif", "/b/y.tif"]), ["x.rlv", "y.rlv"]);
        assert_eq!(names(&["/a/x.tif", "/b/x.tif", "/b/y.tif"]), ["a-x.rlv", "b-x.rlv", "y.rlv"]);
        assert_eq!(names(&["/p/a/x.tif", "/q/a/x.tif"]), ["p-a-x.rlv", "q-a-x.rlv"]);
        assert_eq!(names(&["/a/x.tif", "/a/X.hgt"]), ["x-tif.rlv", "X-hgt.rlv"]);
        assert_eq!(names(&["/a/x.tif", "/a/x.hgt", "/b/x.tif"]), ["a-x-tif.rlv", "a-x-hgt.rlv", "b-x.rlv"]);
        // A lengthened name may be that of another input.
        assert_eq!(names(&["/a/x.tif", "/b/x.tif", "/c/a-x.tif"]).len(), 3);
        assert!(named(&["/a/x.tif", "/a/x.tif"]).expect_err("twice").contains("would both become"));
        assert!(named(&["/a/x.tif", "/a/./x.tif"]).is_err());
    }
}
