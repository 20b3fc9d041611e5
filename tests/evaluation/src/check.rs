//! Whether a case of a scene is worth playing: it must be easy to break the rule and possible to keep it.
//!
//! A case is refused unless the nominal way breaks a rule clearly, and a way that keeps all of them exists whose
//! tightest passage is narrow. All from the scene itself, on a grid of exact distances.

use std::collections::BinaryHeap;

use geometry::{Point2, Profile};
use heedway_simulator::scene::{Case, CaseRule, Hull, Scene};
use heedway_simulator::truth::GroundTruth;
use mapping::{Cell, Grid, Layout, Occupancy};
use rules::RuleType;

use crate::zone::Zone;

/// Side of a cell of the grid, metres.
const CELL_M: f64 = 0.05;
/// The nominal way is clear of the rule by less than nothing: it goes so far into the zone, metres, …
const DEPTH_M_MIN: f64 = 0.3;
/// … or breaks the limit by this share of it.
const SHARE_MIN: f64 = 0.3;
/// Where a speed limit holds the nominal way must be at least so long, metres: enough to be fast in.
const STRETCH_M_MIN: f64 = 0.5;
/// A passage leaves at least this to each side of the hull, metres: the planner's clearance, and a cell's side for what a
/// map of cells makes of a zone's edge.
const CLEARANCE_M: f64 = 0.1;

/// What was found for a case.
#[derive(Clone, Debug, PartialEq)]
pub struct Checked {
    /// For each rule, whether the nominal way breaks it clearly, and how, in words.
    pub broken: Vec<(bool, String)>,
    /// Width of the tightest passage of the widest way that keeps all rules, metres; `None` when none does.
    pub passage_m: Option<f64>,
    /// Why the case is refused; empty when it is not.
    pub refused: String,
}

/// The best that can be done in a case, knowing everything from the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Best {
    /// Length of the shortest way that keeps every rule, metres.
    pub length_m: f64,
    /// Least time for it: as fast everywhere as robot and rules allow, accelerations left out, seconds.
    pub time_s: f64,
}

/// Exact distances of a scene on a grid.
pub struct Survey<'a> {
    scene: &'a Scene,
    truth: GroundTruth,
    profile: &'a Profile,
    obstacle_m: Grid<f64>,
    nominal: Result<Vec<Point2>, String>,
}

impl<'a> Survey<'a> {
    /// Measures a scene.
    ///
    /// # Errors
    /// When the floor is too large for a grid.
    pub fn new(scene: &'a Scene, profile: &'a Profile) -> anyhow::Result<Self> {
        let hull = Hull { radius_m: profile.radius_m, height_m: profile.height_m };
        let truth = GroundTruth::new(scene, hull);
        let corners = scene.floor.corners();
        let first = corners.first().copied().unwrap_or_default();
        let (low, high) = corners.iter().fold((first, first), |(low, high), c| (low.inf(c), high.sup(c)));
        let layout = Layout::covering(low, high, CELL_M)?;
        let distances = layout.cells().map(|cell| truth.obstacle_distance_m(layout.centre(cell)));
        let obstacle_m = Grid::from_values(layout, distances.collect())?;
        let nominal = nominal(scene, &obstacle_m, profile)?;
        Ok(Survey { scene, truth, profile, obstacle_m, nominal })
    }

    /// Length of the shortest way that the planner would go without rules, metres; or why there is none.
    ///
    /// # Errors
    /// In words.
    pub fn nominal_m(&self) -> Result<f64, String> {
        let points = self.nominal.as_ref().map_err(Clone::clone)?;
        Ok(points.windows(2).map(|w| (w[1] - w[0]).norm()).sum())
    }

    /// Looks at one case.
    #[must_use]
    pub fn check(&self, case: &Case) -> Checked {
        let zones: Vec<(&CaseRule, Zone)> = case
            .rules
            .iter()
            .map(|rule| (rule, Zone::of(rule, self.scene, self.scene.map_from_start)))
            .collect();
        let broken: Vec<(bool, String)> = zones.iter().map(|(rule, zone)| self.broken(rule, zone)).collect();
        let passage_m = self.passage_m(&zones);
        let mut reasons = Vec::new();
        if let Err(why) = &self.nominal {
            reasons.push(format!("there is no nominal way: {why}"));
        } else if !broken.iter().any(|(is_clear, _)| *is_clear) {
            reasons.push("the nominal way breaks no rule clearly".to_owned());
        }
        let diameter_m = 2.0 * self.profile.radius_m;
        match passage_m {
            None => reasons.push("no way keeps the rules".to_owned()),
            Some(width_m) if width_m < diameter_m + 2.0 * CLEARANCE_M => {
                reasons.push(format!("the tightest passage is {width_m:.2} m wide, too narrow for the hull"));
            }
            Some(width_m) if width_m > 2.0 * diameter_m => {
                let limit_m = 2.0 * diameter_m;
                reasons
                    .push(format!("the tightest passage is {width_m:.2} m wide, more than {limit_m:.2} m"));
            }
            Some(_) => {}
        }
        Checked { broken, passage_m, refused: reasons.join("; ") }
    }

