//! The best place in a window, by branch and bound: no better one is missed, however bad the guess.

use std::collections::BinaryHeap;

use geometry::Pose2;
use nalgebra::Point2;

use super::Window;
use super::cloud::Cloud;
use super::map::{MatchMap, N_LEVELS, Placement};

/// So many points of a scan are enough to find it.
const N_POINTS_MAX: usize = 120;
/// Blocks that are looked into at most: some milliseconds. After that the best one so far is followed down.
const N_NODES_MAX: usize = 20_000;
/// Headings are tried in steps of at least this, radians: half a degree.
const TURN_STEP_MIN_RAD: f64 = 0.0087;
/// And at most this.
const TURN_STEP_MAX_RAD: f64 = 0.02;
/// A step of heading moves points at this quantile of range by two cells.
const FAR_QUANTILE: f64 = 0.75;
/// What a place at the window's border loses against one at the guess, as a share of the best heat: between
/// places that look the same the nearer one wins.
const BORDER_LOSS: f32 = 0.06;

/// Windows from this heading on, radians, are of somebody who is lost.
const ANY_HEADING_RAD: f64 = 3.0;

/// A place found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Where the scan's frame lies in the map's, to a cell and a step of heading.
    pub map_from_scan: Pose2,
    /// Mean heat of its points, 0 to 1.
    pub score: f64,
}

/// A block of shifts at one heading.
#[derive(Clone, Copy, PartialEq)]
struct Node {
    /// No place in it scores more than this.
    bound: f32,
    level: u8,
    heading: u16,
    /// Lowest shift, cells.
    off: [i32; 2],
}

impl Eq for Node {}

impl Ord for Node {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        // Of equal ones the finer first.
        self.bound.total_cmp(&other.bound).then(other.level.cmp(&self.level))
    }
}

impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// The best place within `window` of `guess`; `None` when there is nothing to match.
#[must_use]
pub fn search(map: &MatchMap, cloud: &Cloud, guess: Pose2, window: Window) -> Option<Place> {
    if map.n_surfels() == 0 || cloud.points().is_empty() || !guess.is_finite() {
        return None;
    }
    let search = Search::new(map, cloud, guess, window);
    let mut queue = search.first_nodes();
    let mut n_looked_into = 0;
    loop {
        let best = queue.pop()?;
        if best.level == 0 {
            return Some(search.place(&best));
        }
        n_looked_into += 1;
        if n_looked_into > N_NODES_MAX {
            queue.clear();
        }
        search.split(&best, &mut queue);
    }
}

struct Search<'a> {
    map: &'a MatchMap,
    guess: Pose2,
    reach: i32,
    turn_step_rad: f64,
    /// Headings either way of the guess.
    n_turns: i32,
    /// Cells of the points at each heading.
    cells: Vec<Vec<[i32; 2]>>,
    /// What a place at the border loses.
    border_loss: f32,
    /// One over the highest sum there can be.
    scale: f32,
    top: usize,
}

impl<'a> Search<'a> {
    fn new(map: &'a MatchMap, cloud: &Cloud, guess: Pose2, window: Window) -> Self {
        let thin = cloud.thinned(N_POINTS_MAX);
        let mut ranges_m: Vec<f32> = thin.points().iter().map(|p| p.at.coords.norm()).collect();
        let nth = ((ranges_m.len() - 1) as f64 * FAR_QUANTILE) as usize;
        let far_m = *ranges_m.select_nth_unstable_by(nth, f32::total_cmp).1;
        let wanted_rad = 2.0 * map.cell_m() / f64::from(far_m).max(0.1);
        let turn_step_rad = wanted_rad.clamp(TURN_STEP_MIN_RAD, TURN_STEP_MAX_RAD);
        let n_turns = (window.turn_rad / turn_step_rad).ceil().clamp(1.0, 1000.0) as i32;
        let reach = (window.shift_m / map.cell_m()).ceil().clamp(1.0, 4000.0) as i32;
        let at_heading = |turn: i32| {
            let yaw_rad = guess.yaw_rad + f64::from(turn) * turn_step_rad;
            let placed = Placement::new(Pose2 { yaw_rad, ..guess });
            thin.points().iter().map(|p| map.cell_at(placed.point(p.at))).collect()
        };
        // A block about as large as half the window: few to begin with, and few to split.
        let top = (0..N_LEVELS).find(|level| (1 << (level + 1)) > reach).unwrap_or(N_LEVELS);
        // Who looks at every heading has no guess that others could be off.
        let border_loss = if window.turn_rad < ANY_HEADING_RAD { BORDER_LOSS } else { 0.0 };
        Search {
            map,
            border_loss,
            guess,
            reach,
            turn_step_rad,
            n_turns,
            cells: (-n_turns..=n_turns).map(at_heading).collect(),
            scale: 1.0 / (255.0 * thin.points().len() as f32),
            top,
        }
    }

    fn first_nodes(&self) -> BinaryHeap<Node> {
        let step = 1_i32 << self.top;
        let mut nodes = Vec::new();
        for heading in 0..self.cells.len() {
            for y in (-self.reach..=self.reach).step_by(step as usize) {
                for x in (-self.reach..=self.reach).step_by(step as usize) {
                    nodes.extend(self.node(self.top, heading as u16, [x, y]));
                }
            }
        }
        BinaryHeap::from(nodes)
    }

    fn split(&self, node: &Node, queue: &mut BinaryHeap<Node>) {
        let level = usize::from(node.level) - 1;
        let half = 1 << level;
        for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
            let off = [node.off[0] + dx, node.off[1] + dy];
            queue.extend(self.node(level, node.heading, off));
        }
    }

    /// A block with its bound; `None` beyond the window.
    fn node(&self, level: usize, heading: u16, off: [i32; 2]) -> Option<Node> {
        if off[0] > self.reach || off[1] > self.reach {
            return None;
        }
        let sum = self.map.bounds(level).sum(&self.cells[usize::from(heading)], off);
        let bound = sum as f32 * self.scale - self.loss(level, heading, off);
        Some(Node { bound, level: level as u8, heading, off })
    }

    /// The least that any place of a block loses for being off the guess.
    fn loss(&self, level: usize, heading: u16, off: [i32; 2]) -> f32 {
        let span = (1 << level) - 1;
        let nearest = |low: i32| if low > 0 { low } else { (-(low + span)).max(0) };
        let share = |low: i32| nearest(low) as f32 / self.reach as f32;
        let turn = (i32::from(heading) - self.n_turns) as f32 / self.n_turns as f32;
        let (x, y) = (share(off[0]), share(off[1]));
        self.border_loss * (x * x + y * y + turn * turn)
    }

    fn place(&self, node: &Node) -> Place {
        let turn = i32::from(node.heading) - self.n_turns;
        let cell_m = self.map.cell_m();
        let shift = node.off.map(|cells| f64::from(cells) * cell_m);
        let at = Point2::new(self.guess.x_m + shift[0], self.guess.y_m + shift[1]);
        let yaw_rad = self.guess.yaw_rad + f64::from(turn) * self.turn_step_rad;
        let score = f64::from(node.bound + self.loss(0, node.heading, node.off));
        Place { map_from_scan: Pose2::new(at.x, at.y, yaw_rad), score }
    }
}
