//! The field of an object that two pictures show: one as it is, the other in a mirror.

use burn::tensor::{Device, Int, Tensor};
use dvr_core::MirrorAxis;
use dvr_render::extract::ScalarField;
use dvr_render::{Crossing, Differentiable, Field, FieldJet, FieldValues, MarchSettings, Marcher, Query, Snapshot};
use glam::Vec3;

use crate::conditioned::Conditioned;

/// The field of one object: that of object 0 of a model's field or, with a mirror, the mean of that and of object 1 in the mirror,
/// both by their logits and by their colours.
///
/// A picture and the same one flipped from left to right show an object and its mirror image: what a network says of both
/// differs by its errors alone.
#[derive(Clone, Debug)]
pub struct ObjectField {
    field: Conditioned,
    mirror: Option<MirrorAxis>,
}

impl ObjectField {
    /// Of the field of one object, or with `mirror` of two, the second being the mirror image of the first.
    pub fn new(field: Conditioned, mirror: Option<MirrorAxis>) -> Self {
        Self { field, mirror }
    }

    /// The field that it is made of.
    pub fn conditioned(&self) -> &Conditioned {
        &self.field
    }

    /// A query of the object, and of its mirror image.
    fn both(&self, query: &Query, axis: MirrorAxis) -> [Query; 2] {
        let device = query.points.device();
        let mirrored = |vectors: &Tensor<2>| in_mirror(vectors, axis);
        let object = |row: i64| -> Option<Tensor<1, Int>> { Some(Tensor::full([query.len()], row, &device)) };
        let there = Query {
            points: mirrored(&query.points),
            directions: query.directions.as_ref().map(mirrored),
            object: object(1),
        };
        [Query { object: object(0), ..query.clone() }, there]
    }
}

/// Vectors `[n, 3]` in the mirror.
fn in_mirror(vectors: &Tensor<2>, axis: MirrorAxis) -> Tensor<2> {
    let signs = Tensor::<2>::from_floats([axis.mirrored(Vec3::ONE).to_array()], &vectors.device());
    vectors.clone() * signs
}

fn mean(a: FieldValues, b: FieldValues) -> FieldValues {
    FieldValues { occupancy_logit: (a.occupancy_logit + b.occupancy_logit) * 0.5, color: (a.color + b.color) * 0.5 }
}

impl Field for ObjectField {
    fn evaluate(&self, query: &Query) -> FieldValues {
        let Some(axis) = self.mirror else { return self.field.evaluate(query) };
        let [here, there] = self.both(query, axis).map(|query| self.field.evaluate(&query));
        mean(here, there)
    }

    fn occupancy_logit(&self, query: &Query) -> Tensor<1> {
        let Some(axis) = self.mirror else { return self.field.occupancy_logit(query) };
        let [here, there] = self.both(query, axis).map(|query| self.field.occupancy_logit(&query));
        (here + there) * 0.5
    }

    fn device(&self) -> Device {
        self.field.device()
    }
}

impl Differentiable for ObjectField {
    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        let Some(axis) = self.mirror else { return self.field.jet(query, direction) };
        let [here, there] = self.both(query, axis);
        let there = self.field.jet(&there, in_mirror(&direction, axis));
        let here = self.field.jet(&here, direction);
        FieldJet { value: mean(here.value, there.value), derivative: mean(here.derivative, there.derivative) }
    }

    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        let Some(axis) = self.mirror else { return self.field.occupancy_gradient(query) };
        let [here, there] = self.both(query, axis).map(|query| self.field.occupancy_gradient(&query));
        (here + in_mirror(&there, axis)) * 0.5
    }
}

impl Crossing for ObjectField {
    fn own_marcher(&self, settings: MarchSettings) -> Option<Box<dyn Marcher + '_>> {
        // The kernel knows one network and one code.
        if self.mirror.is_some() { None } else { self.field.own_marcher(settings) }
    }

    fn snapshots(&self) -> Vec<Snapshot> {
        let mut snapshots = self.field.snapshots();
        match (self.mirror, snapshots.len()) {
            (Some(axis), 2) => {
                let there = snapshots.remove(1);
                vec![Box::new(MeanSnapshot { here: snapshots.remove(0), there, axis })]
            }
            _ => snapshots,
        }
    }
}

/// The mean off the tensors.
struct MeanSnapshot {
    here: Snapshot,
    there: Snapshot,
    axis: MirrorAxis,
}

impl MeanSnapshot {
    fn mirrored(&self, vectors: &[Vec3]) -> Vec<Vec3> {
        vectors.iter().map(|vector| self.axis.mirrored(*vector)).collect()
    }
}

