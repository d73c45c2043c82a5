//! What COLMAP's database says of pictures: where their features are, and which of them two pictures have in common; and matches
//! that are taken out of it.
//!
//! [Its tables](https://colmap.github.io/database.html) are the same from COLMAP 3.8 on, as far as they are read here.

use std::path::{Path, PathBuf};

use glam::DVec2;
use rusqlite::{Connection, OpenFlags, Row};

use crate::error::{Result, SfmError};

/// A pair of pictures has the number `MOST_PICTURES * first + second`.
const MOST_PICTURES: u64 = 2_147_483_647;

/// Where it is noted that matches were left out; COLMAP leaves tables alone that it does not know.
const LEFT_OUT: &str = "dvr_left_out";

/// Which matches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MatchTable {
    /// All that look alike.
    Raw,
    /// Those that a geometry of two views verified.
    Verified,
}

impl MatchTable {
    fn name(self) -> &'static str {
        match self {
            Self::Raw => "matches",
            Self::Verified => "two_view_geometries",
        }
    }
}

/// How many matches were left out, and of how many.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LeftOut {
    pub left_out: usize,
    pub of: usize,
}

/// Features of pictures, and matches between them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Matches {
    pub pictures: Vec<Features>,
    pub pairs: Vec<Pair>,
}

/// The features of a picture.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Features {
    /// The name of its file.
    pub name: String,
    /// Where they are, pixels from the upper left corner of the picture.
    pub places: Vec<DVec2>,
}

/// What two pictures have in common.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pair {
    /// Which pictures these are.
    pub pictures: [usize; 2],
    /// Features of both that show the same point.
    pub matches: Vec<[usize; 2]>,
}

impl Matches {
    /// Reads those of a table.
    ///
    /// # Errors
    /// [`SfmError::BadDatabase`] where the file cannot be read, or is none that COLMAP wrote.
    pub fn read(path: &Path, table_of_matches: MatchTable) -> Result<Self> {
        let read = || {
            let database = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
            let mut ids: Vec<u64> = Vec::new();
            let mut pictures: Vec<Features> = Vec::new();
            let mut rows = database.prepare("SELECT image_id, name FROM images ORDER BY image_id")?;
            for picture in rows.query_map((), |row| Ok((row.get(0)?, row.get(1)?)))? {
                let (id, name) = picture?;
                ids.push(id);
                pictures.push(Features { name, places: Vec::new() });
            }
            let place_of = |id: u64| ids.binary_search(&id).ok();
            let mut rows = database.prepare("SELECT image_id, rows, cols, data FROM keypoints")?;
            for features in rows.query_map((), |row| Ok((row.get(0)?, table(row)?)))? {
                let (id, numbers) = features?;
                if let Some(picture) = place_of(id) {
                    let place = |row: &[[u8; 4]]| {
                        let at = |i: usize| row.get(i).map(|bytes| f64::from(f32::from_le_bytes(*bytes)));
                        Some(DVec2::new(at(0)?, at(1)?))
                    };
                    pictures[picture].places = numbers.iter().filter_map(|row| place(row)).collect();
                }
            }
            let mut pairs = Vec::new();
            let query = format!("SELECT pair_id, rows, cols, data FROM {} ORDER BY 1", table_of_matches.name());
            let mut rows = database.prepare(&query)?;
            for pair in rows.query_map((), |row| Ok((row.get::<_, u64>(0)?, table(row)?)))? {
                let (id, numbers) = pair?;
                if let [Some(a), Some(b)] = [id / MOST_PICTURES, id % MOST_PICTURES].map(place_of) {
                    let feature = |row: &[[u8; 4]], i: usize| {
                        let feature = usize::try_from(u32::from_le_bytes(*row.get(i)?)).ok()?;
                        (feature < pictures[[a, b][i]].places.len()).then_some(feature)
                    };
                    let of_both = |row: &Vec<[u8; 4]>| Some([feature(row, 0)?, feature(row, 1)?]);
                    pairs.push(Pair { pictures: [a, b], matches: numbers.iter().filter_map(of_both).collect() });
                }
            }
            Ok(Self { pictures, pairs })
        };
        read().map_err(|error| bad(path, &error))
    }

    /// Writes them in place of all matches, of which none is verified then, and notes how many are left out.
    ///
    /// # Errors
    /// As for [`read`](Self::read); the database is as it was then.
    pub fn replace(&self, path: &Path, left_out: LeftOut) -> Result<()> {
        let write = || {
            let mut database = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
            let change = database.transaction()?;
            let id_of = |name: &str| -> rusqlite::Result<u64> {
                change.query_row("SELECT image_id FROM images WHERE name = ?1", [name], |row| row.get(0))
            };
            let ids: Vec<u64> =
                self.pictures.iter().map(|picture| id_of(&picture.name)).collect::<rusqlite::Result<_>>()?;
            change.execute_batch(&format!(
                "DELETE FROM matches; DELETE FROM two_view_geometries;
                 CREATE TABLE {LEFT_OUT} (left_out INTEGER, of_all INTEGER);"
            ))?;
            for Pair { pictures: [a, b], matches } in &self.pairs {
                let numbers = matches.iter().flatten().filter_map(|&feature| u32::try_from(feature).ok());
                let data: Vec<u8> = numbers.flat_map(u32::to_le_bytes).collect();
                change.execute(
                    "INSERT INTO matches (pair_id, rows, cols, data) VALUES (?1, ?2, 2, ?3)",
                    (MOST_PICTURES * ids[*a] + ids[*b], matches.len(), data),
                )?;
            }
            change.execute(&format!("INSERT INTO {LEFT_OUT} VALUES (?1, ?2)"), (left_out.left_out, left_out.of))?;
            change.commit()
        };
        write().map_err(|error| bad(path, &error))
    }
}

