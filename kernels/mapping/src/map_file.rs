//! A base map as ROS's `map_server` keeps it: a PGM image and a YAML file beside it.
//!
//! In the image the first row is the map's last, white is free and black occupied; `origin` is the lower left
//! corner. Written maps are *trinary*: 254 free, 0 occupied, 205 unknown, so that reading gives back what was
//! written. Read maps may use any thresholds; rotated ones are refused, since no grid here is rotated.
//! Deliberately not here: files and folders.

use geometry::Point2;

use crate::grid::{Grid, GridError, Layout, N_CELLS_SIDE_MAX, Occupancy, Shape};

const FREE: u8 = 254;
const OCCUPIED: u8 = 0;
const UNKNOWN: u8 = 205;

/// A map that cannot be read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MapFileError {
    /// A key of the YAML that is missing.
    #[error("`{0}` is missing")]
    Missing(&'static str),
    /// A value of the YAML that cannot be.
    #[error("`{key}` is {value:?}, must be {limit}")]
    Value {
        /// Which.
        key: &'static str,
        /// What it is.
        value: String,
        /// What it must be.
        limit: &'static str,
    },
    /// An image that is no binary PGM of one byte a pixel.
    #[error("the image is no PGM of one byte a pixel: {0}")]
    Image(&'static str),
    /// A grid that cannot be.
    #[error(transparent)]
    Grid(#[from] GridError),
}

/// The image and the YAML of a map; `image` is the image's file name, relative to the YAML.
#[must_use]
pub fn encode(map: &Grid<Occupancy>, image: &str) -> (Vec<u8>, String) {
    let Layout { origin, resolution_m, shape } = *map.layout();
    let mut pgm = format!("P5\n{} {}\n255\n", shape.n_cols, shape.n_rows).into_bytes();
    for row in map.values().chunks_exact(shape.n_cols).rev() {
        pgm.extend(row.iter().map(|cell| match cell {
            Occupancy::Free => FREE,
            Occupancy::Occupied => OCCUPIED,
            Occupancy::Unknown => UNKNOWN,
        }));
    }
    let yaml = format!(
        "image: {image}\nmode: trinary\nresolution: {resolution_m}\norigin: [{}, {}, 0]\nnegate: 0\n\
         occupied_thresh: 0.65\nfree_thresh: 0.196\n",
        origin.x, origin.y
    );
    (pgm, yaml)
}

/// The image's file name that a YAML gives.
///
/// # Errors
/// [`MapFileError::Missing`] when it gives none.
pub fn image_name(yaml: &str) -> Result<&str, MapFileError> {
    value(yaml, "image")
}

/// The map of a YAML and its image.
///
/// # Errors
/// [`MapFileError`] names what is wrong.
pub fn decode(yaml: &str, pgm: &[u8]) -> Result<Grid<Occupancy>, MapFileError> {
    let resolution_m = number(yaml, "resolution", "a length in metres")?;
    let negate = value(yaml, "negate").unwrap_or("0");
    let is_negated = match negate {
        "0" | "false" => false,
        "1" | "true" => true,
        _ => {
            return Err(MapFileError::Value { key: "negate", value: negate.to_owned(), limit: "0 or 1" });
        }
    };
    let occupied_from = share(yaml, "occupied_thresh", 0.65)?;
    let free_until = share(yaml, "free_thresh", 0.196)?;
    let origin = origin(yaml)?;
    let (shape, pixels) = pixels(pgm)?;
    let layout = Layout::new(origin, resolution_m, shape)?;
    let mut values = Vec::with_capacity(shape.n_cells());
    for row in pixels.chunks_exact(shape.n_cols).rev() {
        values.extend(row.iter().map(|&pixel| {
            let dark = f64::from(if is_negated { pixel } else { 255 - pixel }) / 255.0;
            if dark > occupied_from {
                Occupancy::Occupied
            } else if dark < free_until {
                Occupancy::Free
            } else {
                Occupancy::Unknown
            }
        }));
    }
    Ok(Grid::from_values(layout, values)?)
}

/// The value of a key at the start of a line, without comment and quotes.
fn value<'a>(yaml: &'a str, key: &'static str) -> Result<&'a str, MapFileError> {
    let after = |line: &'a str| line.strip_prefix(key)?.trim_start().strip_prefix(':');
    let found = yaml.lines().find_map(after).ok_or(MapFileError::Missing(key))?;
    let found = found.split(" #").next().unwrap_or_default().trim();
    Ok(found.trim_matches(['"', '\'']))
}

fn number(yaml: &str, key: &'static str, limit: &'static str) -> Result<f64, MapFileError> {
    let found = value(yaml, key)?;
    let wrong = || MapFileError::Value { key, value: found.to_owned(), limit };
    found.parse().ok().filter(|n: &f64| n.is_finite()).ok_or_else(wrong)
}

fn share(yaml: &str, key: &'static str, otherwise: f64) -> Result<f64, MapFileError> {
    let limit = "0 to 1";
    let found = match number(yaml, key, limit) {
        Err(MapFileError::Missing(_)) => otherwise,
        other => other?,
    };
    let wrong = || MapFileError::Value { key, value: found.to_string(), limit };
    (0.0..=1.0).contains(&found).then_some(found).ok_or_else(wrong)
}

fn origin(yaml: &str) -> Result<Point2, MapFileError> {
    let found = value(yaml, "origin")?;
    let wrong = || MapFileError::Value {
        key: "origin",
        value: found.to_owned(),
        limit: "[x, y, 0]: metres, and no rotation",
    };
    let inner = found.strip_prefix('[').and_then(|f| f.strip_suffix(']')).ok_or_else(wrong)?;
    let parts: Vec<f64> = inner.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    match parts[..] {
        [x, y, yaw] if yaw.abs() < 1e-9 => Ok(Point2::new(x, y)),
        _ => Err(wrong()),
    }
}

/// Size and pixels of a binary PGM, first row on top.
fn pixels(pgm: &[u8]) -> Result<(Shape, &[u8]), MapFileError> {
    let mut rest = pgm.strip_prefix(b"P5").ok_or(MapFileError::Image("it does not begin with P5"))?;
    let mut header = [0_usize; 3];
    for value in &mut header {
        rest = after_space_and_comments(rest);
        let n_digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
        let digits = std::str::from_utf8(&rest[..n_digits]).unwrap_or_default();
        *value = digits.parse().map_err(|_| MapFileError::Image("its header is cut short"))?;
        rest = &rest[n_digits..];
    }
    let [n_cols, n_rows, largest] = header;
    if largest != 255 {
        return Err(MapFileError::Image("its largest value is not 255"));
    }
    if n_cols > N_CELLS_SIDE_MAX || n_rows > N_CELLS_SIDE_MAX {
        return Err(GridError::Shape { n_cols, n_rows }.into());
    }
    // One white space ends the header.
    let pixels = rest.get(1..).unwrap_or_default();
    let pixels = pixels.get(..n_cols * n_rows).ok_or(MapFileError::Image("it has too few pixels"))?;
    Ok((Shape { n_cols, n_rows }, pixels))
}

fn after_space_and_comments(mut rest: &[u8]) -> &[u8] {
    loop {
        rest = rest.trim_ascii_start();
        if !rest.starts_with(b"#") {
            return rest;
        }
        let end = rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
        rest = &rest[end..];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_was_written_is_read(
            n_cols in 1..20_usize, n_rows in 1..20_usize, x in -99.0..99.0, seed in any::<u64>(),
        ) {
            let layout = Layout::new(Point2::new(x, -3.25), 0.05, Shape { n_cols, n_rows }).unwrap();
            let cell = |idx: usize| match (seed >> (idx % 60)) % 3 {
                0 => Occupancy::Unknown,
                1 => Occupancy::Free,
                _ => Occupancy::Occupied,
            };
            let map = Grid::from_values(layout, (0..n_cols * n_rows).map(cell).collect()).unwrap();
            let (pgm, yaml) = encode(&map, "office.pgm");
            prop_assert_eq!(image_name(&yaml), Ok("office.pgm"));
            prop_assert_eq!(decode(&yaml, &pgm), Ok(map));
        }

        #[test]
        fn no_bytes_crash_it(pgm in prop::collection::vec(any::<u8>(), 0..80), yaml in "\\PC{0,80}") {
            let (_, good) = encode(&grid(), "a.pgm");
            let mut image = b"P5 4 2 255\n".to_vec();
            image.extend(&pgm);
            let (_, _, _) = (decode(&yaml, &image), decode(&good, &pgm), decode(&good, &image));
        }
    }

    fn grid() -> Grid<Occupancy> {
        let layout = Layout::new(Point2::origin(), 0.05, Shape { n_cols: 4, n_rows: 2 }).unwrap();
        Grid::filled(layout, Occupancy::Free)
    }

    #[test]
    fn a_map_as_others_write_it_is_read() {
        let yaml =
            "image: \"a b.pgm\" # drawn by hand\nresolution: 0.1\norigin: [-1.0, 2.5, 0.0]\nnegate: 0\n";
        let pgm = b"P5\n# CREATOR: somebody\n2 2\n255\n\xfe\x00\xcd\xff";
        let map = decode(yaml, pgm).unwrap();
        assert_eq!(image_name(yaml), Ok("a b.pgm"));
        assert_eq!(map.layout().origin, Point2::new(-1.0, 2.5));
        // The image's last row is the map's first.
        let (u, f, o) = (Occupancy::Unknown, Occupancy::Free, Occupancy::Occupied);
        assert_eq!(map.values(), [u, f, f, o]);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let (pgm, yaml) = encode(&grid(), "a.pgm");
        let check = |yaml: &str, pgm: &[u8], words: &str| {
            let refused = decode(yaml, pgm).unwrap_err().to_string();
            assert!(refused.contains(words), "{refused:?} does not say {words:?}");
        };
        check(&yaml.replace("resolution", "size"), &pgm, "`resolution` is missing");
        check(&yaml.replace("0.05", "nan"), &pgm, "`resolution` is \"nan\"");
        check(&yaml.replace(", 0]", ", 0.3]"), &pgm, "no rotation");
        check(&yaml.replace("0.65", "65"), &pgm, "`occupied_thresh` is \"65\"");
        check(&yaml, &pgm[..pgm.len() - 1], "too few pixels");
        check(&yaml, b"P6 1 1 255\n123", "does not begin with P5");
        check(&yaml, b"P5 99999 1 255\n", "grid of 99999");
    }
}
