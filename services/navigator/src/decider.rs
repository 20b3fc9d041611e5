//! What the navigator wants, tick by tick.
//!
//! Plans leave as [`Output::Plan`] and come back as [`Input::PlanReady`], one in flight. Without fresh
//! odometry and pose nothing is sent: the filter then brings the robot to rest by itself.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use control::{Tracker, TrackerGains};
use geometry::{Pose2, Profile, Time, Twist};
use proto::{
    BaseMap, CellSet, DepthObstacles, Goal, Header, NavigatorStatus, NominalCommand, ObjectMap, Odometry,
    PoseEstimate, PoseQuality, RuleSet, Topic, topics,
};
use rules::{Rule, RuleType};

use crate::config::{NavigatorSettings, Planner};
use crate::plan::{KeepOut, Path, PlanJob, PlanReady};

/// Farthest time over which odometry is carried on to now.
const CARRIED_MAX: Duration = Duration::from_millis(100);
/// Most points of a path that are told.
const N_POINTS_TOLD_MAX: usize = 1000;

/// What the navigator hears.
#[derive(Clone, Debug)]
pub enum Input {
    /// Where to go.
    Goal(Goal),
    /// Base feedback, and when it came.
    Odometry(Odometry, Time),
    /// Where `odom` lies in `map`, and when it came.
    Pose(PoseEstimate, Time),
    /// The grid from the LiDAR.
    BaseMap(BaseMap),
    /// The region of one rule.
    ObjectMap(ObjectMap),
    /// The rules in force.
    Rules(RuleSet),
    /// What the camera saw within the robot's height.
    DepthObstacles(DepthObstacles),
    /// A plan that was asked for.
    PlanReady(PlanReady),
    /// Time to plan, and to tell.
    PlanTick,
    /// Time to send a command; the host's wall clock for its stamp.
    TrackTick {
        /// Nanoseconds since the Unix epoch.
        wall_ns: u64,
    },
}

/// What the navigator wants done.
#[derive(Clone, Debug)]
pub enum Output {
    /// Send this.
    Command(NominalCommand),
    /// Tell this.
    Status(NavigatorStatus),
    /// Make this plan, beside the loop.
    Plan(Box<PlanJob>),
    /// Another state, for the log.
    Changed {
        /// One word.
        state: &'static str,
        /// In words.
        words: String,
    },
}

/// The region found for one rule.
#[derive(Debug)]
struct Region {
    map_epoch: u64,
    cells: Arc<CellSet>,
}

/// The navigator of one robot.
pub struct NavigatorDecider {
    settings: NavigatorSettings,
    profile: Profile,
    goal: Option<Goal>,
    goal_count: u64,
    has_arrived: bool,
    odometry: Option<(Odometry, Time)>,
    pose: Option<(PoseEstimate, Time)>,
    base: Option<Arc<BaseMap>>,
    depth: Option<(u64, Arc<CellSet>)>,
    rules: Option<RuleSet>,
    regions: BTreeMap<String, Region>,
    plan: Option<PlanReady>,
    is_planning: bool,
    seq: u64,
    told: (&'static str, String),
}

impl NavigatorDecider {
    /// A navigator that has heard nothing yet.
    #[must_use]
    pub fn new(settings: &NavigatorSettings, profile: &Profile) -> Self {
        NavigatorDecider {
            settings: settings.clone(),
            profile: profile.clone(),
            goal: None,
            goal_count: 0,
            has_arrived: false,
            odometry: None,
            pose: None,
            base: None,
            depth: None,
            rules: None,
            regions: BTreeMap::new(),
            plan: None,
            is_planning: false,
            seq: 0,
            told: ("", String::new()),
        }
    }

    /// Takes one input in, and says what to do.
    pub fn step(&mut self, now: Time, input: Input) -> Vec<Output> {
        match input {
            Input::Goal(goal) => {
                self.set_goal(goal);
                return self.plan(now).into_iter().collect();
            }
            Input::Odometry(odometry, at) => self.hear_odometry(odometry, at),
            Input::Pose(pose, at) => self.hear_pose(pose, at),
            Input::BaseMap(map) => self.base = Some(Arc::new(map)),
            Input::ObjectMap(map) => self.hear_object_map(map),
            Input::Rules(set) => self.hear_rules(set),
            Input::DepthObstacles(seen) => {
                self.depth = seen.cells.map(|cells| (seen.map_epoch, Arc::new(cells)));
            }
            Input::PlanReady(ready) => {
                self.is_planning = false;
                if ready.goal_count == self.goal_count {
                    self.plan = Some(self.settled(now, ready));
                }
            }
            Input::PlanTick => return self.plan_tick(now),
            Input::TrackTick { wall_ns } => return self.track_tick(now, wall_ns),
        }
        Vec::new()
    }

