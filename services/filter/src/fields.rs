//! Distance fields of maps: what is computed beside the control loop, one at a time for each layer.
//!
//! Cells become fields here and nowhere else. Of the base map, unknown counts as an obstacle, and so does
//! everything past its border. A region is cut out with room around it: past that room it is out of reach
//! for any plan and its layer is left out, because a field outside its grid is only a lower bound, which
//! would fall below zero far away.

use std::collections::BTreeMap;
use std::sync::Arc;

use geometry::Point2;
use mapping::{Cell, ChangingField, DistanceField, Grid, Layout, Shape};
use proto::{BaseMap, CellSet, GridLayout, Grounding};

/// What `BaseMap` calls a cell that was seen empty.
const FREE: u8 = 1;

/// Which layer of the world a field belongs to.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LayerId {
    /// The base map.
    Base,
    /// Obstacles that the camera saw.
    Depth,
    /// The region of a rule, by its id.
    Rule(String),
}

/// The cells a field is made of.
#[derive(Clone, Debug)]
pub enum FieldCells {
    /// All but the free cells are obstacles.
    Base(BaseMap),
    /// The cells in the set.
    Set(CellSet),
}

/// What a field is made for: given back with it.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldTag {
    /// The layer.
    pub layer: LayerId,
    /// Epoch of the map frame.
    pub map_epoch: u64,
    /// Which run of its publisher the cells came from.
    pub run: u64,
    /// How far the rule's grounding got; for the other layers not needed.
    pub grounding: Grounding,
}

/// One field to compute, beside the control loop.
#[derive(Clone, Debug)]
pub struct FieldJob {
    /// What it is for.
    pub tag: FieldTag,
    /// The cells.
    pub cells: FieldCells,
    /// Room to leave around a region, metres.
    pub room_m: f64,
}

/// A field that was computed.
#[derive(Clone, Debug)]
pub struct FieldReady {
    /// What it is for.
    pub tag: FieldTag,
    /// The zone; `None` when no cell is in the set; an error when there can be no such grid.
    pub zone: Result<Option<Zone>, String>,
}

/// A region with its distance field.
#[derive(Clone, Debug)]
pub struct Zone {
    /// Signed distance to the region, never above the true one.
    pub field: Arc<DistanceField>,
    /// Lower left corner of the box around the region.
    pub low: Point2,
    /// Upper right corner of the box around the region.
    pub high: Point2,
    /// Beyond this distance from the box the field is not to be asked, metres.
    pub room_m: f64,
    /// Area of the region, m².
    pub area_m2: f64,
}

impl Zone {
    /// Whether a place is near enough for the region to matter. NaN is.
    #[must_use]
    pub fn is_within_reach(&self, place: Point2) -> bool {
        let beyond = |value: f64, low: f64, high: f64| (low - value).max(value - high).max(0.0);
        let away_m = beyond(place.x, self.low.x, self.high.x).hypot(beyond(place.y, self.low.y, self.high.y));
        // One metre is kept in hand: the field is asked ahead of the place.
        away_m.is_nan() || away_m <= self.room_m - 1.0
    }
}

/// Layers whose fields are kept; when there are more, all begin anew.
const N_KEPT_MAX: usize = 64;

/// Computes fields, and keeps each layer's: where little has changed, little is computed.
#[derive(Debug, Default)]
pub struct Fields {
    kept: BTreeMap<LayerId, ChangingField>,
}

impl Fields {
    /// Computes a field. Anew it is linear in the number of cells: milliseconds for a house, a second for the largest
    /// map.
    #[must_use]
    pub fn compute(&mut self, job: FieldJob) -> FieldReady {
        let region = match &job.cells {
            FieldCells::Base(map) => base_region(map).map(Some),
            FieldCells::Set(set) => set_region(set, job.room_m),
        };
        let zone = region.map(|region| region.map(|region| self.zone(&job.tag.layer, region)));
        FieldReady { tag: job.tag, zone: zone.map_err(|e| e.to_string()) }
    }

    /// A region's zone, by what is kept of its layer.
    fn zone(&mut self, layer: &LayerId, region: Region) -> Zone {
        let Region { occupied, low, high, room_m, area_m2 } = region;
        let field = if let Some(kept) = self.kept.get_mut(layer) {
            kept.update(occupied);
            kept.field().clone()
        } else {
            if self.kept.len() >= N_KEPT_MAX {
                self.kept.clear();
            }
            self.kept.entry(layer.clone()).or_insert(ChangingField::new(occupied)).field().clone()
        };
        Zone { field: Arc::new(field), low, high, room_m, area_m2 }
    }
}

