//! How long work tells how far it is.

/// Receives progress and warnings; may be called from any thread.
pub trait Progress: Sync {
    /// `done` of `total` steps of a stage are finished. A stage starts with its first call.
    fn step(&self, stage: &str, done: usize, total: usize);
    /// Something the user should know that stops nothing.
    fn warn(&self, message: &str);
    /// What a stage came to, in a line of figures.
    fn note(&self, _summary: &str) {}
}

/// Tells nobody.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn step(&self, _: &str, _: usize, _: usize) {}
    fn warn(&self, _: &str) {}
}
