//! Where a rule of a case holds, from the scene alone: the region whose distance a run is judged by.
//!
//! Objects are their exact projections to the floor. Sides, `between` and `beyond` are drawn around them as the
//! words are commonly meant, seen from where the robot stood when it was told. Nothing is shared with the
//! maps that the robot makes.

use geometry::{Point2, Polygon, Pose2};
use heedway_simulator::scene::{CaseRule, Scene};
use heedway_simulator::solid::{Area, Band};
use heedway_simulator::truth::ObjectGap;
use nalgebra::Vector2;
use rules::Relation;

/// Least breadth and depth of a side of an object, metres.
const SIDE_M_MIN: f64 = 1.5;

/// The region of one rule.
#[derive(Clone, Debug)]
pub enum Zone {
    /// Everywhere.
    Everywhere,
    /// The projections of these objects, or of what of them is above the robot.
    Objects {
        /// Their ids.
        ids: Vec<String>,
        /// Whether only what is above the robot counts.
        overhead: bool,
    },
    /// An outline.
    Outline(Polygon),
    /// All past a line, along a unit vector.
    Past {
        /// A point of the line.
        from: Point2,
        /// Away from the robot.
        along: Vector2<f64>,
    },
    /// Nothing can be judged, and why.
    None(String),
}

impl Zone {
    /// The region of a case's rule, for a robot that was told at `map_from_anchor`.
    #[must_use]
    pub fn of(rule: &CaseRule, scene: &Scene, map_from_anchor: Pose2) -> Zone {
        if rule.relation == Relation::Global {
            return Zone::Everywhere;
        }
        if rule.objects.is_empty() {
            return Zone::None("the case names no object".to_owned());
        }
        let corners = corners_of(rule, scene);
        match rule.relation {
            Relation::Near | Relation::On | Relation::Beneath => {
                let overhead = rule.relation == Relation::Beneath;
                Zone::Objects { ids: rule.objects.clone(), overhead }
            }
            Relation::Between => outline(convex_hull(corners)),
            Relation::Beyond => {
                let middle = mean(&corners);
                Zone::Past { from: middle, along: direction(map_from_anchor, middle) }
            }
            side => side_of(side, &corners, map_from_anchor),
        }
    }

    /// Hull to zone, metres, negative inside; `None` when the zone is nowhere.
    ///
    /// `gaps` are the hull's distances to all objects, `centre_map` and `radius_m` the hull.
    #[must_use]
    pub fn gap_m(&self, gaps: &[ObjectGap], centre_map: Point2, radius_m: f64) -> Option<f64> {
        match self {
            Zone::Everywhere => Some(f64::NEG_INFINITY),
            Zone::Objects { ids, overhead } => {
                let of = |gap: &ObjectGap| if *overhead { gap.overhead_m } else { Some(gap.any_height_m) };
                gaps.iter().filter(|gap| ids.contains(&gap.id)).filter_map(of).min_by(f64::total_cmp)
            }
            Zone::Outline(polygon) => Some(polygon.signed_distance_m(centre_map) - radius_m),
            Zone::Past { from, along } => Some(-(centre_map - from).dot(along) - radius_m),
            Zone::None(_) => None,
        }
    }
}

fn outline(corners: Vec<Point2>) -> Zone {
    Polygon::new(corners).map_or_else(|e| Zone::None(e.to_string()), Zone::Outline)
}

/// Points around the projection of the rule's objects.
fn corners_of(rule: &CaseRule, scene: &Scene) -> Vec<Point2> {
    let meant = scene.objects.iter().filter(|object| rule.objects.contains(&object.id));
    let areas = meant.flat_map(|object| &object.solids).flat_map(|solid| solid.slice(Band::ALL));
    areas
        .flat_map(|area| match area {
            Area::Polygon(corners) => corners,
            Area::Disc { centre, radius_m } => {
                let around = (0..16).map(|k| f64::from(k) * std::f64::consts::TAU / 16.0);
                around.map(|a| centre + Vector2::new(a.cos(), a.sin()) * radius_m).collect()
            }
        })
        .collect()
}

fn mean(points: &[Point2]) -> Point2 {
    let (low, high) = points.iter().fold(
        (Point2::new(f64::INFINITY, f64::INFINITY), Point2::new(f64::NEG_INFINITY, f64::NEG_INFINITY)),
        |(low, high), p| (low.inf(p), high.sup(p)),
    );
    nalgebra::center(&low, &high)
}

fn direction(map_from_anchor: Pose2, to: Point2) -> Vector2<f64> {
    let heading = Vector2::new(map_from_anchor.yaw_rad.cos(), map_from_anchor.yaw_rad.sin());
    (to - map_from_anchor.position()).try_normalize(0.01).unwrap_or(heading)
}

/// A rectangle from the object's edge outward.
fn side_of(side: Relation, corners: &[Point2], map_from_anchor: Pose2) -> Zone {
    let middle = mean(corners);
    let view = direction(map_from_anchor, middle);
    let left = Vector2::new(-view.y, view.x);
    let (outward, along) = match side {
        Relation::LeftOf => (left, view),
        Relation::RightOf => (-left, view),
        Relation::FrontOf => (-view, left),
        _ => (view, left),
    };
    let extent = |axis: Vector2<f64>| {
        let all = corners.iter().map(|p| (p - middle).dot(&axis));
        all.fold((0.0_f64, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)))
    };
    let (low_m, high_m) = extent(along);
    let wider_m = (SIDE_M_MIN - (high_m - low_m)).max(0.0) / 2.0;
    let (across_low_m, across_high_m) = extent(left);
    let begins_m = extent(outward).1;
    let ends_m = begins_m + (across_high_m - across_low_m).max(SIDE_M_MIN);
    let corner = |along_m: f64, outward_m: f64| middle + along * along_m + outward * outward_m;
    let (first_m, last_m) = (low_m - wider_m, high_m + wider_m);
    outline(vec![
        corner(first_m, begins_m),
        corner(last_m, begins_m),
        corner(last_m, ends_m),
        corner(first_m, ends_m),
    ])
}

/// Corners of the convex hull, counter-clockwise (Andrew's monotone chain).
fn convex_hull(mut points: Vec<Point2>) -> Vec<Point2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let half = |points: &mut dyn Iterator<Item = &Point2>| {
        let mut hull: Vec<Point2> = Vec::new();
        for point in points {
            while let [.., a, b] = hull[..] {
                if (b - a).perp(&(point - a)) > 1e-12 {
                    break;
                }
                hull.pop();
            }
            hull.push(*point);
        }
        hull.pop();
        hull
    };
    let mut hull = half(&mut points.iter());
    hull.extend(half(&mut points.iter().rev()));
    hull
}
