//! The shortest path over a costmap: A* on eight neighbours.
//!
//! A start within an inflated area may leave it, over cells with nothing in them, at a high cost; nothing
//! else may enter one. Diagonals do not cut corners. Deliberately not here: following the path (`tracker`).

use geometry::Point2;

use crate::costmap::{Blocked, Costmap};

mod buckets;
mod place;
mod search;
#[cfg(test)]
mod tests;

use place::Place;
use search::Search;

/// Why there is no path.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoPath {
    /// The start is not on the map, or something stands on it.
    #[error("start ({x_m:.2}, {y_m:.2}) m is off the map or inside an obstacle")]
    Start {
        /// Position in `map`, metres.
        x_m: f64,
        /// Position in `map`, metres.
        y_m: f64,
    },
    /// The goal is not on the map.
    #[error("goal ({x_m:.2}, {y_m:.2}) m is off the map")]
    GoalOffMap {
        /// Position in `map`, metres.
        x_m: f64,
        /// Position in `map`, metres.
        y_m: f64,
    },
    /// The robot does not fit at the goal.
    #[error("goal is too near an obstacle")]
    GoalAtObstacle,
    /// A rule keeps the robot from the goal.
    #[error("goal lies within zone {zone_idx}, which a rule keeps the robot out of")]
    GoalInZone {
        /// Position in the list that the costmap was made with.
        zone_idx: usize,
    },
    /// Both ends are free, and nothing connects them.
    #[error("no way leads to the goal")]
    Closed,
}

/// The cheapest path from start to goal, as points in `map`: the start itself, cell centres, the goal itself.
///
/// # Errors
/// [`NoPath`] names which end is wrong and why, or that nothing connects them.
pub fn shortest_path(map: &Costmap, start: Point2, goal: Point2) -> Result<Vec<Point2>, NoPath> {
    let layout = map.layout();
    let off_start = NoPath::Start { x_m: start.x, y_m: start.y };
    let start_cell = layout.cell_at(start).ok_or(off_start.clone())?;
    let goal_cell = layout.cell_at(goal).ok_or(NoPath::GoalOffMap { x_m: goal.x, y_m: goal.y })?;
    if map.is_solid(start_cell) {
        return Err(off_start);
    }
    match map.blocked(layout.index(goal_cell)) {
        Blocked::Free => {}
        Blocked::Obstacle => return Err(NoPath::GoalAtObstacle),
        Blocked::Zone(zone_idx) => return Err(NoPath::GoalInZone { zone_idx }),
    }
    let mut search = Search::new(map.weights());
    let (from, to) = (Place::of(start_cell), Place::of(goal_cell));
    search.run(from, to);
    let mut path = vec![goal];
    let (mut here, mut step) = (to, 0);
    while here != from {
        (here, step) = search.before(here, step).ok_or(NoPath::Closed)?;
        if here != from {
            path.push(layout.centre(here.cell()));
        }
    }
    path.push(start);
    path.reverse();
    Ok(path)
}