    fn set_goal(&mut self, goal: Goal) {
        self.goal_count += 1;
        self.has_arrived = false;
        self.plan = None;
        self.goal = (!goal.cancel).then_some(goal);
    }

    fn hear_odometry(&mut self, odometry: Odometry, at: Time) {
        if let Some((last, _)) = &self.odometry {
            let (new, old) = (odometry.header, last.header);
            if new.seq <= old.seq && new.stamp_ns <= old.stamp_ns {
                return;
            }
            if new.seq <= old.seq {
                // The robot started over: its odometry frame may be another one.
                self.pose = None;
            }
        }
        self.odometry = Some((odometry, at));
    }

    fn hear_pose(&mut self, pose: PoseEstimate, at: Time) {
        let is_newer = self.pose.as_ref().is_none_or(|(last, _)| pose.header.stamp_ns > last.header.stamp_ns);
        // In doubt it goes by odometry from the last good pose, until that is too old.
        if is_newer && pose.quality != PoseQuality::Uncertain {
            self.pose = Some((pose, at));
        }
    }

    fn hear_object_map(&mut self, map: ObjectMap) {
        // As in the filter: a region that was found stays until its rule goes or a newer one comes.
        let Some(cells) = map.region.filter(|_| map.grounding.is_usable()) else { return };
        if self.regions.len() < proto::rule_set::N_RULES_MAX || self.regions.contains_key(&map.rule_id) {
            self.regions.insert(map.rule_id, Region { map_epoch: map.map_epoch, cells: Arc::new(cells) });
        }
    }

    fn hear_rules(&mut self, set: RuleSet) {
        if self.rules.as_ref().is_some_and(|held| set.version <= held.version) {
            return;
        }
        self.regions.retain(|id, _| set.specs.iter().any(|rule| rule.id == *id));
        self.rules = Some(set);
    }

    /// The plan to follow from now on: the new one, unless the way under way is still free and hardly longer. Maps
    /// grow as the robot looks, and who takes the other way around at every plan gets nowhere.
    fn settled(&self, now: Time, ready: PlanReady) -> PlanReady {
        let Ok((_, map_from_base)) = self.place(now) else { return ready };
        let Some(PlanReady { path: Ok(old), map_epoch, .. }) = &self.plan else { return ready };
        let Ok(new) = &ready.path else { return ready };
        if *map_epoch != ready.map_epoch {
            return ready;
        }
        match new.kept_way(&old.points_map, map_from_base.position()) {
            Some(points_map) => {
                PlanReady { path: Ok(Path { points_map, costmap: Arc::clone(&new.costmap) }), ..ready }
            }
            None => ready,
        }
    }

    fn plan_tick(&mut self, now: Time) -> Vec<Output> {
        let mut outputs: Vec<Output> = self.plan(now).into_iter().collect();
        outputs.push(Output::Status(self.status(now)));
        outputs
    }

    /// The plan to make now, unless one is being made or there is nothing to plan.
    fn plan(&mut self, now: Time) -> Option<Output> {
        if self.is_planning || self.has_arrived {
            return None;
        }
        let goal = self.goal.as_ref()?;
        let (_, map_from_base) = self.place(now).ok()?;
        let map_epoch = self.pose.as_ref()?.0.map_epoch;
        let base = self.base.as_ref().filter(|map| map.map_epoch == map_epoch)?;
        let job = PlanJob {
            goal_count: self.goal_count,
            base: Arc::clone(base),
            depth: self
                .depth
                .as_ref()
                .filter(|(epoch, _)| *epoch == map_epoch)
                .map(|(_, set)| Arc::clone(set)),
            keep_out: self.keep_out(map_epoch),
            start_map: map_from_base.position(),
            goal_map: geometry::Point2::new(goal.x_m, goal.y_m),
            clearance_m: self.settings.clearance_m,
        };
        self.is_planning = true;
        Some(Output::Plan(Box::new(job)))
    }

    /// The regions that rules keep the robot out of, as far as they are found.
    fn keep_out(&self, map_epoch: u64) -> Vec<KeepOut> {
        if self.settings.planner == Planner::Base {
            return Vec::new();
        }
        let rules = self.rules.iter().flat_map(|set| &set.specs).filter(|rule| keeps_out(rule));
        rules
            .filter_map(|rule| {
                let region = self.regions.get(&rule.id).filter(|region| region.map_epoch == map_epoch)?;
                let label = rules::english::status(rule);
                Some(KeepOut { label, region: Arc::clone(&region.cells), buffer_m: rule.buffer_m })
            })
            .collect()
    }

