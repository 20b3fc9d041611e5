//! The two model roles, answered from an instance image as real models would answer them.
//!
//! Segments have exact borders, and say nothing about what they show. Heat maps are coarse and blurred,
//! and know the words. Both err at settable rates, drawn from a seed and the frame's number: objects that
//! are missed, objects taken for what they are not, segments that fall apart. Not here: who asks, and how
//! (`lib`).

use rand::RngExt;

use crate::nouns;
use crate::raycast::{INSTANCE_NONE, INSTANCE_OBJECTS, InstanceImage};
use crate::scene::Scene;
use crate::sensor_noise::draws;

/// Pixels of the image along each side of one cell of a heat map, about: 640 × 480 gives 88 × 66.
const CELL_PIXELS: f64 = 640.0 / 88.0;
/// Passes of the 3 × 3 mean over a heat map: a blur of about one cell and a half.
const N_BLURS: usize = 3;

/// How often the models err; none by default.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct ModelErrors {
    /// Share of (frame, object) pairs in which a heat map misses an object that is meant.
    pub missed: f64,
    /// Share of (frame, phrase) pairs in which some other visible object is taken for it.
    pub wrong: f64,
    /// Share of (frame, segment) pairs in which a segment falls into two.
    pub split: f64,
}

/// The oracle behind both roles.
#[derive(Clone, Debug)]
pub struct Oracle {
    labels: Vec<String>,
    errors: ModelErrors,
    seed: u64,
}

/// One heat map a phrase.
#[derive(Clone, Debug, PartialEq)]
pub struct Heat {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Probability, 0 to 255; `phrases × height × width`, row-major.
    pub values: Vec<u8>,
}

/// A panoptic segmentation.
#[derive(Clone, Debug, PartialEq)]
pub struct Panoptic {
    /// Number of segments.
    pub n_segments: u16,
    /// Label of each pixel, from 1; 0 is none.
    pub labels: Vec<u16>,
}

impl Heat {
    /// One map for each set of instances that are hot, as coarse and blurred as a model's.
    #[must_use]
    pub fn of_instances(image: &InstanceImage, hot: &[Vec<bool>]) -> Heat {
        let cells = |pixels: u32| ((f64::from(pixels) / CELL_PIXELS).round() as u32).clamp(1, 1024);
        let (width, height) = (cells(image.width), cells(image.height));
        let mut values = Vec::with_capacity(hot.len() * (width * height) as usize);
        for hot in hot {
            let mut map = shares(image, hot, width, height);
            for _ in 0..N_BLURS {
                map = blurred(&map, width as usize, height as usize);
            }
            values.extend(map.iter().map(|share| (share * 255.0).round().clamp(0.0, 255.0) as u8));
        }
        Heat { width, height, values }
    }
}

impl Oracle {
    /// An oracle that knows the scene's labels.
    #[must_use]
    pub fn new(scene: &Scene, errors: ModelErrors, seed: u64) -> Self {
        // By instance: nothing, floor, walls, objects.
        let stuff = ["", "floor", "wall"].into_iter().map(String::from);
        let labels = stuff.chain(scene.objects.iter().map(|o| o.label.clone())).collect();
        Oracle { labels, errors, seed }
    }

    /// Segments with exact borders: one a visible instance, of which some fall in two.
    #[must_use]
    pub fn segments(&self, image: &InstanceImage, frame: u64) -> Panoptic {
        let boxes = self.column_spans(image);
        let mut random = draws(self.seed, "segments", frame);
        let mut label_of_instance = vec![(0_u16, 0_u16, u32::MAX); boxes.len()];
        let mut n_segments = 0_u16;
        for ((label, span), instance) in label_of_instance.iter_mut().zip(&boxes).zip(0_u16..) {
            let splits = random.random::<f64>() < self.errors.split;
            let Some((first, last)) = span.filter(|_| instance != INSTANCE_NONE) else { continue };
            n_segments += 1;
            *label = (n_segments, n_segments, u32::MAX);
            if splits && first < last {
                n_segments += 1;
                *label = (n_segments - 1, n_segments, u32::midpoint(first, last));
            }
        }
        let columns = (0..image.width).cycle();
        let labelled = |(instance, column): (&u16, u32)| {
            let (left, right, seam) =
                label_of_instance.get(usize::from(*instance)).copied().unwrap_or_default();
            if column <= seam { left } else { right }
        };
        Panoptic { n_segments, labels: image.instances.iter().zip(columns).map(labelled).collect() }
    }

