//! Exact distance from a point to everything that stands on a part of the floor.
//!
//! A footprint is the union of flat areas, with a grid over them so that a query looks at neighbours
//! only. Distances are exact in `f64`: no cells, no fields, and nothing shared with the maps that the
//! robot itself makes, which are judged by them.

use std::cell::Cell;

use geometry::polygon::segment_distance_m;
use geometry::{Point2, Point3};

use crate::solid::{Area, Band, Solid};

/// Side of a bucket of the index, metres. Chosen: about the size of a small object.
const BUCKET_M: f64 = 0.25;
/// Most buckets along one side; larger footprints get larger buckets.
const N_BUCKETS_SIDE_MAX: usize = 512;
/// An area in more buckets than this is looked at in every query instead.
const N_BUCKETS_PER_AREA_MAX: usize = 4096;

/// A part of the floor that is covered by something, in `map`.
#[derive(Clone, Debug, Default)]
pub struct Footprint {
    areas: Vec<Area>,
    /// Meshes whose inside is covered too.
    hollow: Vec<Hollow>,
    buckets: Buckets,
}

/// A mesh, the height at which to look into it, and the box around it.
#[derive(Clone, Debug)]
struct Hollow {
    solid: Solid,
    z_m: f64,
    low: Point2,
    high: Point2,
}

#[derive(Clone, Debug, Default)]
struct Buckets {
    corner: Point2,
    side_m: f64,
    n_columns: i64,
    n_rows: i64,
    areas: Vec<Vec<u32>>,
    everywhere: Vec<u32>,
}

impl Footprint {
    /// What `solids` cover between the heights of `band`.
    #[must_use]
    pub fn of(solids: &[Solid], band: Band) -> Self {
        let areas: Vec<Area> = solids.iter().flat_map(|solid| solid.slice(band)).collect();
        let hollow = solids.iter().filter_map(|solid| Hollow::of(solid, band)).collect();
        let buckets = Buckets::over(&areas);
        Footprint { areas, hollow, buckets }
    }

    /// True when nothing is covered.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.areas.is_empty()
    }

    /// Distance from a point to the footprint, metres: `+∞` when it is empty, negative inside.
    ///
    /// Outside it is exact. Inside, its size is the depth within the one area that goes deepest: exact
    /// where areas do not join, else not more than the depth in their union.
    #[must_use]
    pub fn distance_m(&self, point: Point2) -> f64 {
        let nearest_m = self.buckets.nearest_m(&self.areas, point);
        if nearest_m <= 0.0 || !nearest_m.is_finite() {
            return nearest_m;
        }
        if self.hollow.iter().any(|hollow| hollow.encloses(point)) { -nearest_m } else { nearest_m }
    }
}

impl Hollow {
    /// `None` for solids that are no meshes, and for meshes outside the band.
    fn of(solid: &Solid, band: Band) -> Option<Hollow> {
        let Solid::Mesh(mesh) = solid else { return None };
        let first = mesh.vertices.first()?;
        let (low, high) = mesh
            .vertices
            .iter()
            .fold((first.coords, first.coords), |(low, high), p| (low.inf(&p.coords), high.sup(&p.coords)));
        let (bottom_m, top_m) = (low.z.max(band.bottom_m), high.z.min(band.top_m));
        (bottom_m < top_m).then(|| Hollow {
            solid: solid.clone(),
            z_m: f64::midpoint(bottom_m, top_m),
            low: low.xy().into(),
            high: high.xy().into(),
        })
    }

    fn encloses(&self, point: Point2) -> bool {
        (self.low.x..=self.high.x).contains(&point.x)
            && (self.low.y..=self.high.y).contains(&point.y)
            && self.solid.encloses(Point3::new(point.x, point.y, self.z_m))
    }
}

impl Area {
    /// Distance from a point to the area, metres, negative inside.
    #[must_use]
    pub fn distance_m(&self, point: Point2) -> f64 {
        match self {
            Area::Disc { centre, radius_m } => (point - centre).norm() - radius_m,
            Area::Polygon(corners) => {
                let mut border_m = f64::INFINITY;
                let mut inside = false;
                let mut a = corners.last().copied().unwrap_or_default();
                for &b in corners {
                    border_m = border_m.min(segment_distance_m(point, a, b));
                    let crosses = (a.y > point.y) != (b.y > point.y);
                    if crosses && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x) {
                        inside = !inside;
                    }
                    a = b;
                }
                if inside { -border_m } else { border_m }
            }
        }
    }

    /// Lower left and upper right corner of the box around the area.
    #[must_use]
    pub fn bounds(&self) -> (Point2, Point2) {
        match self {
            Area::Disc { centre, radius_m } => {
                let reach = nalgebra::Vector2::repeat(*radius_m);
                (centre - reach, centre + reach)
            }
            Area::Polygon(corners) => {
                let none =
                    (Point2::new(f64::INFINITY, f64::INFINITY), Point2::new(-f64::INFINITY, -f64::INFINITY));
                corners.iter().fold(none, |(low, high), p| {
                    (low.coords.inf(&p.coords).into(), high.coords.sup(&p.coords).into())
                })
            }
        }
    }
}

impl Buckets {
    fn over(areas: &[Area]) -> Self {
        let Some((low, high)) = areas.iter().map(Area::bounds).reduce(|(low, high), (l, h)| {
            (low.coords.inf(&l.coords).into(), high.coords.sup(&h.coords).into())
        }) else {
            return Buckets::default();
        };
        let extent_m = (high - low).max();
        let side_m = BUCKET_M.max(extent_m / N_BUCKETS_SIDE_MAX as f64);
        let n_along = |length_m: f64| ((length_m / side_m).floor() as i64 + 1).max(1);
        let (n_columns, n_rows) = (n_along(high.x - low.x), n_along(high.y - low.y));
        let mut buckets = Buckets {
            corner: low,
            side_m,
            n_columns,
            n_rows,
            areas: vec![Vec::new(); (n_columns * n_rows) as usize],
            everywhere: Vec::new(),
        };
        for (idx, area) in areas.iter().enumerate() {
            buckets.add(idx as u32, area);
        }
        buckets
    }