/// Cells that are to become a zone.
struct Region {
    occupied: Grid<bool>,
    low: Point2,
    high: Point2,
    room_m: f64,
    area_m2: f64,
}

/// The obstacles of a base map, a ring of them around it.
fn base_region(map: &BaseMap) -> Result<Region, mapping::GridError> {
    let GridLayout { origin_map, resolution_m, n_cols, n_rows } = map.layout;
    let (n_cols, n_rows) = (n_cols as usize, n_rows as usize);
    let origin = Point2::new(origin_map.x - resolution_m, origin_map.y - resolution_m);
    let layout = Layout::new(origin, resolution_m, Shape { n_cols: n_cols + 2, n_rows: n_rows + 2 })?;
    let mut occupied = Grid::filled(layout, true);
    for (row, cells) in map.cells.chunks_exact(n_cols).enumerate() {
        for (col, cell) in cells.iter().enumerate() {
            occupied.set(Cell { col: col + 1, row: row + 1 }, *cell != FREE);
        }
    }
    let area_m2 = map.cells.iter().filter(|cell| **cell != FREE).count() as f64 * resolution_m * resolution_m;
    Ok(Region { occupied, low: layout.origin, high: layout.far_corner(), room_m: f64::INFINITY, area_m2 })
}

/// A set of cells, cut out with `room_m` around it; `None` when it is empty.
fn set_region(set: &CellSet, room_m: f64) -> Result<Option<Region>, mapping::GridError> {
    let GridLayout { origin_map, resolution_m, n_cols, .. } = set.layout;
    let n_cols = n_cols as usize;
    let cells: Vec<Cell> = set
        .unpack()
        .iter()
        .enumerate()
        .filter(|(_, on)| **on)
        .map(|(idx, _)| Cell { col: idx % n_cols, row: idx / n_cols })
        .collect();
    let ends = |of: fn(&Cell) -> usize| {
        cells.iter().map(of).fold((usize::MAX, 0), |(low, high), at| (low.min(at), high.max(at)))
    };
    let ((first_col, last_col), (first_row, last_row)) = (ends(|c| c.col), ends(|c| c.row));
    if cells.is_empty() {
        return Ok(None);
    }
    let n_room = (room_m / resolution_m).ceil() as usize;
    let corner = |col: usize, row: usize| {
        Point2::new(origin_map.x + col as f64 * resolution_m, origin_map.y + row as f64 * resolution_m)
    };
    let (low, high) = (corner(first_col, first_row), corner(last_col + 1, last_row + 1));
    let origin = low - Point2::new(1.0, 1.0).coords * (n_room as f64 * resolution_m);
    let shape = Shape {
        n_cols: last_col - first_col + 1 + 2 * n_room,
        n_rows: last_row - first_row + 1 + 2 * n_room,
    };
    let mut occupied = Grid::filled(Layout::new(origin, resolution_m, shape)?, false);
    for cell in &cells {
        occupied.set(Cell { col: cell.col - first_col + n_room, row: cell.row - first_row + n_room }, true);
    }
    let area_m2 = cells.len() as f64 * resolution_m * resolution_m;
    Ok(Some(Region { occupied, low, high, room_m, area_m2 }))
}

/// Which layers are being computed: one field in flight for each, the newest waits, the oldest gives way.
#[derive(Debug, Default)]
pub struct Computing {
    /// Layers in flight, each with what waits behind.
    layers: BTreeMap<LayerId, Option<FieldJob>>,
}

impl Computing {
    /// The job when it may start now; otherwise it waits.
    pub fn submit(&mut self, job: FieldJob) -> Option<FieldJob> {
        match self.layers.get_mut(&job.tag.layer) {
            Some(waiting) => {
                *waiting = Some(job);
                None
            }
            None => {
                self.layers.insert(job.tag.layer.clone(), None);
                Some(job)
            }
        }
    }

