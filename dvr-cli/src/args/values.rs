//! Parsers of values: times, sizes, shares.

use std::fmt::Display;
use std::str::FromStr;
use std::time::Duration;

use dvr_core::hull::Bounds;
use dvr_train::Shard;
use glam::DVec3;

/// Reads a number between two, both included. The help of an argument says which.
pub(super) fn within<T>(least: T, most: T) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static,
{
    move |text: &str| {
        let number = text.parse().ok().filter(|number| (&least..=&most).contains(&number));
        number.ok_or_else(|| format!("write a number from {least} to {most}"))
    }
}

/// Longest time limit: a year.
const LONGEST: Duration = Duration::from_hours(8760);

/// Reads `90s`, `10m`, `2h` or plain seconds.
pub(super) fn parse_duration(text: &str) -> Result<Duration, String> {
    let (number, factor) = match text.char_indices().last() {
        Some((i, 's')) => (&text[..i], 1.0),
        Some((i, 'm')) => (&text[..i], 60.0),
        Some((i, 'h')) => (&text[..i], 3600.0),
        _ => (text, 1.0),
    };
    let seconds: f64 = number
        .parse()
        .map_err(|_| format!("{text:?} is not a time; write a time from 0s to 8760h, e.g. 90s, 10m or 2h"))?;
    let time = Duration::try_from_secs_f64(seconds * factor).ok().filter(|time| *time <= LONGEST);
    time.ok_or_else(|| format!("{text:?}: write a time from 0s to 8760h"))
}

/// Most parts that an evaluation is divided into.
const MOST_SHARDS: usize = 1_000_000;

/// Reads `3/16`.
pub(super) fn parse_shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
    let shard = parts
        .map(|(number, of)| Shard { number, of })
        .filter(|shard| (1..=shard.of).contains(&shard.number) && shard.of <= MOST_SHARDS);
    shard.ok_or_else(|| {
        format!("{text:?} is not a part; write 1/16, 2/16, ... up to 16/16, of parts from 1 to {MOST_SHARDS}")
    })
}

/// Largest stored field, and most memory.
const MOST_BYTES: u64 = 1_000_000_000_000;
const MOST_MEMORY: u64 = 1_000 * MOST_BYTES;

/// Largest threshold of distances, in the units of the files.
const LONGEST_LENGTH: f64 = 1e12;

/// Reads a length, which is positive and finite.
pub(super) fn parse_length(text: &str) -> Result<f64, String> {
    let length = text.trim().parse::<f64>().ok().filter(|length| *length > 0.0 && *length <= LONGEST_LENGTH);
    length.ok_or_else(|| format!("{text:?} is not a length; write a number above 0, e.g. 0.5, from above 0 to 1e12"))
}

/// Reads the size of a stored field, which is not 0.
pub(super) fn parse_bytes(text: &str) -> Result<usize, String> {
    let bytes = bytes_of(text).filter(|&n| n > 0 && n <= MOST_BYTES).and_then(|n| usize::try_from(n).ok());
    bytes.ok_or_else(|| format!("{text:?} is not a size; write 32000, 32k or 1M, from 1 to 1000G"))
}

/// Reads an amount of memory, which may be 0.
pub(super) fn parse_memory(text: &str) -> Result<u64, String> {
    let bytes = bytes_of(text).filter(|&n| n <= MOST_MEMORY);
    bytes.ok_or_else(|| format!("{text:?} is not an amount of memory; write 500M or 2G, from 0 to 1000000G"))
}

/// `32000`, `32k`, `1M` or `2G` in bytes.
fn bytes_of(text: &str) -> Option<u64> {
    let (number, factor) = match text.char_indices().last() {
        Some((i, 'k' | 'K')) => (&text[..i], 1_000),
        Some((i, 'M')) => (&text[..i], 1_000_000),
        Some((i, 'G')) => (&text[..i], 1_000_000_000),
        _ => (text, 1),
    };
    number.parse::<u64>().ok().and_then(|n| n.checked_mul(factor))
}

/// Farthest corner of a box from the origin, in the units of the files.
const FARTHEST: f64 = 1e12;