/// What was left out of a database; `None` where nothing was.
pub(crate) fn left_out(path: &Path) -> Option<LeftOut> {
    let database = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY).ok()?;
    let of_row = |row: &Row| Ok(LeftOut { left_out: row.get(0)?, of: row.get(1)? });
    database.query_row(&format!("SELECT left_out, of_all FROM {LEFT_OUT}"), (), of_row).ok()
}

fn bad(path: &Path, error: &rusqlite::Error) -> SfmError {
    SfmError::BadDatabase { path: PathBuf::from(path), said: error.to_string() }
}

/// A table of numbers of four bytes, row by row, from the columns `rows`, `cols` and `data`, which follow a first one.
fn table(row: &Row) -> rusqlite::Result<Vec<Vec<[u8; 4]>>> {
    let (rows, columns, data): (usize, usize, Option<Vec<u8>>) = (row.get(1)?, row.get(2)?, row.get(3)?);
    let (numbers, _) = data.as_deref().unwrap_or_default().as_chunks::<4>();
    Ok(numbers.chunks_exact(columns.max(1)).take(rows).map(<[_]>::to_vec).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A database with the tables that are read, as COLMAP makes them.
    fn database(path: &Path, statements: &str) {
        let tables = "CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER);
            CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
            CREATE TABLE matches (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB);
            CREATE TABLE two_view_geometries
                (pair_id INTEGER PRIMARY KEY, rows INTEGER, cols INTEGER, data BLOB, config INTEGER);";
        Connection::open(path).unwrap().execute_batch(&format!("{tables}{statements}")).unwrap();
    }

    fn hex<const N: usize>(numbers: [[u8; 4]; N]) -> String {
        numbers.iter().flatten().map(|byte| format!("{byte:02x}")).collect()
    }

    #[test]
    fn features_and_verified_matches_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("database.db");
        let features = hex([1.5f32, 2.5, 9.0, 9.0, 3.0, 4.0, 9.0, 9.0].map(f32::to_le_bytes));
        // The last match names a feature that is not there.
        let matches = hex([1u32, 0, 0, 1, 7, 0].map(u32::to_le_bytes));
        database(
            &path,
            &format!(
                "INSERT INTO images VALUES (2, 'b.png', 1), (5, 'a.png', 1), (6, 'none.png', 1);
                 INSERT INTO keypoints VALUES (2, 2, 4, x'{features}'), (5, 2, 4, x'{features}'), (6, 0, 4, NULL);
                 INSERT INTO two_view_geometries VALUES ({}, 3, 2, x'{matches}', 2), ({}, 0, 2, NULL, 1);",
                2 * MOST_PICTURES + 5,
                2 * MOST_PICTURES + 6,
            ),
        );
        let found = Matches::read(&path, MatchTable::Verified).unwrap();
        let places = vec![DVec2::new(1.5, 2.5), DVec2::new(3.0, 4.0)];
        let features = |name: &str, places: &Vec<DVec2>| Features { name: name.to_owned(), places: places.clone() };
        assert_eq!(
            found.pictures,
            [features("b.png", &places), features("a.png", &places), features("none.png", &Vec::new())]
        );
        let pair = |a: usize, b: usize, matches: &[[usize; 2]]| Pair { pictures: [a, b], matches: matches.to_vec() };
        assert_eq!(found.pairs, [pair(0, 1, &[[1, 0], [0, 1]]), pair(0, 2, &[])]);
        // Others in their place are not verified.
        assert_eq!(left_out(&path), None);
        let fewer = Matches { pairs: vec![pair(0, 1, &[[0, 1]]), pair(0, 2, &[])], ..found };
        let how_many = LeftOut { left_out: 1, of: 2 };
        fewer.replace(&path, how_many).unwrap();
        assert_eq!(left_out(&path), Some(how_many));
        assert_eq!(Matches::read(&path, MatchTable::Raw).unwrap(), fewer);
        assert_eq!(Matches::read(&path, MatchTable::Verified).unwrap(), Matches { pairs: Vec::new(), ..fewer.clone() });
        // A second time it fails, and nothing is changed.
        assert!(Matches { pairs: Vec::new(), ..fewer.clone() }.replace(&path, how_many).is_err());
        assert_eq!(Matches::read(&path, MatchTable::Raw).unwrap(), fewer);
    }

    #[test]
    fn a_file_that_colmap_did_not_write_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("database.db");
        let said = || Matches::read(&path, MatchTable::Verified).unwrap_err().to_string();
        assert!(said().contains("database.db"), "{}", said());
        std::fs::write(&path, "").unwrap();
        assert!(said().contains("database.db") && said().contains("images"), "{}", said());
        std::fs::write(&path, "no database at all".repeat(100)).unwrap();
        assert!(said().contains("not a database"), "{}", said());
    }
}
