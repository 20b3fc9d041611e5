//! The window against asking every layer, wherever the robot goes.

use geometry::Point2;
use mapping::{DistanceField, Layout, Shape};
use proptest::prelude::*;

use super::*;

/// The field of a disc on a lattice of 5 cm, `first` cells from the origin.
fn disc(first: (i32, i32), n_side: usize, centre: (f64, f64), radius_m: f64) -> Arc<DistanceField> {
    let origin = Point2::new(0.05 * f64::from(first.0), 0.05 * f64::from(first.1));
    let layout = Layout::new(origin, 0.05, Shape { n_cols: n_side, n_rows: n_side }).unwrap();
    let centre = Point2::new(centre.0, centre.1);
    let values = layout.cells().map(|cell| ((layout.centre(cell) - centre).norm() - radius_m) as f32);
    Arc::new(DistanceField::from_values(layout, values.collect()).unwrap())
}

/// A layer: where its field begins, its disc, and what is subtracted.
fn layers() -> impl Strategy<Value = Vec<(Arc<DistanceField>, f64)>> {
    let layer = ((-40..40_i32, -40..40_i32), (-3.0..3.0_f64, -3.0..3.0_f64), 0.05..0.8_f64, 0.1..0.6_f64);
    let made = layer.prop_map(|(first, centre, radius_m, keep_m)| {
        (disc((first.0 - 60, first.1 - 60), 160, centre, radius_m), keep_m)
    });
    prop::collection::vec(made, 1..9)
}

fn hold(window: &mut Window, layers: &[(Arc<DistanceField>, f64)]) {
    let mut n_taken = 0;
    window.hold(layers.iter().enumerate().map(|(k, (field, keep_m))| (k, field, *keep_m)), |k, bit| {
        assert_eq!(k, usize::from(bit));
        n_taken += 1;
    });
    assert_eq!(n_taken, layers.len());
}

fn least_m(layers: &[(Arc<DistanceField>, f64)], place: Point2, mask: u64) -> f64 {
    let asked = layers.iter().enumerate().filter(|(bit, _)| mask >> bit & 1 == 1);
    asked.map(|(_, (field, keep_m))| field.sample(place) - keep_m).fold(f64::INFINITY, f64::min)
}

proptest! {
    #[test]
    fn the_layers_of_the_mask_hold_the_smallest_margin_of_all(
        first in layers(), second in layers(),
        places in prop::collection::vec((-30.0..30.0_f64, -30.0..30.0_f64, any::<bool>()), 1..60),
    ) {
        let mut window = Window::on(Isa::detect());
        // Maps change under way, and the window wraps around: what was built before must not count.
        for layers in [&first, &second, &first] {
            hold(&mut window, layers);
            for (x, y, is_near) in &places {
                let share = if *is_near { 0.1 } else { 1.0 };
                let place = Point2::new(x * share, y * share);
                let (found, wanted) =
                    (least_m(layers, place, window.mask(place)), least_m(layers, place, u64::MAX));
                prop_assert!((found - wanted).abs() < 1e-9, "{place}: {found} {wanted}");
            }
        }
    }
}

#[test]
fn a_layer_on_another_lattice_is_left_to_be_asked() {
    let first = disc((0, 0), 40, (1.0, 1.0), 0.2);
    let layout = Layout::new(Point2::new(0.013, 0.0), 0.05, Shape { n_cols: 40, n_rows: 40 }).unwrap();
    let other = Arc::new(DistanceField::from_values(layout, vec![1.0; 1600]).unwrap());
    let mut window = Window::on(Isa::detect());
    for _ in 0..2 {
        let mut taken = Vec::new();
        window.hold([(0, &first, 0.1), (1, &other, 0.1), (2, &first, 0.2)].into_iter(), |k, bit| {
            taken.push((k, bit));
        });
        assert_eq!(taken, [(0, 0), (2, 1)]);
    }
}

#[test]
fn a_place_that_is_none_asks_every_layer() {
    let field = disc((0, 0), 40, (1.0, 1.0), 0.2);
    let mut window = Window::on(Isa::detect());
    hold(&mut window, &[(field, 0.1)]);
    assert_eq!(window.mask(Point2::new(f64::NAN, 0.0)), u64::MAX);
}
