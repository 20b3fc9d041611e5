//! Room of plans that are no more, for those to come: time spent in the allocator has no bound.

use super::{Plan, Sample};

/// Most plans whose room is kept: those of one tick.
const N_KEPT: usize = 8;

/// Room of plans that are no more.
#[derive(Debug)]
pub(crate) struct Spares(Vec<Vec<Sample>>);

impl Default for Spares {
    fn default() -> Self {
        Spares(Vec::with_capacity(N_KEPT))
    }
}

impl Spares {
    /// Room for a plan; new room when there is none.
    pub(crate) fn take(&mut self) -> Vec<Sample> {
        self.0.pop().unwrap_or_default()
    }

    /// Keeps the room of a plan that nobody follows any more.
    pub(crate) fn keep(&mut self, plan: Option<Plan>) {
        if let Some(plan) = plan.filter(|_| self.0.len() < N_KEPT) {
            self.0.push(plan.samples);
        }
    }
}
