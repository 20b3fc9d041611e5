//! The world made ready for one tick: spatial layers, speed limits, and the tube, around one start state.
//!
//! A [`World`] says what there is; a scene adds what is true of it *now*: which zones the robot already
//! stands in (they are `soft`: nobody is kept in by them), which limits it already breaks (they allow full
//! braking), and which scan hits may move. It is built once per tick and only read afterwards.

use geometry::{Point2, Profile};
use mapping::DistanceField;

use crate::config::{Disturbance, FilterConfig};
use crate::dynamics::{Heading, Limits, State};
use crate::margin::{Demand, World};
use crate::points::PointIndex;

mod place;

pub(crate) use place::Place;

/// Driving exactly at a limit complies: tolerance, m/s and rad/s. A limit of 0 in a zone has none.
pub const LIMIT_TOLERANCE: f64 = 0.01;
/// Scan hits nearer than this to a mapped obstacle belong to it, metres: scan noise plus a cell.
const ON_MAP_M: f64 = 0.15;
/// So near to a limit's zone it is held to before it is in force, metres.
const AT_ONCE_M: f64 = 0.1;
/// Farthest place a scene speaks of, metres from the start.
const REACH_M_MAX: f64 = 7.5;

/// What does not change from tick to tick: the robot and the configured assumptions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Assumptions {
    pub limits: Limits,
    pub radius_m: f64,
    pub step_s: f64,
    pub disturbance: Disturbance,
    pub closing_speed_m_s: f64,
    pub braking_tail: bool,
}

impl Assumptions {
    /// What a configuration assumes of a robot.
    pub(crate) fn of(config: &FilterConfig, profile: &Profile) -> Assumptions {
        Assumptions {
            limits: Limits::of(profile),
            radius_m: profile.radius_m,
            step_s: config.step_s,
            disturbance: config.disturbance,
            closing_speed_m_s: config.closing_speed_m_s,
            braking_tail: config.braking_tail,
        }
    }
}

/// Which thing of the world a margin belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    /// Position in [`World::base`].
    Base(usize),
    /// The live scan.
    Points,
    /// Position in [`World::rules`].
    Rule(usize),
}

/// Where the distance of a spatial layer comes from.
#[derive(Debug)]
pub(crate) enum Shape<'w> {
    Field(&'w DistanceField),
    /// Points, and the speed at which they may come closer, m/s.
    Points(PointIndex, f64),
}

/// Something the hull must stay clear of.
#[derive(Debug)]
pub(crate) struct SpatialLayer<'w> {
    pub source: Source,
    pub shape: Shape<'w>,
    /// Radius plus buffer, metres: what the distance must exceed.
    pub keep_m: f64,
    /// Margin at the start, metres.
    pub start_m: f64,
    /// True when the robot stands in it already (or recovery had to give it up): it does not bind.
    pub soft: bool,
}

/// A limit on speed and turn rate, somewhere or everywhere; tolerances included.
#[derive(Debug)]
pub(crate) struct LimitLayer<'w> {
    pub source: Source,
    /// The zone and the distance at which the hull counts as in it; everywhere when `None`.
    pub zone: Option<(&'w DistanceField, f64)>,
    pub speed_m_s: f64,
    pub yaw_rate_rad_s: f64,
    /// Margin to the zone at the start, metres; negative infinity for a global limit.
    pub start_m: f64,
    /// The speed the robot had when it was found too fast: it may brake down from there.
    pub braking_from_m_s: Option<f64>,
}

/// The world at one tick, seen from one start.
#[derive(Debug)]
pub(crate) struct Scene<'w> {
    pub assumptions: Assumptions,
    pub start: State,
    /// The start's.
    pub heading: Heading,
    /// Nearest first.
    pub spatial: Vec<SpatialLayer<'w>>,
    pub limits: Vec<LimitLayer<'w>>,
    segment_guard_m: f64,
}

