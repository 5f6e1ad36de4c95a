//! Warnings of the library, printed to stderr with the options that help.

use relevo::Error;
use relevo::text::printable;

use crate::cli::{options, voice};

/// Warnings of the library with command-line names of options.
pub fn with_options(warnings: &[String]) -> Vec<String> {
    warnings.iter().map(|warning| options::named(warning)).collect()
}

/// Prints warnings to stderr.
pub fn print_warnings(warnings: &[String]) {
    for warning in warnings {
        voice::warning(&printable(warning));
    }
}

/// Fails if there are warnings and `--strict` is set.
pub fn refuse(warnings: &[String], is_strict: bool) -> Result<(), Error> {
    if !is_strict || warnings.is_empty() {
        return Ok(());
    }
    let count =
        if warnings.len() == 1 { "1 warning".to_owned() } else { format!("{} warnings", warnings.len()) };
    Err(Error::usage(format!("{count}, an error by --strict: nothing is built")))
}