impl ScalarField for MeanSnapshot {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        let mut logits = self.here.logits(points);
        let there = self.there.logits(&self.mirrored(points));
        logits.iter_mut().zip(there).for_each(|(here, there)| *here = 0.5 * (*here + there));
        logits
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        let mut gradients = self.here.gradients(points)?;
        let there = self.there.gradients(&self.mirrored(points))?;
        gradients.iter_mut().zip(there).for_each(|(here, there)| *here = 0.5 * (*here + self.axis.mirrored(there)));
        Some(gradients)
    }

    fn colors(&self, points: &[Vec3], normals: &[Vec3], directions: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        let mut colors = self.here.colors(points, normals, directions)?;
        let directions = directions.map(|directions| self.mirrored(directions));
        let there = self.there.colors(&self.mirrored(points), &self.mirrored(normals), directions.as_deref())?;
        for (here, there) in colors.iter_mut().zip(there) {
            *here = [0, 1, 2].map(|channel| 0.5 * (here[channel] + there[channel]));
        }
        Some(colors)
    }
}

#[cfg(test)]
mod tests {
    use dvr_test_support::max_difference;

    use super::*;
    use crate::decoder::DecoderConfig;
    use crate::seeded::seeded;

    /// A field of two objects, and its mean in the mirror of x.
    fn fields() -> (Conditioned, ObjectField) {
        let device = Device::flex();
        let config = DecoderConfig::new().with_code_dim(4).with_hidden(24).with_blocks(2).with_octaves(2);
        let decoder = seeded(&device, 3, || config.init(&device));
        let codes = [[0.3, -0.8, 0.5, 1.0], [-0.9, 0.4, 0.2, -0.6]];
        let field = decoder.with_codes(Tensor::from_floats(codes, &device));
        (field.clone(), ObjectField::new(field, Some(MirrorAxis::X)))
    }

    fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
        tensor.into_data().iter::<f32>().collect()
    }

    const POINTS: [[f32; 3]; 3] = [[0.1, 0.2, -0.3], [-0.4, 0.1, 0.2], [0.0, -0.25, 0.35]];

    #[test]
    fn it_is_the_mean_of_the_object_and_its_mirror_image_however_it_is_asked() {
        let (field, both) = fields();
        let device = Device::flex();
        let of = |row: i64, sign: f32| {
            let points = POINTS.map(|[x, y, z]| [sign * x, y, z]);
            let object = Some(Tensor::full([3], row, &device));
            field.evaluate(&Query { object, ..Query::new(Tensor::from_floats(points, &device)) })
        };
        let expected = mean(of(0, 1.0), of(1, -1.0));
        let query = Query::new(Tensor::from_floats(POINTS, &device));
        let found = both.evaluate(&query);
        let [logits, colors] = [numbers(expected.occupancy_logit), numbers(expected.color)];
        assert!(max_difference(&numbers(found.occupancy_logit), &logits) < 1e-6);
        assert!(max_difference(&numbers(found.color), &colors) < 1e-6);
        assert!(max_difference(&numbers(both.occupancy_logit(&query)), &logits) < 1e-6);
        let [snapshot] = &both.snapshots()[..] else { panic!("one object") };
        let points = POINTS.map(Vec3::from_array);
        assert!(max_difference(&snapshot.logits(&points), &logits) < 1e-5);
        let snapshot_colors = snapshot.colors(&points, &points, None).unwrap();
        assert!(max_difference(snapshot_colors.as_flattened(), &colors) < 1e-5);
    }

    #[test]
    fn its_gradient_is_that_of_differences_on_tensors_and_off_them() {
        let (_, both) = fields();
        let query = Query::new(Tensor::from_floats(POINTS, &Device::flex()));
        let gradient = numbers(both.occupancy_gradient(&query));
        let [snapshot] = &both.snapshots()[..] else { panic!("one object") };
        let points = POINTS.map(Vec3::from_array);
        let off_tensors: Vec<f32> = snapshot.gradients(&points).unwrap().iter().flat_map(Vec3::to_array).collect();
        assert!(max_difference(&gradient, &off_tensors) < 1e-5);
        let step = 1e-3;
        for axis in 0..3 {
            let at = |t: f32| snapshot.logits(&points.map(|point| point + t * Vec3::AXES[axis]));
            for (point, (above, below)) in at(step).into_iter().zip(at(-step)).enumerate() {
                let slope = (above - below) / (2.0 * step);
                assert!((gradient[3 * point + axis] - slope).abs() < 0.02 * slope.abs().max(0.5), "{axis} {point}");
            }
        }
    }

    #[test]
    fn without_a_mirror_it_is_the_field_of_object_0() {
        let (field, _) = fields();
        let query = Query::new(Tensor::from_floats(POINTS, &Device::flex()));
        let alone = ObjectField::new(field.clone(), None);
        assert_eq!(numbers(alone.occupancy_logit(&query)), numbers(field.occupancy_logit(&query)));
    }
}
