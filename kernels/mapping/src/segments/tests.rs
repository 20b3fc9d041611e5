use proptest::prelude::*;

use super::*;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const WALL: u16 = 1;
const FLOOR: u16 = 2;

/// A picture of wall above, floor below, and rectangles (columns, rows) with labels from 3.
fn picture(things: &[([usize; 2], [usize; 2])]) -> Vec<u16> {
    let mut labels: Vec<u16> =
        (0..WIDTH * HEIGHT).map(|idx| if idx / WIDTH < 110 { WALL } else { FLOOR }).collect();
    for (thing, (cols, rows)) in things.iter().enumerate() {
        for row in rows[0]..rows[1] {
            labels[row * WIDTH + cols[0]..row * WIDTH + cols[1]].fill(thing as u16 + 3);
        }
    }
    labels
}

fn segments(labels: &[u16]) -> Segments {
    let n = *labels.iter().max().unwrap();
    Segments::new(WIDTH as u32, HEIGHT as u32, labels.to_vec(), n).unwrap()
}

/// What a model would say of the pixels that are `hot`: one value for 7 × 7 pixels, blurred by two cells.
fn heat(hot: impl Fn(usize) -> f32) -> HeatMap {
    let (n_cols, n_rows) = (WIDTH / 7, HEIGHT / 7);
    let mean = |cell: usize| {
        let (col, row) = (cell % n_cols * 7, cell / n_cols * 7);
        (0..49).map(|p| hot((row + p / 7) * WIDTH + col + p % 7)).sum::<f32>() / 49.0
    };
    let sharp: Vec<f32> = (0..n_cols * n_rows).map(mean).collect();
    let blurred = |cell: usize| {
        let (mut sum, mut weight) = (0.0, 0.0);
        for off in 0..81_i64 {
            let (dx, dy) = (off % 9 - 4, off / 9 - 4);
            let (col, row) = ((cell % n_cols) as i64 + dx, (cell / n_cols) as i64 + dy);
            if (0..n_cols as i64).contains(&col) && (0..n_rows as i64).contains(&row) {
                let w = (-((dx * dx + dy * dy) as f32) / 8.0).exp();
                weight += w;
                sum += w * sharp[row as usize * n_cols + col as usize];
            }
        }
        (sum / weight).clamp(0.0, 1.0)
    };
    HeatMap::new(n_cols as u32, n_rows as u32, (0..sharp.len()).map(blurred).collect()).unwrap()
}

fn chosen(labels: &[u16], hot: &[u16], rule: Fusion) -> Option<Vec<u16>> {
    let heat = heat(|idx| f32::from(u8::from(hot.contains(&labels[idx]))));
    fuse(&heat, &segments(labels), rule).map(|fused| fused.segments)
}

const CHAIRS: [([usize; 2], [usize; 2]); 3] =
    [([30, 80], [90, 160]), ([130, 180], [95, 170]), ([230, 280], [90, 150])];

#[test]
fn three_chairs_that_are_each_a_third_of_the_heat_are_all_kept() {
    let labels = picture(&CHAIRS);
    assert_eq!(chosen(&labels, &[3, 4, 5], Fusion::default()), Some(vec![3, 4, 5]));
}

#[test]
fn the_papers_rule_loses_all_three() {
    let labels = picture(&CHAIRS);
    assert_eq!(chosen(&labels, &[3, 4, 5], Fusion::PaperIou { threshold: 0.5 }), None);
    // And finds one that is alone.
    assert_eq!(chosen(&labels, &[3], Fusion::PaperIou { threshold: 0.5 }), Some(vec![3]));
}

#[test]
fn one_of_three_chairs_is_one() {
    let labels = picture(&CHAIRS);
    assert_eq!(chosen(&labels, &[4], Fusion::default()), Some(vec![4]));
}

