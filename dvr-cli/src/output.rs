//! Lines on standard output and standard error. Where nobody reads them any more (`dvr stress --list | head`), they go
//! nowhere, and the command finishes what it does: the standard library's macros would panic.
//!
//! The macros here have the names of those and take their place in all modules that come after this one.

use std::fmt::Arguments;
use std::io::{self, Write};

/// As `std::println`, for a reader that may go.
macro_rules! println {
    ($($part:tt)*) => { $crate::output::out(format_args!($($part)*)) };
}

/// As `std::eprintln`, for a reader that may go.
macro_rules! eprintln {
    ($($part:tt)*) => { $crate::output::error(format_args!($($part)*)) };
}

/// Writes a line to standard output.
pub fn out(line: Arguments<'_>) {
    put(&mut io::stdout().lock(), line);
}

/// Writes a line to standard error.
pub fn error(line: Arguments<'_>) {
    put(&mut io::stderr().lock(), line);
}

/// Writes a line. What cannot be written has no reader: there is nobody to tell.
fn put(to: &mut dyn Write, line: Arguments<'_>) {
    let _ = to.write_fmt(line).and_then(|()| to.write_all(b"\n")).and_then(|()| to.flush());
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pipe whose reader has gone.
    struct Closed;

    impl Write for Closed {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(io::ErrorKind::BrokenPipe.into())
        }

        fn flush(&mut self) -> io::Result<()> {
            Err(io::ErrorKind::BrokenPipe.into())
        }
    }

    #[test]
    fn a_line_is_written_whole_or_goes_nowhere() {
        let mut text = Vec::new();
        put(&mut text, format_args!("{} views", 3));
        assert_eq!(text, b"3 views\n");
        put(&mut Closed, format_args!("nobody reads this"));
    }
}
