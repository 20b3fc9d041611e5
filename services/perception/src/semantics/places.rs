//! Named places: rules about "the kitchen" or "room 3" get their region from the operator's polygons.
//!
//! They need no camera and are never searched for. A name is taken as it was said first, then by its class
//! noun, then as a kind ("every room except the office"). Deliberately not here: what a relation makes of
//! a footprint ([`super::regions`]).

use std::path::Path;

use anyhow::Context;
use geometry::Point2;
use mapping::{Grid, Layout};
use proto::Message;
use proto::places::Place;
use rules::Rule;

/// Longest file of places, bytes.
const N_BYTES_MAX: u64 = 4 * 1024 * 1024;

/// The named places, with the cells that each covers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Places {
    map_epoch: Option<u64>,
    areas: Vec<Area>,
}

/// One place.
#[derive(Clone, Debug, PartialEq)]
struct Area {
    names: Vec<String>,
    kind: String,
    footprint: Grid<bool>,
}

/// What a rule's phrase means among the places.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The cells of all places that it means.
    pub footprint: Grid<bool>,
    /// Whether what the rule excepts was left out already.
    pub excepts_honoured: bool,
}

impl Places {
    /// The places of a file.
    ///
    /// # Errors
    /// When it cannot be read, or holds anything but places; the message names the file.
    pub fn load(file: &Path, resolution_m: f64) -> anyhow::Result<Places> {
        let place = || format!("semantics.places: {}", file.display());
        let n_bytes = std::fs::metadata(file).with_context(place)?.len();
        anyhow::ensure!(n_bytes <= N_BYTES_MAX, "{}: {n_bytes} bytes, at most {N_BYTES_MAX}", place());
        let text = std::fs::read_to_string(file).with_context(place)?;
        let told: proto::Places = toml::from_str(&text).with_context(place)?;
        told.check().with_context(place)?;
        Ok(Places::of(&told, resolution_m))
    }

    /// Places as they were told; their numbers are checked by then.
    #[must_use]
    pub fn of(told: &proto::Places, resolution_m: f64) -> Places {
        let areas = told.places.iter().filter_map(|place| Area::of(place, resolution_m)).collect();
        Places { map_epoch: told.map_epoch, areas }
    }

    /// Those that hold in a map of this epoch.
    #[must_use]
    pub fn in_map(&self, map_epoch: u64) -> Option<&Places> {
        self.map_epoch.is_none_or(|drawn_in| drawn_in == map_epoch).then_some(self)
    }

    /// What a phrase of a rule means; none when it names no place.
    #[must_use]
    pub fn find(&self, rule: &Rule, phrase: &str) -> Option<Found> {
        let by_name = |wanted: &str| -> Vec<&Area> {
            let wanted = plain(wanted);
            self.areas.iter().filter(|area| area.names.contains(&wanted)).collect()
        };
        let mut meant = by_name(phrase);
        if meant.is_empty() && phrase == rule.phrase() {
            meant = by_name(&rule.obj);
        }
        let mut excepts_honoured = false;
        if meant.is_empty() {
            let excepted: Vec<Area> = rule.except.iter().flat_map(|name| by_name(name)).cloned().collect();
            let wanted = plain(&rule.obj);
            let of_kind = |area: &&Area| !wanted.is_empty() && area.kind == wanted;
            // Nothing is let off unless everything that was excepted is known.
            excepts_honoured = rule.except.iter().all(|name| !by_name(name).is_empty());
            meant = self.areas.iter().filter(of_kind).collect();
            if excepts_honoured {
                meant.retain(|area| !excepted.contains(area));
            }
        }
        let footprint = union(&meant)?;
        Some(Found { footprint, excepts_honoured })
    }

    /// Whether a phrase of a rule names a place: then nothing has to be searched for.
    #[must_use]
    pub fn holds(&self, rule: &Rule, phrase: &str) -> bool {
        self.find(rule, phrase).is_some()
    }
}

impl Area {
    fn of(place: &Place, resolution_m: f64) -> Option<Area> {
        let corners: Vec<Point2> = place.polygon_map.iter().map(|[x, y]| Point2::new(*x, *y)).collect();
        let first = *corners.first()?;
        let (low, high) = corners.iter().fold((first, first), |(low, high), c| (low.inf(c), high.sup(c)));
        let layout = Layout::covering(low, high, resolution_m).ok()?;
        let mut footprint = Grid::filled(layout, false);
        // A cell that the outline only touches is covered too.
        let touch_m = resolution_m * std::f64::consts::FRAC_1_SQRT_2;
        for cell in layout.cells() {
            let centre = layout.centre(cell);
            footprint.set(cell, is_inside(&corners, centre) || is_near_outline(&corners, centre, touch_m));
        }
        let names = std::iter::once(&place.name).chain(&place.also).map(|name| plain(name)).collect();
        Some(Area { names, kind: plain(&place.kind), footprint })
    }
}

/// All cells of several areas; none without any.
fn union(areas: &[&Area]) -> Option<Grid<bool>> {
    let layouts = || areas.iter().map(|area| area.footprint.layout());
    let resolution_m = layouts().next()?.resolution_m;
    let mut corners = layouts().flat_map(|layout| [layout.origin, layout.far_corner()]);
    let first = corners.next()?;
    let (low, high) = corners.fold((first, first), |(low, high), c| (low.inf(&c), high.sup(&c)));
    // Half a cell, so that rounding cannot cost the last row.
    let half = nalgebra::Vector2::repeat(resolution_m / 2.0);
    let mut all = Grid::filled(Layout::covering(low - half, high + half, resolution_m).ok()?, false);
    for area in areas {
        let layout = *area.footprint.layout();
        for cell in layout.cells().filter(|cell| *area.footprint.get(*cell)) {
            if let Some(target) = all.layout().cell_at(layout.centre(cell)) {
                all.set(target, true);
            }
        }
    }
    Some(all)
}

