//! How a TSDF sees, remembers and forgets, and which of it cannot work.

use crate::projection::DepthLimits;

/// How a TSDF sees, remembers and forgets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TsdfConfig {
    /// Side of a voxel, metres, 0.005 to 0.5.
    pub voxel_m: f64,
    /// Distances are kept up to this far from a surface, metres; at least two voxels.
    pub truncation_m: f64,
    /// A voxel's weight never exceeds this: old evidence does not outlive new.
    pub weight_max: f32,
    /// A voxel counts as surface from this weight on: 1.5 is two masks that agree.
    pub weight_min: f32,
    /// Weight taken by a ray that passes through; 0 turns carving off.
    pub carve_step: f32,
    /// Weight taken when the surface at the voxel is seen and is not in the mask.
    pub absent_step: f32,
    /// Most blocks held. Beyond it new ones are refused and counted.
    pub n_blocks_max: usize,
    /// Which depth is trusted.
    pub limits: DepthLimits,
}

impl Default for TsdfConfig {
    /// Voxels of 4 cm. Twelve frames fill a voxel, four to six empty it: at two frames a second an object that
    /// was moved is gone within 3 s of its place being seen empty. 20 000 blocks are 80 MB.
    fn default() -> Self {
        TsdfConfig {
            voxel_m: 0.04,
            truncation_m: 0.12,
            weight_max: 12.0,
            weight_min: 1.5,
            carve_step: 3.0,
            absent_step: 2.0,
            n_blocks_max: 20_000,
            limits: DepthLimits::default(),
        }
    }
}

impl TsdfConfig {
    /// Whether anything loses weight.
    pub(super) fn clears(&self) -> bool {
        self.carve_step > 0.0 || self.absent_step > 0.0
    }

    /// Whether it can work.
    pub(super) fn check(&self) -> Result<(), TsdfConfigError> {
        let check = |key, value: f64, ok: bool, limit| {
            if ok { Ok(()) } else { Err(TsdfConfigError { key, value, limit }) }
        };
        let TsdfConfig { voxel_m, truncation_m, weight_max, weight_min, carve_step, absent_step, .. } = *self;
        check("voxel_m", voxel_m, (0.005..=0.5).contains(&voxel_m), "0.005 to 0.5")?;
        check(
            "truncation_m",
            truncation_m,
            (2.0 * voxel_m..=8.0 * voxel_m).contains(&truncation_m),
            "2 to 8 voxels",
        )?;
        check("weight_max", weight_max.into(), (1.0..=1000.0).contains(&weight_max), "1 to 1000")?;
        check(
            "weight_min",
            weight_min.into(),
            weight_min > 0.0 && weight_min <= weight_max,
            "0 to weight_max",
        )?;
        check("carve_step", carve_step.into(), (0.0..=1000.0).contains(&carve_step), "0 to 1000")?;
        check("absent_step", absent_step.into(), (0.0..=1000.0).contains(&absent_step), "0 to 1000")?;
        let n_blocks = self.n_blocks_max;
        check("n_blocks_max", n_blocks as f64, (1..=1_000_000).contains(&n_blocks), "1 to 1000000")
    }
}

/// A configuration that cannot work.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{key} is {value}, must be {limit}")]
pub struct TsdfConfigError {
    /// Which value.
    pub key: &'static str,
    /// What it is.
    pub value: f64,
    /// What it must be.
    pub limit: &'static str,
}
