//! One TOML file a service: the common part, and one section of its own. Checked at the door.
//!
//! Every error names the file, the key, the value and the limit. Unknown keys are refused; a safety limit
//! has no default; nothing is clamped.

use std::path::{Path, PathBuf};

use geometry::Profile;
use proto::{Invalid, Segment};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use sha2::{Digest, Sha256};

/// Longest configuration file, bytes.
const N_BYTES_MAX: u64 = 1024 * 1024;
/// The last place in the queue for the CPU.
const NICENESS_MAX: u8 = 19;

/// A service's own section.
pub trait Settings: DeserializeOwned + Serialize + Send + 'static {
    /// Name of the section, as in `[filter]`.
    const SECTION: &'static str;

    /// Checks what the types do not.
    ///
    /// # Errors
    /// [`Invalid`] names the key, the value and the limit.
    fn check(&self, profile: &Profile) -> Result<(), Invalid>;
}

/// What every service's file has in common.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Common {
    /// The robot's name on the network.
    pub robot: String,
    /// The robot's profile, a TOML file; relative to this file.
    pub profile: PathBuf,
    /// What is logged, as in `info` or `info,heedway_filter=debug`.
    pub log: String,
    /// How far behind others the process stands in the queue for the CPU: 0 (not at all) to 19. What may
    /// take its time leaves the CPU to what must be on time.
    #[serde(default)]
    pub niceness: u8,
    /// How the network is reached.
    pub network: Network,
}

/// How the network is reached.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Network {
    /// A zenoh json5 file to start from (TLS, access control); relative to this file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zenoh: Option<PathBuf>,
    /// `peer`, `client` or `router`.
    pub mode: String,
    /// Endpoints to connect to.
    #[serde(default)]
    pub connect: Vec<String>,
    /// Endpoints to listen on.
    #[serde(default)]
    pub listen: Vec<String>,
    /// Whether peers are looked for by multicast.
    pub multicast: bool,
}

/// A configuration, checked.
pub struct Loaded<S> {
    /// The common part.
    pub common: Common,
    /// The robot's name, fit for keys.
    pub robot: Segment,
    /// The robot's profile.
    pub profile: Profile,
    /// The service's own section.
    pub settings: S,
    /// Folder of the file: relative paths start here.
    pub folder: PathBuf,
    /// The effective configuration, as TOML.
    pub effective: String,
    /// SHA-256 of the effective configuration, hex.
    pub hash: String,
}

/// Why a configuration cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", file.display())]
pub struct ConfigError {
    file: PathBuf,
    reason: String,
}

impl ConfigError {
    fn new(file: &Path, reason: impl ToString) -> Self {
        ConfigError { file: file.to_owned(), reason: reason.to_string() }
    }
}

/// Reads and checks a service's configuration.
///
/// # Errors
/// [`ConfigError`] names the file, the key, the value and the limit.
pub fn load<S: Settings>(file: &Path) -> Result<Loaded<S>, ConfigError> {
    let fail = |reason: String| ConfigError::new(file, reason);
    let text = read_text(file)?;
    let mut table: toml::Table = toml::from_str(&text).map_err(|e| fail(e.to_string()))?;
    let section =
        table.remove(S::SECTION).ok_or_else(|| fail(format!("section `[{}]` is missing", S::SECTION)))?;
    let settings: S = section.try_into().map_err(|e| fail(format!("[{}]: {e}", S::SECTION)))?;
    let common: Common = table.try_into().map_err(|e| fail(e.to_string()))?;

    let folder = file.parent().map(Path::to_owned).unwrap_or_default();
    let profile_file = folder.join(&common.profile);
    let profile = load_profile(&profile_file)?;
    let robot = Segment::new(&common.robot).map_err(|e| fail(format!("robot: {e}")))?;
    if !["peer", "client", "router"].contains(&common.network.mode.as_str()) {
        let mode = &common.network.mode;
        return Err(fail(format!("network.mode is {mode:?}, must be peer, client or router")));
    }
    if common.niceness > NICENESS_MAX {
        return Err(fail(format!("niceness is {}, must be 0 to {NICENESS_MAX}", common.niceness)));
    }
    settings.check(&profile).map_err(|e| fail(format!("[{}]: {e}", S::SECTION)))?;

    let effective = effective(&common, &profile, &settings).map_err(|e| fail(e.to_string()))?;
    let hash = Sha256::digest(effective.as_bytes()).iter().map(|b| format!("{b:02x}")).collect();
    Ok(Loaded { common, robot, profile, settings, folder, effective, hash })
}

