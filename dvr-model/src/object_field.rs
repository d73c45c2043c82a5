//! The field of an object that two pictures show, one as it is, the other in a mirror; or that is its own mirror image.

use burn::tensor::{Device, Int, Tensor};
use dvr_core::MirrorAxis;
use dvr_render::extract::ScalarField;
use dvr_render::{Crossing, Differentiable, Field, FieldJet, FieldValues, MarchSettings, Marcher, Query, Snapshot};
use glam::Vec3;

use crate::conditioned::Conditioned;

/// The field of one object: that of object 0 of a model's field or, with a mirror, the mean of that and of object 1 in the mirror,
/// both by their logits and by their colours. Of an object that is its own mirror image it is the mean of what both say of a point
/// and of its mirror image.
///
/// A picture and the same one flipped from left to right show an object and its mirror image: what a network says of both
/// differs by its errors alone. So does what it says of the halves of a symmetric object, of which a picture hides one.
#[derive(Clone, Debug)]
pub struct ObjectField {
    field: Conditioned,
    /// What it is the mean of; at least one.
    parts: Vec<Part>,
}

/// An object of a model's field, as it is or in the mirror.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Part {
    object: usize,
    mirror: Option<MirrorAxis>,
}

impl ObjectField {
    /// Of the field of one object, or with `mirror` of two, the second being the mirror image of the first.
    pub fn new(field: Conditioned, mirror: Option<MirrorAxis>) -> Self {
        let parts = std::iter::once(Part { object: 0, mirror: None });
        let in_mirror = mirror.map(|axis| Part { object: 1, mirror: Some(axis) });
        Self { field, parts: parts.chain(in_mirror).collect() }
    }

    /// The same of an object that is its own mirror image.
    #[must_use]
    pub fn symmetric(mut self, axis: MirrorAxis) -> Self {
        let turned = |part: &Part| Part { mirror: part.mirror.is_none().then_some(axis), ..*part };
        let turned: Vec<Part> = self.parts.iter().map(turned).filter(|part| !self.parts.contains(part)).collect();
        self.parts.extend(turned);
        self
    }

    /// The field that it is made of.
    pub fn conditioned(&self) -> &Conditioned {
        &self.field
    }

    /// The part that it is, where it is a mean of no others.
    fn is_plain(&self) -> bool {
        self.parts.len() == 1
    }

    /// What a part is asked where the object is asked `query`.
    fn query(query: &Query, Part { object, mirror }: Part) -> Query {
        let seen = |vectors: &Tensor<2>| in_mirror(vectors, mirror);
        let object: Tensor<1, Int> = Tensor::full([query.len()], object as i64, &query.points.device());
        Query { points: seen(&query.points), directions: query.directions.as_ref().map(seen), object: Some(object) }
    }

    /// The mean of what the parts answer.
    fn mean<T>(
        &self,
        query: &Query,
        ask: impl Fn(&Query, Part) -> T,
        add: impl Fn(T, T) -> T,
        scale: impl Fn(T, f64) -> T,
    ) -> T {
        let mut answers = self.parts.iter().map(|part| ask(&Self::query(query, *part), *part));
        let first = answers.next().expect("there is a part");
        scale(answers.fold(first, add), 1.0 / self.parts.len() as f64)
    }
}

/// Vectors `[n, 3]` in the mirror, where there is one.
fn in_mirror(vectors: &Tensor<2>, mirror: Option<MirrorAxis>) -> Tensor<2> {
    let Some(axis) = mirror else { return vectors.clone() };
    let signs = Tensor::<2>::from_floats([axis.mirrored(Vec3::ONE).to_array()], &vectors.device());
    vectors.clone() * signs
}

fn sum(a: FieldValues, b: FieldValues) -> FieldValues {
    FieldValues { occupancy_logit: a.occupancy_logit + b.occupancy_logit, color: a.color + b.color }
}

fn scaled(values: FieldValues, factor: f64) -> FieldValues {
    FieldValues { occupancy_logit: values.occupancy_logit * factor, color: values.color * factor }
}

impl Field for ObjectField {
    fn evaluate(&self, query: &Query) -> FieldValues {
        if self.is_plain() {
            return self.field.evaluate(query);
        }
        self.mean(query, |query, _| self.field.evaluate(query), sum, scaled)
    }

    fn occupancy_logit(&self, query: &Query) -> Tensor<1> {
        if self.is_plain() {
            return self.field.occupancy_logit(query);
        }
        self.mean(query, |query, _| self.field.occupancy_logit(query), |a, b| a + b, |sum, factor| sum * factor)
    }

    fn device(&self) -> Device {
        self.field.device()
    }
}

impl Differentiable for ObjectField {
    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        if self.is_plain() {
            return self.field.jet(query, direction);
        }
        let jet = |query: &Query, part: Part| self.field.jet(query, in_mirror(&direction, part.mirror));
        let add = |a: FieldJet, b: FieldJet| FieldJet {
            value: sum(a.value, b.value),
            derivative: sum(a.derivative, b.derivative),
        };
        let scale = |jet: FieldJet, factor: f64| FieldJet {
            value: scaled(jet.value, factor),
            derivative: scaled(jet.derivative, factor),
        };
        self.mean(query, jet, add, scale)
    }

    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        if self.is_plain() {
            return self.field.occupancy_gradient(query);
        }
        let gradient = |query: &Query, part: Part| in_mirror(&self.field.occupancy_gradient(query), part.mirror);
        self.mean(query, gradient, |a, b| a + b, |sum, factor| sum * factor)
    }
}