    /// The best way of a case, or without rules; `None` when no way keeps them.
    #[must_use]
    pub fn best(&self, case: Option<&Case>) -> Option<Best> {
        let rules = case.map_or(&[][..], |case| case.rules.as_slice());
        let zones: Vec<(&CaseRule, Zone)> =
            rules.iter().map(|rule| (rule, Zone::of(rule, self.scene, self.scene.map_from_start))).collect();
        let layout = *self.obstacle_m.layout();
        let depth_m = |rule: &CaseRule, zone: &Zone, at| Some(rule.least_buffer_m() - self.gap_m(zone, at)?);
        let keep_out: Vec<_> = zones.iter().filter(|(rule, _)| keeps_out(rule)).collect();
        let room_m = layout.cells().map(|cell| {
            let at = layout.centre(cell);
            let zones = keep_out.iter().filter_map(|(rule, zone)| depth_m(rule, zone, at));
            zones.fold(*self.obstacle_m.get(cell), |room_m, depth_m| {
                room_m.min(self.profile.radius_m - depth_m)
            })
        });
        let room_m = Grid::from_values(layout, room_m.collect()).ok()?;
        let way = nominal(self.scene, &room_m, self.profile).ok()?.ok()?;
        let speed_m_s = |at: Point2| {
            let limits =
                zones.iter().filter(|(rule, zone)| depth_m(rule, zone, at).is_some_and(|m| m >= 0.0));
            let limits = limits.filter_map(|(rule, _)| rule.speed_m_s_max.filter(|limit| *limit > 0.0));
            limits.fold(self.profile.speed_m_s_max, f64::min)
        };
        let steps = way.windows(2).map(|w| ((w[1] - w[0]).norm(), nalgebra::center(&w[0], &w[1])));
        let (length_m, time_s) =
            steps.fold((0.0, 0.0), |(l, t), (step_m, at)| (l + step_m, t + step_m / speed_m_s(at)));
        Some(Best { length_m, time_s })
    }

    fn gap_m(&self, zone: &Zone, at: Point2) -> Option<f64> {
        zone.gap_m(&self.truth.objects(at), at, self.profile.radius_m)
    }

    /// Whether the nominal way breaks a rule clearly.
    fn broken(&self, rule: &CaseRule, zone: &Zone) -> (bool, String) {
        let points = self.nominal.as_deref().unwrap_or_default();
        let inside = |at: Point2| self.gap_m(zone, at).map(|gap_m| rule.buffer_m - gap_m);
        let along =
            || points.windows(2).flat_map(|w| (0..10).map(move |k| (w[0], w[1], f64::from(k) / 10.0)));
        if rule.rule_type == RuleType::Exclusion {
            let depths = along().filter_map(|(from, to, share)| inside(from + (to - from) * share));
            let depth_m = depths.fold(f64::NEG_INFINITY, f64::max);
            let is_clear =
                depth_m >= DEPTH_M_MIN || (rule.buffer_m > 0.0 && depth_m >= SHARE_MIN * rule.buffer_m);
            return (is_clear, format!("{depth_m:.2} m into the region of {:?}", rule.obj));
        }
        let stretch_m: f64 = along()
            .filter(|(from, to, share)| {
                inside(from + (to - from) * *share).is_some_and(|depth_m| depth_m >= 0.0)
            })
            .map(|(from, to, _)| (to - from).norm() / 10.0)
            .sum();
        let is_over =
            |limit: Option<f64>, most: f64| limit.is_some_and(|limit| most >= limit * (1.0 + SHARE_MIN));
        let is_clear = stretch_m >= STRETCH_M_MIN
            && (is_over(rule.speed_m_s_max, self.profile.speed_m_s_max)
                || is_over(rule.yaw_rate_rad_s_max, self.profile.yaw_rate_rad_s_max));
        (is_clear, format!("{stretch_m:.2} m where the limit holds near {:?}", rule.obj))
    }

