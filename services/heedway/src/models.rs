//! `heedway models`: which models a robot's semantics uses, whether they are there and right, and where to get
//! what is missing.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use heedway_perception::semantics::Settings;
use heedway_perception::semantics::config::ModelSource;
use heedway_perception::semantics::models::folder::{library_for, yolo_in};
use heedway_perception::semantics::models::inventory::{self, Item};
use heedway_perception::semantics::models::manifest;
use service::life::EXIT_FAILED;

/// Arguments of `heedway models`.
#[derive(Args, Debug)]
#[group(required = true, multiple = false)]
pub struct Arguments {
    /// The configuration of semantics.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// A folder of models, as `heedway ground` takes it.
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
}

/// Prints what is configured; fails when something is missing or wrong.
///
/// # Errors
/// When the configuration or the folder cannot be read.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let (source, items) = match (&arguments.config, &arguments.models) {
        (Some(file), _) => {
            let loaded = service::config::load::<Settings>(file)?;
            (loaded.settings.models, inventory::of(&loaded.settings, &loaded.folder))
        }
        (None, Some(folder)) if folder.join(manifest::FILE).exists() => {
            (ModelSource::Clipseg, inventory::clipseg(&library_for(folder), folder))
        }
        (None, Some(folder)) => (ModelSource::Yolo, inventory::yolo(&library_for(folder), &yolo_in(folder)?)),
        (None, None) => anyhow::bail!("one of --config and --models is needed"),
    };
    let is_good = items.iter().all(|item| item.state.is_ok());
    say(&text(source, &items));
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::from(EXIT_FAILED) })
}

/// What is printed.
fn text(source: ModelSource, items: &[Item]) -> String {
    let mut text = match source {
        ModelSource::Remote => {
            "models = \"remote\": whoever answers on the robot's network; nothing is needed here".to_owned()
        }
        ModelSource::Yolo => "models = \"yolo\"".to_owned(),
        ModelSource::Clipseg => "models = \"clipseg\"".to_owned(),
    };
    for item in items {
        let (mark, words) = match &item.state {
            Ok(words) => ("ok     ", words),
            Err(words) => ("MISSING", words),
        };
        text.push_str(&format!("\n{mark} {}: {}\n        {words}", item.role, item.file.display()));
        if item.state.is_err() {
            text.push_str(&format!("\n        get it: {}", item.where_to_get));
        }
    }
    text
}

/// Output is this command's purpose.
#[allow(clippy::print_stdout, reason = "the command's result goes to standard output")]
fn say(text: &str) {
    println!("{text}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_comes_with_where_to_get_it() {
        let item = |state: Result<&str, &str>| Item {
            role: "objects".into(),
            file: "m.onnx".into(),
            state: state.map(str::to_owned).map_err(str::to_owned),
            where_to_get: "the shop".into(),
        };
        let good = text(ModelSource::Yolo, &[item(Ok("3 MB"))]);
        assert!(good.contains("ok      objects: m.onnx") && !good.contains("the shop"), "{good}");
        let bad = text(ModelSource::Yolo, &[item(Err("no such file"))]);
        assert!(
            bad.contains("MISSING objects") && bad.contains("no such file") && bad.contains("the shop"),
            "{bad}"
        );
    }
}
