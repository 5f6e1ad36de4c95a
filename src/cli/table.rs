//! Tables and figures for people.

use std::io::{self, Write};

/// A table: columns as wide as their widest cell, numbers to the right.
pub struct Table {
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with this heading.
    pub fn new(heading: &[&str]) -> Self {
        Self { rows: vec![heading.iter().map(ToString::to_string).collect()] }
    }

    /// One more row.
    pub fn row(&mut self, cells: Vec<String>) {
        self.rows.push(cells);
    }

    /// Prints it, indented by two.
    pub fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let width = |c: usize| {
            self.rows.iter().filter_map(|r| r.get(c)).map(|s| s.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..columns).map(width).collect();
        for row in &self.rows {
            let cells: Vec<String> =
                row.iter().zip(&widths).map(|(cell, &w)| format!("{cell:>w$}")).collect();
            writeln!(out, "  {}", cells.join("  ").trim_end())?;
        }
        Ok(())
    }
}

/// `4.2 MB`; powers of 1000, as disks and GDAL users count.
pub fn bytes(count: u64) -> String {
    let mut value = count as f64;
    for unit in ["B", "kB", "MB", "GB"] {
        if value < 999.5 {
            return if unit == "B" { format!("{count} B") } else { format!("{} {unit}", short(value)) };
        }
        value /= 1000.0;
    }
    format!("{} TB", short(value))
}

/// Three significant digits, without an exponent where it reads well.
pub fn short(value: f64) -> String {
    let magnitude = value.abs();
    if value == 0.0 {
        "0".to_owned()
    } else if !value.is_finite() {
        value.to_string()
    } else if magnitude >= 99.95 {
        if magnitude < 1e7 { format!("{value:.0}") } else { format!("{value:.2e}") }
    } else if magnitude >= 9.995 {
        format!("{value:.1}")
    } else if magnitude >= 0.995 {
        format!("{value:.2}")
    } else if magnitude >= 0.000_95 {
        format!("{value:.*}", (2 - magnitude.log10().floor() as i32).clamp(2, 6) as usize)
    } else {
        format!("{value:.1e}")
    }
}

/// `1 234 567`.
pub fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(' ');
        }
        out.push(digit);
    }
    out
}

/// `12.3 s`, `4 min 05 s`, `2 h 10 min`.
pub fn seconds(value: f64) -> String {
    let whole = value.round() as u64;
    if value < 60.0 {
        format!("{} s", short(value))
    } else if whole < 3600 {
        format!("{} min {:02} s", whole / 60, whole % 60)
    } else {
        format!("{} h {:02} min", whole / 3600, whole % 3600 / 60)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_keep_three_digits() {
        for (value, text) in [
            (0.0, "0"),
            (1234.5, "1234"),
            (99.96, "100"),
            (12.345, "12.3"),
            (1.005, "1.00"),
            (0.9949, "0.995"),
            (0.012_34, "0.0123"),
            (0.000_012, "1.2e-5"),
        ] {
            assert_eq!(short(value), text);
        }
        assert_eq!(bytes(999), "999 B");
        assert_eq!(bytes(3_277_899), "3.28 MB");
        assert_eq!(grouped(1_442_401), "1 442 401");
        assert_eq!(seconds(125.0), "2 min 05 s");
    }
}