    /// The odometry's number and the pose in `map` now; otherwise what is missing, in words.
    fn place(&self, now: Time) -> Result<(u64, Pose2), String> {
        let (odometry, odometry_at) = self.odometry.as_ref().ok_or("no odometry yet")?;
        fresh(&topics::ODOMETRY, "odometry", now.since(*odometry_at))?;
        let (pose, pose_at) = self.pose.as_ref().ok_or("no pose yet")?;
        fresh(&topics::POSE, "pose", now.since(*pose_at))?;
        if pose.quality == PoseQuality::Lost {
            return Err("localisation is lost".to_owned());
        }
        let carried_s = now.since(*odometry_at).min(CARRIED_MAX).as_secs_f64();
        let Twist { speed_m_s, yaw_rate_rad_s } = odometry.twist;
        let odom_from_base = odometry.odom_from_base.along_arc(speed_m_s, yaw_rate_rad_s, carried_s);
        Ok((odometry.header.seq, pose.map_from_odom * odom_from_base))
    }

    fn track_tick(&mut self, now: Time, wall_ns: u64) -> Vec<Output> {
        let (state, words, wanted) = self.wish(now);
        let mut outputs = Vec::new();
        if let Some((odometry_seq, twist)) = wanted {
            self.seq += 1;
            let header = Header { seq: self.seq, stamp_ns: wall_ns, echo: odometry_seq };
            outputs.push(Output::Command(NominalCommand { header, twist }));
        }
        let has_changed = self.told.0 != state;
        self.told = (state, words);
        if has_changed {
            outputs.push(Output::Changed { state, words: self.told.1.clone() });
            outputs.push(Output::Status(self.status(now)));
        }
        outputs
    }

    /// State, words, and the command with the odometry it was made from; `None` when nothing is to be sent.
    fn wish(&mut self, now: Time) -> (&'static str, String, Option<(u64, Twist)>) {
        let (odometry_seq, map_from_base) = match self.place(now) {
            Ok(place) => place,
            Err(missing) => return ("waiting", missing, None),
        };
        let standing = Some((odometry_seq, Twist::ZERO));
        let Some(goal) = &self.goal else { return ("idle", "no goal".to_owned(), standing) };
        let goal_m = (geometry::Point2::new(goal.x_m, goal.y_m) - map_from_base.position()).norm();
        self.has_arrived |= goal_m <= goal.tolerance_m;
        if self.has_arrived {
            return ("arrived", format!("{goal_m:.2} m from the goal"), standing);
        }
        let map_epoch = self.pose.as_ref().map(|(pose, _)| pose.map_epoch);
        let plan = self.plan.as_ref().filter(|plan| Some(plan.map_epoch) == map_epoch);
        match plan.map(|plan| &plan.path) {
            None if self.base.is_none() => ("waiting", "no base map yet".to_owned(), standing),
            None => ("waiting", "planning".to_owned(), standing),
            Some(Err(why)) => ("no_path", why.clone(), standing),
            Some(Ok(path)) => {
                let twist = self.follow(map_from_base, path, goal.tolerance_m);
                ("driving", format!("{goal_m:.1} m from the goal"), Some((odometry_seq, twist)))
            }
        }
    }

    fn follow(&self, map_from_base: Pose2, path: &Path, tolerance_m: f64) -> Twist {
        let gains = self.settings.gains;
        let gains = TrackerGains {
            yaw_per_s: gains.yaw_per_s,
            sight: gains.sight,
            turn_in_place_rad: gains.turn_in_place_rad,
            braking_share: gains.braking_share,
            // Well inside: who stops just at the edge is never quite there.
            goal_tolerance_m: tolerance_m / 2.0,
        };
        let speed_m_s = self.odometry.as_ref().map_or(0.0, |(odometry, _)| odometry.twist.speed_m_s);
        Tracker::new(&self.profile, gains).step(map_from_base, speed_m_s, &path.points_map, &path.costmap)
    }

    fn status(&self, now: Time) -> NavigatorStatus {
        let (state, words) = &self.told;
        let points = match self.plan.as_ref().map(|plan| &plan.path) {
            Some(Ok(path)) if !self.has_arrived && self.place(now).is_ok() => path.points_map.as_slice(),
            _ => &[],
        };
        let stride = points.len().div_ceil(N_POINTS_TOLD_MAX).max(1);
        NavigatorStatus {
            state: (if state.is_empty() { "waiting" } else { *state }).to_owned(),
            words: words.clone(),
            path: points.iter().step_by(stride).map(|point| [point.x, point.y]).collect(),
            goal: self.goal.as_ref().map(|goal| [goal.x_m, goal.y_m]),
        }
    }
}

/// Whether a rule keeps the robot out of its region altogether.
fn keeps_out(rule: &Rule) -> bool {
    rule.needs_grounding() && (rule.rule_type == RuleType::Exclusion || rule.vel_max == Some(0.0))
}

fn fresh(topic: &Topic, input: &str, age: Duration) -> Result<(), String> {
    match topic.age_max {
        Some(limit) if age > limit => {
            Err(format!("{input} {} ms old, at most {} ms", age.as_millis(), limit.as_millis()))
        }
        _ => Ok(()),
    }
}
