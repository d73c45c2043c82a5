//! Several files as one input: each part begins with a line `%%% name`.

use std::path::{Component, Path};

const MARK: &[u8] = b"\n%%% ";

/// Files as one input.
pub(super) fn joined(parts: &[(&str, &[u8])]) -> Vec<u8> {
    let part = |(name, bytes): &(&str, &[u8])| [MARK, name.as_bytes(), b"\n", bytes].concat();
    parts.iter().flat_map(part).collect()
}

/// The files of an input, as far as its marks are whole.
pub(super) fn split(input: &[u8]) -> Vec<(String, &[u8])> {
    let mut parts = Vec::new();
    let mut rest = after(input, MARK);
    while let Some(part) = rest {
        let next = find(part, MARK);
        let whole = &part[..next.unwrap_or(part.len())];
        if let Some(end) = whole.iter().position(|&byte| byte == b'\n') {
            parts.push((String::from_utf8_lossy(&whole[..end]).into_owned(), &whole[end + 1..]));
        }
        rest = next.map(|at| &part[at + MARK.len()..]);
    }
    parts
}

/// Writes the files of an input into a folder; names that lead out of it are passed over. The names that are known but
/// not in the input are removed.
pub(super) fn unpack(folder: &Path, input: &[u8], known: &[&str]) {
    for name in known {
        let _ = std::fs::remove_file(folder.join(name));
    }
    for (name, bytes) in split(input) {
        let stays_inside = Path::new(&name).components().all(|part| matches!(part, Component::Normal(_)));
        if stays_inside && known.contains(&name.as_str()) {
            std::fs::write(folder.join(&name), bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
        }
    }
}

fn after<'a>(bytes: &'a [u8], mark: &[u8]) -> Option<&'a [u8]> {
    find(bytes, mark).map(|at| &bytes[at + mark.len()..])
}

fn find(bytes: &[u8], mark: &[u8]) -> Option<usize> {
    bytes.windows(mark.len()).position(|window| window == mark)
}
