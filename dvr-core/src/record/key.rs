//! The key of a row of results.

use serde::{Deserialize, Serialize};

use super::digest::Digest;
use super::machine::Machine;

/// What determines a figure, up to chance that has no seed. A row is made again where one of these differs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordKey {
    /// The scene's files.
    pub scene: Digest,
    /// The whole effective configuration, defaults included.
    pub settings: Digest,
    /// The program: its version, commit and kind of build.
    pub program: String,
    /// Where it ran.
    pub machine: Machine,
}

impl RecordKey {
    /// In what another key differs, in words for people; empty where both are the same.
    pub fn difference(&self, other: &Self) -> Vec<&'static str> {
        let parts = [
            (self.scene != other.scene, "scene"),
            (self.settings != other.settings, "settings"),
            (self.program != other.program, "program"),
            (self.machine != other.machine, "machine"),
        ];
        parts.into_iter().filter(|(differs, _)| *differs).map(|(_, name)| name).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_says_in_what_it_differs() {
        let machine = Machine { cpu: "a".into(), cores: 2, threads: 2, device: "cpu".into() };
        let key = RecordKey {
            scene: Digest::of_bytes(b"scene"),
            settings: Digest::of_bytes(b"settings"),
            program: "dvr 1 (abc)".into(),
            machine: machine.clone(),
        };
        assert!(key.difference(&key).is_empty());
        let other = RecordKey { program: "dvr 1 (abd)".into(), scene: Digest::of_bytes(b""), ..key.clone() };
        assert_eq!(key.difference(&other), ["scene", "program"]);
        let other = RecordKey { machine: Machine { threads: 1, ..machine }, ..key.clone() };
        assert_eq!(key.difference(&other), ["machine"]);
        let text = serde_json::to_string(&key).unwrap();
        assert_eq!(serde_json::from_str::<RecordKey>(&text).unwrap(), key);
    }
}
