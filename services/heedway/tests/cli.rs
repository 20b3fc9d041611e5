//! The command line as a user meets it: exit codes, and errors that say what to change.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail")]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const USAGE: i32 = 64;
const CONFIG: i32 = 78;

const SERVICES: [&str; 6] = ["simulator", "localisation", "semantics", "language", "filter", "navigator"];

fn deploy() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy")
}

fn heedway(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_heedway")).args(arguments).stdin(Stdio::null()).output().unwrap()
}

fn with_input(arguments: &[&str], input: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_heedway"))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    child.wait_with_output().unwrap()
}

/// The command ends with `code`, and what it says on standard error holds all `words`.
#[track_caller]
fn check(arguments: &[&str], code: i32, words: &[&str]) {
    let output = heedway(arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "heedway {arguments:?} said: {said}");
    for word in words {
        assert!(said.contains(word), "heedway {arguments:?}: {said:?} does not name {word:?}");
    }
}

/// The shipped configuration of a service, with one line of it replaced.
fn changed(folder: &Path, service: &str, key: &str, line: &str) -> String {
    let shipped = deploy().join("config/sim").join(format!("{service}.toml"));
    let text = std::fs::read_to_string(shipped).unwrap();
    let is_key = |l: &&str| l.split('=').next().unwrap_or_default().trim() == key;
    assert_eq!(text.lines().filter(is_key).count(), 1, "{key} is not in {service}.toml exactly once");
    let change = |l: &str| if is_key(&l) { line.to_owned() } else { l.to_owned() };
    let text: Vec<String> = text.lines().map(change).collect();
    std::fs::create_dir_all(folder.join("config/sim")).unwrap();
    std::fs::create_dir_all(folder.join("profiles")).unwrap();
    std::fs::copy(deploy().join("profiles/sim.toml"), folder.join("profiles/sim.toml")).unwrap();
    let file = folder.join("config/sim").join(format!("{service}.toml"));
    std::fs::write(&file, text.join("\n")).unwrap();
    file.to_str().unwrap().to_owned()
}

#[test]
fn a_wrong_command_line_is_a_usage_error() {
    check(&[], USAGE, &["Usage"]);
    check(&["walk"], USAGE, &["walk"]);
    check(&["service"], USAGE, &["--config"]);
    check(&["service", "butler", "--config", "x.toml"], USAGE, &["butler", "filter", "navigator"]);
    check(&["service", "filter"], USAGE, &["--config"]);
    check(&["say"], USAGE, &["TEXT"]);
    check(&["demo", "--seed", "many"], USAGE, &["many", "--seed"]);
    check(&["parse", "--profile", "tank"], USAGE, &["tank", "turtlebot2"]);
}

#[test]
fn help_and_version_are_no_errors() {
    for arguments in [&["--help"][..], &["--version"], &["demo", "--help"], &["service", "--help"]] {
        let output = heedway(arguments);
        assert!(output.status.success(), "{arguments:?}");
        assert!(!output.stdout.is_empty(), "{arguments:?}");
    }
}

#[test]
fn every_shipped_configuration_is_good() {
    for robot in ["sim", "turtlebot2"] {
        let mut n_files = 0;
        for service in SERVICES {
            let file = deploy().join("config").join(robot).join(format!("{service}.toml"));
            if file.exists() {
                n_files += 1;
                check(&["service", service, "--config", file.to_str().unwrap(), "--check"], 0, &["is good"]);
            }
        }
        // A TurtleBot is not simulated.
        assert_eq!(n_files, if robot == "sim" { 6 } else { 5 }, "{robot}");
    }
}

#[test]
fn every_line_of_a_shipped_configuration_is_commented() {
    for robot in ["config/sim", "config/turtlebot2", "profiles"] {
        for entry in std::fs::read_dir(deploy().join(robot)).unwrap() {
            let file = entry.unwrap().path();
            let text = std::fs::read_to_string(&file).unwrap();
            let lines: Vec<&str> = text.lines().collect();
            for (idx, line) in
                lines.iter().enumerate().filter(|(_, line)| line.contains(" = ") && !line.starts_with('#'))
            {
                // A pair of keys may share a comment: min and max, x and y.
                let above = &lines[idx.saturating_sub(2)..idx];
                assert!(above.iter().any(|l| l.starts_with("# ")), "{}: {line}", file.display());
            }
        }
    }
}

#[test]
fn a_bad_value_is_named_with_its_limit() {
    let folder = tempfile::tempdir().unwrap();
    let bad = changed(folder.path(), "filter", "rate_hz", "rate_hz = 5.0");
    check(&["service", "filter", "--config", &bad], CONFIG, &["filter.toml", "rate_hz", "5", "20 to 200"]);
    let bad = changed(folder.path(), "simulator", "start_jitter_m", "start_jitter_m = nan");
    let said = ["simulator.toml", "start_jitter_m", "NaN", "0 to 1"];
    check(&["service", "simulator", "--config", &bad, "--check"], CONFIG, &said);
}

