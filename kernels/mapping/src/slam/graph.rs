//! Sub-maps as a graph of poses that settle until their constraints agree.
//!
//! Gauss–Newton on relative poses; loops carry a robust weight, so that a wrong one is outvoted. The linear
//! systems are solved by conjugate gradients, preconditioned with the chain of sub-maps, which is solved
//! exactly: about as many rounds as there are loops, and no factorisation that grows with the building.

use geometry::Pose2;
use geometry::angle::wrapped;
use nalgebra::{Matrix3, Vector3};

use super::submap::Submap;
use crate::scan_match::Match;

/// Standard deviations of a sub-map's place against the one before it, metres and radians.
const CHAIN_SHIFT_M: f64 = 0.03;
const CHAIN_TURN_RAD: f64 = 0.006;
/// Best that a loop is believed, metres and radians.
const LOOP_SHIFT_M: f64 = 0.04;
const LOOP_TURN_RAD: f64 = 0.006;
/// Weighted errors of a loop beyond this many deviations count less and less.
const ROBUST_DEVIATIONS: f64 = 4.0;
/// A loop that is this many deviations off when all has settled was wrong, and is let go.
const WRONG_DEVIATIONS: f64 = 12.0;
const N_STEPS_MAX: usize = 12;
const N_INNER_MAX: usize = 200;
/// Sub-maps that moved less than this have not, metres and radians.
const STILL_M: f64 = 0.03;
const STILL_RAD: f64 = 0.005;
/// A loop that is off by less has nothing to move.
const AGREED_DEVIATIONS: f64 = 0.5;

/// How one sub-map lies to another.
#[derive(Clone, Debug)]
pub(super) struct Constraint {
    from: usize,
    to: usize,
    from_from_to: Pose2,
    /// In `from`'s frame: 1/m², 1/rad².
    information: Matrix3<f64>,
    is_loop: bool,
}

impl Constraint {
    /// A sub-map found in another one.
    pub(super) fn of_match(from: usize, to: usize, found: &Match) -> Self {
        Constraint::no_better_than(from, to, found, (LOOP_SHIFT_M, LOOP_TURN_RAD))
    }

    /// One found in another; no better than the deviations `best`, metres and radians, and where the surfaces do
    /// not tell, as little as they do.
    pub(super) fn no_better_than(from: usize, to: usize, found: &Match, best: (f64, f64)) -> Self {
        let best = diagonal(best.0, best.1);
        let told = found.information + Matrix3::identity() * 1e-3;
        let both = best.try_inverse().and_then(|b| told.try_inverse().map(|t| b + t));
        let information = both.and_then(|covariance| covariance.try_inverse()).unwrap_or(best);
        Constraint { from, to, from_from_to: found.map_from_scan, information, is_loop: true }
    }

    /// One somewhere around a place in another; deviations in metres and radians.
    pub(super) fn loose(from: usize, to: usize, from_from_to: Pose2, off: (f64, f64)) -> Self {
        Constraint { from, to, from_from_to, information: diagonal(off.0, off.1), is_loop: false }
    }

    /// One where odometry tells; deviations along and aside in metres, turned in radians. Wheels spin and robots
    /// are carried: what is far off counts less, as a loop does.
    pub(super) fn told(from: usize, to: usize, from_from_to: Pose2, deviations: [f64; 3]) -> Self {
        let information = Matrix3::from_diagonal(&Vector3::from(deviations.map(|d| d.powi(-2))));
        Constraint { from, to, from_from_to, information, is_loop: true }
    }

    /// Error and its derivatives by the two poses.
    fn linear(&self, from: &Pose2, to: &Pose2) -> (Vector3<f64>, Matrix3<f64>, Matrix3<f64>) {
        let (sin, cos) = from.yaw_rad.sin_cos();
        let (dx, dy) = (to.x_m - from.x_m, to.y_m - from.y_m);
        let (along, aside) = (cos * dx + sin * dy, cos * dy - sin * dx);
        let error = Vector3::new(
            along - self.from_from_to.x_m,
            aside - self.from_from_to.y_m,
            wrapped(to.yaw_rad - from.yaw_rad - self.from_from_to.yaw_rad),
        );
        let by_from = Matrix3::new(-cos, -sin, aside, sin, -cos, -along, 0.0, 0.0, -1.0);
        let by_to = Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0);
        (error, by_from, by_to)
    }

    fn squared_error(&self, poses: &[Pose2]) -> f64 {
        let (error, ..) = self.linear(&poses[self.from], &poses[self.to]);
        error.dot(&(self.information * error))
    }
}

