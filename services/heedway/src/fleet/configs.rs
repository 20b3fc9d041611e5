//! The configurations of a fleet: the shipped ones, with this fleet's own facts filled in.
//!
//! What is filled in is set in the parsed tables, and only where the shipped file has the key already:
//! a key that has been renamed there is an error here, not a silent default.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use toml::{Table, Value};

use super::{FleetOptions, Method, Planner, SceneSource};
use crate::carry::ServiceName;

/// The office scene, as built in.
pub const OFFICE_SCENE: &str = include_str!("../../../../scenes/office.json");

const PROFILE_FILE: &str = "profile.toml";
const SCENE_FILE: &str = "scene.json";

/// What this fleet's configurations have of their own.
pub(super) struct Facts<'a> {
    /// Where they are written.
    pub folder: &'a Path,
    /// The robot's name.
    pub robot: &'a str,
    /// Where the services meet.
    pub endpoint: &'a str,
    /// What was asked for.
    pub options: &'a FleetOptions,
}

/// The profile that is shipped for the simulated robot, as TOML.
#[must_use]
pub fn shipped_profile() -> &'static str {
    include_str!("../../../../deploy/profiles/sim.toml")
}

fn shipped_config(name: ServiceName) -> &'static str {
    match name {
        ServiceName::Simulator => include_str!("../../../../deploy/config/sim/simulator.toml"),
        ServiceName::Localisation => include_str!("../../../../deploy/config/sim/localisation.toml"),
        ServiceName::Semantics => include_str!("../../../../deploy/config/sim/semantics.toml"),
        ServiceName::Language => include_str!("../../../../deploy/config/sim/language.toml"),
        ServiceName::Filter => include_str!("../../../../deploy/config/sim/filter.toml"),
        ServiceName::Navigator => include_str!("../../../../deploy/config/sim/navigator.toml"),
    }
}

/// Writes what several services read: the profile, and the scene when it is built in.
pub(super) fn write_shared(facts: &Facts<'_>) -> anyhow::Result<()> {
    write(&facts.folder.join(PROFILE_FILE), shipped_profile())?;
    if facts.options.scene == SceneSource::Office {
        write(&facts.folder.join(SCENE_FILE), OFFICE_SCENE)?;
    }
    Ok(())
}

/// Writes the configuration of one service; gives its path.
pub(super) fn write_config(name: ServiceName, facts: &Facts<'_>) -> anyhow::Result<PathBuf> {
    let table = filled_in(name, facts).with_context(|| format!("configuration of {name}"))?;
    let path = facts.folder.join(format!("{name}.toml"));
    write(&path, &toml::to_string(&table)?)?;
    Ok(path)
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| format!("write {}", path.display()))
}

fn filled_in(name: ServiceName, facts: &Facts<'_>) -> anyhow::Result<Table> {
    let mut table: Table = toml::from_str(shipped_config(name))?;
    let options = facts.options;
    set(&mut table, &["robot"], facts.robot)?;
    set(&mut table, &["profile"], PROFILE_FILE)?;
    set(&mut table, &["network", "mode"], "peer")?;
    set(&mut table, &["network", "multicast"], false)?;
    set(&mut table, &["network", "connect"], vec![facts.endpoint])?;
    set(&mut table, &["network", "listen"], vec!["tcp/127.0.0.1:0"])?;
    match name {
        ServiceName::Simulator => {
            set(&mut table, &["simulator", "scene"], scene_path(&options.scene)?)?;
            set(&mut table, &["simulator", "seed"], i64::try_from(options.seed)?)?;
        }
        ServiceName::Language => set(&mut table, &["language", "journal"], "rules.redb")?,
        ServiceName::Filter => {
            if let Some(method) = options.method {
                set(&mut table, &["filter", "method"], method_word(method))?;
            }
        }
        ServiceName::Navigator => {
            set(&mut table, &["navigator", "planner"], planner_word(options.planner))?;
        }
        ServiceName::Localisation | ServiceName::Semantics => {}
    }
    for change in options.changes.iter().filter(|change| change.service == name) {
        let path: Vec<&str> = change.key.split('.').collect();
        put(&mut table, &path, change.value.clone())?;
    }
    Ok(table)
}

fn scene_path(scene: &SceneSource) -> anyhow::Result<String> {
    match scene {
        SceneSource::Office => Ok(SCENE_FILE.to_owned()),
        SceneSource::File(path) => {
            let path = path.canonicalize().with_context(|| format!("scene {}", path.display()))?;
            Ok(path.to_str().with_context(|| format!("scene {}: not UTF-8", path.display()))?.to_owned())
        }
    }
}

fn method_word(method: Method) -> &'static str {
    match method {
        Method::SmoothBlending => "smooth_blending",
        Method::LeastRestrictive => "least_restrictive",
        Method::PaperLiteral => "paper_literal",
        Method::PaperLiteralBlending => "paper_literal_blending",
    }
}

fn planner_word(planner: Planner) -> &'static str {
    match planner {
        Planner::Base => "base",
        Planner::Rules => "base_and_rules",
    }
}

