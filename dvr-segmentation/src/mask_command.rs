//! The command line of a program that makes the mask of a picture, with places for both.

use std::ffi::OsString;
use std::fmt;
use std::path::Path;
use std::process::Command;
use std::str::FromStr;

/// Stands for the path of the picture.
const PICTURE: &str = "{in}";

/// Stands for the path of the mask.
const MASK: &str = "{out}";

/// A command line such as `rembg i {in} {out}`. It is split into words as a POSIX shell does it, by blanks, quotes and
/// backslashes; no shell takes part, so that nothing else in it has a meaning, and paths with blanks stay one word.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaskCommand {
    text: String,
    program: String,
    arguments: Vec<String>,
}

/// What is wrong with a command line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MaskCommandError {
    /// A quote or a backslash at its end.
    #[error("a quote is open, or a backslash is at the end")]
    Quotes,
    /// A placeholder that is nowhere in it.
    #[error("{missing} is missing, which stands for the path of {meaning}; as in: rembg i {{in}} {{out}}")]
    Placeholder {
        /// `{in}` or `{out}`.
        missing: &'static str,
        /// What it stands for.
        meaning: &'static str,
    },
    /// Nothing, or a placeholder, where the program's name must be.
    #[error("the first word must be the program; as in: rembg i {{in}} {{out}}")]
    Program,
}

impl MaskCommand {
    /// The command for a picture, whose mask goes to `mask`.
    pub(crate) fn of_picture(&self, picture: &Path, mask: &Path) -> Command {
        let mut command = Command::new(&self.program);
        command.args(self.arguments.iter().map(|word| filled(word, picture, mask)));
        command
    }

    /// The program's name, without the folders before it.
    pub fn program(&self) -> &str {
        Path::new(&self.program).file_name().and_then(|name| name.to_str()).unwrap_or(&self.program)
    }
}

/// A word with paths in place of its placeholders. What a path itself holds is not looked at again.
fn filled(mut word: &str, picture: &Path, mask: &Path) -> OsString {
    let mut filled = OsString::new();
    let next = |word: &str| {
        let found = [(PICTURE, picture), (MASK, mask)].map(|(name, path)| word.find(name).map(|at| (at, name, path)));
        found.into_iter().flatten().min_by_key(|(at, ..)| *at)
    };
    while let Some((at, name, path)) = next(word) {
        filled.push(&word[..at]);
        filled.push(path);
        word = &word[at + name.len()..];
    }
    filled.push(word);
    filled
}

impl FromStr for MaskCommand {
    type Err = MaskCommandError;

    fn from_str(text: &str) -> Result<Self, MaskCommandError> {
        let mut words = shlex::split(text).ok_or(MaskCommandError::Quotes)?.into_iter();
        let is_placed = |word: &String| word.contains(PICTURE) || word.contains(MASK);
        let program = words.next().filter(|word| !word.is_empty() && !is_placed(word));
        let program = program.ok_or(MaskCommandError::Program)?;
        let arguments: Vec<String> = words.collect();
        for (missing, meaning) in [(PICTURE, "the picture"), (MASK, "the mask that is to be written")] {
            if !arguments.iter().any(|word| word.contains(missing)) {
                return Err(MaskCommandError::Placeholder { missing, meaning });
            }
        }
        Ok(Self { text: text.to_owned(), program, arguments })
    }
}

/// As it was given.
impl fmt::Display for MaskCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str, picture: &str, mask: &str) -> Vec<String> {
        let command = text.parse::<MaskCommand>().unwrap().of_picture(picture.as_ref(), mask.as_ref());
        std::iter::once(command.get_program())
            .chain(command.get_args())
            .map(|word| word.to_str().unwrap().to_owned())
            .collect()
    }

    #[test]
    fn words_are_split_as_a_shell_does_and_paths_with_blanks_stay_whole() {
        assert_eq!(words("rembg i {in} {out}", "/a b/1.png", "/c.png"), ["rembg", "i", "/a b/1.png", "/c.png"]);
        let quoted = words(r#"'my sam' --size "3 4" -o={out} {in}\ x ; "{in}" $HOME"#, "p", "m");
        assert_eq!(quoted, ["my sam", "--size", "3 4", "-o=m", "p x", ";", "p", "$HOME"]);
        // A path that looks like a placeholder is a path.
        assert_eq!(words("sam {in}{out}", "/{out}/1", "/{in}/2"), ["sam", "/{out}/1/{in}/2"]);
    }

    #[test]
    fn a_command_says_what_it_lacks() {
        let refused = |text: &str| text.parse::<MaskCommand>().unwrap_err().to_string();
        assert!(refused("rembg i {out}").starts_with("{in} is missing"));
        assert!(refused("rembg i {in}").starts_with("{out} is missing"));
        assert!(refused("rembg 'i {in} {out}").contains("quote"));
        for text in ["", "  ", "{in} {out}", "'' {in} {out}"] {
            assert!(refused(text).contains("first word"), "{text}");
        }
    }

    #[test]
    fn a_command_is_shown_as_it_was_given_and_by_its_program() {
        let command: MaskCommand = "./tools/sam.sh  '{in}' {out}".parse().unwrap();
        assert_eq!((command.to_string().as_str(), command.program()), ("./tools/sam.sh  '{in}' {out}", "sam.sh"));
    }
}