/// Reads `(-1,-1,0) to (1,1,2.5)`, as `dvr info` prints a box, or `(-1,-1,0)-(1,1,2.5)`.
pub(super) fn parse_box(text: &str) -> Result<Bounds, String> {
    let wrong = || format!("{text:?} is not a box; write two opposite corners, e.g. \"(-1,-1,0) to (1,1,2.5)\"");
    let coordinate = |s: &str| s.trim().parse::<f64>().ok().filter(|x| x.abs() <= FARTHEST);
    let corner = |s: &str| -> Option<DVec3> {
        let numbers: Vec<f64> = s.split(',').map(coordinate).collect::<Option<_>>()?;
        <[f64; 3]>::try_from(numbers).ok().map(DVec3::from_array)
    };
    let inner = text.trim().strip_prefix('(').and_then(|s| s.strip_suffix(')')).ok_or_else(wrong)?;
    let (first, rest) = inner.split_once(')').ok_or_else(wrong)?;
    let (between, second) = rest.split_once('(').ok_or_else(wrong)?;
    if !matches!(between.trim(), "to" | "-") {
        return Err(wrong());
    }
    let (first, second) = corner(first).zip(corner(second)).ok_or_else(wrong)?;
    let bounds = Bounds { min: first.min(second), max: first.max(second) };
    if bounds.size().min_element() > 0.0 {
        Ok(bounds)
    } else {
        Err(format!("{text:?}: the corners must differ along each axis"))
    }
}

/// Reads `64` or `320x240`.
pub(super) fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let (width, height) = text.split_once('x').unwrap_or((text, text));
    let side = |s: &str| s.parse::<u32>().ok().filter(|n| (1..=16_384).contains(n));
    match (side(width), side(height)) {
        (Some(width), Some(height)) => Ok((width, height)),
        _ => Err(format!("{text:?} is not a size; write 64 or 320x240, sides from 1 to 16384")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_sizes_are_read_or_refused() {
        assert_eq!(parse_duration("90s"), Ok(Duration::from_secs(90)));
        assert_eq!(parse_duration("1.5m"), Ok(Duration::from_secs(90)));
        assert!(parse_duration("soon").is_err() && parse_duration("-1s").is_err());
        assert_eq!(parse_size("320x240"), Ok((320, 240)));
        assert_eq!(parse_shard("3/16"), Ok(Shard { number: 3, of: 16 }));
        assert!(["0/3", "4/3", "3", "a/b", "1/0"].into_iter().all(|shard| parse_shard(shard).is_err()));
        assert_eq!((parse_bytes("32k"), parse_bytes("1M")), (Ok(32_000), Ok(1_000_000)));
        assert!(parse_bytes("k").is_err() && parse_bytes("0").is_err());
        assert_eq!((parse_memory("2G"), parse_memory("0")), (Ok(2_000_000_000), Ok(0)));
        for wrong in ["-1", "2T", "1.5G", "G", "", "18446744073709551615k"] {
            assert!(parse_memory(wrong).is_err(), "{wrong}");
        }
        assert_eq!((parse_length("0.5"), parse_length(" 2e-3")), (Ok(0.5), Ok(0.002)));
        assert!(["0", "-1", "nan", "inf", "", "mm"].into_iter().all(|length| parse_length(length).is_err()));
        assert!(parse_size("0").is_err() && parse_size("axb").is_err());
    }

    #[test]
    fn boxes_are_read_by_any_two_opposite_corners() {
        let expected = Bounds { min: DVec3::new(-1.0, 0.0, -2.5), max: DVec3::new(1.0, 3e-2, 4.0) };
        for text in ["(-1,0,-2.5) to (1,3e-2,4)", " ( 1, 0 ,4)-(-1, 0.03,-2.5) "] {
            assert_eq!(parse_box(text), Ok(expected), "{text}");
        }
        for wrong in ["", "(1,2,3)", "1,2,3,4,5,6", "(1,2) to (3,4)", "(1,2,3) and (4,5,6)", "(1,2,3) to (4,5,x)"] {
            assert!(parse_box(wrong).unwrap_err().contains("is not a box"), "{wrong}");
        }
        for wrong in ["(nan,0,0) to (1,1,1)", "(0,0,0) to (inf,1,1)", "(0,0,0) to (1,1,1e13)"] {
            assert!(parse_box(wrong).is_err(), "{wrong}");
        }
        assert!(parse_box("(0,0,0) to (1,0,1)").unwrap_err().contains("differ along each axis"));
    }
}