/// Reads and checks a robot's profile.
///
/// # Errors
/// [`ConfigError`] names the file, the key, the value and the limit.
pub fn load_profile(file: &Path) -> Result<Profile, ConfigError> {
    let profile: Profile = toml::from_str(&read_text(file)?).map_err(|e| ConfigError::new(file, e))?;
    profile.checked().map_err(|e| ConfigError::new(file, e))
}

fn read_text(file: &Path) -> Result<String, ConfigError> {
    let fail = |reason: String| ConfigError::new(file, reason);
    let n_bytes = std::fs::metadata(file).map_err(|e| fail(e.to_string()))?.len();
    if n_bytes > N_BYTES_MAX {
        return Err(fail(format!("{n_bytes} bytes, at most {N_BYTES_MAX}")));
    }
    std::fs::read_to_string(file).map_err(|e| fail(e.to_string()))
}

fn effective<S: Settings>(
    common: &Common,
    profile: &Profile,
    settings: &S,
) -> Result<String, toml::ser::Error> {
    let mut table = toml::Table::try_from(common)?;
    table.insert("profile".into(), toml::Value::try_from(profile)?);
    table.insert(S::SECTION.into(), toml::Value::try_from(settings)?);
    toml::to_string(&table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Sample {
        rate_hz: f64,
    }

    impl Settings for Sample {
        const SECTION: &'static str = "sample";

        fn check(&self, _: &Profile) -> Result<(), Invalid> {
            proto::codec::within("rate_hz", self.rate_hz, 1.0, 100.0)
        }
    }

    const COMMON: &str = "robot = \"r1\"\nprofile = \"sim.toml\"\nlog = \"info\"\n\
        [network]\nmode = \"peer\"\nmulticast = false\n";

    #[track_caller]
    fn check(text: &str, wanted: Result<f64, &[&str]>) {
        let folder = tempfile::tempdir().unwrap();
        let profile = toml::to_string(&Profile::sim()).unwrap();
        std::fs::write(folder.path().join("sim.toml"), profile).unwrap();
        let file = folder.path().join("sample.toml");
        std::fs::write(&file, text).unwrap();
        match (load::<Sample>(&file), wanted) {
            (Ok(loaded), Ok(rate_hz)) => assert_eq!(loaded.settings.rate_hz, rate_hz),
            (Err(e), Err(words)) => {
                let said = e.to_string();
                for word in words.iter().chain(&["sample.toml"]) {
                    assert!(said.contains(word), "{said:?} does not name {word:?}");
                }
            }
            (Ok(_), Err(words)) => panic!("accepted, but must be refused for {words:?}"),
            (Err(e), Ok(_)) => panic!("refused: {e}"),
        }
    }

    #[test]
    fn a_good_file_is_read() {
        check(&format!("{COMMON}[sample]\nrate_hz = 20.0\n"), Ok(20.0));
    }

    #[test]
    fn an_error_names_file_key_value_and_limit() {
        check(&format!("{COMMON}[sample]\nrate_hz = 200.0\n"), Err(&["rate_hz", "200", "1 to 100"]));
        check(&format!("{COMMON}[sample]\nrate_hz = nan\n"), Err(&["rate_hz", "NaN", "1 to 100"]));
        check(&format!("{COMMON}[sample]\n"), Err(&["rate_hz"]));
        check(&format!("{COMMON}[sample]\nrate_hz = 20.0\nspeed = 1\n"), Err(&["speed", "unknown"]));
        check(&format!("{COMMON}\n"), Err(&["[sample]", "missing"]));
        check(&format!("extra = 1\n{COMMON}[sample]\nrate_hz = 20.0\n"), Err(&["extra", "unknown"]));
        check(
            &format!("niceness = 20\n{COMMON}[sample]\nrate_hz = 20.0\n"),
            Err(&["niceness", "20", "0 to 19"]),
        );
        let odd = COMMON.replace("\"r1\"", "\"r/1\"");
        check(&format!("{odd}[sample]\nrate_hz = 20.0\n"), Err(&["robot", "r/1"]));
        let odd = COMMON.replace("\"peer\"", "\"pear\"");
        check(&format!("{odd}[sample]\nrate_hz = 20.0\n"), Err(&["mode", "pear", "client"]));
    }

    #[test]
    fn a_missing_file_is_named() {
        let e = load::<Sample>(Path::new("/nowhere/filter.toml")).err().unwrap();
        assert!(e.to_string().contains("/nowhere/filter.toml"));
    }
}