#[test]
fn an_unknown_key_a_missing_file_and_another_service_s_file_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let bad = changed(folder.path(), "filter", "rate_hz", "rate_herz = 20.0");
    check(&["service", "filter", "--config", &bad], CONFIG, &["filter.toml", "rate_herz"]);
    check(&["service", "filter", "--config", "/nowhere/f.toml"], CONFIG, &["/nowhere/f.toml"]);
    let other = changed(folder.path(), "localisation", "map_epoch", "map_epoch = 1");
    check(&["service", "semantics", "--config", &other], CONFIG, &["localisation.toml", "[semantics]"]);
}

#[test]
fn sentences_are_parsed_line_by_line() {
    let input = "{\"id\":\"d1\",\"context\":[],\"text\":\"keep 0.25 m away from the cars\"}\n\
        {\"id\":\"d2\",\"context\":[],\"text\":\"stay away from that\"}\n";
    let output = with_input(&["parse", "--profile", "turtlebot2"], input);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines: Vec<serde_json::Value> = String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(lines.len(), 2);
    assert_eq!(lines[0]["outcome"], "accept", "{}", lines[0]);
    assert_eq!(lines[0]["specs"][0]["buffer_m"], 0.25);
    assert_eq!(lines[1]["outcome"], "clarify", "{}", lines[1]);
    assert_eq!(lines[1]["id"], "d2");
}

/// `heedway parse` with a language model that nobody serves.
fn without_a_server(parser: &str, environment: &[(&str, &str)]) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_heedway"))
        .args(["parse", "--parser", parser])
        .env_remove("HEEDWAY_LLM_BASE_URL")
        .env_remove("HEEDWAY_LLM_KEY")
        .envs(environment.iter().copied())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It may end before it reads.
    let _ = child.stdin.take().unwrap().write_all(b"{\"id\":\"a\",\"text\":\"stay off the rug\"}\n");
    child.wait_with_output().unwrap()
}

#[test]
fn a_language_model_is_told_by_the_environment_and_its_silence_is_a_question_or_the_grammar() {
    let missing = without_a_server("llm", &[]);
    assert_eq!(missing.status.code(), Some(1));
    let said = String::from_utf8_lossy(&missing.stderr).into_owned();
    assert!(said.contains("HEEDWAY_LLM_BASE_URL") && said.contains("--config"), "{said}");
    let nobody = [("HEEDWAY_LLM_BASE_URL", "http://127.0.0.1:1/v1"), ("HEEDWAY_LLM_MODEL", "m")];
    for (parser, outcome) in [("llm", "clarify"), ("llm-then-offline", "accept")] {
        let output = without_a_server(parser, &nobody);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let line: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(line["outcome"], outcome, "{line}");
    }
}

#[test]
fn an_audit_log_is_shown_and_a_broken_one_is_named() {
    use heedway_language::audit::{Audit, Entry, Event};
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("audit.jsonl");
    let mut log = Audit::open(&file, 1_700_000_000_000).unwrap();
    for words in ["stay off the rug", "forget it\u{1b}[2J"] {
        let said = Entry::bare(1_700_000_000_000, Event::Replied, String::new());
        log.append(&Entry { text: words.into(), speaker: "ann".into(), ..said }).unwrap();
    }
    drop(log);
    let path = file.to_str().unwrap();
    let shown = heedway(&["audit", path]);
    let words = String::from_utf8(shown.stdout).unwrap();
    assert!(shown.status.success());
    for part in ["#1", "2023-11-14 22:13:20", "ann", "stay off the rug", "2 entries, the chain holds"] {
        assert!(words.contains(part), "{words:?} does not hold {part:?}");
    }
    assert!(!words.contains('\u{1b}'));
    let last = String::from_utf8(heedway(&["audit", "--last", "1", "--json", path]).stdout).unwrap();
    assert_eq!(last.lines().count(), 2);
    assert!(last.contains("\"number\":2") && !last.contains("rug"), "{last}");
    std::fs::write(&file, std::fs::read_to_string(&file).unwrap().replace("rug", "mat")).unwrap();
    check(&["audit", "--verify", path], 1, &["audit.jsonl", "line 1 at byte 0", "sha256"]);
    check(&["audit"], USAGE, &["--config"]);
}

#[test]
fn a_robot_that_is_not_there_is_told_with_its_place() {
    // Port 1 is privileged and free on any sane machine.
    for command in [&["rules"][..], &["watch"], &["say", "stop"]] {
        let arguments = [command, &["--connect", "tcp/127.0.0.1:1"]].concat();
        check(&arguments, 1, &["tcp/127.0.0.1:1", "--connect"]);
    }
}
