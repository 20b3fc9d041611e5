//! The plant: a differential base with limited accelerations, a delay from command to effect, and walls
//! that it cannot pass.
//!
//! This is the world, not an opinion about it: it shares no code with the rollouts of the filter that it
//! judges, not even the arcs. Each step of at most 1 ms is an exact arc at the step's mean speed and turn
//! rate. Deliberately not here: sensors, noise, and what the motion is good for.

use std::collections::VecDeque;
use std::time::Duration;

use geometry::{Point2, Pose2, Time, Twist, angle};

/// Longest step of integration.
const STEP: Duration = Duration::from_millis(1);
/// Commands on their way to the wheels; more than 0.5 s of delay at 100 Hz need.
const N_PENDING_MAX: usize = 256;
/// How deep the hull is let into an obstacle by a contact, metres: so that a contact measures as one.
const CONTACT_DEPTH_M: f64 = 1e-4;

/// What the base can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlantLimits {
    /// Largest speed either way, m/s.
    pub speed_m_s_max: f64,
    /// Largest turn rate either way, rad/s.
    pub yaw_rate_rad_s_max: f64,
    /// Largest change of speed, m/s².
    pub accel_m_s2_max: f64,
    /// Largest change of turn rate, rad/s².
    pub yaw_accel_rad_s2_max: f64,
    /// From a command to its effect.
    pub delay: Duration,
    /// Time constant of the drive behind the limits; zero follows the set-point at once.
    pub lag: Duration,
    /// Without a command for so long the base stops by itself, as real bases do.
    pub watchdog: Duration,
    /// Radius of the hull, metres.
    pub radius_m: f64,
}

/// Where a base starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Where it really is.
    pub map_from_start: Pose2,
    /// Where its wheels begin to count.
    pub odom_from_start: Pose2,
}

/// Distance from a point in `map` to the nearest obstacle, metres, negative inside.
pub type Distance<'a> = &'a dyn Fn(Point2) -> f64;

/// Where the base is and how it moves.
#[derive(Clone, Debug)]
pub struct Plant {
    limits: PlantLimits,
    now: Time,
    map_from_base: Pose2,
    twist: Twist,
    target: Twist,
    last_command: Option<Time>,
    pending: VecDeque<(Time, Twist)>,
    in_contact: bool,
    n_collisions: u64,
    /// The hull may travel so far before it can touch anything, metres.
    free_m: f64,
    drift: OdometryDrift,
    odom_from_base: Pose2,
}

/// Systematic errors of the wheels' measurement; none by default.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct OdometryDrift {
    /// Share by which ways are measured too long.
    pub scale: f64,
    /// Turn that is measured and not made, radians a metre.
    pub yaw_rad_per_m: f64,
}

impl Plant {
    /// A base at rest; its wheels believe that it starts at `odom_from_start`.
    #[must_use]
    pub fn new(limits: PlantLimits, drift: OdometryDrift, start: Start, now: Time) -> Self {
        Plant {
            limits,
            now,
            map_from_base: start.map_from_start,
            twist: Twist::ZERO,
            target: Twist::ZERO,
            last_command: None,
            pending: VecDeque::new(),
            in_contact: false,
            n_collisions: 0,
            free_m: 0.0,
            drift,
            odom_from_base: start.odom_from_start,
        }
    }

    /// The world has changed: how far it is to anything is not known any more.
    pub fn look_anew(&mut self) {
        self.free_m = 0.0;
    }

    /// Takes a set-point; it takes effect after the delay. One that is not finite is taken as zero.
    pub fn command(&mut self, now: Time, twist: Twist) {
        if self.pending.len() == N_PENDING_MAX {
            self.pending.pop_front();
        }
        let twist = if twist.is_finite() { twist } else { Twist::ZERO };
        self.pending.push_back((now + self.limits.delay, twist));
    }

    /// Moves on to `until`; earlier moments change nothing.
    pub fn advance(&mut self, until: Time, distance: Distance<'_>) {
        while self.now < until {
            if self.rests_for_good() {
                self.now = until;
                return;
            }
            let step = STEP.min(until.since(self.now));
            self.take_commands();
            self.now = self.now + step;
            self.step(step.as_secs_f64(), distance);
        }
    }

    /// At rest, and nothing is on its way that could change it: a long pause costs nothing.
    fn rests_for_good(&self) -> bool {
        self.pending.is_empty() && self.twist == Twist::ZERO && self.target == Twist::ZERO
    }

    fn take_commands(&mut self) {
        while let Some((due, twist)) = self.pending.front().copied().filter(|(due, _)| *due <= self.now) {
            self.pending.pop_front();
            let speed_max = self.limits.speed_m_s_max;
            let yaw_rate_max = self.limits.yaw_rate_rad_s_max;
            self.target = Twist::new(
                twist.speed_m_s.clamp(-speed_max, speed_max),
                twist.yaw_rate_rad_s.clamp(-yaw_rate_max, yaw_rate_max),
            );
            self.last_command = Some(due);
        }
        if self.last_command.is_some_and(|at| self.now.since(at) > self.limits.watchdog) {
            self.target = Twist::ZERO;
        }
    }