/// All constraints.
#[derive(Default)]
pub(super) struct Graph {
    constraints: Vec<Constraint>,
}

impl Graph {
    pub(super) fn n_loops(&self) -> usize {
        self.constraints.iter().filter(|c| c.is_loop).count()
    }

    /// `to` was begun at a known place in `from`.
    pub(super) fn tie(&mut self, from: usize, to: usize, from_from_to: Pose2) {
        self.constraints.push(Constraint::loose(from, to, from_from_to, (CHAIN_SHIFT_M, CHAIN_TURN_RAD)));
    }

    /// `to` was begun somewhere around a place in `from`; deviations in metres and radians.
    pub(super) fn tie_loosely(&mut self, from: usize, to: usize, from_from_to: Pose2, off: (f64, f64)) {
        self.constraints.push(Constraint::loose(from, to, from_from_to, off));
    }

    /// `to` was found in another one: the guess by which it was tied to `from` is let go.
    pub(super) fn mend(&mut self, from: usize, to: usize, found: Constraint) {
        self.constraints.retain(|c| (c.from, c.to) != (from, to));
        self.constraints.push(Constraint { is_loop: false, ..found });
    }

    /// Adds a loop; true when it asks the sub-maps to move.
    pub(super) fn add_loop(&mut self, constraint: Constraint, submaps: &[Submap]) -> bool {
        let poses: Vec<Pose2> = submaps.iter().map(|s| s.map_from_submap).collect();
        let is_news = constraint.squared_error(&poses) > AGREED_DEVIATIONS * AGREED_DEVIATIONS;
        self.constraints.push(constraint);
        is_news
    }

    /// Moves the sub-maps, all but the first, until the constraints agree; true when any of them moved.
    pub(super) fn settle(&mut self, submaps: &mut [Submap]) -> bool {
        let before: Vec<Pose2> = submaps.iter().map(|s| s.map_from_submap).collect();
        let mut poses = before.clone();
        optimise(&self.constraints, &mut poses);
        let n_before = self.constraints.len();
        self.constraints
            .retain(|c| !c.is_loop || c.squared_error(&poses) < WRONG_DEVIATIONS * WRONG_DEVIATIONS);
        if self.constraints.len() < n_before {
            poses.clone_from(&before);
            optimise(&self.constraints, &mut poses);
        }
        let mut has_moved = false;
        for (submap, pose) in submaps.iter_mut().zip(&poses) {
            let off = submap.map_from_submap.inverse() * *pose;
            has_moved |= off.position().coords.norm() > STILL_M || off.yaw_rad.abs() > STILL_RAD;
            submap.map_from_submap = *pose;
        }
        has_moved
    }
}

fn diagonal(shift_m: f64, turn_rad: f64) -> Matrix3<f64> {
    let (shift, turn) = (shift_m.powi(-2), turn_rad.powi(-2));
    Matrix3::from_diagonal(&Vector3::new(shift, shift, turn))
}

/// Gauss–Newton; the first pose stays.
pub(super) fn optimise(constraints: &[Constraint], poses: &mut [Pose2]) {
    for _ in 0..N_STEPS_MAX {
        let system = System::at(constraints, poses);
        let step = system.solve();
        let mut largest = 0.0_f64;
        for (pose, step) in poses.iter_mut().zip(&step) {
            *pose = Pose2::new(pose.x_m + step.x, pose.y_m + step.y, pose.yaw_rad + step.z);
            largest = largest.max(step.amax());
        }
        if largest < 1e-4 {
            break;
        }
    }
}

/// The normal equations in blocks.
struct System {
    diagonal: Vec<Matrix3<f64>>,
    /// (row, column, block) above the diagonal.
    beside: Vec<(usize, usize, Matrix3<f64>)>,
    right: Vec<Vector3<f64>>,
}

