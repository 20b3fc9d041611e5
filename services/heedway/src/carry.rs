//! Every service in one binary: `heedway service NAME --config FILE [--check]`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, ValueEnum};

/// A service, by its name on the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, ValueEnum)]
pub enum ServiceName {
    /// A robot in a scene, and its ground truth.
    Simulator,
    /// Base map and pose.
    Localisation,
    /// The regions that rules speak of.
    Semantics,
    /// Words to rules.
    Language,
    /// The nominal command to a safe one.
    Filter,
    /// Where to go next.
    Navigator,
}

impl ServiceName {
    /// Every service, in an order in which they may be started; any other order works too.
    pub const ALL: [ServiceName; 6] = [
        ServiceName::Simulator,
        ServiceName::Localisation,
        ServiceName::Semantics,
        ServiceName::Language,
        ServiceName::Filter,
        ServiceName::Navigator,
    ];

    /// The name, as on the network, on the command line and of its configuration's section.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            ServiceName::Simulator => "simulator",
            ServiceName::Localisation => "localisation",
            ServiceName::Semantics => "semantics",
            ServiceName::Language => "language",
            ServiceName::Filter => "filter",
            ServiceName::Navigator => "navigator",
        }
    }
}

impl std::fmt::Display for ServiceName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Arguments of `heedway service`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// Which service.
    name: ServiceName,
    /// Its configuration, a TOML file.
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// Only check the configuration.
    #[arg(long)]
    check: bool,
}

/// Runs one service to its end. It starts its own runtime: do not call this from within another.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    let Some(file) = arguments.config.to_str() else {
        eprintln!("heedway: --config {}: not UTF-8", arguments.config.display());
        return ExitCode::from(service::life::EXIT_USAGE);
    };
    let mut words = vec!["--config".to_owned(), file.to_owned()];
    if arguments.check {
        words.push("--check".to_owned());
    }
    match arguments.name {
        ServiceName::Simulator => service::run_with("heedway-simulator", &words, heedway_simulator::serve),
        ServiceName::Localisation => {
            service::run_with("heedway-localisation", &words, heedway_perception::localisation::serve)
        }
        ServiceName::Semantics => {
            service::run_with("heedway-semantics", &words, heedway_perception::semantics::serve)
        }
        ServiceName::Language => service::run_with("heedway-language", &words, heedway_language::serve),
        ServiceName::Filter => service::run_with("heedway-filter", &words, heedway_filter::serve),
        ServiceName::Navigator => service::run_with("heedway-navigator", &words, heedway_navigator::serve),
    }
}
