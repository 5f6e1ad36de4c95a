//! Makes text of files safe for a terminal: characters that would move its cursor, change its
//! colours or the order of its letters become escapes.

use std::borrow::Cow;
use std::io::{self, Write};

/// The text with every control character, and every character that changes the direction of
/// letters, as a JSON escape such as `\u001b`. Newlines are escaped too, so a line stays a line.
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, is_unfit)
}

/// True for characters that no text of a file may bring to a terminal.
fn is_unfit(letter: char) -> bool {
    letter.is_control()
        || matches!(letter, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{206f}' | '\u{feff}')
}

fn escaped(text: &str, unfit: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&unfit) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for letter in text.chars() {
        if unfit(letter) {
            // All these characters are below 2^16.
            let number = u32::from(letter);
            out.push_str("\\u");
            out.extend([12, 8, 4, 0].iter().filter_map(|shift| char::from_digit(number >> shift & 15, 16)));
        } else {
            out.push(letter);
        }
    }
    Cow::Owned(out)
}

/// A writer that escapes like [`printable`], but for newlines and tabs, which pass. JSON stays the
/// same JSON.
pub struct Plain<W>(pub W);

impl<W: Write> Write for Plain<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.write_all(bytes).map(|()| bytes.len())
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        // Callers write whole words; bytes that are not UTF-8 are not lost either.
        for chunk in bytes.utf8_chunks() {
            let unfit = |letter| is_unfit(letter) && !matches!(letter, '\n' | '\t');
            self.0.write_all(escaped(chunk.valid(), unfit).as_bytes())?;
            if !chunk.invalid().is_empty() {
                self.0.write_all("\u{fffd}".as_bytes())?;
            }
        }
        Ok(())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_a_terminal_obeys_is_escaped() {
        for text in ["", "Höhe über NN", "c:\\dem.tif", "地形 \"x\"", "a' b"] {
            assert!(matches!(printable(text), Cow::Borrowed(same) if same == text));
        }
        let hostile = "a\u{1b}[31mb\nc\u{9b}d\u{202e}e\u{7f}\r\t\u{2028}\0";
        let shown = printable(hostile);
        assert_eq!(shown, "a\\u001b[31mb\\u000ac\\u009bd\\u202ee\\u007f\\u000d\\u0009\\u2028\\u0000");
        for letter in (0..=0x2100).filter_map(char::from_u32).filter(|letter| letter.is_control()) {
            assert!(!printable(&letter.to_string()).contains(letter));
        }
    }

    #[test]
    fn json_stays_what_it_is() {
        let text = "C1 \u{9b}2J, turned \u{202e} and ended\n";
        let mut out = Plain(Vec::new());
        serde_json::to_writer(&mut out, &serde_json::json!({ "name": text })).expect("JSON");
        writeln!(out, "\tx \u{1b}c").expect("write");
        let shown = String::from_utf8(out.0).expect("text");
        let (json, rest) = shown.split_once('\n').expect("two lines");
        assert!(json.is_ascii() && rest.is_empty(), "{shown:?}");
        let (json, rest) = json.split_at(json.rfind('}').expect("JSON") + 1);
        assert_eq!(rest, "\tx \\u001bc");
        let back: serde_json::Value = serde_json::from_str(json).expect("JSON");
        assert_eq!(back["name"], text);
    }
}
