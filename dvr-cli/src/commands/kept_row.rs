//! Rows of results that are kept, each in a file of its own with its key. A row whose key differs is made again.

use std::fmt;
use std::path::Path;

use anyhow::{Context, Result};
use dvr_core::files::write_bytes_atomically;
use dvr_core::record::RecordKey;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A file with a row.
#[derive(Serialize, Deserialize)]
struct File<T> {
    key: RecordKey,
    row: T,
}

/// What is kept under a name.
#[derive(Debug, PartialEq)]
pub enum Kept<T> {
    /// The row of this key.
    Row(T),
    /// The row of another key, and in what it differs.
    Other(String),
    /// Nothing.
    Nothing,
}

/// What is kept at `path`, for a key.
///
/// # Errors
/// When the file is damaged.
pub fn kept<T: DeserializeOwned>(path: &Path, key: &RecordKey) -> Result<Kept<T>> {
    let Ok(text) = std::fs::read_to_string(path) else { return Ok(Kept::Nothing) };
    let damaged = || format!("{} is damaged; remove it", path.display());
    let mut file: Value = serde_json::from_str(&text).with_context(damaged)?;
    let mut part = |name: &str| file.get_mut(name).map(Value::take).unwrap_or_default();
    let Ok(found) = serde_json::from_value::<RecordKey>(part("key")) else {
        return Ok(Kept::Other("without a key".into()));
    };
    let difference = key.difference(&found);
    if !difference.is_empty() {
        return Ok(Kept::Other(format!("of another {}", difference.join(", another "))));
    }
    serde_json::from_value(part("row")).map(Kept::Row).with_context(damaged)
}

/// Keeps a row, and returns it as it will be read: JSON has no infinity.
///
/// # Errors
/// When it cannot be written.
pub fn keep<T: Serialize + DeserializeOwned>(path: &Path, key: &RecordKey, row: T) -> Result<T> {
    let text = serde_json::to_string_pretty(&File { key: key.clone(), row })?;
    write_bytes_atomically(path, text.as_bytes())?;
    Ok(serde_json::from_str::<File<T>>(&text)?.row)
}

/// How many rows of a plan are kept, and which are made again.
#[derive(Debug, Default)]
pub struct Standing {
    /// All rows.
    pub all: usize,
    /// Kept ones.
    pub kept: usize,
    /// Names of rows that are made again, with the reason.
    again: Vec<String>,
}

impl Standing {
    /// Counts a row.
    pub fn count<T>(&mut self, name: &str, kept: &Kept<T>) {
        self.all += 1;
        match kept {
            Kept::Row(_) => self.kept += 1,
            Kept::Other(why) => self.again.push(format!("{name} ({why})")),
            Kept::Nothing => {}
        }
    }
}

impl fmt::Display for Standing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { all, kept, again } = self;
        write!(f, "{kept} of {all} are kept")?;
        match &again[..] {
            [] => Ok(()),
            [one] => write!(f, "; made again: {one}"),
            [first, ..] => write!(f, "; {} are made again, e.g. {first}", again.len()),
        }
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::record::Digest;
    use serde_json::json;

    use super::*;
    use crate::commands::provenance::record_key;

    #[test]
    fn a_row_is_kept_for_its_key_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("row.json");
        let key = record_key(Digest::of_bytes(b"scene"), &json!({"steps": 1}), "cpu").unwrap();
        assert_eq!(kept::<f64>(&path, &key).unwrap(), Kept::Nothing);
        assert_eq!(keep(&path, &key, 0.25).unwrap(), 0.25);
        assert_eq!(kept(&path, &key).unwrap(), Kept::Row(0.25));
        let others = [
            ("scene", RecordKey { scene: Digest::of_bytes(b"other"), ..key.clone() }),
            ("settings", RecordKey { settings: Digest::of_json(&json!({"steps": 2})), ..key.clone() }),
            ("program", RecordKey { program: format!("{}-dirty", key.program), ..key.clone() }),
            ("machine", record_key(Digest::of_bytes(b"scene"), &json!({"steps": 1}), "gpu:0").unwrap()),
        ];
        for (what, other) in others {
            assert_eq!(kept::<f64>(&path, &other).unwrap(), Kept::Other(format!("of another {what}")));
        }
        std::fs::write(&path, "0.25").unwrap();
        assert_eq!(kept::<f64>(&path, &key).unwrap(), Kept::Other("without a key".into()), "an older program's");
        std::fs::write(&path, "{").unwrap();
        assert!(kept::<f64>(&path, &key).unwrap_err().to_string().contains("row.json is damaged"));
    }

    #[test]
    fn a_plan_says_what_is_made_again() {
        let mut standing = Standing::default();
        standing.count("a", &Kept::Row(1));
        standing.count::<i32>("b", &Kept::Nothing);
        assert_eq!(standing.to_string(), "1 of 2 are kept");
        standing.count::<i32>("c", &Kept::Other("of another scene".into()));
        assert_eq!(standing.to_string(), "1 of 3 are kept; made again: c (of another scene)");
    }
}
