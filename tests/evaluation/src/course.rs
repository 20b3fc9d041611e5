//! What happens in a run beside driving, and when: the words, their taking back, a box on the way.
//!
//! Decides only; saying, judging and setting down are the trial's work.

use geometry::{Point2, Pose2};
use heedway_simulator::scene::{Kind, Object, Scene};
use heedway_simulator::solid::{Placement, Solid};
use heedway_simulator::truth::GroundTruth;

use crate::condition::Event;

/// Words that come late come when the hull is so near to where they hold, metres: about the last moment at which they
/// can be heeded. At 1.5 m/s braking takes 0.4 m, and finding the object half a second.
const TOLD_AT_M: f64 = 1.2;
/// Words that hold everywhere come so long after the goal, seconds.
const TOLD_AFTER_S: f64 = 1.0;
/// Words are taken back so long after the goal, seconds.
const REVOKED_AFTER_S: f64 = 2.0;
/// What is said to take them back.
pub const REVOCATION: &str = "Forget all rules";
/// The box appears from then on, seconds after the goal, …
const BOX_AFTER_S: f64 = 1.0;
/// … so far ahead on the robot's way, metres: at 1.5 m/s a second's drive, and braking takes 0.4 m …
const BOX_AHEAD_M: f64 = 1.5;
/// … where this much is free around its middle, metres: the hull gets past on either side.
const BOX_ROOM_M: f64 = 0.9;
/// Sides and height of the box, metres.
const BOX_M: [f64; 3] = [0.3, 0.3, 0.6];

/// Something to be done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Deed {
    /// Say the words: from here on they are judged.
    Say,
    /// Take them back: from here on they are not.
    Revoke,
    /// Set a box down there.
    SetDown(Point2),
}

/// Where a run is.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// Since the goal was given, seconds.
    pub time_s: f64,
    /// Where the base is, in `map`.
    pub position_map: Point2,
    /// Whether the robot breaks what the words will say.
    pub breaks: bool,
    /// How far the hull is from where they hold, metres; `None` when they hold everywhere.
    pub room_m: Option<f64>,
    /// The way that the navigator goes, in `map`, from the robot on.
    pub way_map: &'a [[f64; 2]],
}

/// What is still to happen.
#[derive(Clone, Copy, Debug)]
pub struct Course {
    event: Event,
    is_done: bool,
}

impl Course {
    /// All is still to come.
    #[must_use]
    pub fn new(event: Event) -> Self {
        Course { event, is_done: event == Event::None }
    }

    /// Whether the words come before the goal.
    #[must_use]
    pub fn begins_with_words(&self) -> bool {
        !matches!(self.event, Event::ToldLate | Event::ToldInside)
    }

    /// What never happened, in words, when the run is over.
    #[must_use]
    pub fn left_out(&self) -> Option<String> {
        (!self.is_done).then(|| format!("there was no occasion for {}", self.event.word()))
    }

    /// What is to be done now.
    pub fn next(&mut self, progress: &Progress<'_>, truth: &GroundTruth) -> Option<Deed> {
        if self.is_done {
            return None;
        }
        let after = |s: f64| progress.time_s >= s;
        let deed = match self.event {
            Event::None => None,
            Event::ToldLate => match progress.room_m {
                Some(room_m) => (room_m <= TOLD_AT_M).then_some(Deed::Say),
                None => after(TOLD_AFTER_S).then_some(Deed::Say),
            },
            Event::ToldInside => progress.breaks.then_some(Deed::Say),
            Event::Revoked => after(REVOKED_AFTER_S).then_some(Deed::Revoke),
            Event::Obstacle if after(BOX_AFTER_S) => place_of_box(progress, truth).map(Deed::SetDown),
            Event::Obstacle => None,
        };
        self.is_done = deed.is_some();
        deed
    }
}

