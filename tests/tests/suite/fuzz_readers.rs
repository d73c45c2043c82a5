//! A short campaign over every reader: damaged files, files that claim much, and what earlier campaigns found.

use std::path::Path;
use std::process::Command;

/// Inputs per reader; about a second each at most.
const INPUTS: &str = "2000";

/// Seconds per reader, of which there are less than thirty; the files of extreme claims take another ten in all.
const SECONDS: &str = "0.4";

#[test]
fn damaged_files_of_every_kind_end_in_an_error_within_time_and_memory() {
    let findings = tempfile::tempdir().unwrap();
    let regressions = Path::new(env!("CARGO_MANIFEST_DIR")).join("regressions");
    let mut program = Command::new(env!("CARGO_BIN_EXE_fuzz-readers"));
    program.args(["--inputs", INPUTS, "--seconds", SECONDS]);
    program.arg("--findings").arg(findings.path()).arg("--regressions").arg(regressions);
    let output = program.output().unwrap();
    let (table, said) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    println!("{table}");
    assert!(output.status.success(), "{said}");
    for reader in dvr_tests::fuzz::READERS {
        assert!(table.contains(&format!("| {} |", reader.name)), "{} is not in the table", reader.name);
    }
}
