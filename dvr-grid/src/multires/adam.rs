//! Adam (Kingma and Ba 2015) on rows of parameters.

use pulp::NullaryFnOnce;

use crate::bricks::{EDGE, Row};

/// What a step needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamStep {
    /// Step size.
    pub learning_rate: f32,
    /// Decay of the gradient's running mean.
    pub beta1: f32,
    /// Decay of the running mean of its square.
    pub beta2: f32,
    /// Added to the root of the latter.
    pub epsilon: f32,
    /// Which step it is, from 1: corrects the bias of means that started at zero.
    pub step: i32,
}

/// The running means, one each per parameter.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments<const C: usize> {
    /// Of the gradient.
    pub first: Vec<Row<C>>,
    /// Of its square.
    pub second: Vec<Row<C>>,
}

impl<const C: usize> Moments<C> {
    /// Zeros for this many rows.
    pub fn new(rows: usize) -> Self {
        Self { first: vec![[[0.0; C]; EDGE]; rows], second: vec![[[0.0; C]; EDGE]; rows] }
    }
}

/// Moves parameters; those whose gradient and moments are zero stay.
pub struct Adam<'a> {
    pub parameters: &'a mut [f32],
    pub gradient: &'a [f32],
    pub first: &'a mut [f32],
    pub second: &'a mut [f32],
    pub settings: &'a AdamStep,
}

/// Compiled for each instruction set: a closure would not be.
impl NullaryFnOnce for Adam<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let AdamStep { learning_rate, beta1, beta2, epsilon, step } = *self.settings;
        let rate = learning_rate / (1.0 - beta1.powi(step));
        let scale = 1.0 / (1.0 - beta2.powi(step));
        let moments = self.first.iter_mut().zip(self.second);
        for ((parameter, &g), (m, v)) in self.parameters.iter_mut().zip(self.gradient).zip(moments) {
            *m = beta1 * *m + (1.0 - beta1) * g;
            *v = beta2 * *v + (1.0 - beta2) * g * g;
            *parameter -= rate * *m / ((*v * scale).sqrt() + epsilon);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_follow_adam_and_rest_where_there_was_never_a_gradient() {
        let gradient: Vec<f32> = (0..40).map(|i| if i % 4 == 1 { 0.0 } else { (0.1 + i as f32 * 0.7).sin() }).collect();
        let (mut parameters, mut first, mut second) = ([1.0f32; 40], [0.0; 40], [0.0; 40]);
        for number in [1, 2] {
            let settings = AdamStep { learning_rate: 0.1, beta1: 0.9, beta2: 0.99, epsilon: 1e-8, step: number };
            let (parameters, first, second) = (&mut parameters, &mut first, &mut second);
            Adam { parameters, gradient: &gradient, first, second, settings: &settings }.call();
        }
        for (parameter, gradient) in parameters.iter().zip(&gradient) {
            // A constant gradient moves a parameter by the learning rate a step.
            let moved = if *gradient == 0.0 { 0.0 } else { 0.2 * gradient.signum() };
            assert!((1.0 - parameter - moved).abs() < 1e-5, "{gradient}: {parameter}");
        }
    }
}
