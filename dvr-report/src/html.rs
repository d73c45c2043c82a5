//! Text for HTML and SVG: escaping, and how numbers are written for people.

/// Text as it may stand in the body of HTML, XML and their attributes.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            // Not allowed in XML, however it is escaped.
            control if control.is_control() && !matches!(control, '\n' | '\t' | '\r') => escaped.push(' '),
            other => escaped.push(other),
        }
    }
    escaped
}

/// Data that a script reads, as it may stand within `<script type="...">`, where nothing is unescaped: JSON, whose only
/// dangerous character is written by its code.
pub fn json_for_script(value: &serde_json::Value) -> String {
    value.to_string().replace('<', "\\u003c")
}

/// Seconds for people: `0.42 s`, `7.3 s`, `2 min 05 s`, `3 h 12 min`.
pub fn seconds(value: f64) -> String {
    let whole = value.max(0.0).round() as u64;
    match value {
        v if v < 0.95 => format!("{v:.2} s"),
        v if v < 99.5 => format!("{v:.1} s"),
        _ if whole < 3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole / 60 % 60),
    }
}

/// Bytes for people, in powers of a thousand: `31 kB`, `1.2 GB`.
pub fn bytes(value: f64) -> String {
    match value {
        v if v < 1e3 => format!("{v:.0} B"),
        v if v < 1e6 => format!("{:.0} kB", v / 1e3),
        v if v < 1e7 => format!("{:.1} MB", v / 1e6),
        v if v < 1e9 => format!("{:.0} MB", v / 1e6),
        v => format!("{:.1} GB", v / 1e9),
    }
}

/// A whole number with narrow spaces between thousands, at which no line breaks.
pub fn count(value: usize) -> String {
    let digits = value.to_string();
    let mut spaced = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            spaced.push('\u{202f}');
        }
        spaced.push(digit);
    }
    spaced
}

/// A number with about `digits` significant digits and no superfluous zeros; very large and small ones as powers of
/// ten.
pub fn number(value: f64, digits: usize) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !value.is_finite() {
        return if value.is_nan() { "?".into() } else { format!("{}\u{221e}", if value < 0.0 { "-" } else { "" }) };
    }
    let exponent = value.abs().log10().floor() as i32;
    if !(-4..6).contains(&exponent) {
        let mantissa = format!("{:.*}", digits.saturating_sub(1), value / 10f64.powi(exponent));
        let mantissa = trimmed(&mantissa);
        let power: String = exponent.to_string().chars().map(superscript).collect();
        return if mantissa == "1" { format!("10{power}") } else { format!("{mantissa}\u{b7}10{power}") };
    }
    let decimals = (digits as i32 - 1 - exponent).max(0) as usize;
    trimmed(&format!("{value:.decimals$}")).to_owned()
}

fn trimmed(number: &str) -> &str {
    if number.contains('.') { number.trim_end_matches('0').trim_end_matches('.') } else { number }
}

fn superscript(digit: char) -> char {
    match digit {
        '-' => '\u{207b}',
        '1' => '\u{b9}',
        '2' => '\u{b2}',
        '3' => '\u{b3}',
        _ => char::from_u32(0x2070 + digit.to_digit(10).unwrap_or(0)).unwrap_or(digit),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_a_name_holds_becomes_markup() {
        let name = "<script>alert('&\"')</script>\u{1}";
        let escaped = escape(name);
        assert!(!escaped.contains(['<', '>', '"', '\'', '\u{1}']), "{escaped}");
        assert!(escaped.starts_with("&lt;script&gt;") && escaped.contains("&amp;&quot;"));
        let json = json_for_script(&serde_json::json!({ "name": "</script><script>alert(1)" }));
        assert!(!json.contains('<'));
        assert_eq!(serde_json::from_str::<serde_json::Value>(&json).unwrap()["name"], "</script><script>alert(1)");
    }

    #[test]
    fn numbers_are_written_for_people() {
        assert_eq!(
            (seconds(0.423), seconds(7.31), seconds(125.2)),
            ("0.42 s".into(), "7.3 s".into(), "2 min 05 s".into())
        );
        assert_eq!((seconds(11_530.0), bytes(31_400.0)), ("3 h 12 min".into(), "31 kB".into()));
        assert_eq!((number(0.0029, 3), number(1000.0, 3)), ("0.0029".to_owned(), "1000".to_owned()));
        assert_eq!((number(1e-7, 2), number(2.5e7, 2)), ("10\u{207b}\u{2077}".into(), "2.5\u{b7}10\u{2077}".into()));
        assert_eq!(count(1_234_567), "1\u{202f}234\u{202f}567");
    }
}
