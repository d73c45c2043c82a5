//! Who hears how long work goes on.

/// Hears how a run goes on.
pub trait Observer {
    /// A phase of so many steps begins; or, where it has begun and is not at its end, turns out to have so many.
    fn phase(&mut self, name: &str, steps: usize);
    /// So many steps of the phase are done.
    fn progress(&mut self, done: usize, message: &str);
    /// Something worth a line.
    fn note(&mut self, line: &str);
}

/// Nobody listens.
impl Observer for () {
    fn phase(&mut self, _: &str, _: usize) {}
    fn progress(&mut self, _: usize, _: &str) {}
    fn note(&mut self, _: &str) {}
}
