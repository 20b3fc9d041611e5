//! What is seen through an object is not the object: the carpet between the bars of a chair's back.
//!
//! Segments have the outline of a thing; models rarely cut out what shows through it. Depth tells: a small
//! patch of a segment that lies behind what is all around it belongs to something else. Parts that lie behind
//! for another reason stay: a table's far half beyond a chair has that chair beside it, which is another
//! segment, and a seat behind an armrest is no small part.

use super::Segments;
use crate::image::{DepthImage, ImageError};

/// Neighbours whose depths differ by more than this, relative to depth, are not of one surface.
const JUMP: f32 = 0.04;
/// Around a hole, depth is missing for some pixels: so far is looked across, pixels.
const REACH_PX: usize = 5;
/// A neighbour is in front from this on, relative to depth, …
const FRONT: f32 = 0.05;
/// … and at least this, millimetres.
const FRONT_MM: f32 = 80.0;
/// A patch of more than this share of its segment is a part of it.
const SHARE_MAX: f32 = 0.15;
/// A patch is seen through when this share of its border has its own segment in front of it. A far leg beside a
/// near one has it on one side and above, a hole between bars all around.
const BORDER_SHARE: f32 = 0.6;

impl Segments {
    /// The segments without what is seen through them; those pixels belong to none.
    ///
    /// Linear in the number of pixels.
    ///
    /// # Errors
    /// [`ImageError::Size`] when depth is of another size.
    pub fn without_seen_through(&self, depth: &DepthImage<'_>) -> Result<Segments, ImageError> {
        if (depth.width(), depth.height()) != (self.width, self.height) {
            return Err(ImageError::Size {
                what: "depth image",
                found_width: depth.width(),
                found_height: depth.height(),
                width: self.width,
                height: self.height,
            });
        }
        let image = Image {
            labels: &self.labels,
            depth_mm: depth.depth_mm(),
            width: self.width as usize,
            height: self.height as usize,
        };
        let mut n_pixels = vec![0_u32; usize::from(self.n_segments) + 1];
        for (label, depth_mm) in self.labels.iter().zip(depth.depth_mm()) {
            n_pixels[usize::from(*label)] += u32::from(*depth_mm > 0);
        }
        let mut labels = self.labels.clone();
        let mut seen = vec![false; labels.len()];
        let mut patch = Vec::new();
        for start in 0..labels.len() {
            let label = self.labels[start];
            if seen[start] || label == 0 || image.depth_mm[start] == 0 {
                continue;
            }
            image.grow(start, &mut seen, &mut patch);
            let share = patch.len() as f32 / n_pixels[usize::from(label)].max(1) as f32;
            if share <= SHARE_MAX && image.is_seen_through(&patch) {
                patch.iter().for_each(|&idx| labels[idx] = 0);
            }
        }
        Ok(Segments { labels, ..self.clone() })
    }
}

struct Image<'a> {
    labels: &'a [u16],
    depth_mm: &'a [u16],
    width: usize,
    height: usize,
}