    /// Column and row of the bucket that a point falls into; may lie outside the grid.
    fn bucket_of(&self, point: Point2) -> (i64, i64) {
        let at = (point - self.corner) / self.side_m;
        (at.x.floor() as i64, at.y.floor() as i64)
    }

    fn add(&mut self, idx: u32, area: &Area) {
        let (low, high) = area.bounds();
        let ((c0, r0), (c1, r1)) = (self.bucket_of(low), self.bucket_of(high));
        if ((c1 - c0 + 1) * (r1 - r0 + 1)) as usize > N_BUCKETS_PER_AREA_MAX {
            self.everywhere.push(idx);
            return;
        }
        for row in r0.max(0)..=r1.min(self.n_rows - 1) {
            for column in c0.max(0)..=c1.min(self.n_columns - 1) {
                self.areas[(row * self.n_columns + column) as usize].push(idx);
            }
        }
    }

    /// Signed distance to the nearest area; the deepest, when the point is inside some.
    fn nearest_m(&self, areas: &[Area], point: Point2) -> f64 {
        if self.areas.is_empty() || !(point.x.is_finite() && point.y.is_finite()) {
            return f64::INFINITY;
        }
        let nearest_m = Cell::new(f64::INFINITY);
        let look = |list: &[u32]| {
            for idx in list {
                nearest_m.set(nearest_m.get().min(areas[*idx as usize].distance_m(point)));
            }
        };
        look(&self.everywhere);
        let (column, row) = self.bucket_of(point);
        let outside = |at: i64, n: i64| (-at).max(at - (n - 1)).max(0);
        let first = outside(column, self.n_columns).max(outside(row, self.n_rows));
        let last = column.max(self.n_columns - 1 - column).max(row).max(self.n_rows - 1 - row);
        for ring in first..=last {
            // What is only in this ring or beyond it is at least this far away.
            if ring > first && nearest_m.get() <= (ring - 1) as f64 * self.side_m {
                break;
            }
            self.ring(column, row, ring, &look);
        }
        nearest_m.get()
    }

    /// Looks at the buckets of the grid that are `ring` steps from (`column`, `row`).
    fn ring(&self, column: i64, row: i64, ring: i64, look: &dyn Fn(&[u32])) {
        let bucket = |c: i64, r: i64| look(&self.areas[(r * self.n_columns + c) as usize]);
        let columns = (column - ring).max(0)..=(column + ring).min(self.n_columns - 1);
        for r in (row - ring).max(0)..=(row + ring).min(self.n_rows - 1) {
            if (r - row).abs() == ring {
                columns.clone().for_each(|c| bucket(c, r));
                continue;
            }
            for c in [column - ring, column + ring] {
                if (0..self.n_columns).contains(&c) {
                    bucket(c, r);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solid::Placement;
    use geometry::Pose2;
    use proptest::prelude::*;

    fn any_solid() -> impl Strategy<Value = Solid> {
        let place = (-9.0..9.0_f64, -9.0..9.0_f64, -3.0..3.0_f64, 0.0..1.0_f64)
            .prop_map(|(x, y, yaw, z)| Placement { map_from_shape: Pose2::new(x, y, yaw), base_m: z });
        (place, 0.05..4.0_f64, 0.05..1.0_f64, 0.1..1.0_f64, any::<bool>()).prop_map(|(at, a, b, c, round)| {
            if round { Solid::cylinder(at, b, c) } else { Solid::cuboid(at, [a, b, c]) }
        })
    }

    proptest! {
        #[test]
        fn the_index_changes_nothing(
            solids in prop::collection::vec(any_solid(), 1..30),
            x in -30.0..30.0_f64, y in -12.0..12.0_f64,
        ) {
            let band = Band::of_hull(0.45);
            let footprint = Footprint::of(&solids, band);
            let slow = solids
                .iter()
                .flat_map(|s| s.slice(band))
                .map(|a| a.distance_m(Point2::new(x, y)))
                .fold(f64::INFINITY, f64::min);
            prop_assert_eq!(footprint.distance_m(Point2::new(x, y)), slow);
        }

        #[test]
        fn a_box_given_as_a_mesh_is_as_far_away_as_the_box(
            x in -3.0..3.0_f64, y in -3.0..3.0_f64, yaw in -3.0..3.0_f64,
        ) {
            let at = Placement { map_from_shape: Pose2::new(0.3, -0.2, yaw), base_m: 0.0 };
            let solid = Solid::cuboid(at, [1.6, 0.8, 1.0]);
            let surface = solid.surface();
            let mesh = Solid::Mesh(crate::mesh::Mesh {
                vertices: surface.iter().flatten().copied().collect(),
                triangles: (0..surface.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
            });
            let point = Point2::new(x, y);
            // The band cuts through the walls: top and bottom of the mesh are not in it.
            let of_box = Footprint::of(&[solid], Band::of_hull(0.45)).distance_m(point);
            let of_mesh = Footprint::of(&[mesh], Band::of_hull(0.45)).distance_m(point);
            prop_assert!((of_box - of_mesh).abs() < 1e-9, "{} {}", of_box, of_mesh);
        }
    }

    #[test]
    fn nothing_is_infinitely_far_away() {
        assert_eq!(Footprint::of(&[], Band::ALL).distance_m(Point2::origin()), f64::INFINITY);
    }
}
