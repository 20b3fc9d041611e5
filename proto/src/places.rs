//! Named places: rooms and other areas that people speak of, as polygons in the map.
//!
//! One form for the file that an operator keeps and for the key by which they are told. Deliberately not
//! here: which rule means which place (`perception`).

use serde::{Deserialize, Serialize};

use crate::codec::{Encoding, Invalid, Message, within};
use crate::motion::COORDINATE_M_MAX;

/// Most places.
pub const N_PLACES_MAX: usize = 256;
/// Most corners of one place.
pub const N_CORNERS_MAX: usize = 256;
/// Longest name, characters.
const NAME_CHARS_MAX: usize = 120;
/// Most further names of one place.
const N_NAMES_MAX: usize = 16;
/// Longest side of the box around a place, metres. Chosen: a hall of a large warehouse.
const SIDE_M_MAX: f64 = 200.0;
/// Smallest place, square metres; less is a slip of the hand.
const AREA_M2_MIN: f64 = 1e-4;

/// Every named place. Replaces what was told before.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Places {
    /// The epoch of the map they were drawn in; without one they hold in every map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_epoch: Option<u64>,
    /// The places.
    #[serde(default)]
    pub places: Vec<Place>,
}

/// One place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// What people call it: "kitchen", "room 3".
    pub name: String,
    /// What else they call it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub also: Vec<String>,
    /// What kind of place it is, for rules about all of a kind: "room"; empty when nobody speaks of it so.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub kind: String,
    /// Its corners in `map`, metres, in order around it, the first not repeated.
    pub polygon_map: Vec<[f64; 2]>,
}

impl Message for Places {
    const NAME: &'static str = "Places";
    const ENCODING: Encoding = Encoding::Json;
    const N_BYTES_MAX: usize = 4 * 1024 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        if self.places.len() > N_PLACES_MAX {
            return Err(Invalid::new("places", self.places.len(), format_args!("at most {N_PLACES_MAX}")));
        }
        self.places.iter().try_for_each(Place::check)
    }
}

impl Place {
    fn check(&self) -> Result<(), Invalid> {
        if self.name.trim().is_empty() {
            return Err(Invalid::new("place.name", "empty", "what people call it"));
        }
        within("number of other names", self.also.len() as f64, 0.0, N_NAMES_MAX as f64)?;
        for name in [&self.name, &self.kind].into_iter().chain(&self.also) {
            within("length of a place's name", name.chars().count() as f64, 0.0, NAME_CHARS_MAX as f64)?;
        }
        let corners = &self.polygon_map;
        within("corners of a place", corners.len() as f64, 3.0, N_CORNERS_MAX as f64)?;
        for [x_m, y_m] in corners {
            within("polygon_map.x", *x_m, -COORDINATE_M_MAX, COORDINATE_M_MAX)?;
            within("polygon_map.y", *y_m, -COORDINATE_M_MAX, COORDINATE_M_MAX)?;
        }
        for axis in 0..2 {
            let values = || corners.iter().filter_map(|corner| corner.get(axis));
            let low = values().copied().fold(f64::INFINITY, f64::min);
            let high = values().copied().fold(f64::NEG_INFINITY, f64::max);
            within("side of a place", high - low, 0.0, SIDE_M_MAX)?;
        }
        let area_m2 = twice_area_m2(corners).abs() / 2.0;
        if area_m2 < AREA_M2_MIN || crosses_itself(corners) {
            let found = format!("that of {:?}, {area_m2} m²", self.name);
            return Err(Invalid::new("polygon_map", found, "an outline around an area, not crossing itself"));
        }
        Ok(())
    }
}

/// The sides of an outline: each corner with the next.
fn sides(corners: &[[f64; 2]]) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + Clone + '_ {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

fn twice_area_m2(corners: &[[f64; 2]]) -> f64 {
    sides(corners).map(|([ax, ay], [bx, by])| ax * by - bx * ay).sum()
}

/// Whether two sides cut each other: an outline that does covers less than was meant.
fn crosses_itself(corners: &[[f64; 2]]) -> bool {
    let turn = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
        let [ax, ay] = a;
        // Its sign tells the side; touching is no crossing.
        (b[0] - ax) * (c[1] - ay) - (b[1] - ay) * (c[0] - ax)
    };
    let cut = |(a, b): ([f64; 2], [f64; 2]), (c, d): ([f64; 2], [f64; 2])| {
        turn(a, b, c) * turn(a, b, d) < 0.0 && turn(c, d, a) * turn(c, d, b) < 0.0
    };
    sides(corners).enumerate().any(|(idx, one)| sides(corners).skip(idx + 1).any(|other| cut(one, other)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(polygon_map: &[[f64; 2]]) -> Places {
        let kitchen = Place {
            name: "kitchen".into(),
            also: vec![],
            kind: "room".into(),
            polygon_map: polygon_map.to_vec(),
        };
        Places { map_epoch: None, places: vec![kitchen] }
    }

    #[track_caller]
    fn check(polygon_map: &[[f64; 2]], field: Option<&str>) {
        let found = place(polygon_map).check().err().map(|invalid| invalid.field);
        assert_eq!(found, field);
    }

    #[test]
    fn an_outline_has_an_area_and_does_not_cross_itself() {
        check(&[[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 2.0]], None);
        check(&[[0.0, 0.0], [0.0, 2.0], [3.0, 2.0], [1.0, 1.0]], None);
        check(&[[0.0, 0.0], [3.0, 2.0], [3.0, 0.0], [0.0, 2.0]], Some("polygon_map"));
        check(&[[0.0, 0.0], [3.0, 0.0], [6.0, 0.0]], Some("polygon_map"));
        check(&[[0.0, 0.0], [3.0, 0.0]], Some("corners of a place"));
        check(&[[0.0, 0.0], [f64::NAN, 0.0], [1.0, 1.0]], Some("polygon_map.x"));
        check(&[[0.0, 0.0], [201.0, 0.0], [1.0, 1.0]], Some("side of a place"));
    }

    #[test]
    fn a_place_without_a_name_is_refused() {
        let mut places = place(&[[0.0, 0.0], [3.0, 0.0], [3.0, 2.0]]);
        places.places[0].name = " ".into();
        assert_eq!(places.check().unwrap_err().field, "place.name");
    }
}
