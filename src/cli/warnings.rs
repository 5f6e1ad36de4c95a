//! What the library warns of, on stderr, with the options that help.

use relevo::Error;
use relevo::text::printable;

use crate::cli::{options, voice};

/// Warnings of the library with the names of options.
pub fn told(warnings: &[String]) -> Vec<String> {
    warnings.iter().map(|warning| options::named(warning)).collect()
}

/// Says them on stderr.
pub fn say(warnings: &[String]) {
    for warning in warnings {
        voice::warning(&printable(warning));
    }
}

/// Fails if there are warnings and `--strict` makes errors of them.
pub fn refuse(warnings: &[String], is_strict: bool) -> Result<(), Error> {
    if !is_strict || warnings.is_empty() {
        return Ok(());
    }
    let count =
        if warnings.len() == 1 { "1 warning".to_owned() } else { format!("{} warnings", warnings.len()) };
    Err(Error::usage(format!("{count}, an error by --strict: nothing is built")))
}
