//! Notes on standard error.

/// Prints notes on standard error, one per line.
pub fn print_notes(notes: &[String]) {
    for note in notes {
        eprintln!("note: {note}");
    }
}
