//! The best places in a window, however bad the guess: all of it is looked at, coarsely, and what may be good is
//! looked at more finely, by branch and bound.
//!
//! The coarse look is dense: at each heading, the bounds of a whole row of shifts are summed at once, point by
//! point, which is what processors are good at. A place's score is the mean heat of the scan's points there, less what it loses for lying far from where it
//! was expected. Several places are told when several look alike: which of them it is, others must say.

use std::collections::BinaryHeap;

use geometry::Pose2;
use nalgebra::Point2;

use super::cloud::Cloud;
use super::dense::{self, Dense};
use super::map::{MatchMap, N_LEVELS};
use super::placement::Placement;
use super::{Prior, Window};

/// So many points of a scan are enough to find it.
const N_POINTS_MAX: usize = 64;
/// Blocks that promise less than this share of what the best one promises are not looked into.
const PROMISE_SHARE_MIN: f32 = 0.55;
/// Blocks that are looked into at most for each place that is wanted. After that the most promising ones are
/// followed straight down.
const N_NODES_EACH: usize = 150;
/// Headings are tried in steps of at least this, radians: half a degree.
const TURN_STEP_MIN_RAD: f64 = 0.0087;
/// And at most this.
const TURN_STEP_MAX_RAD: f64 = 0.02;
/// A step of heading moves points at this quantile of range by two cells.
const FAR_QUANTILE: f64 = 0.75;
/// Most that a place loses for being unexpected, as a share of the best heat, ...
const LOSS_MAX: f64 = 0.3;
/// ... half of it at this many squared deviations.
const LOSS_HALF: f64 = 9.0;
/// Places this near to a better one are the same: metres and radians.
const SAME_SHIFT_M: f64 = 0.3;
const SAME_TURN_RAD: f64 = 0.12;
/// Places that score less than this share of the best are not told.
const SCORE_SHARE_MIN: f32 = 0.6;

/// What a place loses for lying so many squared deviations from where it was expected.
#[must_use]
pub fn loss(squared_deviations: f64) -> f64 {
    LOSS_MAX * squared_deviations / (squared_deviations + LOSS_HALF)
}

/// A place found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Where the scan's frame lies in the map's, to a cell and a step of heading.
    pub map_from_scan: Pose2,
    /// Mean heat of its points, 0 to 1, less its loss.
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

/// The best places within `window` of what is expected, at most `n_max`, the best first; none when there is
/// nothing to match.
#[must_use]
pub fn search(map: &MatchMap, cloud: &Cloud, prior: &Prior, window: Window, n_max: usize) -> Vec<Place> {
    if map.n_surfels() == 0 || cloud.points().is_empty() || !prior.map_from_scan.is_finite() {
        return Vec::new();
    }
    let search = Search::new(map, cloud, prior, window);
    let mut queue = search.promising();
    let mut found: Vec<Node> = Vec::new();
    let mut n_looked_into = 0;
    while let Some(best) = queue.pop() {
        let is_worse = found.first().is_some_and(|first| best.bound < SCORE_SHARE_MIN * first.bound);
        if found.len() >= n_max || is_worse {
            break;
        }
        if found.iter().any(|other| search.is_same(other, &best)) {
            continue;
        }
        if best.level == 0 {
            found.push(best);
            continue;
        }
        n_looked_into += 1;
        if n_looked_into < N_NODES_EACH * n_max {
            queue.extend(search.parts(&best));
        } else {
            let place = search.straight_down(best);
            if !found.iter().any(|other| search.is_same(other, &place)) {
                found.push(place);
            }
        }
    }
    found.sort_by(|a, b| b.cmp(a));
    found.iter().map(|node| search.place(node)).collect()
}

struct Search<'a> {
    map: &'a MatchMap,
    cell_m: f64,
    guess: Pose2,
    /// Shifts either way of the guess, cells.
    reach: i32,
    turn_step_rad: f64,
    /// Headings either way of the guess.
    n_turns: i32,
    /// Cells of the points at each heading.
    cells: Vec<Vec<[i32; 2]>>,
    /// One cell and one step of heading, in deviations.
    deviations: [f32; 2],
    /// One over the highest sum there can be.
    scale: f32,
    /// Level of the dense look.
    top: usize,
}

impl<'a> Search<'a> {
    fn new(map: &'a MatchMap, cloud: &Cloud, prior: &Prior, window: Window) -> Self {
        let guess = prior.map_from_scan;
        let thin = cloud.spread(N_POINTS_MAX);
        let mut ranges_m: Vec<f32> = thin.iter().map(|at| at.coords.norm()).collect();
        let nth = (ranges_m.len().saturating_sub(1) as f64 * FAR_QUANTILE) as usize;
        let far_m = *ranges_m.select_nth_unstable_by(nth, f32::total_cmp).1;
        let wanted_rad = 2.0 * map.cell_m() / f64::from(far_m).max(0.1);
        let turn_step_rad = wanted_rad.clamp(TURN_STEP_MIN_RAD, TURN_STEP_MAX_RAD);
        let n_turns = (window.turn_rad / turn_step_rad).ceil().clamp(1.0, 1000.0) as i32;
        let reach = (window.shift_m / map.cell_m()).ceil().clamp(1.0, 4000.0) as i32;
        let at_heading = |turn: i32| {
            let yaw_rad = guess.yaw_rad + f64::from(turn) * turn_step_rad;
            let placed = Placement::new(Pose2 { yaw_rad, ..guess });
            thin.iter().map(|at| map.cell_at(placed.point(*at))).collect()
        };
        let is_few = |level: &usize| (2 * reach) >> level < dense::N_SIDE_MAX as i32;
        let cell = map.cell_m() / prior.shift_m.max(1e-3);
        let turn = turn_step_rad / prior.turn_rad.max(1e-4);
        Search {
            map,
            cell_m: map.cell_m(),
            deviations: [cell as f32, turn as f32],
            guess,
            reach,
            turn_step_rad,
            n_turns,
            cells: (-n_turns..=n_turns).map(at_heading).collect(),
            scale: 1.0 / (255.0 * thin.len() as f32),
            top: (1..N_LEVELS).find(is_few).unwrap_or(N_LEVELS),
        }
    }