fn sides(corners: &[Point2]) -> impl Iterator<Item = (Point2, Point2)> + '_ {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

fn is_inside(corners: &[Point2], point: Point2) -> bool {
    let crossings = sides(corners).filter(|(a, b)| {
        (a.y > point.y) != (b.y > point.y) && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x)
    });
    crossings.count() % 2 == 1
}

fn is_near_outline(corners: &[Point2], point: Point2, distance_m: f64) -> bool {
    sides(corners).any(|(a, b)| {
        let along = b - a;
        let share = ((point - a).dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
        (point - (a + along * share)).norm() <= distance_m
    })
}

/// A name as it is compared: lower case, without articles, apostrophes and marks.
fn plain(name: &str) -> String {
    const ARTICLES: [&str; 8] = ["the", "a", "an", "my", "our", "your", "this", "that"];
    let lower = name.to_lowercase().replace(['\'', '\u{2019}'], "");
    let words = lower.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
    words.skip_while(|word| ARTICLES.contains(word)).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use rules::Relation;

    fn place(name: &str, also: &[&str], x_m: f64) -> Place {
        Place {
            name: name.into(),
            also: also.iter().map(|name| (*name).to_owned()).collect(),
            kind: "room".into(),
            polygon_map: vec![[x_m, 0.0], [x_m + 2.0, 0.0], [x_m + 2.0, 1.0], [x_m, 1.0]],
        }
    }

    fn home() -> Places {
        let places = vec![
            place("Kitchen", &["galley"], 0.0),
            place("room 3", &[], 4.0),
            place("kids' bedroom", &[], 8.0),
            place("office", &["study"], 12.0),
        ];
        Places::of(&proto::Places { map_epoch: Some(7), places }, 0.05)
    }

    fn rule(obj: &str, reference: &str, except: &[&str]) -> Rule {
        Rule {
            reference: reference.into(),
            except: except.iter().map(|name| (*name).to_owned()).collect(),
            ..Rule::exclusion(Relation::On, obj)
        }
    }

    /// Whether the rule covers the middle of the place that begins at `x_m`.
    fn covers(found: &Found, x_m: f64) -> bool {
        found.footprint.at(Point2::new(x_m + 1.0, 0.5)).is_some_and(|covered| *covered)
    }

    #[test]
    fn a_place_is_found_by_any_of_its_names() {
        for (obj, reference, x_m) in [
            ("kitchen", "kitchen", 0.0),
            ("kitchen", "the kitchen", 0.0),
            ("galley", "galley", 0.0),
            ("kitchen", "big kitchen", 0.0),
            ("room 3", "room 3", 4.0),
            ("bedroom", "kids bedroom", 8.0),
        ] {
            let rule = rule(obj, reference, &[]);
            let found = home().find(&rule, rule.phrase()).unwrap();
            assert!(covers(&found, x_m), "{reference}");
            let area_m2 = found.footprint.values().iter().filter(|covered| **covered).count() as f64 * 0.0025;
            assert!((1.9..2.4).contains(&area_m2), "{reference}: {area_m2} m²");
        }
        assert_eq!(home().find(&rule("sofa", "sofa", &[]), "sofa"), None);
        assert_eq!(home().find(&rule("room 4", "room 4", &[]), "room 4"), None);
    }

    #[test]
    fn a_kind_means_all_of_it_but_what_is_excepted_and_known() {
        let all = home().find(&rule("room", "room", &["study"]), "room").unwrap();
        assert!(all.excepts_honoured && covers(&all, 0.0) && covers(&all, 8.0) && !covers(&all, 12.0));
        let unknown = home().find(&rule("room", "room", &["attic"]), "room").unwrap();
        assert!(!unknown.excepts_honoured && covers(&unknown, 12.0));
    }

    #[test]
    fn places_of_another_map_do_not_hold() {
        assert!(home().in_map(7).is_some());
        assert!(home().in_map(8).is_none());
    }

    #[test]
    fn no_point_inside_an_outline_is_left_uncovered() {
        let triangle =
            Place { polygon_map: vec![[0.0, 0.0], [1.0, 0.013], [0.31, 0.9]], ..place("a", &[], 0.0) };
        let corners: Vec<Point2> = triangle.polygon_map.iter().map(|[x, y]| Point2::new(*x, *y)).collect();
        let area = Area::of(&triangle, 0.05).unwrap();
        for idx in 0..10_000 {
            let point = Point2::new(f64::from(idx % 100) / 99.0, f64::from(idx / 100) / 99.0);
            if is_inside(&corners, point) {
                assert_eq!(area.footprint.at(point), Some(&true), "{point}");
            }
        }
    }

    #[test]
    fn a_file_is_read_and_a_bad_one_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("places.toml");
        let good = "[[places]]\nname = \"kitchen\"\npolygon_map = [[0, 0], [2, 0], [2, 1]]\n";
        std::fs::write(&file, good).unwrap();
        let kitchen = rule("kitchen", "kitchen", &[]);
        assert!(Places::load(&file, 0.05).unwrap().holds(&kitchen, "kitchen"));
        for (bad, word) in
            [("[[places]]\nname = 3\n", "name"), (&good.replace("[2, 1]", "[4, 0]"), "outline")]
        {
            std::fs::write(&file, bad).unwrap();
            let error = format!("{:#}", Places::load(&file, 0.05).unwrap_err());
            assert!(error.contains("places.toml") && error.contains(word), "{error}");
        }
    }
}
