//! What the library warns of, on stderr, with the options that help.

use relevo::Error;
use relevo::source::advice;
use relevo::text::printable;

use crate::cli::voice;

/// How the words of the library read on a command line.
const OPTIONS: [(&str, &str); 5] = [
    (advice::NODATA, "give --nodata"),
    (advice::BAND, "choose another by --band N"),
    (advice::UNIT, "give --vertical-unit"),
    (advice::DEPTH, "give --depth"),
    (advice::CRS, "warp to a system in which they are near by --crs"),
];

/// The same with options by name.
pub fn told(warnings: &[String]) -> Vec<String> {
    let named = |warning: &String| {
        OPTIONS.iter().fold(warning.clone(), |text, (words, option)| text.replace(words, option))
    };
    warnings.iter().map(named).collect()
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