/// Sets a key that is there already.
fn set(table: &mut Table, path: &[&str], value: impl Into<Value>) -> anyhow::Result<()> {
    let missing = || anyhow!("the shipped file has no key {}", path.join("."));
    let (last, sections) = path.split_last().ok_or_else(missing)?;
    let mut place = table;
    for section in sections {
        place = place.get_mut(*section).and_then(Value::as_table_mut).ok_or_else(missing)?;
    }
    *place.get_mut(*last).ok_or_else(missing)? = value.into();
    Ok(())
}

/// Sets a key, with the sections that it wants: the service itself refuses what it does not know.
fn put(table: &mut Table, path: &[&str], value: Value) -> anyhow::Result<()> {
    let (last, sections) = path.split_last().ok_or_else(|| anyhow!("a key of no name cannot be set"))?;
    let mut place = table;
    for section in sections {
        let inner = place.entry(*section).or_insert_with(|| Value::Table(Table::new()));
        place = inner.as_table_mut().ok_or_else(|| anyhow!("{section} of {} has no keys", path.join(".")))?;
    }
    place.insert((*last).to_owned(), value);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::Change;
    use super::*;
    use geometry::Profile;

    fn table_of(name: ServiceName, options: &FleetOptions) -> Table {
        let folder = Path::new("/nowhere");
        let facts = Facts { folder, robot: "demo-1", endpoint: "tcp/127.0.0.1:4", options };
        filled_in(name, &facts).unwrap()
    }

    #[test]
    fn every_service_meets_at_the_fleet_s_own_endpoint_without_multicast() {
        let options = FleetOptions::office(PathBuf::from("heedway"));
        for name in ServiceName::ALL {
            let table = table_of(name, &options);
            assert_eq!(table["robot"].as_str(), Some("demo-1"), "{name}");
            let network = table["network"].as_table().unwrap();
            assert_eq!(network["connect"], Value::from(vec!["tcp/127.0.0.1:4"]), "{name}");
            assert_eq!(network["multicast"], Value::from(false), "{name}");
        }
    }

    #[test]
    fn what_was_asked_for_reaches_the_services() {
        let options = FleetOptions {
            planner: Planner::Base,
            method: Some(Method::LeastRestrictive),
            seed: 42,
            changes: vec![Change {
                service: ServiceName::Simulator,
                key: "simulator.models.missed".into(),
                value: Value::from(0.25),
            }],
            ..FleetOptions::office(PathBuf::from("heedway"))
        };
        let found = |name, key: &str| table_of(name, &options)[name.as_str()][key].clone();
        assert_eq!(found(ServiceName::Simulator, "seed"), Value::from(42));
        assert_eq!(found(ServiceName::Simulator, "models")["missed"], Value::from(0.25));
        assert_eq!(found(ServiceName::Filter, "method"), Value::from("least_restrictive"));
        assert_eq!(found(ServiceName::Navigator, "planner"), Value::from("base"));
    }

    #[test]
    fn a_change_is_said_as_a_key_and_a_value_of_toml() {
        let change = |text: &str| text.parse::<Change>().map_err(|e| format!("{e:#}"));
        assert_eq!(
            change("filter.disturbance.yaw_rad=0.02").unwrap(),
            Change {
                service: ServiceName::Filter,
                key: "filter.disturbance.yaw_rad".into(),
                value: Value::from(0.02)
            }
        );
        assert_eq!(change("language.parser=\"llm\"").unwrap().value, Value::from("llm"));
        for (text, words) in [
            ("filter.rate_hz", "not KEY=VALUE"),
            ("robot=1", "\"robot\" is no service: simulator"),
            ("filter.rate_hz=fast", "value of filter.rate_hz"),
        ] {
            assert!(change(text).unwrap_err().contains(words), "{text}: {:?}", change(text));
        }
    }

    #[test]
    fn a_change_may_add_a_section_but_not_to_what_has_none() {
        let mut table: Table = toml::from_str("[semantics]\nmodels = \"remote\"\n").unwrap();
        put(&mut table, &["semantics", "yolo", "model"], Value::from("a.onnx")).unwrap();
        put(&mut table, &["semantics", "models"], Value::from("yolo")).unwrap();
        assert_eq!(table["semantics"]["yolo"]["model"].as_str(), Some("a.onnx"));
        assert_eq!(table["semantics"]["models"].as_str(), Some("yolo"));
        assert!(put(&mut table, &["semantics", "models", "yolo"], Value::from(1)).is_err());
    }

    #[test]
    fn the_shipped_profiles_are_those_of_the_geometry() {
        let read = |text: &str| toml::from_str::<Profile>(text).unwrap().checked().unwrap();
        assert_eq!(read(shipped_profile()), Profile::sim());
        assert_eq!(read(include_str!("../../../../deploy/profiles/turtlebot2.toml")), Profile::turtlebot2());
    }

    #[test]
    fn a_key_that_the_shipped_file_does_not_have_is_an_error() {
        let mut table: Table = toml::from_str("[simulator]\nscene = \"a\"\n").unwrap();
        set(&mut table, &["simulator", "scene"], "b").unwrap();
        assert_eq!(table["simulator"]["scene"].as_str(), Some("b"));
        for path in [&["simulator", "sceene"][..], &["simulation", "scene"], &["scene"]] {
            assert!(set(&mut table, path, "c").is_err(), "{path:?}");
        }
    }
}
