//! Damage to bytes and to text.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::LONGEST;

/// Numbers at which arithmetic breaks.
const NUMBERS: [u64; 16] = [
    0,
    1,
    2,
    0x7f,
    0xff,
    0x100,
    2049,
    0x7fff,
    0xffff,
    0x10000,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x1_0000_0000,
    0x7fff_ffff_ffff_ffff,
    0xffff_ffff_ffff_ffff,
];

/// Words at which parsers break.
const WORDS: [&str; 28] = [
    "",
    "0",
    "-1",
    "1",
    "2049",
    "65536",
    "2147483647",
    "2147483648",
    "-2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "99999999999999999999999",
    "1e38",
    "1e39",
    "-1e308",
    "1e400",
    "nan",
    "inf",
    "-inf",
    "1e-46",
    "0.5",
    "true",
    "null",
    "\"\"",
    "[]",
    "{}",
];

/// Some bytes of damage, done one after another.
pub(super) fn bytes(base: &[u8], other: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = base.to_vec();
    for _ in 0..rounds(rng) {
        one(&mut bytes, other, rng);
    }
    bytes
}

/// One, mostly; at times a dozen.
fn rounds(rng: &mut ChaCha8Rng) -> usize {
    match rng.random_range(0..10) {
        0..5 => 1,
        5..8 => rng.random_range(2..5),
        _ => rng.random_range(5..16),
    }
}

/// A place in `length` bytes, near the beginning more often than not: that is where headers are.
fn place(length: usize, rng: &mut ChaCha8Rng) -> usize {
    let within = if rng.random_bool(0.5) { length.min(64) } else { length };
    rng.random_range(0..within.max(1)).min(length.saturating_sub(1))
}

fn one(bytes: &mut Vec<u8>, other: &[u8], rng: &mut ChaCha8Rng) {
    if bytes.is_empty() {
        bytes.extend(other);
        return;
    }
    let at = place(bytes.len(), rng);
    let length = rng.random_range(1..=(bytes.len() - at).min(64));
    match rng.random_range(0..10) {
        0 | 1 => bytes[at] ^= 1 << rng.random_range(0..8),
        2 => bytes[at] = rng.random(),
        3..=5 => number(bytes, at, rng),
        6 => {
            let copy = bytes[at..at + length].to_vec();
            let to = place(bytes.len(), rng);
            bytes.splice(to..to, copy.into_iter().cycle().take(length * rng.random_range(1..5)));
        }
        7 => {
            bytes.drain(at..at + length);
        }
        8 => bytes.truncate(at),
        _ if other.is_empty() => {}
        _ => {
            let from = rng.random_range(0..other.len());
            let end = (from + length).min(other.len());
            let to = (at + rng.random_range(0..=length)).min(bytes.len());
            bytes.splice(at..to, other[from..end].iter().copied());
        }
    }
}

/// Overwrites 1, 2, 4 or 8 bytes with a number, in either order of bytes.
fn number(bytes: &mut [u8], at: usize, rng: &mut ChaCha8Rng) {
    let value = NUMBERS[rng.random_range(0..NUMBERS.len())];
    let value = if rng.random_bool(0.2) { value.wrapping_sub(rng.random_range(0..4)) } else { value };
    let size = [1, 2, 4, 8][rng.random_range(0..4)].min(bytes.len() - at);
    let little = value.to_le_bytes();
    let target = &mut bytes[at..at + size];
    target.copy_from_slice(&little[..size]);
    if rng.random_bool(0.3) {
        target.reverse();
    }
}

/// Damage to lines and words; at times to bytes.
pub(super) fn text(base: &[u8], other: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    if rng.random_bool(0.25) {
        return bytes(base, other, rng);
    }
    let mut text = String::from_utf8_lossy(base).into_owned();
    for _ in 0..rounds(rng) {
        text = if rng.random_bool(0.7) { with_word(&text, rng) } else { with_lines(&text, rng) };
        // Repetitions of repetitions grow without end.
        if let Some((end, _)) = text.char_indices().nth(LONGEST) {
            text.truncate(end);
        }
    }
    text.into_bytes()
}

/// The same text with a word replaced, repeated or nested.
fn with_word(text: &str, rng: &mut ChaCha8Rng) -> String {
    let ends_word = |c: char| c.is_whitespace() || ",:;[](){}/\"'".contains(c);
    let mut words: Vec<(usize, &str)> = Vec::new();
    let mut start = 0;
    for (at, c) in text.char_indices().filter(|(_, c)| ends_word(*c)) {
        words.push((start, &text[start..at]));
        start = at + c.len_utf8();
    }
    words.push((start, &text[start..]));
    words.retain(|(_, word)| !word.is_empty());
    if words.is_empty() {
        return text.to_owned();
    }
    let (at, word) = words[rng.random_range(0..words.len())];
    let new = match rng.random_range(0..10) {
        0..6 => WORDS[rng.random_range(0..WORDS.len())].to_owned(),
        6 => words[rng.random_range(0..words.len())].1.to_owned(),
        7 => word.repeat(rng.random_range(2..200)),
        8 => {
            let depth = [10, 130, 2000][rng.random_range(0..3)];
            let (open, close) = [("[", "]"), ("(", ")"), ("{\"a\":", "}")][rng.random_range(0..3)];
            format!("{}{word}{}", open.repeat(depth), close.repeat(depth))
        }
        _ => format!("{word} {word}"),
    };
    [&text[..at], &new, &text[at + word.len()..]].concat()
}

/// The same text with a line removed, repeated or moved.
fn with_lines(text: &str, rng: &mut ChaCha8Rng) -> String {
    let mut lines: Vec<&str> = text.split_inclusive('\n').collect();
    if lines.is_empty() {
        return text.to_owned();
    }
    let at = rng.random_range(0..lines.len());
    let line = lines[at];
    match rng.random_range(0..4) {
        0 => {
            lines.remove(at);
        }
        1 => {
            let count = [1, 3, 300][rng.random_range(0..3)];
            lines.splice(at..at, std::iter::repeat_n(line, count));
        }
        2 => {
            let other = rng.random_range(0..lines.len());
            lines.swap(at, other);
        }
        _ => lines.truncate(at),
    }
    lines.concat()
}