    /// First and last column of each instance; `None` for those that are not seen.
    fn column_spans(&self, image: &InstanceImage) -> Vec<Option<(u32, u32)>> {
        let mut spans: Vec<Option<(u32, u32)>> = vec![None; self.labels.len()];
        for (instance, column) in image.instances.iter().zip((0..image.width).cycle()) {
            if let Some(span) = spans.get_mut(usize::from(*instance)) {
                let (first, last) = span.unwrap_or((column, column));
                *span = Some((first.min(column), last.max(column)));
            }
        }
        spans
    }

    /// One coarse, blurred map a phrase.
    #[must_use]
    pub fn heat(&self, image: &InstanceImage, frame: u64, phrases: &[String]) -> Heat {
        Heat::of_instances(image, &self.hot_instances(image, frame, phrases))
    }

    /// For each phrase and each instance, whether this frame's map of the phrase shows it.
    #[must_use]
    pub fn hot_instances(&self, image: &InstanceImage, frame: u64, phrases: &[String]) -> Vec<Vec<bool>> {
        let visible: Vec<bool> = self.column_spans(image).iter().map(Option::is_some).collect();
        let hot = |(idx, phrase): (usize, &String)| self.hot_for(phrase, &visible, frame, idx);
        phrases.iter().enumerate().map(hot).collect()
    }

    fn hot_for(&self, phrase: &str, visible: &[bool], frame: u64, idx: usize) -> Vec<bool> {
        let labels: Vec<&str> = self.labels.iter().map(String::as_str).collect();
        let mut hot = nouns::meant(phrase, &labels);
        let mut random = draws(self.seed, "heat", frame.wrapping_mul(257).wrapping_add(idx as u64));
        for is_hot in &mut hot {
            *is_hot &= random.random::<f64>() >= self.errors.missed;
        }
        if random.random::<f64>() < self.errors.wrong {
            let others: Vec<usize> = (usize::from(INSTANCE_OBJECTS)..hot.len())
                .filter(|k| visible.get(*k) == Some(&true) && hot.get(*k) == Some(&false))
                .collect();
            let pick = (random.random::<f64>() * others.len() as f64) as usize;
            if let Some(is_hot) = others.get(pick).and_then(|k| hot.get_mut(*k)) {
                *is_hot = true;
            }
        }
        hot
    }
}

/// The share of each cell's pixels that show a hot instance.
fn shares(image: &InstanceImage, hot: &[bool], width: u32, height: u32) -> Vec<f32> {
    let mut n_hot = vec![0_u32; (width * height) as usize];
    let mut n_all = n_hot.clone();
    let n_columns = image.width.max(1) as usize;
    for (row, pixels) in (0_u64..).zip(image.instances.chunks(n_columns)) {
        let cell_row = row * u64::from(height) / u64::from(image.height.max(1));
        for (column, instance) in (0_u64..).zip(pixels) {
            let cell_column = column * u64::from(width) / n_columns as u64;
            let cell = (cell_row * u64::from(width) + cell_column) as usize;
            n_all[cell] += 1;
            n_hot[cell] += u32::from(hot.get(usize::from(*instance)) == Some(&true));
        }
    }
    n_hot.iter().zip(n_all).map(|(hot, all)| *hot as f32 / all.max(1) as f32).collect()
}

/// The mean over each cell and its neighbours.
fn blurred(map: &[f32], width: usize, height: usize) -> Vec<f32> {
    let mean = |row: usize, column: usize| {
        let (mut sum, mut n) = (0.0, 0.0);
        for r in row.saturating_sub(1)..(row + 2).min(height) {
            for c in column.saturating_sub(1)..(column + 2).min(width) {
                sum += map[r * width + c];
                n += 1.0;
            }
        }
        sum / n
    };
    (0..height).flat_map(|row| (0..width).map(move |column| (row, column))).map(|(r, c)| mean(r, c)).collect()
}