#[test]
fn an_object_split_into_pieces_is_kept_whole() {
    let pieces = [
        ([100, 150], [90, 130]),
        ([150, 220], [90, 130]),
        ([100, 220], [130, 150]),
        ([190, 220], [150, 200]),
    ];
    let labels = picture(&pieces);
    assert_eq!(chosen(&labels, &[3, 4, 5, 6], Fusion::default()), Some(vec![3, 4, 5, 6]));
}

#[test]
fn a_large_and_a_small_hot_spot_are_both_found() {
    let labels = picture(&[([20, 160], [60, 200]), ([250, 275], [120, 145])]);
    assert_eq!(chosen(&labels, &[3, 4], Fusion::default()), Some(vec![3, 4]));
}

#[test]
fn nothing_hot_is_nothing_found() {
    let labels = picture(&CHAIRS);
    assert_eq!(chosen(&labels, &[], Fusion::default()), None);
    let haze = heat(|_| 0.2);
    assert_eq!(fuse(&haze, &segments(&labels), Fusion::default()), None);
}

#[test]
fn heat_that_fits_no_segment_is_nothing_found() {
    // A hot spot in the middle of the wall: the wall is not the thing.
    let labels = picture(&[]);
    let spot = heat(|idx| f32::from(u8::from((100..160).contains(&(idx % WIDTH)) && idx / WIDTH < 60)));
    assert_eq!(fuse(&spot, &segments(&labels), Fusion::default()), None);
}

#[test]
fn the_mask_has_the_exact_border_and_confidence_follows_heat() {
    let labels = picture(&CHAIRS);
    let strong = heat(|idx| f32::from(u8::from(labels[idx] == 3)));
    let weak = heat(|idx| 0.5 * f32::from(u8::from(labels[idx] == 3)));
    let strong = fuse(&strong, &segments(&labels), Fusion::default()).unwrap();
    let weak = fuse(&weak, &segments(&labels), Fusion::default()).unwrap();
    for (bit, label) in strong.mask.bits().iter().zip(&labels) {
        assert_eq!(*bit, *label == 3);
    }
    assert!(strong.confidence > 0.5 && strong.confidence <= 1.0, "{}", strong.confidence);
    assert!(weak.confidence < 0.7 * strong.confidence);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn what_is_hot_is_chosen_and_background_is_not(
        col in 0..250_usize, row in 0..170_usize, width in 25..150_usize, height in 25..150_usize,
    ) {
        let (right, low) = ((col + width).min(WIDTH), (row + height).min(HEIGHT));
        // So large that it hides nearly all of the wall it stands before is another matter.
        let labels = picture(&[([col, right], [row, low])]);
        let found = chosen(&labels, &[3], Fusion::default());
        prop_assert_eq!(found, Some(vec![3]));
    }

    #[test]
    fn any_map_and_segments_are_answered(
        values in prop::collection::vec(0.0..=1.0_f32, 12), labels in prop::collection::vec(0..=4_u16, 35),
    ) {
        let heat = HeatMap::new(4, 3, values).unwrap();
        let segments = Segments::new(7, 5, labels, 4).unwrap();
        for rule in [Fusion::default(), Fusion::PaperIou { threshold: 0.2 }] {
            if let Some(fused) = fuse(&heat, &segments, rule) {
                prop_assert!((0.0..=1.0).contains(&fused.confidence));
                prop_assert!(fused.mask.n_set() > 0 && !fused.segments.contains(&0));
            }
        }
    }
}

#[test]
fn maps_that_cannot_be_are_refused() {
    assert!(matches!(HeatMap::new(2, 1, vec![0.5, f32::NAN]), Err(ImageError::Heat { idx: 1, .. })));
    assert!(matches!(HeatMap::new(2, 1, vec![0.5, 1.5]), Err(ImageError::Heat { .. })));
    assert!(matches!(HeatMap::new(2, 2, vec![0.5]), Err(ImageError::Length { .. })));
    let error = Segments::new(2, 1, vec![0, 3], 2).unwrap_err();
    assert_eq!(error.to_string(), "segment 3 at pixel 1, there are only 2");
}
