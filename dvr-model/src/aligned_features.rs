//! What the decoder's first layer takes of the pictures of its objects.

use burn::tensor::{Int, Tensor};

use crate::pixel_aligned::{PicturePlane, PixelAligned};

/// Features of places in pictures, and the weights by which the decoder's first layer takes them.
#[derive(Clone, Debug)]
pub(crate) struct AlignedFeatures {
    /// `channels` features of each place.
    pub planes: PixelAligned,
    /// Weights of the features, `[channels, hidden]`.
    pub features: Tensor<2>,
    /// Weights of the point in the camera's axes, `[3, hidden]`.
    pub place: Tensor<2>,
}

impl AlignedFeatures {
    /// What is added to the layer, `[n, hidden]`, at points `[n, 3]` of objects `[n]`, or of the first object.
    pub fn at(&self, points: &Tensor<2>, object: Option<&Tensor<1, Int>>) -> Tensor<2> {
        let object = object_of(points, object);
        self.planes.at(points, &object).matmul(self.features.clone()) + self.turned(points, &object)
    }

    /// The same, and its derivatives along directions `[n, 3]`.
    pub fn tangents(
        &self,
        points: &Tensor<2>,
        object: Option<&Tensor<1, Int>>,
        directions: &[Tensor<2>],
    ) -> (Tensor<2>, Vec<Tensor<2>>) {
        let object = object_of(points, object);
        let (features, along) = self.planes.tangents(points, &object, directions);
        let of_features = |features: Tensor<2>| features.matmul(self.features.clone());
        let along = along.into_iter().zip(directions);
        let along = along.map(|(along, direction)| of_features(along) + self.turned(direction, &object));
        (of_features(features) + self.turned(points, &object), along.collect())
    }

    /// The point in the camera's axes, or a direction, weighted.
    fn turned(&self, vectors: &Tensor<2>, object: &Tensor<1, Int>) -> Tensor<2> {
        self.planes.in_camera_axes(vectors, object).matmul(self.place.clone())
    }

    /// What the layer takes at points that are constants, `[n, channels + 3]`, for [`AlignedFeatures::weights`].
    pub fn inputs(&self, points: &Tensor<2>, object: Option<&Tensor<1, Int>>) -> Tensor<2> {
        let object = object_of(points, object);
        Tensor::cat(vec![self.planes.at_constants(points, &object), self.planes.in_camera_axes(points, &object)], 1)
    }

    /// The weights of [`AlignedFeatures::inputs`], `[channels + 3, hidden]`.
    pub fn weights(&self) -> Tensor<2> {
        Tensor::cat(vec![self.features.clone(), self.place.clone()], 0)
    }

    /// The same, object by object, off the tensors.
    pub fn picture_planes(&self) -> Vec<PicturePlane> {
        self.planes.picture_planes()
    }

    /// The same off the graph.
    pub fn inner(&self) -> Self {
        Self { planes: self.planes.inner(), features: self.features.clone().inner(), place: self.place.clone().inner() }
    }
}

fn object_of(points: &Tensor<2>, object: Option<&Tensor<1, Int>>) -> Tensor<1, Int> {
    object.cloned().unwrap_or_else(|| Tensor::zeros([points.dims()[0]], &points.device()))
}
