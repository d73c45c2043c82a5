//! The lattice field as a burn module: what [`LatticeField`] looks up, with gradients.

use burn::config::Config;
use burn::module::{Module, Param};
use burn::tensor::{DType, Device, Tensor, TensorData};
use dvr_core::UnitCube;
use dvr_kernels::Lattice;
use dvr_render::{Field, FieldJet, FieldValues, Query, Snapshot, axis_direction};

use crate::lattice_field::{LatticeField, LatticeValues};
use crate::lattice_op::{interpolate, interpolate_jet};

/// Configuration of a [`LatticeDecoder`].
#[derive(Config, Debug, PartialEq)]
pub struct LatticeDecoderConfig {
    /// Cells along an edge of the occupancy lattice.
    #[config(default = 64)]
    pub cells: usize,
    /// Cells along an edge of the colour lattice: coarser, since fine colour would explain the pictures on a wrong
    /// surface.
    #[config(default = 32)]
    pub color_cells: usize,
    /// Radius of the ball that the occupancy starts as, in object units.
    #[config(default = 0.4)]
    pub radius: f32,
    /// How steeply the logit falls at the ball's surface, a unit of length. Colours start grey.
    #[config(default = 10.0)]
    pub steepness: f32,
}

impl LatticeDecoderConfig {
    /// Lattices over the padded unit cube, with the values of a grey ball.
    ///
    /// # Panics
    /// With no cells.
    pub fn init(&self, device: &Device) -> LatticeDecoder {
        let half_extent = UnitCube::default().half_extent() as f32;
        let [shape, color] = [self.cells, self.color_cells].map(|cells| Lattice::new(cells + 1, half_extent));
        let logit = |node| self.steepness * (self.radius - shape.position(node).length());
        let logits = (0..shape.len()).map(logit).collect();
        LatticeDecoder::new((shape, logits), (color, vec![0.5; 3 * color.len()]), device)
    }
}

/// Occupancy logit and colour, each interpolated between the nodes of a lattice: a [`LatticeField`] whose values are
/// parameters.
///
/// Values, gradients and the forward-mode pass are single operations on the CPU (burn's `flex`, or its `ndarray` behind
/// the feature of that name), in single or double precision, with the same results whatever the number of threads.
/// Object indices are not looked at: it holds one object.
#[derive(Module, Debug)]
pub struct LatticeDecoder {
    /// Occupancy logits, `[nodes, 1]`, x fastest, then y, then z.
    pub shape: Param<Tensor<2>>,
    /// sRGB colours, `[nodes, 3]`; those that leave `[0, 1]` are clamped after interpolation.
    pub color: Param<Tensor<2>>,
    /// Nodes along an edge of the occupancy lattice.
    shape_nodes: usize,
    /// Nodes along an edge of the colour lattice.
    color_nodes: usize,
    /// Half the edge of both, in object units.
    half_extent: [f32; 2],
}

impl LatticeDecoder {
    fn new(shape: (Lattice, Vec<f32>), color: (Lattice, Vec<f32>), device: &Device) -> Self {
        let param = |(lattice, values): (Lattice, Vec<f32>)| {
            let size = [lattice.len(), values.len() / lattice.len()];
            Param::from_tensor(Tensor::from_data(TensorData::new(values, size), device))
        };
        Self {
            shape_nodes: shape.0.nodes(),
            color_nodes: color.0.nodes(),
            half_extent: [shape.0.half_extent(), color.0.half_extent()],
            shape: param(shape),
            color: param(color),
        }
    }

    /// Takes the values of a field as parameters.
    pub fn from_field(field: &LatticeField, device: &Device) -> Self {
        let parts = [field.shape(), field.color()].map(|part| (part.lattice, part.values.clone()));
        let [shape, color] = parts;
        Self::new(shape, color, device)
    }

    /// The field as it is now: what rays meet exactly and files hold.
    pub fn to_field(&self) -> LatticeField {
        let part = |lattice, parameter: &Param<Tensor<2>>| LatticeValues {
            lattice,
            values: parameter.val().into_data().iter::<f32>().collect(),
        };
        LatticeField::new(part(self.shape_lattice(), &self.shape), part(self.color_lattice(), &self.color))
    }

    /// Where the occupancy's nodes lie.
    pub fn shape_lattice(&self) -> Lattice {
        Lattice::new(self.shape_nodes, self.half_extent[0])
    }

    /// Where the colour's nodes lie.
    pub fn color_lattice(&self) -> Lattice {
        Lattice::new(self.color_nodes, self.half_extent[1])
    }
}

impl Field for LatticeDecoder {
    fn evaluate(&self, query: &Query) -> FieldValues {
        let color = interpolate(self.color_lattice(), self.color.val(), query.points.clone());
        FieldValues { occupancy_logit: self.occupancy_logit(query), color: color.clamp(0.0, 1.0) }
    }

    fn occupancy_logit(&self, query: &Query) -> Tensor<1> {
        interpolate(self.shape_lattice(), self.shape.val(), query.points.clone()).squeeze_dim(1)
    }

    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        let points = query.points.clone();
        let shape = interpolate_jet(self.shape_lattice(), self.shape.val(), points.clone(), direction.clone());
        let [logit, slope] = shape.map(|part| part.squeeze_dim(1));
        let [color, change] = interpolate_jet(self.color_lattice(), self.color.val(), points, direction);
        let clamped = color.clone().lower_elem(0.0).bool_or(color.clone().greater_elem(1.0));
        FieldJet {
            value: FieldValues { occupancy_logit: logit, color: color.clamp(0.0, 1.0) },
            derivative: FieldValues { occupancy_logit: slope, color: change.mask_fill(clamped, 0.0) },
        }
    }

    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        let along = |axis| {
            let (lattice, points) = (self.shape_lattice(), query.points.clone());
            let [_, slope] = interpolate_jet(lattice, self.shape.val(), points, axis_direction(query, axis));
            slope
        };
        Tensor::cat((0..3).map(along).collect(), 1)
    }

    fn device(&self) -> Device {
        self.shape.val().device()
    }

    fn snapshots(&self) -> Vec<Snapshot> {
        let suits = self.device() == Device::flex() && self.shape.val().dtype() == DType::F32;
        if suits { vec![Box::new(self.to_field())] } else { Vec::new() }
    }
}
