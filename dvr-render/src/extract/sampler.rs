//! Asking a field in batches, and the counting and checking of its answers.

use dvr_core::Cancellation;
use glam::Vec3;

use super::error::{ExtractError, Result};
use crate::field::scalar::ScalarField;

/// Evaluates a field in batches, checks the answers, and keeps count.
pub(super) struct Sampler<'a, F: ?Sized> {
    pub field: &'a F,
    /// The logit at the surface.
    pub level: f32,
    /// The most points in a batch.
    pub max_points: usize,
    /// Asked before each batch.
    pub cancellation: Cancellation,
    /// Points evaluated so far.
    pub evaluations: usize,
    /// Smallest and largest logit seen so far.
    pub range: (f32, f32),
}

impl<'a, F: ScalarField + ?Sized> Sampler<'a, F> {
    /// A sampler that has seen nothing.
    pub fn new(field: &'a F, level: f32, max_points: usize, cancellation: Cancellation) -> Self {
        let range = (f32::INFINITY, f32::NEG_INFINITY);
        Self { field, level, max_points, cancellation, evaluations: 0, range }
    }

    /// Logits relative to the level, finite.
    pub fn values(&mut self, points: &[Vec3]) -> Result<Vec<f32>> {
        let mut values = Vec::with_capacity(points.len());
        for batch in points.chunks(self.max_points) {
            self.cancellation.check()?;
            let logits = self.field.logits(batch);
            check("logits", batch, &logits, |logit| !logit.is_nan())?;
            for logit in logits {
                self.range = (self.range.0.min(logit), self.range.1.max(logit));
                // A saturated field may answer +-infinity, between which nothing can be interpolated.
                values.push((logit - self.level).clamp(f32::MIN, f32::MAX));
            }
        }
        self.evaluations += points.len();
        Ok(values)
    }

    /// Whether points on both sides of the surface have been seen.
    pub fn has_seen_both_sides(&self) -> bool {
        self.range.0 - self.level < 0.0 && self.range.1 - self.level >= 0.0
    }
}

/// Checks that a batch's answers are as many as the points, and sound.
pub(super) fn check<T>(what: &'static str, points: &[Vec3], answers: &[T], sound: impl Fn(&T) -> bool) -> Result<()> {
    if answers.len() != points.len() {
        return Err(ExtractError::AnswerLength { what, points: points.len(), answers: answers.len() });
    }
    let mut unsound = points.iter().zip(answers).filter(|(_, answer)| !sound(answer));
    match unsound.next() {
        None => Ok(()),
        Some((&first, _)) => {
            Err(ExtractError::NotANumber { what, count: 1 + unsound.count(), points: points.len(), first })
        }
    }
}
