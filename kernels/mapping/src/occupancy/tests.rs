use proptest::prelude::*;

use super::*;

const BAND: HeightBand = HeightBand { robot_height_m: 0.45 };

/// Points every 2 cm over a box's faces that a camera sees: all but the lowest.
fn box_points(x: (f64, f64), y: (f64, f64), z: (f64, f64)) -> Vec<Point3> {
    let steps = |(low, high): (f64, f64)| {
        let n = ((high - low) / 0.02_f64).round().max(1.0) as usize;
        (0..=n).map(move |i| low + (high - low) * i as f64 / n as f64)
    };
    let mut points = Vec::new();
    for px in steps(x) {
        for py in steps(y) {
            for pz in steps(z) {
                let on_side = px == x.0 || px == x.1 || py == y.0 || py == y.1;
                if on_side || pz == z.1 {
                    points.push(Point3::new(px, py, pz));
                }
            }
        }
    }
    points
}

fn table() -> Vec<Point3> {
    let mut points = box_points((0.0, 1.6), (0.0, 0.8), (0.69, 0.72));
    for (x, y) in [(0.0, 0.0), (1.55, 0.0), (1.55, 0.75), (0.0, 0.75)] {
        points.extend(box_points((x, x + 0.05), (y, y + 0.05), (0.0, 0.69)));
    }
    points
}

fn cells(grid: &Grid<bool>) -> usize {
    grid.values().iter().filter(|o| **o).count()
}

fn found(points: &[Point3], relation: Relation) -> Grid<bool> {
    footprint(points, relation, BAND, &Closing::default()).unwrap()
}

proptest! {
    #[test]
    fn every_point_of_an_object_is_covered(
        x in -5.0..5.0, y in -5.0..5.0, w in 0.1..2.0, d in 0.1..2.0,
    ) {
        let points = box_points((x, x + w), (y, y + d), (0.0, 0.5));
        let grid = found(&points, Relation::Near);
        for point in &points {
            prop_assert_eq!(grid.at(point.xy()), Some(&true));
        }
        // And no more than the cells the box touches.
        for cell in grid.layout().cells().filter(|&c| *grid.get(c)) {
            let c = grid.layout().centre(cell);
            prop_assert!(c.x > x - 0.026 && c.x < x + w + 0.026 && c.y > y - 0.026 && c.y < y + d + 0.026);
        }
    }

    #[test]
    fn the_order_of_points_does_not_matter(seed in 0..1000_u64) {
        use rand::{SeedableRng, seq::SliceRandom};
        let mut points = table();
        let straight = found(&points, Relation::Beneath);
        points.shuffle(&mut rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed));
        prop_assert_eq!(found(&points, Relation::Beneath), straight);
    }
}

#[test]
fn beneath_a_table_is_the_whole_of_its_top() {
    let grid = found(&table(), Relation::Beneath);
    assert_eq!(grid.at(Point2::new(0.8, 0.4)), Some(&true));
    // 1.6 × 0.8 m, and the cells that its border touches.
    assert!((32 * 16..=34 * 18).contains(&cells(&grid)), "{}", cells(&grid));
}

#[test]
fn the_rim_of_a_top_is_enough_to_fill_it() {
    let rim: Vec<Point3> =
        table().into_iter().filter(|p| p.x < 0.1 || p.x > 1.5 || p.y < 0.1 || p.y > 0.7).collect();
    assert_eq!(found(&rim, Relation::Beneath), found(&table(), Relation::Beneath));
}

#[test]
fn stripes_of_a_top_at_a_grazing_angle_are_closed() {
    let stripes: Vec<Point3> =
        table().into_iter().filter(|p| p.z > 0.6 && (p.y / 0.2).fract() < 0.15).collect();
    assert!(cells(&found(&stripes, Relation::Beneath)) >= 32 * 14);
}

#[test]
fn only_the_top_and_the_legs_within_it_count_as_beneath() {
    // A foot that reaches half a metre out, joined to the top by its leg.
    let mut points = table();
    points.extend(box_points((0.0, 0.05), (-0.6, 0.0), (0.0, 0.05)));
    let beneath = found(&points, Relation::Beneath);
    assert_ne!(beneath.at(Point2::new(0.02, -0.5)), Some(&true));
    assert_eq!(found(&points, Relation::On).at(Point2::new(0.02, -0.5)), Some(&true));
}