impl Crossing for ObjectField {
    fn own_marcher(&self, settings: MarchSettings) -> Option<Box<dyn Marcher + '_>> {
        // The kernel knows one network and one code.
        if self.is_plain() { self.field.own_marcher(settings) } else { None }
    }

    fn snapshots(&self) -> Vec<Snapshot> {
        let objects = self.field.snapshots();
        let is_whole = self.parts.iter().all(|part| part.object < objects.len());
        if self.is_plain() || !is_whole {
            return objects;
        }
        vec![Box::new(MeanSnapshot { objects, parts: self.parts.clone() })]
    }
}

/// The mean off the tensors.
struct MeanSnapshot {
    objects: Vec<Snapshot>,
    parts: Vec<Part>,
}

impl Part {
    fn seen(self, vectors: &[Vec3]) -> Vec<Vec3> {
        vectors.iter().map(|vector| self.mirror.map_or(*vector, |axis| axis.mirrored(*vector))).collect()
    }
}

impl MeanSnapshot {
    /// The mean of what the parts say of each of `count` places; `None` where one says nothing.
    fn mean<T: Copy>(
        &self,
        ask: impl Fn(&Snapshot, Part) -> Option<Vec<T>>,
        add: impl Fn(T, T) -> T,
        scale: impl Fn(T, f32) -> T,
    ) -> Option<Vec<T>> {
        let mut answers = self.parts.iter().map(|part| ask(&self.objects[part.object], *part));
        let mut sums = answers.next()??;
        for answer in answers {
            sums.iter_mut().zip(answer?).for_each(|(sum, value)| *sum = add(*sum, value));
        }
        let factor = 1.0 / self.parts.len() as f32;
        sums.iter_mut().for_each(|sum| *sum = scale(*sum, factor));
        Some(sums)
    }
}

impl ScalarField for MeanSnapshot {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        let logits = |object: &Snapshot, part: Part| Some(object.logits(&part.seen(points)));
        self.mean(logits, |a, b| a + b, |sum, factor| sum * factor).unwrap_or_default()
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        let gradients = |object: &Snapshot, part: Part| Some(part.seen(&object.gradients(&part.seen(points))?));
        self.mean(gradients, |a, b| a + b, |sum, factor| sum * factor)
    }

    fn colors(&self, points: &[Vec3], normals: &[Vec3], directions: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        let colors = |object: &Snapshot, part: Part| {
            let directions = directions.map(|directions| part.seen(directions));
            let colors = object.colors(&part.seen(points), &part.seen(normals), directions.as_deref())?;
            Some(colors.into_iter().map(Vec3::from_array).collect())
        };
        let means = self.mean(colors, |a, b| a + b, |sum, factor| sum * factor)?;
        Some(means.into_iter().map(|color| color.to_array()).collect())
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
        let expected = scaled(sum(of(0, 1.0), of(1, -1.0)), 0.5);
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
    fn an_object_that_is_its_own_mirror_image_has_one_value_on_both_sides() {
        let (field, both) = fields();
        let device = Device::flex();
        for (alone, whole) in [(ObjectField::new(field, None), false), (both, true)] {
            let symmetric = alone.clone().symmetric(MirrorAxis::X);
            let at = |field: &ObjectField, sign: f32| {
                let points = POINTS.map(|[x, y, z]| [sign * x, y, z]);
                let query = Query::new(Tensor::from_floats(points, &device));
                let values = field.evaluate(&query);
                let gradient =
                    numbers(in_mirror(&field.occupancy_gradient(&query), Some(MirrorAxis::X).filter(|_| sign < 0.0)));
                [numbers(values.occupancy_logit), numbers(values.color), gradient]
            };
            let (here, there) = (at(&symmetric, 1.0), at(&symmetric, -1.0));
            for (k, (here, there)) in here.iter().zip(&there).enumerate() {
                assert!(max_difference(here, there) < 1e-5, "{whole} {k}");
                // The mean of what is said of both sides.
                let [right, left] = [1.0, -1.0].map(|sign| at(&alone, sign)[k].clone());
                let mean: Vec<f32> = right.iter().zip(&left).map(|(a, b)| 0.5 * (a + b)).collect();
                assert!(max_difference(here, &mean) < 1e-5 && max_difference(&right, &left) > 1e-3, "{whole} {k}");
            }
            let [snapshot] = &symmetric.snapshots()[..] else { panic!("one object") };
            let points = POINTS.map(Vec3::from_array);
            assert!(max_difference(&snapshot.logits(&points), &here[0]) < 1e-5);
            assert!(max_difference(snapshot.colors(&points, &points, None).unwrap().as_flattened(), &here[1]) < 1e-5);
            let gradients: Vec<f32> =
                snapshot.gradients(&points).unwrap().iter().flat_map(|slope| slope.to_array()).collect();
            assert!(max_difference(&gradients, &here[2]) < 1e-4);
            // Said twice, it is the same.
            assert_eq!(symmetric.clone().symmetric(MirrorAxis::X).parts, symmetric.parts);
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
