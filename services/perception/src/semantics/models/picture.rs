//! Images as models want them: another size, other numbers, another order.
//!
//! All sizes are pixels, all images row-major. Not here: which model wants what.

use anyhow::{Context, ensure};
use image::imageops::FilterType;
use image::{ImageBuffer, Rgb, RgbImage};

/// Largest side of an image that is taken, pixels.
const N_SIDE_MAX: u32 = 8192;

/// In which order a model wants the numbers of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// All reds, all greens, all blues: `3 × height × width`.
    Planes,
    /// Pixel by pixel: `height × width × 3`.
    Pixels,
}

/// The image of a frame.
///
/// # Errors
/// When the size is impossible or not that of the bytes.
pub fn picture(width: u32, height: u32, rgb: &[u8]) -> anyhow::Result<RgbImage> {
    let side = 1..=N_SIDE_MAX;
    ensure!(
        side.contains(&width) && side.contains(&height),
        "image of {width}×{height} pixels, each side must be 1 to {N_SIDE_MAX}"
    );
    let n_wanted = 3 * width as usize * height as usize;
    ensure!(rgb.len() == n_wanted, "image of {} bytes, must be {n_wanted}", rgb.len());
    ImageBuffer::from_raw(width, height, rgb.to_vec()).context("image")
}

/// Stretched to a size, bilinear (with smoothing when it shrinks).
#[must_use]
pub fn stretched(picture: &RgbImage, width: u32, height: u32) -> RgbImage {
    if picture.dimensions() == (width, height) {
        return picture.clone();
    }
    image::imageops::resize(picture, width, height, FilterType::Triangle)
}

/// How an image lies in a larger one of another aspect: scaled, then set down at an offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Letterbox {
    /// Pixels of the model for each pixel of the image.
    pub scale: f32,
    /// Columns before it.
    pub left: f32,
    /// Rows above it.
    pub top: f32,
}

/// Scaled without distortion into a size, in the middle of grey.
#[must_use]
pub fn letterboxed(picture: &RgbImage, width: u32, height: u32) -> (RgbImage, Letterbox) {
    let (from_width, from_height) = picture.dimensions();
    let scale = (f64::from(width) / f64::from(from_width)).min(f64::from(height) / f64::from(from_height));
    let scaled = |side: u32, limit: u32| ((f64::from(side) * scale).round() as u32).clamp(1, limit);
    let (in_width, in_height) = (scaled(from_width, width), scaled(from_height, height));
    let (left, top) = ((width - in_width) / 2, (height - in_height) / 2);
    let small = stretched(picture, in_width, in_height);
    if (in_width, in_height) == (width, height) {
        return (small, Letterbox { scale: scale as f32, left: 0.0, top: 0.0 });
    }
    // The grey that the family is trained with.
    let mut boxed = RgbImage::from_pixel(width, height, Rgb([114, 114, 114]));
    image::imageops::replace(&mut boxed, &small, i64::from(left), i64::from(top));
    (boxed, Letterbox { scale: scale as f32, left: left as f32, top: top as f32 })
}

/// The numbers of an image: `value · gain + offset` for each channel, value 0 to 255.
#[must_use]
pub fn numbers(picture: &RgbImage, order: Order, gain: [f32; 3], offset: [f32; 3]) -> Vec<f32> {
    let one = |channel: usize, pixel: &Rgb<u8>| {
        let value = pixel.0.get(channel).copied().unwrap_or(0);
        let (gain, offset) = (gain.get(channel).unwrap_or(&0.0), offset.get(channel).unwrap_or(&0.0));
        f32::from(value) * gain + offset
    };
    match order {
        Order::Planes => {
            (0..3).flat_map(|c| picture.pixels().map(move |p| (c, p))).map(|(c, p)| one(c, p)).collect()
        }
        Order::Pixels => {
            picture.pixels().flat_map(|p| (0..3).map(move |c| (c, p))).map(|(c, p)| one(c, p)).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wide_image_lies_in_the_middle_of_a_square_one() {
        let wide = RgbImage::from_pixel(8, 4, Rgb([255, 0, 0]));
        let (boxed, place) = letterboxed(&wide, 16, 16);
        assert_eq!(place, Letterbox { scale: 2.0, left: 0.0, top: 4.0 });
        assert_eq!(boxed.get_pixel(0, 3), &Rgb([114, 114, 114]));
        assert_eq!(boxed.get_pixel(0, 4), &Rgb([255, 0, 0]));
        assert_eq!(boxed.get_pixel(15, 11), &Rgb([255, 0, 0]));
        assert_eq!(boxed.get_pixel(15, 12), &Rgb([114, 114, 114]));
    }

    #[test]
    fn numbers_come_by_planes_or_by_pixels() {
        let two = picture(2, 1, &[10, 20, 30, 40, 50, 60]).unwrap();
        let check = |order, wanted: [f32; 6]| {
            assert_eq!(numbers(&two, order, [0.1; 3], [0.0, 1.0, 0.0]), wanted);
        };
        check(Order::Planes, [1.0, 4.0, 3.0, 6.0, 3.0, 6.0]);
        check(Order::Pixels, [1.0, 3.0, 3.0, 4.0, 6.0, 6.0]);
    }

    #[test]
    fn an_image_of_the_wrong_size_is_named() {
        let error = picture(2, 2, &[0; 11]).unwrap_err().to_string();
        assert_eq!(error, "image of 11 bytes, must be 12");
        assert!(picture(0, 2, &[]).unwrap_err().to_string().contains("0×2"));
    }
}
