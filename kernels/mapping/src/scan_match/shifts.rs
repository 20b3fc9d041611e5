//! All shifts and headings of a window, in blocks, with bounds of how well a scan fits in each.
//!
//! The first look is dense: at each heading, the bounds of whole rows of blocks are summed at once, point by point,
//! which is what processors are good at. Blocks that may hold the best place or one like it are then parted in four,
//! and those again; in which order, others say.

use geometry::Pose2;
use nalgebra::Point2;

use super::cloud::Cloud;
use super::correlate::{Care, Place, loss};
use super::dense::{self, Dense};
use super::map::{MatchMap, N_LEVELS};
use super::placement::Placement;
use super::{Prior, Window};
use crate::isa::{Isa, Work};

/// Blocks that promise less than this share of what the best one promises are not looked into.
const PROMISE_SHARE_MIN: f32 = 0.55;
/// Headings are tried in steps of at least this, radians: half a degree.
const TURN_STEP_MIN_RAD: f64 = 0.0087;
/// And at most this.
const TURN_STEP_MAX_RAD: f64 = 0.02;
/// A step of heading moves points at this quantile of range by two cells.
const FAR_QUANTILE: f64 = 0.75;
/// Places this near to a better one are the same: metres and radians.
const SAME_SHIFT_M: f64 = 0.3;
const SAME_TURN_RAD: f64 = 0.12;

/// A block of shifts at one heading.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Node {
    /// No place in it scores more than this.
    pub(super) bound: f32,
    pub(super) level: u8,
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

/// The cells of all points at all headings.
struct Placing<'a> {
    map: &'a MatchMap,
    headings: &'a [Placement],
    points: &'a [Point2<f32>],
    cells: &'a mut [[i32; 2]],
}

impl Work for Placing<'_> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let of_headings = self.cells.chunks_exact_mut(self.points.len().max(1));
        for (placed, cells) in self.headings.iter().zip(of_headings) {
            for (cell, at) in cells.iter_mut().zip(self.points) {
                *cell = self.map.cell_at(placed.point(*at));
            }
        }
    }
}

/// The places that a scan may lie at.
pub(super) struct Shifts<'a> {
    map: &'a MatchMap,
    cell_m: f64,
    guess: Pose2,
    /// Shifts either way of the guess, cells.
    reach: i32,
    turn_step_rad: f64,
    /// Headings either way of the guess.
    n_turns: i32,
    /// Cells of the points, heading by heading.
    cells: Vec<[i32; 2]>,
    n_points: usize,
    /// One cell and one step of heading, in deviations.
    deviations: [f32; 2],
    /// One over the highest sum there can be.
    scale: f32,
    /// Level of the dense look.
    top: usize,
}

impl<'a> Shifts<'a> {
    pub(super) fn new(map: &'a MatchMap, cloud: &Cloud, prior: &Prior, window: Window, care: Care) -> Self {
        let guess = prior.map_from_scan;
        let thin = cloud.spread(care.n_points);
        let mut ranges_m: Vec<f32> = thin.iter().map(|at| at.coords.norm()).collect();
        let nth = (ranges_m.len().saturating_sub(1) as f64 * FAR_QUANTILE) as usize;
        let far_m = *ranges_m.select_nth_unstable_by(nth, f32::total_cmp).1;
        let wanted_rad = 2.0 * map.cell_m() / f64::from(far_m).max(0.1);
        let turn_step_rad = care.turns * wanted_rad.clamp(TURN_STEP_MIN_RAD, TURN_STEP_MAX_RAD);
        let n_turns = (window.turn_rad / turn_step_rad).ceil().clamp(1.0, 1000.0) as i32;
        let reach = (window.shift_m / map.cell_m()).ceil().clamp(1.0, 4000.0) as i32;
        let at_heading = |turn: i32| {
            let yaw_rad = guess.yaw_rad + f64::from(turn) * turn_step_rad;
            Placement::new(Pose2 { yaw_rad, ..guess })
        };
        let headings: Vec<Placement> = (-n_turns..=n_turns).map(at_heading).collect();
        let mut cells = vec![[0; 2]; headings.len() * thin.len()];
        Isa::detect().run(Placing { map, headings: &headings, points: &thin, cells: &mut cells });
        let is_few = |level: &usize| (2 * reach) >> level < dense::N_SIDE_MAX as i32;
        let cell = map.cell_m() / prior.shift_m.max(1e-3);
        let turn = turn_step_rad / prior.turn_rad.max(1e-4);
        Shifts {
            map,
            cell_m: map.cell_m(),
            deviations: [cell as f32, turn as f32],
            guess,
            reach,
            turn_step_rad,
            n_turns,
            cells,
            n_points: thin.len(),
            scale: 1.0 / (255.0 * thin.len() as f32),
            top: (1..N_LEVELS).find(is_few).unwrap_or(N_LEVELS),
        }
    }

