//! Numbers formatted for people.

/// A byte count such as `4.2 MB`, in powers of 1000 as disks and GDAL users count.
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

/// A number to three significant digits, with an exponent only if it is very large or small.
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

/// A height to the centimetre, without trailing zeros.
pub fn metres(value: f64) -> String {
    if value.abs() >= 1e7 || !value.is_finite() {
        return short(value);
    }
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// A count with its digits in groups of three: `1 234 567`.
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

/// A count for a table cell, at most nine columns wide: `9 999 999`, then `12.3 M`, `1.23 G`.
pub fn count(count: u64) -> String {
    if count < 10_000_000 {
        return grouped(count);
    }
    let mut value = count as f64 / 1e6;
    for unit in ["M", "G"] {
        if value < 999.5 {
            return format!("{} {unit}", short(value));
        }
        value /= 1000.0;
    }
    format!("{} T", short(value))
}

/// A duration such as `12.3 s`, `4 min 05 s`, `2 h 10 min`.
pub fn seconds(value: f64) -> String {
    let whole = value.round() as u64;
    if value < 0.0005 {
        "0 s".to_owned()
    } else if value < 60.0 {
        format!("{} s", short(value))
    } else if whole < 3600 {
        format!("{} min {:02} s", whole / 60, whole % 60)
    } else {
        format!("{} h {:02} min", whole / 3600, whole % 3600 / 60)
    }
}

/// A count with its noun: `1 tile`, `17 tiles`.
pub fn plural(count: u64, one: &str, many: &str) -> String {
    format!("{} {}", grouped(count), if count == 1 { one } else { many })
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
        assert_eq!(seconds(6.1e-7), "0 s");
    }

    #[test]
    fn heights_and_counts_are_short() {
        for (value, text) in [(0.0, "0"), (-0.001, "0"), (1234.0, "1234"), (12.346, "12.35"), (0.5, "0.5")] {
            assert_eq!(metres(value), text);
        }
        assert_eq!(metres(-3.4e38), "-3.40e38");
        assert_eq!(count(9_999_999), "9 999 999");
        assert_eq!((count(12_345_678), count(1_234_567_890_123)), ("12.3 M".to_owned(), "1.23 T".to_owned()));
        assert!((0..20).all(|power| count(10_u64.pow(power) - 1).len() <= 9));
    }
}
