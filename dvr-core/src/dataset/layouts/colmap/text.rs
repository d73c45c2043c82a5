//! `cameras.txt`, `images.txt` and `points3D.txt`.

use std::path::Path;
use std::str::FromStr;

use super::model::{Model, ModelCamera, ModelImage, ModelPoint, TrackEntry};
use crate::error::{Error, Result};
use crate::files::read_text;

pub(super) fn read_model(folder: &Path) -> Result<Model> {
    let mut model = Model::default();
    let path = folder.join("cameras.txt");
    for (number, line) in content(&read_text(&path)?).filter(|(_, line)| !line.is_empty()) {
        let mut words = Words::new(&path, number, line);
        let id = words.next("the camera's id")?;
        let camera = ModelCamera {
            model: words.next("the camera model")?,
            width: words.next("the width")?,
            height: words.next("the height")?,
            parameters: words.rest("a parameter")?,
        };
        model.cameras.insert(id, camera);
    }
    let path = folder.join("images.txt");
    let text = read_text(&path)?;
    // Two lines an image: its pose, then its features, which may be none: an empty line counts there.
    let mut lines = content(&text);
    while let Some((number, line)) = lines.next() {
        if line.is_empty() {
            continue;
        }
        let mut words = Words::new(&path, number, line);
        let id = words.next("the image's id")?;
        let rotation = words.array("a number of the rotation")?;
        let translation = words.array("a number of the translation")?;
        let camera = words.next("the camera's id")?;
        // A name may hold spaces.
        let name = words.words.collect::<Vec<_>>().join(" ");
        let features = match lines.next() {
            Some((number, line)) => Words::new(&path, number, line).rest::<f64>("a feature")?,
            None => Vec::new(),
        };
        // Each is x, y and the id of a point.
        let features = features.chunks_exact(3).map(|f| [f[0] as f32, f[1] as f32]).collect();
        model.images.push(ModelImage { id, rotation, translation, camera, name, features });
    }
    let path = folder.join("points3D.txt");
    if path.is_file() {
        model.points = read_points(&path)?;
    }
    Ok(model)
}

/// `points3D.txt`.
pub(super) fn read_points(path: &Path) -> Result<Vec<ModelPoint>> {
    let mut points = Vec::new();
    for (number, line) in content(&read_text(path)?).filter(|(_, line)| !line.is_empty()) {
        let mut words = Words::new(path, number, line);
        words.next::<u64>("the point's id")?;
        let position = words.array("a coordinate")?;
        let color = words.array("a colour")?;
        let error = words.next("the error")?;
        let track: Vec<u32> = words.rest("the track")?;
        let track = track.chunks_exact(2).map(|entry| TrackEntry { image: entry[0], feature: entry[1] }).collect();
        points.push(ModelPoint { position, color, error, track });
    }
    Ok(points)
}

/// Lines with their numbers, from 1, without comments.
fn content(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())).filter(|(_, line)| !line.starts_with('#'))
}

/// The words of a line, and where it stands.
struct Words<'a> {
    path: &'a Path,
    number: usize,
    words: std::str::SplitWhitespace<'a>,
}

impl<'a> Words<'a> {
    fn new(path: &'a Path, number: usize, line: &'a str) -> Self {
        Self { path, number, words: line.split_whitespace() }
    }

    fn parse<T: FromStr>(&self, word: Option<&str>, what: &str) -> Result<T> {
        let found = word.map_or("the line ends".to_owned(), |word| format!("`{word}`"));
        word.and_then(|word| word.parse().ok()).ok_or_else(|| {
            Error::format(
                self.path,
                format!("line {}: {found} where {what} should be", self.number),
                "The file may be truncated: export the model again.",
            )
        })
    }

    fn next<T: FromStr>(&mut self, what: &str) -> Result<T> {
        let word = self.words.next();
        self.parse(word, what)
    }

    fn array<T: FromStr + Copy + Default, const N: usize>(&mut self, what: &str) -> Result<[T; N]> {
        let mut array = [T::default(); N];
        for value in &mut array {
            *value = self.next(what)?;
        }
        Ok(array)
    }

    fn rest<T: FromStr>(&mut self, what: &str) -> Result<Vec<T>> {
        let words: Vec<&str> = self.words.by_ref().collect();
        words.into_iter().map(|word| self.parse(Some(word), what)).collect()
    }
}
