//! Tables and lines of text that fit the terminal.

use std::io::{self, Write};
use std::ops::Range;

use relevo::text::printable;

pub use crate::cli::figures::{bytes, count, grouped, metres, plural, seconds, short};

/// Columns of the output if it is not a terminal.
const PIPED: usize = 80;
/// Least columns assumed: narrower terminals wrap lines themselves.
const NARROWEST: usize = 40;
/// Spaces before a table.
const INDENT: usize = 2;

/// Columns of standard output: those of its terminal, else 80.
pub fn width() -> usize {
    let terminal = terminal_size::terminal_size_of(io::stdout());
    terminal.map_or(PIPED, |(terminal_size::Width(columns), _)| usize::from(columns).max(NARROWEST))
}

/// A table whose columns are as wide as their widest cell, with numbers aligned right. Headings and
/// group names may have several lines.
pub struct Table {
    heading: Vec<String>,
    groups: Vec<(usize, String)>,
    rows: Vec<Vec<String>>,
    /// The column of text, which is aligned left and shortened if the table is too wide.
    words: Option<usize>,
}

impl Table {
    /// A table with a heading for each column; a line break starts another line.
    pub fn new(heading: &[&str]) -> Self {
        let heading = heading.iter().map(ToString::to_string).collect();
        Self { heading, groups: Vec::new(), rows: Vec::new(), words: None }
    }

    /// Sets names that stand above several columns each: `(columns, name)`, aligned with the last
    /// column. The columns before them have no group.
    pub fn groups(mut self, groups: &[(usize, &str)]) -> Self {
        self.groups = groups.iter().map(|&(columns, name)| (columns, name.to_owned())).collect();
        self
    }

    /// Sets the column of text, counted from 0.
    pub fn words(mut self, column: usize) -> Self {
        self.words = Some(column);
        self
    }

    /// Adds a row.
    pub fn row(&mut self, cells: Vec<String>) {
        self.rows.push(cells);
    }

    /// Prints the table, indented by two.
    pub fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        self.print_in(width(), out)
    }

    /// Prints the table for a page of `page` columns.
    fn print_in(&self, page: usize, out: &mut dyn Write) -> io::Result<()> {
        // Columns get one space between them where there is no room for two; then the text column
        // is shortened.
        let apart = |gap: usize| {
            let mut widths = self.widths();
            self.widen_for_groups(&mut widths, gap);
            let all = INDENT + widths.iter().sum::<usize>() + gap * widths.len().saturating_sub(1);
            (widths, gap, all)
        };
        let (mut widths, gap, all) =
            Some(apart(2)).filter(|(.., all)| *all <= page).unwrap_or_else(|| apart(1));
        if let Some(width) = self.words.and_then(|column| widths.get_mut(column)) {
            *width = width.saturating_sub(all.saturating_sub(page)).max(8);
        }
        self.print_groups(&widths, gap, out)?;
        let lines = self.heading.iter().map(|name| name.lines().count()).max().unwrap_or(0);
        for line in 0..lines {
            // The last line of every heading stands right above the cells.
            let part = |name: &String| {
                let first = lines - name.lines().count();
                line.checked_sub(first).and_then(|line| name.lines().nth(line)).unwrap_or_default().to_owned()
            };
            self.print_row(&self.heading.iter().map(part).collect::<Vec<_>>(), &widths, gap, out)?;
        }
        self.rows.iter().try_for_each(|row| self.print_row(row, &widths, gap, out))
    }

    fn widths(&self) -> Vec<usize> {
        let columns = self.rows.iter().map(Vec::len).chain([self.heading.len()]).max().unwrap_or(0);
        let of_cell = |cell: &String| cell.lines().map(|line| line.chars().count()).max().unwrap_or(0);
        let cells =
            |column: usize| self.rows.iter().chain([&self.heading]).filter_map(move |row| row.get(column));
        (0..columns).map(|column| cells(column).map(of_cell).max().unwrap_or(0)).collect()
    }

    /// Widens the first column of each group until the group's name fits.
    fn widen_for_groups(&self, widths: &mut [usize], gap: usize) {
        for (range, name) in self.spans(widths.len()) {
            let needed = name.lines().map(|line| line.chars().count()).max().unwrap_or(0);
            let own = widths[range.clone()].iter().sum::<usize>() + gap * (range.len() - 1);
            widths[range.start] += needed.saturating_sub(own);
        }
    }

    /// The columns of each group, and its name.
    fn spans(&self, columns: usize) -> Vec<(Range<usize>, &str)> {
        let mut from = columns.saturating_sub(self.groups.iter().map(|(columns, _)| columns).sum());
        let mut spans = Vec::with_capacity(self.groups.len());
        for (columns, name) in &self.groups {
            spans.push((from..from + columns, name.as_str()));
            from += columns;
        }
        spans
    }

    fn print_groups(&self, widths: &[usize], gap: usize, out: &mut dyn Write) -> io::Result<()> {
        let spans = self.spans(widths.len());
        let lines = spans.iter().map(|(_, name)| name.lines().count()).max().unwrap_or(0);
        for line in 0..lines {
            let mut text = String::new();
            for (range, name) in &spans {
                let end = INDENT + widths[..range.end].iter().sum::<usize>() + gap * (range.end - 1);
                let name = name.lines().nth(line).unwrap_or_default();
                let room = end.saturating_sub(text.chars().count() + name.chars().count());
                text.extend([&" ".repeat(room), name]);
            }
            writeln!(out, "{}", text.trim_end())?;
        }
        Ok(())
    }

    fn print_row(&self, row: &[String], widths: &[usize], gap: usize, out: &mut dyn Write) -> io::Result<()> {
        let cell = |(column, (cell, &width)): (usize, (&String, &usize))| {
            if self.words == Some(column) {
                format!("{:<width$}", shortened(cell, width))
            } else {
                format!("{cell:>width$}")
            }
        };
        let cells: Vec<String> = row.iter().zip(widths).enumerate().map(cell).collect();
        writeln!(out, "{:INDENT$}{}", "", cells.join(&" ".repeat(gap)).trim_end())
    }
}