#[test]
fn beneath_what_is_lower_than_the_robot_is_nothing_known() {
    let stool = box_points((0.0, 0.4), (0.0, 0.4), (0.0, 0.4));
    assert!(matches!(
        footprint(&stool, Relation::Beneath, BAND, &Closing::default()),
        Err(OccupancyError::Nothing { n_points: 1.. })
    ));
    assert!(footprint(&stool, Relation::Near, BAND, &Closing::default()).is_ok());
}

#[test]
fn three_chairs_are_three_footprints() {
    let mut points = Vec::new();
    for chair in 0..3 {
        let x = f64::from(chair) * 0.8;
        points.extend(box_points((x, x + 0.45), (0.0, 0.45), (0.0, 0.9)));
    }
    let grid = found(&points, Relation::Near);
    assert_eq!(groups(&grid, 0.0).len(), 3);
    assert_eq!(grid.at(Point2::new(0.62, 0.2)), Some(&false));
}

#[test]
fn the_inner_corner_of_a_sofa_stays_free() {
    let mut points = box_points((0.0, 2.4), (0.0, 0.8), (0.0, 0.8));
    points.extend(box_points((0.0, 0.8), (0.8, 2.4), (0.0, 0.8)));
    let grid = found(&points, Relation::Near);
    assert_eq!(grid.at(Point2::new(1.6, 1.6)), Some(&false));
    assert_eq!(grid.at(Point2::new(1.2, 1.2)), Some(&false));
    assert_eq!(grid.at(Point2::new(0.4, 2.0)), Some(&true));
}

#[test]
fn floor_seen_between_the_legs_is_not_the_table_and_a_rug_is_a_rug() {
    let floor: Vec<Point3> =
        box_points((-1.0, 3.0), (-1.0, 2.0), (-0.01, 0.02)).into_iter().filter(|p| p.z > 0.0).collect();
    let mut points = table();
    points.extend(&floor);
    let truth = found(&table(), Relation::On);
    assert_eq!(cells(&found(&points, Relation::On)), cells(&truth));
    assert!(cells(&found(&floor, Relation::On)) >= 80 * 60);
}

#[test]
fn specks_and_things_that_are_no_points_are_left_out() {
    let mut points = table();
    points.push(Point3::new(4.0, 4.0, 1.0));
    points.push(Point3::new(4.02, 4.0, 1.0));
    assert_eq!(found(&points, Relation::Near).at(Point2::new(4.0, 4.0)), Some(&false));
    points.push(Point3::new(0.0, f64::NAN, 1.0));
    let error = footprint(&points, Relation::Near, BAND, &Closing::default());
    assert_eq!(error, Err(OccupancyError::NotFinite(points.len() - 1)));
    assert!(matches!(
        footprint(&[], Relation::Near, BAND, &Closing::default()),
        Err(OccupancyError::Nothing { .. })
    ));
    let far = [Point3::origin(), Point3::new(1e4, 0.0, 0.0)];
    assert!(matches!(
        footprint(&far, Relation::Near, BAND, &Closing::default()),
        Err(OccupancyError::Grid(_))
    ));
}

#[test]
fn merging_covers_every_occupied_cell_and_no_neighbour_of_an_aligned_one() {
    let source = found(&table(), Relation::Near);
    let same = Layout::covering(Point2::new(-1.0, -1.0), Point2::new(3.0, 3.0), 0.05).unwrap();
    let mut into = Grid::filled(same, false);
    merge_into(&mut into, &source);
    assert_eq!(cells(&into), cells(&source));
    let askew = Layout::new(Point2::new(-0.513, -0.521), 0.07, same.shape).unwrap();
    let mut into = Grid::filled(askew, false);
    merge_into(&mut into, &source);
    for cell in source.layout().cells().filter(|&c| *source.get(c)) {
        assert_eq!(into.at(source.layout().centre(cell)), Some(&true));
    }
}
