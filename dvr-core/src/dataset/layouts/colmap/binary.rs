//! `cameras.bin`, `images.bin` and `points3D.bin`: little endian, without padding.

use std::path::Path;

use super::model::{Model, ModelCamera, ModelImage, ModelPoint, TrackEntry};
use crate::error::{Error, Result};
use crate::files::read_bytes;
use crate::lens::COLMAP_MODELS;

pub(super) fn read_model(folder: &Path) -> Result<Model> {
    let mut model = Model::default();
    let path = folder.join("cameras.bin");
    let mut bytes = Bytes { path: &path, rest: &read_bytes(&path)? };
    for _ in 0..bytes.u64()? {
        let (id, number) = (bytes.u32()?, bytes.u32()?);
        let &(name, n_parameters) = COLMAP_MODELS.get(number as usize).ok_or_else(|| {
            Error::format(
                &path,
                format!("camera {id} is of model number {number}, which is not known"),
                "Undistort the pictures with the program that made the model, and give the folder that it writes.",
            )
        })?;
        let (width, height) = (bytes.u64()?, bytes.u64()?);
        let parameters = (0..n_parameters).map(|_| bytes.f64()).collect::<Result<_>>()?;
        model.cameras.insert(id, ModelCamera { model: name.to_owned(), width, height, parameters });
    }
    let path = folder.join("images.bin");
    let mut bytes = Bytes { path: &path, rest: &read_bytes(&path)? };
    for _ in 0..bytes.u64()? {
        let id = bytes.u32()?;
        let rotation = [bytes.f64()?, bytes.f64()?, bytes.f64()?, bytes.f64()?];
        let translation = [bytes.f64()?, bytes.f64()?, bytes.f64()?];
        let (camera, name) = (bytes.u32()?, bytes.text()?);
        // Features are x, y and the id of a point, 8 bytes each.
        let mut features = Vec::new();
        for _ in 0..bytes.u64()? {
            features.push([bytes.f64()? as f32, bytes.f64()? as f32]);
            bytes.u64()?;
        }
        model.images.push(ModelImage { id, rotation, translation, camera, name, features });
    }
    let path = folder.join("points3D.bin");
    if path.is_file() {
        model.points = read_points(&path)?;
    }
    Ok(model)
}

/// `points3D.bin`.
pub(super) fn read_points(path: &Path) -> Result<Vec<ModelPoint>> {
    let mut bytes = Bytes { path, rest: &read_bytes(path)? };
    let mut points = Vec::new();
    for _ in 0..bytes.u64()? {
        bytes.u64()?;
        let position = [bytes.f64()?, bytes.f64()?, bytes.f64()?];
        let color = bytes.take()?;
        let error = bytes.f64()?;
        let mut track = Vec::new();
        for _ in 0..bytes.u64()? {
            track.push(TrackEntry { image: bytes.u32()?, feature: bytes.u32()? });
        }
        points.push(ModelPoint { position, color, error, track });
    }
    Ok(points)
}

/// What is left of a file.
struct Bytes<'a> {
    path: &'a Path,
    rest: &'a [u8],
}

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N]> {
        let (first, rest) = self.rest.split_first_chunk().ok_or_else(|| self.too_short())?;
        self.rest = rest;
        Ok(*first)
    }

    fn u32(&mut self) -> Result<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64> {
        self.take().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64> {
        self.take().map(f64::from_le_bytes)
    }

    /// Text up to the next zero byte.
    fn text(&mut self) -> Result<String> {
        let length = self.rest.iter().position(|&byte| byte == 0).ok_or_else(|| self.too_short())?;
        let text = String::from_utf8_lossy(&self.rest[..length]).into_owned();
        self.rest = &self.rest[length + 1..];
        Ok(text)
    }

    fn too_short(&self) -> Error {
        Error::format(
            self.path,
            "the file ends too early",
            "It may be truncated: copy it again, or export the model again.",
        )
    }
}