impl System {
    fn at(constraints: &[Constraint], poses: &[Pose2]) -> Self {
        let n = poses.len();
        let mut system = System {
            // A whisper of damping: a sub-map that nothing ties stays where it is.
            diagonal: vec![Matrix3::identity() * 1e-6; n],
            beside: Vec::with_capacity(constraints.len()),
            right: vec![Vector3::zeros(); n],
        };
        for constraint in constraints {
            let Constraint { from, to, .. } = *constraint;
            if from >= n || to >= n {
                continue;
            }
            let (error, by_from, by_to) = constraint.linear(&poses[from], &poses[to]);
            let mut information = constraint.information;
            if constraint.is_loop {
                // Cauchy.
                let deviations = error.dot(&(information * error)) / ROBUST_DEVIATIONS.powi(2);
                information /= 1.0 + deviations;
            }
            system.diagonal[from] += by_from.transpose() * information * by_from;
            system.diagonal[to] += by_to.transpose() * information * by_to;
            system.beside.push((from, to, by_from.transpose() * information * by_to));
            system.right[from] -= by_from.transpose() * information * error;
            system.right[to] -= by_to.transpose() * information * error;
        }
        // The first one is held.
        if let (Some(first), Some(right)) = (system.diagonal.first_mut(), system.right.first_mut()) {
            *first += Matrix3::identity() * 1e12;
            *right = Vector3::zeros();
        }
        system
    }

    fn times(&self, v: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut product: Vec<_> = self.diagonal.iter().zip(v).map(|(block, v)| block * v).collect();
        for &(row, col, ref block) in &self.beside {
            product[row] += block * v[col];
            product[col] += block.transpose() * v[row];
        }
        product
    }

    /// Preconditioned conjugate gradients.
    fn solve(&self) -> Vec<Vector3<f64>> {
        let chain = Chain::new(self);
        let apply = |v: &[Vector3<f64>]| chain.solve(v);
        let mut x = vec![Vector3::zeros(); self.right.len()];
        let mut rest = self.right.clone();
        let mut scaled = apply(&rest);
        let mut way = scaled.clone();
        let mut size = dot(&rest, &scaled);
        let enough = size * 1e-12;
        for _ in 0..N_INNER_MAX {
            if size <= enough || size <= 0.0 {
                break;
            }
            let bent = self.times(&way);
            let step = size / dot(&way, &bent);
            for idx in 0..x.len() {
                x[idx] += way[idx] * step;
                rest[idx] -= bent[idx] * step;
            }
            scaled = apply(&rest);
            let next = dot(&rest, &scaled);
            for (way, scaled) in way.iter_mut().zip(&scaled) {
                *way = scaled + *way * (next / size);
            }
            size = next;
        }
        x
    }
}

/// The blocks on and next to the diagonal, factorised (Thomas).
struct Chain {
    /// Inverses of the diagonal blocks after elimination.
    inverse: Vec<Matrix3<f64>>,
    /// Block (k, k + 1).
    beside: Vec<Matrix3<f64>>,
}

impl Chain {
    fn new(system: &System) -> Self {
        let n = system.diagonal.len();
        let mut beside = vec![Matrix3::zeros(); n];
        for &(row, col, ref block) in &system.beside {
            if col == row + 1 {
                beside[row] += block;
            } else if row == col + 1 {
                beside[col] += block.transpose();
            }
        }
        let mut inverse: Vec<Matrix3<f64>> = Vec::with_capacity(n);
        for (idx, diagonal) in system.diagonal.iter().enumerate() {
            let mut block = *diagonal;
            if idx > 0 {
                let before = beside[idx - 1];
                block -= before.transpose() * inverse[idx - 1] * before;
            }
            inverse.push(block.try_inverse().unwrap_or_default());
        }
        Chain { inverse, beside }
    }

    fn solve(&self, right: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut x: Vec<Vector3<f64>> = right.to_vec();
        for idx in 1..x.len() {
            let carried = self.beside[idx - 1].transpose() * (self.inverse[idx - 1] * x[idx - 1]);
            x[idx] -= carried;
        }
        for idx in (0..x.len()).rev() {
            let after = x.get(idx + 1).map_or(Vector3::zeros(), |next| self.beside[idx] * next);
            x[idx] = self.inverse[idx] * (x[idx] - after);
        }
        x
    }
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}
