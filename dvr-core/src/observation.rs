//! How well the photographs that a mesh was made from see a vertex.

/// How well the views of a scene see a vertex. Zeros: nothing was ever seen of it, and what is there was made up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observation {
    /// Views that see the vertex: it projects into their frame, nothing of the mesh is in between, and the line of
    /// sight is less than 78 degrees away from the normal.
    pub views: u16,
    /// `cos(best) (1 - 2^-views)`, in `[0, 1]`: the cosine of the smallest angle between a line of sight and the
    /// normal, times a half for a single view (which determines a colour but no depth), three quarters for two, and so on
    /// towards one.
    pub confidence: f32,
}

impl Observation {
    /// Of a point seen by as many views as there are cosines between their lines of sight and the normal.
    pub fn of(cosines: impl IntoIterator<Item = f64>) -> Self {
        let (mut views, mut best) = (0u16, 0.0f64);
        for cosine in cosines {
            views = views.saturating_add(1);
            best = best.max(cosine);
        }
        let confidence = best.clamp(0.0, 1.0) * (1.0 - 0.5f64.powi(i32::from(views)));
        Self { views, confidence: confidence as f32 }
    }
}
