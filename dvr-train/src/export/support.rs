//! The plane that an object stands on, as a run keeps it.

use dvr_core::HalfSpace;
use serde::{Deserialize, Serialize};

/// What an object stands on, where that was found with its masks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Support {
    /// The object's side of the plane, in the coordinates and units of the scene's files.
    pub plane: HalfSpace,
    /// Whether the mesh is cut by it.
    pub is_dropped: bool,
}

/// In a few words, for people.
impl std::fmt::Display for Support {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let HalfSpace { normal, offset } = self.plane;
        let [x, y, z] = normal.to_array();
        write!(f, "normal ({x:.3}, {y:.3}, {z:.3}), height {offset:.4} along it, in the units of the scene")?;
        if self.is_dropped { write!(f, "; the mesh is cut by it") } else { Ok(()) }
    }
}
