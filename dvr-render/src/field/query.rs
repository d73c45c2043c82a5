//! What a field is asked.

use burn::tensor::{Int, Tensor};

/// Points at which a field is asked, from where they are seen, and whose they are.
#[derive(Clone, Debug)]
pub struct Query {
    /// Positions, `[n, 3]`, object space.
    pub points: Tensor<2>,
    /// Unit viewing directions from the camera to each point, `[n, 3]`, object space. `None` asks for no view: a field
    /// answers with a colour that does not depend on one. Occupancy never depends on the view.
    pub directions: Option<Tensor<2>>,
    /// Index of the object (row of the latent codes) of each point, `[n]`; `None` where there is only object 0.
    pub object: Option<Tensor<1, Int>>,
}

impl Query {
    /// Points of the one object that a per-scene field holds, without a view.
    pub fn new(points: Tensor<2>) -> Self {
        Self { points, directions: None, object: None }
    }

    /// How many points are asked for.
    pub fn len(&self) -> usize {
        self.points.dims()[0]
    }

    /// Whether nothing is asked.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The same of other points, one for each of these.
    #[must_use]
    pub fn moved_to(&self, points: Tensor<2>) -> Self {
        Self { points, directions: self.directions.clone(), object: self.object.clone() }
    }

    /// The points `start..start + length`.
    #[must_use]
    pub fn narrow(&self, start: usize, length: usize) -> Self {
        Self {
            points: self.points.clone().narrow(0, start, length),
            directions: self.directions.clone().map(|d| d.narrow(0, start, length)),
            object: self.object.clone().map(|o| o.narrow(0, start, length)),
        }
    }

    /// The points with the given indices, `[m]`.
    #[must_use]
    pub fn select(&self, indices: &Tensor<1, Int>) -> Self {
        Self {
            points: self.points.clone().select(0, indices.clone()),
            directions: self.directions.clone().map(|d| d.select(0, indices.clone())),
            object: self.object.clone().map(|o| o.select(0, indices.clone())),
        }
    }

    /// The same on the autodiff device, as constants.
    #[must_use]
    pub fn lifted(self) -> Self {
        Self {
            points: Tensor::from_inner(self.points),
            directions: self.directions.map(Tensor::from_inner),
            object: self.object.map(Tensor::from_inner),
        }
    }
}