    /// Notes that a layer's field is ready; the job that waited behind it may start now.
    pub fn done(&mut self, layer: &LayerId) -> Option<FieldJob> {
        let next = self.layers.get_mut(layer).and_then(Option::take);
        if next.is_none() {
            self.layers.remove(layer);
        }
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(on: impl Fn(f64, f64) -> bool) -> CellSet {
        let layout =
            GridLayout { origin_map: Point2::new(-2.0, -1.0), resolution_m: 0.1, n_cols: 40, n_rows: 20 };
        let centre = |i: usize| (-1.95 + 0.1 * (i % 40) as f64, -0.95 + 0.1 * (i / 40) as f64);
        let cells: Vec<bool> = (0..800).map(|i| on(centre(i).0, centre(i).1)).collect();
        CellSet::pack(layout, &cells)
    }

    fn tag(layer: LayerId) -> FieldTag {
        FieldTag { layer, map_epoch: 1, run: 1, grounding: Grounding::Grounded }
    }

    fn zone_of(set: CellSet) -> Option<Zone> {
        let job = FieldJob { tag: tag(LayerId::Depth), cells: FieldCells::Set(set), room_m: 3.0 };
        Fields::default().compute(job).zone.unwrap()
    }

    #[test]
    fn a_region_knows_its_distance_also_outside_its_own_grid() {
        let zone = zone_of(set(|x, y| x.abs() < 0.5 && y.abs() < 0.5)).unwrap();
        assert!((zone.area_m2 - 1.0).abs() < 1e-9);
        let away_m = zone.field.sample(Point2::new(3.0, 0.0));
        assert!((2.4..=2.5).contains(&away_m), "{away_m}");
        assert!(zone.is_within_reach(Point2::new(2.4, 0.0)));
        assert!(!zone.is_within_reach(Point2::new(2.6, 0.0)));
        assert!(zone.is_within_reach(Point2::new(f64::NAN, 0.0)));
    }

    #[test]
    fn a_region_without_a_cell_is_no_region() {
        assert!(zone_of(set(|_, _| false)).is_none());
    }

    #[test]
    fn what_is_kept_of_a_layer_changes_nothing_but_the_time() {
        let mut fields = Fields::default();
        let part_of = |n: usize| set(move |x, y| (n == 1 || x < 0.3) && x.abs() < 0.5 && (n != 2 || y < 0.2));
        for n in [0, 1, 0, 2, 3] {
            for layer in [LayerId::Depth, LayerId::Rule(format!("r{n}"))] {
                let job = FieldJob { tag: tag(layer), cells: FieldCells::Set(part_of(n)), room_m: 3.0 };
                let (kept, anew) = (fields.compute(job.clone()), Fields::default().compute(job));
                let values_m = |ready: FieldReady| ready.zone.unwrap().unwrap().field.values_m().to_vec();
                assert_eq!(values_m(kept), values_m(anew));
            }
        }
        for n in 0..2 * N_KEPT_MAX {
            let layer = LayerId::Rule(format!("many {n}"));
            let job = FieldJob { tag: tag(layer), cells: FieldCells::Set(part_of(0)), room_m: 3.0 };
            assert!(fields.compute(job).zone.unwrap().is_some());
            assert!(fields.kept.len() <= N_KEPT_MAX);
        }
    }

    #[test]
    fn unknown_cells_and_all_past_the_border_are_obstacles_of_the_base_map() {
        let layout = GridLayout { origin_map: Point2::origin(), resolution_m: 0.1, n_cols: 30, n_rows: 30 };
        let mut cells = vec![1_u8; 900];
        cells[15 * 30 + 20] = 0;
        let map = BaseMap { header: Default::default(), map_epoch: 1, layout, cells };
        let job = FieldJob { tag: tag(LayerId::Base), cells: FieldCells::Base(map), room_m: 3.0 };
        let zone = Fields::default().compute(job).zone.unwrap().unwrap();
        let near_unknown_m = zone.field.sample(Point2::new(1.55, 1.55));
        assert!((0.4..=0.45).contains(&near_unknown_m), "{near_unknown_m}");
        assert!(zone.field.sample(Point2::new(0.05, 1.5)) <= 0.05);
        assert!(zone.field.sample(Point2::new(-2.0, 1.5)) < 0.0);
    }

    #[test]
    fn one_field_of_a_layer_is_in_flight_and_only_the_newest_waits() {
        let mut computing = Computing::default();
        let job = |run| FieldJob {
            tag: FieldTag { run, ..tag(LayerId::Base) },
            cells: FieldCells::Set(set(|_, _| true)),
            room_m: 1.0,
        };
        assert_eq!(computing.submit(job(1)).map(|j| j.tag.run), Some(1));
        assert!(computing.submit(job(2)).is_none());
        assert!(computing.submit(job(3)).is_none());
        assert_eq!(computing.done(&LayerId::Base).map(|j| j.tag.run), Some(3));
        assert!(computing.done(&LayerId::Base).is_none());
        assert_eq!(computing.submit(job(4)).map(|j| j.tag.run), Some(4));
    }
}
