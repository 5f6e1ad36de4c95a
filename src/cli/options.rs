//! Replaces names of the library's options by those of the command line.

use relevo::source::advice;

/// Advice and option fields (in backquotes) of the library, each with its command-line option.
const NAMES: [(&str, &str); 21] = [
    (advice::NODATA, "give --nodata"),
    (advice::BAND, "choose another by --band N"),
    (advice::UNIT, "give --vertical-unit"),
    (advice::DEPTH, "give --depth"),
    (advice::CRS, "warp to a system in which they are near by --crs"),
    ("`crs`", "--crs"),
    ("`deep`", "--deep"),
    ("`force`", "--force"),
    ("`imagery_tile`", "--imagery-tile"),
    ("`level`", "--level"),
    ("`memory`", "--memory"),
    ("`metric`", "--metric"),
    ("`nodata`", "--nodata"),
    ("`overlap`", "--overlap"),
    ("`patch`", "--patch"),
    ("`precision_m`", "--precision"),
    ("`resume`", "--resume"),
    ("`stretch`", "--imagery-stretch"),
    ("`tile`", "--tile"),
    ("`vertical_unit`", "--vertical-unit"),
    ("`window`", "--window"),
];

/// A text of the library with command-line names of options.
pub fn named(text: &str) -> String {
    NAMES.iter().fold(text.to_owned(), |text, (words, option)| text.replace(words, option))
}