    fn step(&mut self, seconds: f64, distance: Distance<'_>) {
        let PlantLimits { accel_m_s2_max, yaw_accel_rad_s2_max, .. } = self.limits;
        let before = self.twist;
        let after = Twist::new(
            self.approached(before.speed_m_s, self.target.speed_m_s, accel_m_s2_max, seconds),
            self.approached(before.yaw_rate_rad_s, self.target.yaw_rate_rad_s, yaw_accel_rad_s2_max, seconds),
        );
        let way_m = f64::midpoint(before.speed_m_s, after.speed_m_s) * seconds;
        let turn_rad = f64::midpoint(before.yaw_rate_rad_s, after.yaw_rate_rad_s) * seconds;
        let share = self.free_share(way_m, turn_rad, distance);
        self.twist = after;
        if share < 1.0 {
            self.twist.speed_m_s = 0.0;
        }
        let way_m = way_m * share;
        self.map_from_base = along(self.map_from_base, way_m, turn_rad);
        self.odom_from_base = along(
            self.odom_from_base,
            way_m * (1.0 + self.drift.scale),
            turn_rad + way_m.abs() * self.drift.yaw_rad_per_m,
        );
    }

    /// The value after a step towards `target`: by the lag, within the limit.
    fn approached(&self, value: f64, target: f64, change_per_s_max: f64, seconds: f64) -> f64 {
        let lag_s = self.limits.lag.as_secs_f64();
        let wanted =
            if lag_s > 0.0 { (target - value) * (1.0 - (-seconds / lag_s).exp()) } else { target - value };
        let limit = change_per_s_max * seconds;
        // Below this the lag's tail is standstill.
        if (target - value).abs() < 1e-6 { target } else { value + wanted.clamp(-limit, limit) }
    }

    /// How much of a step can be driven before an obstacle stops it, 0 to 1; counts the contact.
    fn free_share(&mut self, way_m: f64, turn_rad: f64, distance: Distance<'_>) -> f64 {
        if way_m == 0.0 {
            return 1.0;
        }
        self.free_m -= way_m.abs();
        if self.free_m > 0.0 {
            return 1.0;
        }
        let gap_m = |share: f64| {
            distance(along(self.map_from_base, way_m * share, turn_rad).position()) - self.limits.radius_m
        };
        let (gap_before_m, gap_after_m) = (gap_m(0.0), gap_m(1.0));
        self.free_m = gap_after_m;
        if gap_after_m > 0.0 {
            self.in_contact = false;
            return 1.0;
        }
        if !self.in_contact {
            self.in_contact = true;
            self.n_collisions += 1;
        }
        // Out of an obstacle, or along it, the way is free.
        if gap_after_m >= -CONTACT_DEPTH_M || gap_after_m > gap_before_m {
            return 1.0;
        }
        if gap_before_m <= -CONTACT_DEPTH_M / 2.0 {
            return 0.0;
        }
        let (mut free, mut blocked) = (0.0, 1.0);
        for _ in 0..20 {
            let middle = f64::midpoint(free, blocked);
            if gap_m(middle) > -CONTACT_DEPTH_M { free = middle } else { blocked = middle }
        }
        free
    }

    /// The base in `map`.
    #[must_use]
    pub fn map_from_base(&self) -> Pose2 {
        self.map_from_base
    }

    /// How it moves.
    #[must_use]
    pub fn twist(&self) -> Twist {
        self.twist
    }

    /// Up to when it was moved on.
    #[must_use]
    pub fn now(&self) -> Time {
        self.now
    }

    /// The base in `odom`, as the wheels have measured it.
    #[must_use]
    pub fn odom_from_base(&self) -> Pose2 {
        self.odom_from_base
    }

    /// Contacts since the start; staying in contact counts once.
    #[must_use]
    pub fn n_collisions(&self) -> u64 {
        self.n_collisions
    }

    /// Whether the hull touches something.
    #[must_use]
    pub fn in_contact(&self) -> bool {
        self.in_contact
    }
}

/// The pose at the end of an arc of length `way_m` that turns by `turn_rad`: along its chord.
fn along(pose: Pose2, way_m: f64, turn_rad: f64) -> Pose2 {
    let half_rad = turn_rad / 2.0;
    let shortening =
        if half_rad.abs() < 1e-5 { 1.0 - half_rad * half_rad / 6.0 } else { half_rad.sin() / half_rad };
    let (sin, cos) = (pose.yaw_rad + half_rad).sin_cos();
    Pose2 {
        x_m: pose.x_m + way_m * shortening * cos,
        y_m: pose.y_m + way_m * shortening * sin,
        yaw_rad: angle::wrapped(pose.yaw_rad + turn_rad),
    }
}
