//! Parsers of values: times, sizes, shares.

use std::time::Duration;

use dvr_train::Shard;

/// Reads `90s`, `10m`, `2h` or plain seconds.
pub(super) fn parse_duration(text: &str) -> Result<Duration, String> {
    let (number, factor) = match text.char_indices().last() {
        Some((i, 's')) => (&text[..i], 1.0),
        Some((i, 'm')) => (&text[..i], 60.0),
        Some((i, 'h')) => (&text[..i], 3600.0),
        _ => (text, 1.0),
    };
    let seconds: f64 = number.parse().map_err(|_| format!("{text:?} is not a time; write 90s, 10m or 2h"))?;
    Duration::try_from_secs_f64(seconds * factor).map_err(|e| format!("{text:?}: {e}"))
}

/// Reads `3/16`.
pub(super) fn parse_shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
    let shard = parts.map(|(number, of)| Shard { number, of }).filter(|shard| (1..=shard.of).contains(&shard.number));
    shard.ok_or_else(|| format!("{text:?} is not a part; write 1/16, 2/16, ... up to 16/16"))
}

/// Reads a share from 0 to 1.
pub(super) fn parse_share(text: &str) -> Result<f32, String> {
    let share = text.parse::<f32>().ok().filter(|share| (0.0..=1.0).contains(share));
    share.ok_or_else(|| format!("{text:?} is not a share; write a number from 0 to 1, e.g. 0.0005"))
}

/// Reads the size of a stored field, which is not 0.
pub(super) fn parse_bytes(text: &str) -> Result<usize, String> {
    let bytes = bytes_of(text).filter(|&n| n > 0).and_then(|n| usize::try_from(n).ok());
    bytes.ok_or_else(|| format!("{text:?} is not a size; write 32000, 32k or 1M"))
}

/// Reads an amount of memory, which may be 0.
pub(super) fn parse_memory(text: &str) -> Result<u64, String> {
    bytes_of(text).ok_or_else(|| format!("{text:?} is not an amount of memory; write 500M or 2G"))
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

/// Reads `64` or `320x240`.
pub(super) fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let (width, height) = text.split_once('x').unwrap_or((text, text));
    let side = |s: &str| s.parse::<u32>().ok().filter(|n| (1..=16_384).contains(n));
    match (side(width), side(height)) {
        (Some(width), Some(height)) => Ok((width, height)),
        _ => Err(format!("{text:?} is not a size; write 64 or 320x240, at most 16384")),
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
        assert!(parse_size("0").is_err() && parse_size("axb").is_err());
    }
}