/// A text shortened to `width` columns by leaving out its middle, as a path says most at its ends.
fn shortened(text: &str, width: usize) -> String {
    let text = &*printable(text);
    let letters: Vec<char> = text.chars().collect();
    if letters.len() <= width {
        return text.to_owned();
    }
    let (head, tail) = ((width - 1) / 3, width - 1 - (width - 1) / 3);
    letters[..head].iter().chain(['…'].iter()).chain(&letters[letters.len() - tail..]).collect()
}

/// A text broken between words into lines of at most the page width; all but the first are indented
/// by `indent`. A longer word stays whole, since it may be a path to copy.
pub fn wrapped(text: &str, indent: usize) -> String {
    wrapped_in(text, indent, width())
}

fn wrapped_in(text: &str, indent: usize, page: usize) -> String {
    let text = &*printable(text);
    let start = text.len() - text.trim_start_matches(' ').len();
    let mut line = " ".repeat(start);
    let mut lines = Vec::new();
    for word in text[start..].split(' ') {
        let length = line.chars().count();
        let begun = !line.trim_start().is_empty();
        if begun && length + 1 + word.chars().count() > page {
            lines.push(std::mem::replace(&mut line, " ".repeat(indent)));
            line += word;
        } else {
            line += if begun { " " } else { "" };
            line += word;
        }
    }
    lines.push(line);
    lines.join("\n")
}

/// Prints a named fact as `  name       text`; a long text continues below itself.
pub fn fact(name: &str, text: &str, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "{}", wrapped(&format!("  {name:<NAMES$} {text}"), NAMES + 3))
}

/// Width of the column of names.
const NAMES: usize = 10;

#[cfg(test)]
mod tests {
    use super::*;

    fn printed(table: &Table, page: usize) -> Vec<String> {
        let mut out = Vec::new();
        table.print_in(page, &mut out).expect("memory");
        String::from_utf8(out).expect("text").lines().map(str::to_owned).collect()
    }

    #[test]
    fn headings_stand_above_their_columns_and_groups_above_theirs() {
        let mut table = Table::new(&["level", "size\n(m)", "a", "b"]).groups(&[(2, "of both")]);
        table.row(["0", "1234567", "1", "2"].map(str::to_owned).to_vec());
        let lines = printed(&table, 80);
        assert_eq!(
            lines,
            [
                "                  of both",
                "            size",
                "  level      (m)     a  b",
                "      0  1234567     1  2",
            ]
        );
    }

    #[test]
    fn words_give_way_where_a_table_is_too_wide() {
        let mut table = Table::new(&["input", "samples"]).words(0);
        table.row(vec!["a/very/long/path/of/many/folders/to/a/file.tif".to_owned(), "1 442 401".to_owned()]);
        for page in [40, 50, 80] {
            let lines = printed(&table, page);
            assert!(lines.iter().all(|line| line.chars().count() <= page), "{lines:#?}");
            assert!(lines[1].contains("file.tif") && lines[1].contains("1 442 401"), "{lines:#?}");
        }
        assert_eq!(shortened("0123456789", 7), "01…6789");
    }

    #[test]
    fn lines_are_broken_between_words_and_words_stay_whole() {
        let text = "  name  one two three /a/path/that/is/longer/than/the/page four";
        let lines: Vec<String> = wrapped_in(text, 8, 20).lines().map(str::to_owned).collect();
        let path = "        /a/path/that/is/longer/than/the/page";
        assert_eq!(lines, ["  name  one two", "        three", path, "        four"]);
        assert_eq!(wrapped_in("short", 4, 20), "short");
    }
}