    /// All blocks of the window that may hold the best place or one like it.
    fn promising(&self) -> BinaryHeap<Node> {
        let Some(bounds) = self.map.bounds(self.top) else { return BinaryHeap::new() };
        let mut dense = Dense::new(((2 * self.reach) >> self.top) as usize + 1);
        let mut nodes: Vec<Node> = Vec::new();
        let mut highest = 0.0_f32;
        let shift = |n: usize| ((n as i32) << self.top) - self.reach;
        // From the expected heading to either side: what is good is found early, and all else falls short of it.
        let mut headings: Vec<(usize, &Vec<[i32; 2]>)> = self.cells.iter().enumerate().collect();
        headings.sort_by_key(|(heading, _)| (*heading as i32 - self.n_turns).abs());
        for (heading, cells) in headings {
            let turn_loss = self.loss(self.top, heading as u16, [0; 2]);
            let least = ((PROMISE_SHARE_MIN * highest + turn_loss) / self.scale) as u16;
            // Most are nowhere near: no loss needs to be known for that.
            for (row, sums) in dense.sums(&bounds, cells, [-self.reach; 2], least) {
                for (col, &sum) in sums.iter().enumerate().filter(|(_, sum)| **sum >= least) {
                    let off = [shift(col), shift(row)];
                    let node = self.node_of(self.top, heading as u16, off, u32::from(sum));
                    highest = highest.max(node.bound);
                    if node.bound >= PROMISE_SHARE_MIN * highest {
                        nodes.push(node);
                    }
                }
            }
        }
        nodes.retain(|node| node.bound >= PROMISE_SHARE_MIN * highest);
        BinaryHeap::from(nodes)
    }

    /// The four quarters of a block, those beyond the window left out.
    fn parts(&self, node: &Node) -> impl Iterator<Item = Node> {
        let level = usize::from(node.level).saturating_sub(1);
        let (half, node) = (1 << level, *node);
        let cells = self.cells.get(usize::from(node.heading)).map_or(&[][..], Vec::as_slice);
        let sums = match self.map.bounds(level) {
            Some(bounds) => bounds.four_sums(cells, node.off),
            None => self.map.four_heat_sums(cells, node.off),
        };
        [(0, 0), (half, 0), (0, half), (half, half)]
            .map(|(dx, dy)| [node.off[0] + dx, node.off[1] + dy])
            .into_iter()
            .zip(sums)
            .filter(|(off, _)| off.iter().all(|o| *o <= self.reach))
            .map(move |(off, sum)| self.node_of(level, node.heading, off, sum))
    }

    /// The place in a block that promises most at each step.
    fn straight_down(&self, mut node: Node) -> Node {
        while node.level > 0 {
            let Some(best) = self.parts(&node).max() else { break };
            node = best;
        }
        node
    }

    fn node_of(&self, level: usize, heading: u16, off: [i32; 2], sum: u32) -> Node {
        let bound = sum as f32 * self.scale - self.loss(level, heading, off);
        Node { bound, level: level as u8, heading, off }
    }

    /// The least that any place of a block loses for being off the guess.
    fn loss(&self, level: usize, heading: u16, off: [i32; 2]) -> f32 {
        let span = (1 << level) - 1;
        let nearest = |low: i32| if low > 0 { low } else { (-(low + span)).max(0) };
        let [cell, step] = self.deviations;
        let (x, y) = (nearest(off[0]) as f32 * cell, nearest(off[1]) as f32 * cell);
        let turn = (i32::from(heading) - self.n_turns) as f32 * step;
        loss((x * x + y * y + turn * turn).into()) as f32
    }

    /// Whether all of a block lies around a place that was found.
    fn is_same(&self, found: &Node, node: &Node) -> bool {
        let span = (1 << node.level) - 1;
        let near = (SAME_SHIFT_M / self.cell_m) as i32;
        let turns = (i32::from(found.heading) - i32::from(node.heading)).abs();
        f64::from(turns) * self.turn_step_rad <= SAME_TURN_RAD
            && (0..2).all(|axis| {
                let low = node.off[axis] - found.off[axis];
                low >= -near && low + span <= near
            })
    }

    fn place(&self, node: &Node) -> Place {
        let turn = i32::from(node.heading) - self.n_turns;
        let shift = node.off.map(|cells| f64::from(cells) * self.cell_m);
        let at = Point2::new(self.guess.x_m + shift[0], self.guess.y_m + shift[1]);
        let yaw_rad = self.guess.yaw_rad + f64::from(turn) * self.turn_step_rad;
        Place { map_from_scan: Pose2::new(at.x, at.y, yaw_rad), score: node.bound.into() }
    }
}