impl SpatialLayer<'_> {
    /// Margin of the hull at a place after `seconds` of motion, metres.
    #[inline]
    pub(crate) fn margin_m(&self, place: Point2, seconds: f64) -> f64 {
        self.margin_at(&mut Place::at(place), seconds)
    }

    /// The same at a place that other layers are asked about, too.
    #[inline]
    pub(crate) fn margin_at(&self, place: &mut Place, seconds: f64) -> f64 {
        match &self.shape {
            Shape::Field(field) => place.sample(field) - self.keep_m,
            Shape::Points(index, closing_m_s) => {
                index.distance_m(place.point) - self.keep_m - closing_m_s * seconds
            }
        }
    }

    /// Whether the start is nearer than a pose can be told: nothing is certified, and none may come nearer.
    pub(crate) fn is_too_near(&self, assumptions: &Assumptions) -> bool {
        !self.soft && self.start_m <= assumptions.disturbance.position_m
    }

    /// Whether it is an obstacle, and not a rule.
    pub(crate) fn is_base(&self) -> bool {
        !matches!(self.source, Source::Rule(_))
    }
}

impl LimitLayer<'_> {
    /// Margin of the hull to the zone, metres; negative infinity for a global limit.
    #[inline]
    pub(crate) fn zone_margin_m(&self, place: Point2) -> f64 {
        self.zone_margin_at(&mut Place::at(place))
    }

    /// The same at a place that other layers are asked about, too.
    #[inline]
    pub(crate) fn zone_margin_at(&self, place: &mut Place) -> f64 {
        match self.zone {
            Some((field, keep_m)) => place.sample(field) - keep_m,
            None => f64::NEG_INFINITY,
        }
    }

    /// The largest speed allowed after `seconds`, m/s.
    #[inline]
    pub(crate) fn speed_at(&self, seconds: f64, accel_m_s2: f64) -> f64 {
        match self.braking_from_m_s {
            Some(from) => self.speed_m_s.max(from - accel_m_s2 * seconds + 1e-9),
            None => self.speed_m_s,
        }
    }
}

/// What a scene leaves to the next one: room, and indices of points that are not in use.
#[derive(Debug, Default)]
pub(crate) struct Spare {
    pub points: Vec<PointIndex>,
    spatial: Vec<SpatialLayer<'static>>,
    limits: Vec<LimitLayer<'static>>,
}

/// The room of a list without its content. That it is the same room is how the library collects in place.
fn emptied<A, B>(mut list: Vec<A>) -> Vec<B> {
    list.clear();
    list.into_iter().filter_map(|_| None).collect()
}

