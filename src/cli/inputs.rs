//! Inputs as they stand on the command line: files, and lists of files.

use std::fs;
use std::path::PathBuf;

use relevo::Error;

/// Replaces every `@list.txt` by the files it names, one a line; lines that are empty or begin with `#` are passed over. Names are taken as
/// they are, relative to the current folder.
pub fn expand(inputs: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    let mut files = Vec::with_capacity(inputs.len());
    for input in inputs {
        let name = input.to_string_lossy();
        let Some(list) = name.strip_prefix('@').filter(|_| !input.exists()).map(PathBuf::from) else {
            files.push(input.clone());
            continue;
        };
        let text =
            fs::read_to_string(&list).map_err(|source| Error::io(&list, "read the list of files", source))?;
        let before = files.len();
        let named = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
        files.extend(named.map(PathBuf::from));
        if files.len() == before {
            return Err(Error::format("list of files", "one name a line", "none").at(&list));
        }
    }
    Ok(files)
}
