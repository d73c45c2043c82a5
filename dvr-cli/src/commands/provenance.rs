//! What makes results: the key of a row, and its words in tables.

use std::sync::OnceLock;

use anyhow::{Context, Result};
use dvr_core::record::{Digest, Machine, RecordKey};
use serde::Serialize;
use serde_json::Value;

/// The key of a row that this program makes on this machine.
///
/// # Errors
/// When this program's own file cannot be read.
pub fn record_key(scene: Digest, settings: &Value, device: &str) -> Result<RecordKey> {
    Ok(RecordKey {
        scene,
        settings: Digest::of_json(settings),
        program: program()?.to_owned(),
        machine: Machine::this(device),
    })
}

/// Version and commit of this program. Builds that no commit tells apart carry the digest of their own file; those
/// without optimisation say so.
fn program() -> Result<&'static str> {
    static PROGRAM: OnceLock<String> = OnceLock::new();
    if let Some(known) = PROGRAM.get() {
        return Ok(known);
    }
    let commit = env!("DVR_COMMIT");
    let mut parts = vec![commit.to_owned()];
    if commit.ends_with("-dirty") || commit == "unknown" {
        let file = std::env::current_exe().context("this program does not find its own file")?;
        parts.push(format!("binary {}", Digest::of_file(&file)?));
    }
    if cfg!(debug_assertions) {
        parts.push("debug build".to_owned());
    }
    Ok(PROGRAM.get_or_init(|| format!("dvr {} ({})", env!("CARGO_PKG_VERSION"), parts.join(", "))))
}

/// A key in a table of all figures.
#[derive(Debug, Default, Serialize)]
pub struct KeyColumns {
    scene_digest: Option<String>,
    settings_digest: Option<String>,
    program: Option<String>,
    machine: Option<String>,
}

impl KeyColumns {
    /// The columns of a key; empty ones where it is unknown.
    pub fn of(key: Option<&RecordKey>) -> Self {
        Self {
            scene_digest: key.map(|key| key.scene.to_string()),
            settings_digest: key.map(|key| key.settings.to_string()),
            program: key.map(|key| key.program.clone()),
            machine: key.map(|key| key.machine.to_string()),
        }
    }
}

/// Where rows come from, for the head of a table: each machine with its program once. Rows without a key are other
/// software's.
pub fn origin<'a>(keys: impl IntoIterator<Item = Option<&'a RecordKey>>) -> String {
    let mut origins: Vec<String> = Vec::new();
    let mut foreign = 0;
    for key in keys {
        match key.map(|key| format!("{}, {}", key.machine, key.program)) {
            Some(origin) if origins.contains(&origin) => {}
            Some(origin) => origins.push(origin),
            None => foreign += 1,
        }
    }
    if foreign > 0 {
        origins.push(format!("{foreign} row(s) of unknown origin"));
    }
    origins.join("; ")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_table_names_every_origin_once() {
        let key = record_key(Digest::of_bytes(b"scene"), &json!({}), "cpu").unwrap();
        let older = RecordKey { program: "dvr 0 (older)".into(), ..key.clone() };
        let text = origin([Some(&key), Some(&older), Some(&key), None]);
        assert_eq!(text.matches(&key.program).count(), 1, "{text}");
        assert!(text.contains("dvr 0 (older); 1 row(s) of unknown origin"), "{text}");
        assert!(key.program.contains(env!("DVR_COMMIT")), "{}", key.program);
    }
}
