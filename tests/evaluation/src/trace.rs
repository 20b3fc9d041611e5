//! What is kept of a run beside its line: where it went, and what it took for the rules' regions.
//!
//! One small JSON file a trial, so that pictures are drawn without playing anything again.

use std::path::Path;

use anyhow::Context;
use proto::CellSet;
use serde::{Deserialize, Serialize};

use crate::trial::Run;

/// A path and the regions at its end.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Trace {
    /// Where the base was, in `map`, metres.
    pub path_map: Vec<[f64; 2]>,
    /// The last region of each rule, as the robot knew it.
    pub regions: Vec<CellSet>,
}

/// Every so many-th point of a run's path is kept: five a second.
const STRIDE: usize = 4;

impl Trace {
    /// Of a run.
    #[must_use]
    pub fn of(run: &Run) -> Self {
        let rounded = |m: f64| (m * 1e3).round() / 1e3;
        let last = run.path.len().saturating_sub(1);
        let kept = run.path.iter().enumerate().filter(|(idx, _)| idx % STRIDE == 0 || *idx == last);
        let path_map = kept.map(|(_, p)| [rounded(p.position_map.x), rounded(p.position_map.y)]).collect();
        Trace { path_map, regions: run.regions.clone() }
    }

    /// Writes it.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, file: &Path) -> anyhow::Result<()> {
        std::fs::write(file, serde_json::to_string(self)?)
            .with_context(|| format!("write {}", file.display()))
    }

    /// Reads one; `None` when there is none, or it was cut off.
    #[must_use]
    pub fn read(file: &Path) -> Option<Self> {
        serde_json::from_str(&std::fs::read_to_string(file).ok()?).ok()
    }
}