    /// All blocks of the window that may hold the best place or one like it.
    pub(super) fn promising(&self) -> Vec<Node> {
        let Some(bounds) = self.map.bounds(self.top) else { return Vec::new() };
        let n_side = ((2 * self.reach) >> self.top) as usize + 1;
        let mut dense = Dense::new(bounds, n_side, &self.cells, self.n_points, [-self.reach; 2]);
        let mut nodes: Vec<Node> = Vec::new();
        let mut highest = 0.0_f32;
        let shift = |n: usize| ((n as i32) << self.top) - self.reach;
        // From the expected place outwards: what is good is found early, and all else falls short of it.
        let mut headings: Vec<i32> = (0..=2 * self.n_turns).collect();
        headings.sort_by_key(|heading| (heading - self.n_turns).abs());
        let looks =
            dense.bands().flat_map(|band| headings.iter().map(move |heading| (band, *heading as usize)));
        for (band, heading) in looks {
            let least_at = |highest: f32, off: [i32; 2]| {
                let loss = self.loss(self.top, heading as u16, off);
                ((PROMISE_SHARE_MIN * highest + loss) / self.scale) as u16
            };
            // Most are nowhere near, and known for that by what all of a heading loses, or all of a row.
            for (row, sums) in dense.sums(heading, band, least_at(highest, [0; 2])) {
                let least = least_at(highest, [0, shift(row)]);
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
        nodes
    }

    /// The four quarters of a block, those beyond the window left out.
    pub(super) fn parts(&self, node: &Node) -> impl Iterator<Item = Node> {
        let level = usize::from(node.level).saturating_sub(1);
        let (half, node) = (1 << level, *node);
        let from = usize::from(node.heading) * self.n_points;
        let cells = self.cells.get(from..from + self.n_points).unwrap_or_default();
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
    pub(super) fn straight_down(&self, mut node: Node) -> Node {
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
    pub(super) fn is_same(&self, found: &Node, node: &Node) -> bool {
        let span = (1 << node.level) - 1;
        let near = (SAME_SHIFT_M / self.cell_m) as i32;
        let turns = (i32::from(found.heading) - i32::from(node.heading)).abs();
        f64::from(turns) * self.turn_step_rad <= SAME_TURN_RAD
            && (0..2).all(|axis| {
                let low = node.off[axis] - found.off[axis];
                low >= -near && low + span <= near
            })
    }

    pub(super) fn place(&self, node: &Node) -> Place {
        let turn = i32::from(node.heading) - self.n_turns;
        let shift = node.off.map(|cells| f64::from(cells) * self.cell_m);
        let at = Point2::new(self.guess.x_m + shift[0], self.guess.y_m + shift[1]);
        let yaw_rad = self.guess.yaw_rad + f64::from(turn) * self.turn_step_rad;
        Place { map_from_scan: Pose2::new(at.x, at.y, yaw_rad), score: node.bound.into() }
    }
}