impl<'w> Scene<'w> {
    /// The scene of a world, seen from `start`. `stands_still` names the rules with a limit of 0 in whose
    /// zone the robot stood when told.
    #[cfg(test)]
    pub(crate) fn of(
        world: &'w World,
        start: State,
        assumptions: Assumptions,
        stands_still: &dyn Fn(&str) -> bool,
    ) -> Scene<'w> {
        Scene::with(world, start, assumptions, stands_still, &mut Spare::default())
    }

    /// As `of`, with what former scenes left ([`Scene::leave`]).
    pub(crate) fn with(
        world: &'w World,
        start: State,
        assumptions: Assumptions,
        stands_still: &dyn Fn(&str) -> bool,
        spare: &mut Spare,
    ) -> Scene<'w> {
        let spatial = emptied(std::mem::take(&mut spare.spatial));
        let limits = emptied(std::mem::take(&mut spare.limits));
        let heading = Heading::of(start.yaw_rad);
        let mut scene = Scene { assumptions, start, heading, spatial, limits, segment_guard_m: 0.0 };
        scene.segment_guard_m = scene.longest_segment_guard_m();
        let radius_m = assumptions.radius_m;
        let here = &mut Place::at(start.position());
        for (idx, layer) in world.base.iter().enumerate() {
            scene.add_spatial(Source::Base(idx), Shape::Field(&layer.field), radius_m, here);
        }
        scene.add_points(world, &mut spare.points, here);
        for (idx, rule) in world.rules.iter().enumerate() {
            scene.add_rule(Source::Rule(idx), &rule.demand, stands_still(&rule.id), here);
        }
        scene
    }

    /// Adds a layer that the hull must stay clear of.
    fn add_spatial(&mut self, source: Source, shape: Shape<'w>, keep_m: f64, here: &mut Place) {
        let mut layer = SpatialLayer { source, shape, keep_m, start_m: 0.0, soft: false };
        layer.start_m = match &layer.shape {
            Shape::Field(_) => layer.margin_at(here, 0.0),
            // The motions from here may never come near enough to the scan to ask for it.
            Shape::Points(index, _) => index.distance_by_all_m(here.point) - keep_m,
        };
        layer.soft = layer.start_m <= 0.0 && !layer.is_base();
        // Sorted as they come; of equally near ones the earlier stays first.
        let at = self.spatial.partition_point(|other| other.start_m.total_cmp(&layer.start_m).is_le());
        self.spatial.insert(at, layer);
    }

    /// Adds the scan, those hits apart that are on no map and may move.
    fn add_points(&mut self, world: &World, spare: &mut Vec<PointIndex>, here: &mut Place) {
        let Assumptions { limits, radius_m, closing_speed_m_s, .. } = self.assumptions;
        let centre = self.start.position();
        // Turning half round and driving away must stay within reach.
        let reach_m = (3.5 * limits.speed_m_s_max + 2.0).min(REACH_M_MAX);
        let moves = |p: &Point2| {
            closing_speed_m_s > 0.0 && world.base.iter().all(|layer| layer.field.sample(*p) > ON_MAP_M)
        };
        for (is_moving, closing_m_s) in [(false, 0.0), (true, closing_speed_m_s)] {
            if is_moving && closing_speed_m_s <= 0.0 {
                break;
            }
            let mut index = spare.pop().unwrap_or_default();
            if index.fill(&world.points, |p| moves(p) == is_moving, centre, reach_m) {
                self.add_spatial(Source::Points, Shape::Points(index, closing_m_s), radius_m, here);
            } else {
                spare.push(index);
            }
        }
    }

    /// Leaves what can be used again to the next scene.
    pub(crate) fn leave(mut self, spare: &mut Spare) {
        spare.points.extend(self.spatial.drain(..).filter_map(|layer| match layer.shape {
            Shape::Points(index, _) => Some(index),
            Shape::Field(_) => None,
        }));
        (spare.spatial, spare.limits) = (emptied(self.spatial), emptied(self.limits));
    }

    fn add_rule(&mut self, source: Source, demand: &'w Demand, stands_still: bool, here: &mut Place) {
        let radius_m = self.assumptions.radius_m;
        let infinity = f64::INFINITY;
        match demand {
            Demand::Exclusion { zone, buffer_m } => {
                self.add_spatial(source, Shape::Field(zone), radius_m + buffer_m, here);
            }
            Demand::SpeedCap { speed_m_s_max } => {
                self.add_limit(source, None, (*speed_m_s_max, infinity), here);
            }
            Demand::Limit { zone: Some(zone), buffer_m, speed_m_s_max: Some(0.0), .. } if !stands_still => {
                self.add_spatial(source, Shape::Field(zone), radius_m + buffer_m, here);
            }
            Demand::Limit { zone, buffer_m, speed_m_s_max, yaw_rate_rad_s_max } => {
                let zone = zone.as_deref().map(|field| (field, radius_m + buffer_m));
                let (speed, yaw_rate) = (speed_m_s_max.unwrap_or(infinity), yaw_rate_rad_s_max);
                self.add_limit(source, zone, (speed, yaw_rate.unwrap_or(infinity)), here);
            }
        }
    }

    fn add_limit(
        &mut self,
        source: Source,
        zone: Option<(&'w DistanceField, f64)>,
        (speed_m_s_max, yaw_rate_rad_s_max): (f64, f64),
        here: &mut Place,
    ) {
        let with_tolerance = |limit: f64| if limit > 0.0 { limit + LIMIT_TOLERANCE } else { 0.0 };
        let mut layer = LimitLayer {
            source,
            zone,
            speed_m_s: with_tolerance(speed_m_s_max),
            yaw_rate_rad_s: with_tolerance(yaw_rate_rad_s_max),
            start_m: 0.0,
            braking_from_m_s: None,
        };
        layer.start_m = layer.zone_margin_at(here);
        let inside = layer.start_m <= self.zone_guard_m(self.tube_m(self.start.speed_m_s, 0.0, 0.0));
        let measured_m_s = self.start.speed_m_s - self.assumptions.disturbance.speed_m_s;
        if inside && measured_m_s > layer.speed_m_s {
            layer.braking_from_m_s = Some(self.start.speed_m_s);
        }
        self.limits.push(layer);
    }

    /// The robot's limits, held to those of the rules that are in force at the start or [`AT_ONCE_M`] from it.
    pub(crate) fn limits_in_force(&self) -> Limits {
        let near = self.limits.iter().filter(|layer| layer.start_m <= AT_ONCE_M);
        near.fold(self.assumptions.limits, |limits, layer| Limits {
            speed_m_s_max: limits.speed_m_s_max.min((layer.speed_m_s - LIMIT_TOLERANCE).max(0.0)),
            yaw_rate_rad_s_max: limits
                .yaw_rate_rad_s_max
                .min((layer.yaw_rate_rad_s - LIMIT_TOLERANCE).max(0.0)),
            ..limits
        })
    }

    /// How near a zone's border a *sample* with this tube counts as inside, metres: what the segments that
    /// meet there may lose between samples, and what the tube may grow by along them.
    #[inline]
    pub(crate) fn zone_guard_m(&self, tube_m: f64) -> f64 {
        tube_m + self.segment_guard_m
    }

    fn longest_segment_guard_m(&self) -> f64 {
        let Assumptions { limits, step_s, disturbance: d, .. } = self.assumptions;
        let longest_m = limits.speed_m_s_max.max(self.start.speed_m_s) * step_s;
        let growth_m = d.speed_m_s * step_s
            + (d.yaw_rad + limits.yaw_rate_rad_s_max * d.delay_s) * longest_m
            + limits.accel_m_s2_max * d.delay_s * d.delay_s / 2.0;
        growth_m + self.loss_m(longest_m, limits.yaw_rate_rad_s_max * step_s)
    }

    /// The most that a margin loses between two samples `length_m` of path and `turn_rad` apart, against
    /// the smaller of its two values there. Proof in `certificate`.
    #[inline]
    pub(crate) fn loss_m(&self, length_m: f64, turn_rad: f64) -> f64 {
        let radius_m = self.assumptions.radius_m;
        let half_m = length_m / 2.0;
        radius_m - (radius_m * radius_m - half_m * half_m).max(0.0).sqrt() + length_m * turn_rad.abs() / 4.0
    }

    /// The radius of the tube around a plan after `seconds` of motion along `path_m`, metres.
    #[inline]
    pub(crate) fn tube_m(&self, start_m_s: f64, seconds: f64, path_m: f64) -> f64 {
        let Assumptions { limits, disturbance: d, .. } = self.assumptions;
        let carried_m = if start_m_s > 0.0 || path_m > 0.0 {
            start_m_s * d.delay_s + limits.accel_m_s2_max * d.delay_s * d.delay_s / 2.0
        } else {
            0.0
        };
        d.position_m
            + d.speed_m_s * seconds
            + carried_m
            + (d.yaw_rad + limits.yaw_rate_rad_s_max * d.delay_s) * path_m
    }

    /// The layers that bind, with the smallest margin at a place, metres. Infinite when none binds.
    pub(crate) fn nearest(&self, place: Point2, seconds: f64) -> (f64, Option<Source>) {
        let (mut nearest, mut place) = ((f64::INFINITY, None), Place::at(place));
        for layer in self.spatial.iter().filter(|layer| !layer.soft) {
            let margin_m = layer.margin_at(&mut place, seconds);
            if margin_m < nearest.0 {
                nearest = (margin_m, Some(layer.source));
            }
        }
        nearest
    }
}