/// The point of the way that is so far ahead, if there is room enough around it.
fn place_of_box(progress: &Progress<'_>, truth: &GroundTruth) -> Option<Point2> {
    let way = progress.way_map.iter().map(|[x, y]| Point2::new(*x, *y));
    let ahead = way.skip_while(|p| (p - progress.position_map).norm() < BOX_AHEAD_M);
    let spot = ahead.take(1).next()?;
    let is_near = (spot - progress.position_map).norm() < BOX_AHEAD_M + 0.2;
    (is_near && truth.obstacle_distance_m(spot) >= BOX_ROOM_M).then_some(spot)
}

/// The scene with a box in it.
#[must_use]
pub fn with_box(scene: &Scene, at: Point2) -> Scene {
    let placement = Placement { map_from_shape: Pose2::new(at.x, at.y, 0.0), base_m: 0.0 };
    let mut scene = scene.clone();
    scene.objects.push(Object {
        id: "appeared".into(),
        label: "cardboard parcel".into(),
        kind: Kind::Thing,
        rgb: Some([170, 130, 80]),
        placement,
        solids: vec![Solid::cuboid(placement, BOX_M)],
        extra: serde_json::Map::new(),
    });
    scene
}

#[cfg(test)]
mod tests {
    use super::*;
    use heedway_simulator::scene::Hull;

    fn empty_room() -> (Scene, GroundTruth) {
        let text = r#"{"name":"room","title":"","units":"m","floor":{"polygon":[[0,0],[8,0],[8,4],[0,4]]},
            "walls":[],"objects":[],"cases":[],"start":[1,2,0],"goal":[7,2]}"#;
        let hull = Hull { radius_m: 0.25, height_m: 0.45 };
        let scene = Scene::parse("room", text, &|_| Err("no mesh".into()), hull).unwrap();
        let truth = GroundTruth::new(&scene, hull);
        (scene, truth)
    }

    #[track_caller]
    fn check(event: Event, time_s: f64, breaks: bool, room_m: Option<f64>, wanted: Option<Deed>) {
        let (_, truth) = empty_room();
        let way_map: Vec<[f64; 2]> = (0..60).map(|k| [1.0 + 0.1 * f64::from(k), 2.0]).collect();
        let position_map = Point2::new(1.0, 2.0);
        let progress = Progress { time_s, position_map, breaks, room_m, way_map: &way_map };
        let mut course = Course::new(event);
        let deed = course.next(&progress, &truth);
        assert_eq!(deed, wanted);
        assert_eq!(course.next(&progress, &truth), None, "once only, or not yet");
    }

    #[test]
    fn each_thing_happens_once_and_in_its_time() {
        check(Event::None, 5.0, true, None, None);
        check(Event::ToldLate, 0.9, true, None, None);
        check(Event::ToldLate, 1.0, false, None, Some(Deed::Say));
        check(Event::ToldLate, 5.0, false, Some(1.3), None);
        check(Event::ToldLate, 0.1, false, Some(1.2), Some(Deed::Say));
        check(Event::ToldInside, 9.0, false, None, None);
        check(Event::ToldInside, 0.1, true, None, Some(Deed::Say));
        check(Event::Revoked, 2.0, false, None, Some(Deed::Revoke));
        check(Event::Obstacle, 0.5, false, None, None);
        check(Event::Obstacle, 1.0, false, None, Some(Deed::SetDown(Point2::new(2.5, 2.0))));
    }

    #[test]
    fn what_never_happened_is_said() {
        assert_eq!(Course::new(Event::None).left_out(), None);
        assert!(Course::new(Event::ToldInside).left_out().unwrap().contains("told_inside"));
    }

    #[test]
    fn a_box_that_is_set_down_can_be_bumped_into() {
        let (scene, before) = empty_room();
        let at = Point2::new(4.0, 2.0);
        let after = GroundTruth::new(&with_box(&scene, at), before.hull());
        assert!(before.clearance_m(at) > 1.0 && after.clearance_m(at) < 0.0);
    }
}
