//! Pixels of one image file: depth as 16-bit PNG or PGM, colour as PNG or JPEG.

use std::path::Path;

use anyhow::{Context, bail, ensure};
use image::DynamicImage;

use super::bytes;

/// What the 7-Scenes sensor writes where it saw nothing.
const NO_DEPTH_MM: u16 = u16::MAX;
/// Most pixels along one side of an image.
const N_PIXELS_SIDE_MAX: u32 = mapping::image::N_PIXELS_SIDE_MAX;

/// Width, height and depth of each pixel, millimetres, row-major, 0 where there is none.
///
/// # Errors
/// Names the file and what is wrong with it.
pub(super) fn depth_mm(file: &Path) -> anyhow::Result<(u32, u32, Vec<u16>)> {
    let place = || file.display().to_string();
    let found = bytes(file)?;
    let (width, height, mut depth_mm) = if found.starts_with(b"P5") {
        pgm_16_bit(&found).with_context(place)?
    } else {
        match decoded(&found).with_context(place)? {
            DynamicImage::ImageLuma16(image) => (image.width(), image.height(), image.into_raw()),
            other => bail!("{}: {:?} pixels, depth is 16 bit grey", place(), other.color()),
        }
    };
    for pixel in &mut depth_mm {
        if *pixel == NO_DEPTH_MM {
            *pixel = 0;
        }
    }
    Ok((width, height, depth_mm))
}

/// Width, height and red, green, blue of each pixel, row-major.
///
/// # Errors
/// Names the file and what is wrong with it.
pub(super) fn rgb(file: &Path) -> anyhow::Result<(u32, u32, Vec<u8>)> {
    let image = decoded(&bytes(file)?).with_context(|| file.display().to_string())?.into_rgb8();
    Ok((image.width(), image.height(), image.into_raw()))
}

fn decoded(found: &[u8]) -> anyhow::Result<DynamicImage> {
    let mut reader = image::ImageReader::new(std::io::Cursor::new(found)).with_guessed_format()?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(N_PIXELS_SIDE_MAX);
    limits.max_image_height = Some(N_PIXELS_SIDE_MAX);
    reader.limits(limits);
    Ok(reader.decode()?)
}

/// A binary PGM with two bytes a pixel, the high one first.
fn pgm_16_bit(found: &[u8]) -> anyhow::Result<(u32, u32, Vec<u16>)> {
    let mut rest = found.get(2..).unwrap_or_default();
    let mut header = [0_u32; 3];
    for (value, name) in header.iter_mut().zip(["width", "height", "largest value"]) {
        rest = after_space_and_comments(rest);
        let n_digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
        let (digits, after) = rest.split_at(n_digits);
        *value = std::str::from_utf8(digits)?.parse().with_context(|| format!("{name} of the PGM"))?;
        rest = after;
    }
    let [width, height, largest] = header;
    ensure!((256..=65535).contains(&largest), "largest value {largest}, depth is 16 bit (256 to 65535)");
    let side = 1..=N_PIXELS_SIDE_MAX;
    ensure!(
        side.contains(&width) && side.contains(&height),
        "{width}×{height} pixels, each side must be 1 to {N_PIXELS_SIDE_MAX}"
    );
    // One white space ends the header.
    let pixels = rest.get(1..).unwrap_or_default();
    let wanted = width as usize * height as usize * 2;
    ensure!(pixels.len() >= wanted, "{} bytes of pixels, {wanted} wanted", pixels.len());
    let pairs = pixels.chunks_exact(2).take(wanted / 2);
    let values = pairs.filter_map(|pair| Some(u16::from_be_bytes(pair.try_into().ok()?)));
    Ok((width, height, values.collect()))
}

fn after_space_and_comments(mut rest: &[u8]) -> &[u8] {
    loop {
        rest = rest.trim_ascii_start();
        if !rest.starts_with(b"#") {
            return rest;
        }
        let end = rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
        rest = rest.get(end..).unwrap_or_default();
    }
}
