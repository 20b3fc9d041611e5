//! Frames to masks to object maps; scans to base map and pose.
//!
//! One binary, two instances: a file with a section `[localisation]` starts [`localisation`], which must run
//! on the robot; one with `[semantics]` starts [`semantics`], which may run wherever the models are. They
//! share how odometry is looked up and nothing else. Deliberately not here: what a map means for motion
//! (`filter`), and the maths of maps (`mapping`).

use std::fs::File;
use std::io::Read;
use std::process::ExitCode;

use service::Settings;

pub mod ground;
pub mod localisation;
pub mod odometry_track;
pub mod recording;
pub mod semantics;
pub mod wire;

/// The process's name in usage and start-up errors.
const NAME: &str = "heedway-perception";
/// As much of a file is searched for its section; longer files are refused when they are read.
const N_BYTES_MAX: u64 = 1024 * 1024;

/// Which of the two services a configuration is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Instance {
    /// Scans to base map and pose.
    Localisation,
    /// Frames to object maps.
    Semantics,
}

impl Instance {
    /// The instance whose section a configuration holds; `None` when it holds neither or both.
    #[must_use]
    pub fn of(configuration: &str) -> Option<Self> {
        let holds = |section: &str| {
            let header = format!("[{section}]");
            configuration.lines().any(|line| line.trim_start().starts_with(&header))
        };
        let localisation = holds(localisation::Settings::SECTION);
        match (localisation, holds(semantics::Settings::SECTION)) {
            (true, false) => Some(Instance::Localisation),
            (false, true) => Some(Instance::Semantics),
            _ => None,
        }
    }
}

/// Runs the instance that the file in `--config FILE` is for, to its end.
pub fn run_with(arguments: &[String]) -> ExitCode {
    let file = match arguments {
        [flag, file, ..] if flag == "--config" => file,
        // Says how it is used.
        _ => return service::run_with(NAME, arguments, semantics::serve),
    };
    let mut text = Vec::new();
    if let Err(e) = File::open(file).and_then(|f| f.take(N_BYTES_MAX).read_to_end(&mut text)) {
        eprintln!("{NAME}: {file}: {e}");
        return ExitCode::from(service::life::EXIT_CONFIG);
    }
    match Instance::of(&String::from_utf8_lossy(&text)) {
        Some(Instance::Localisation) => service::run_with(NAME, arguments, localisation::serve),
        Some(Instance::Semantics) => service::run_with(NAME, arguments, semantics::serve),
        None => {
            eprintln!("{NAME}: {file}: must hold one of the sections `[localisation]` and `[semantics]`");
            ExitCode::from(service::life::EXIT_CONFIG)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_section_decides_which_service_it_is() {
        let common = "robot = \"r1\"\n[network]\nmode = \"peer\"\n";
        let check = |sections: &str, wanted| {
            assert_eq!(Instance::of(&format!("{common}{sections}")), wanted, "{sections}");
        };
        check("[localisation]\n", Some(Instance::Localisation));
        check("  [semantics] # here\n", Some(Instance::Semantics));
        check("# [semantics]\n[localisation]\n", Some(Instance::Localisation));
        check("", None);
        check("[semantics]\n[localisation]\n", None);
    }

    #[test]
    fn a_file_that_is_no_configuration_is_a_configuration_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("perception.toml");
        std::fs::write(&file, "robot = \"r1\"\n").unwrap();
        let run = |path: &std::path::Path| run_with(&["--config".into(), path.display().to_string()]);
        let refused = format!("{:?}", ExitCode::from(service::life::EXIT_CONFIG));
        assert_eq!(format!("{:?}", run(&file)), refused);
        assert_eq!(format!("{:?}", run(&folder.path().join("missing.toml"))), refused);
    }
}
