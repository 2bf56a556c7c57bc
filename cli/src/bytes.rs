//! Sizes in bytes, as people write and read them.

/// Bytes of a size such as `500000`, `64MiB`, `1.5 GB`.
pub(crate) fn parse(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let digits = text
        .trim_end_matches(|c: char| c.is_ascii_alphabetic())
        .trim_end();
    let unit = text[digits.len()..].trim().to_ascii_lowercase();
    let factor: f64 = match unit.as_str() {
        "" | "b" => 1.0,
        "k" | "kib" => 1024.0,
        "m" | "mib" => 1024f64.powi(2),
        "g" | "gib" => 1024f64.powi(3),
        "t" | "tib" => 1024f64.powi(4),
        "kb" => 1e3,
        "mb" => 1e6,
        "gb" => 1e9,
        "tb" => 1e12,
        _ => {
            return Err(format!(
                "{unit:?} is no unit of bytes; use KiB, MiB, GiB, KB, MB or GB"
            ));
        }
    };
    let value: f64 = digits
        .parse()
        .map_err(|_| format!("{digits:?} is no number; write a size such as 2GiB"))?;
    let bytes = value * factor;
    if !(1.0..=2f64.powi(63)).contains(&bytes) {
        return Err(format!("{text} is not between one byte and 2^63"));
    }
    Ok(bytes as u64)
}

/// A size for people: `1.5 MiB`.
pub(crate) fn text(bytes: u64) -> String {
    let (mut value, mut unit) = (bytes as f64, "B");
    for larger in ["KiB", "MiB", "GiB", "TiB"] {
        if value < 1024.0 {
            break;
        }
        (value, unit) = (value / 1024.0, larger);
    }
    match unit {
        "B" => format!("{bytes} B"),
        _ if value < 10.0 => format!("{value:.2} {unit}"),
        _ => format!("{value:.1} {unit}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_understood_and_nonsense_is_refused() {
        for (text, bytes) in [
            ("1", 1),
            ("64MiB", 64 << 20),
            ("1.5 GB", 1_500_000_000),
            ("2g", 2 << 30),
            ("8kb", 8000),
        ] {
            assert_eq!(parse(text), Ok(bytes), "{text}");
        }
        for text in ["", "MiB", "-1", "0", "1e99", "nan", "5 parsecs", "1 2", "inf"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sizes_are_written_with_three_digits() {
        assert_eq!(
            [0, 1023, 1536, 20 << 20].map(text),
            ["0 B", "1023 B", "1.50 KiB", "20.0 MiB"]
        );
    }
}