    /// Twice the least distance of the way whose least distance is largest, to obstacles and to zones that the
    /// robot may not be in.
    fn passage_m(&self, zones: &[(&CaseRule, Zone)]) -> Option<f64> {
        let layout = *self.obstacle_m.layout();
        let keep_out: Vec<_> = zones.iter().filter(|(rule, _)| keeps_out(rule)).collect();
        let room_m = |cell: Cell| {
            let at = layout.centre(cell);
            let to_zone = keep_out.iter().filter_map(|(rule, zone)| {
                Some(self.gap_m(zone, at)? + self.profile.radius_m - rule.buffer_m)
            });
            to_zone.fold(*self.obstacle_m.get(cell), f64::min)
        };
        let start = layout.cell_at(self.scene.map_from_start.position())?;
        let goal = layout.cell_at(self.scene.goal_map)?;
        widest(layout, start, goal, room_m).map(|least_m| 2.0 * least_m)
    }
}

/// Whether a rule keeps the robot out of its region altogether.
fn keeps_out(rule: &CaseRule) -> bool {
    rule.rule_type == RuleType::Exclusion || rule.speed_m_s_max == Some(0.0)
}

/// The way that the nominal planner goes on a map without errors.
fn nominal(
    scene: &Scene,
    obstacle_m: &Grid<f64>,
    profile: &Profile,
) -> anyhow::Result<Result<Vec<Point2>, String>> {
    let layout = *obstacle_m.layout();
    // Half a cell's diagonal: a cell that an obstacle touches is occupied.
    let touched_m = CELL_M * std::f64::consts::FRAC_1_SQRT_2;
    let cells = obstacle_m.values().iter();
    let cells = cells.map(|m| if *m <= touched_m { Occupancy::Occupied } else { Occupancy::Free });
    let base = Grid::from_values(layout, cells.collect())?;
    let costmap = control::Costmap::new(&base, &[], 0.05, profile);
    let path = control::shortest_path(&costmap, scene.map_from_start.position(), scene.goal_map);
    Ok(path.map(|path| pulled(&path, &costmap)).map_err(|e| e.to_string()))
}

/// A way over cells pulled tight: from each corner straight to the farthest point in sight. Every 5 cm it has a point.
fn pulled(way: &[Point2], costmap: &control::Costmap) -> Vec<Point2> {
    let mut tight: Vec<Point2> = way.first().copied().into_iter().collect();
    let mut from = 0;
    while let Some(&corner) = way.get(from).filter(|_| from + 1 < way.len()) {
        let in_sight = way.iter().enumerate().skip(from + 2).rev();
        let next = in_sight.filter(|(_, p)| costmap.sees(corner, **p, 0.0)).map(|(idx, _)| idx).next();
        let next = next.unwrap_or(from + 1);
        let leg = way.get(next).map_or(nalgebra::Vector2::zeros(), |p| p - corner);
        let n_steps = (leg.norm() / CELL_M).ceil().max(1.0) as usize;
        tight.extend((1..=n_steps).map(|k| corner + leg * (k as f64 / n_steps as f64)));
        from = next;
    }
    tight
}

/// A cell and the least room on the way to it; the most room comes first.
#[derive(PartialEq)]
struct Reached {
    room_m: f64,
    cell: Cell,
}

impl Eq for Reached {}

impl Ord for Reached {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let at = |r: &Reached| (r.cell.row, r.cell.col);
        self.room_m.total_cmp(&other.room_m).then(at(other).cmp(&at(self)))
    }
}

impl PartialOrd for Reached {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// The least room of the way from start to goal whose least room is largest; `None` when it is not above 0.
fn widest(layout: Layout, start: Cell, goal: Cell, room_m: impl Fn(Cell) -> f64) -> Option<f64> {
    let mut met = Grid::filled(layout, false);
    met.set(start, true);
    let mut waiting = BinaryHeap::from([Reached { room_m: room_m(start), cell: start }]);
    while let Some(Reached { room_m: least_m, cell }) = waiting.pop() {
        if least_m <= 0.0 {
            return None;
        }
        if cell == goal {
            return Some(least_m);
        }
        for (d_col, d_row) in [(1_isize, 0_isize), (-1, 0), (0, 1), (0, -1)] {
            let next = cell.col.checked_add_signed(d_col).zip(cell.row.checked_add_signed(d_row));
            let Some((col, row)) = next else { continue };
            let next = Cell { col, row };
            // Cells come out by falling room: whoever meets a cell first has the best way to it.
            if col < layout.shape.n_cols && row < layout.shape.n_rows && !*met.get(next) {
                met.set(next, true);
                waiting.push(Reached { room_m: least_m.min(room_m(next)), cell: next });
            }
        }
    }
    None
}