impl Image<'_> {
    /// The pixels of one surface of one segment, from one of them on.
    fn grow(&self, start: usize, seen: &mut [bool], patch: &mut Vec<usize>) {
        patch.clear();
        patch.push(start);
        seen[start] = true;
        let mut next = 0;
        while let Some(&at) = patch.get(next) {
            next += 1;
            for neighbour in self.neighbours(at, 1).into_iter().flatten() {
                if !seen[neighbour] && self.is_of_surface(at, neighbour) {
                    seen[neighbour] = true;
                    patch.push(neighbour);
                }
            }
        }
    }

    fn is_of_surface(&self, at: usize, neighbour: usize) -> bool {
        let (here, there) = (f32::from(self.depth_mm[at]), f32::from(self.depth_mm[neighbour]));
        self.labels[at] == self.labels[neighbour] && there > 0.0 && (there - here).abs() <= JUMP * here
    }

    /// The pixels so far left, right, above and below.
    fn neighbours(&self, at: usize, far: usize) -> [Option<usize>; 4] {
        let (col, row) = (at % self.width, at / self.width);
        [
            (col >= far).then(|| at - far),
            (col + far < self.width).then(|| at + far),
            (row >= far).then(|| at - far * self.width),
            (row + far < self.height).then(|| at + far * self.width),
        ]
    }

    /// Whether most of a patch's border has its own segment in front of it.
    fn is_seen_through(&self, patch: &[usize]) -> bool {
        let (mut n_border, mut n_front) = (0_u32, 0_u32);
        for &at in patch {
            let here = f32::from(self.depth_mm[at]);
            for side in 0..4 {
                let on = self.neighbours(at, 1)[side];
                // Inside the patch, or at the image's end.
                if on.is_none_or(|on| self.is_of_surface(at, on)) {
                    continue;
                }
                n_border += 1;
                let across = (1..=REACH_PX).filter_map(|far| self.neighbours(at, far)[side]);
                let other = across.take_while(|&idx| self.labels[idx] == self.labels[at]);
                let first = other.map(|idx| f32::from(self.depth_mm[idx])).find(|mm| *mm > 0.0);
                let is_front = |there: f32| here - there > (FRONT * here).max(FRONT_MM);
                n_front += u32::from(first.is_some_and(is_front));
            }
        }
        n_border > 0 && n_front as f32 >= BORDER_SHARE * n_border as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 40;
    const HEIGHT: usize = 30;

    /// One segment over all but a border of five pixels, 1.5 m away, with a window of `size` at 3 m in it.
    fn chair(size: usize, window_label: u16) -> (Segments, Vec<u16>) {
        let (mut labels, mut depth_mm) = (vec![0_u16; WIDTH * HEIGHT], vec![4000_u16; WIDTH * HEIGHT]);
        for row in 5..25 {
            for col in 5..35 {
                labels[row * WIDTH + col] = 1;
                depth_mm[row * WIDTH + col] = 1500;
            }
        }
        for row in 10..10 + size {
            for col in 10..10 + size {
                labels[row * WIDTH + col] = window_label;
                depth_mm[row * WIDTH + col] = 3000;
            }
        }
        (Segments::new(WIDTH as u32, HEIGHT as u32, labels, 2).unwrap(), depth_mm)
    }

    fn n_of(segments: &Segments, depth_mm: &[u16]) -> usize {
        let depth = DepthImage::new(WIDTH as u32, HEIGHT as u32, depth_mm).unwrap();
        let cut = segments.without_seen_through(&depth).unwrap();
        cut.labels().iter().filter(|label| **label == 1).count()
    }

    #[test]
    fn a_window_in_a_segment_is_cut_out_and_a_large_part_behind_is_not() {
        let (segments, depth_mm) = chair(6, 1);
        assert_eq!(n_of(&segments, &depth_mm), 600 - 36);
        let (segments, depth_mm) = chair(13, 1);
        assert_eq!(n_of(&segments, &depth_mm), 600);
    }

    #[test]
    fn missing_depth_around_a_window_does_not_hide_it() {
        let (segments, mut depth_mm) = chair(6, 1);
        for row in 8..18 {
            for col in [8, 9, 16, 17] {
                depth_mm[row * WIDTH + col] = 0;
            }
        }
        assert_eq!(n_of(&segments, &depth_mm), 600 - 36);
    }

    #[test]
    fn what_lies_behind_another_thing_stays() {
        // A strip of the segment, far away, beside a nearer thing that is another segment.
        let (mut labels, mut depth_mm) = (vec![1_u16; WIDTH * HEIGHT], vec![1500_u16; WIDTH * HEIGHT]);
        for row in 0..HEIGHT {
            for col in 30..40 {
                let idx = row * WIDTH + col;
                (labels[idx], depth_mm[idx]) = if col < 37 { (2, 1000) } else { (1, 2500) };
            }
        }
        let segments = Segments::new(WIDTH as u32, HEIGHT as u32, labels, 2).unwrap();
        assert_eq!(n_of(&segments, &depth_mm), 33 * HEIGHT);
    }

    #[test]
    fn depth_of_another_size_is_refused() {
        let (segments, _) = chair(6, 1);
        let depth = DepthImage::new(2, 2, &[0; 4]).unwrap();
        assert!(matches!(segments.without_seen_through(&depth), Err(ImageError::Size { .. })));
    }
}
