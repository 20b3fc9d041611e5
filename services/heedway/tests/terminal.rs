//! `heedway say` as a person uses it: in a terminal, with a question and its answer.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly")]

use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

use heedway_cli::carry::ServiceName;
use heedway_cli::fleet::{Fleet, FleetOptions};

const PATIENCE: Duration = Duration::from_secs(30);

/// `heedway say` on a pseudo-terminal that `script` makes.
struct Person {
    child: Child,
    keys: ChildStdin,
    screen: ChildStdout,
    seen: String,
}

impl Person {
    fn says(fleet: &Fleet, words: &str) -> Person {
        let program = env!("CARGO_BIN_EXE_heedway");
        let command = format!(
            "{program} say --robot {} --connect {} --speaker ann {words}",
            fleet.robot(),
            fleet.endpoint()
        );
        let mut child = Command::new("script")
            .args(["--quiet", "--flush", "--return", "--command", &command, "/dev/null"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (keys, screen) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        Person { child, keys, screen, seen: String::new() }
    }

    /// Reads until these words are on the screen.
    fn reads(&mut self, words: &str) {
        let mut byte = [0];
        while !self.seen.contains(words) {
            let n_bytes = self.screen.read(&mut byte).unwrap();
            assert_ne!(n_bytes, 0, "{words:?} is not in {:?}", self.seen);
            self.seen.push(char::from(byte[0]));
        }
    }

    fn types(&mut self, answer: &str) {
        self.keys.write_all(format!("{answer}\n").as_bytes()).unwrap();
    }

    fn leaves(mut self) -> (Option<i32>, String) {
        self.screen.read_to_string(&mut self.seen).unwrap();
        (self.child.wait().unwrap().code(), self.seen)
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_question_is_asked_and_a_number_answers_it() {
    if Command::new("script").arg("--version").output().is_err() {
        println!("skipped: this host has no `script` to make a pseudo-terminal");
        return;
    }
    let options = FleetOptions {
        services: vec![ServiceName::Language],
        ..FleetOptions::office(PathBuf::from(env!("CARGO_BIN_EXE_heedway")))
    };
    let mut fleet = Fleet::launch(options).await.unwrap();
    fleet.wait_until_alive(PATIENCE).await.unwrap();
    let asked = tokio::task::block_in_place(|| {
        let mut person = Person::says(&fleet, "keep 2 away from the table");
        person.reads("2 metres, feet or centimetres?");
        person.reads("2) 2 ft");
        person.reads("Your answer");
        person.types("2");
        person.reads("0.6096");
        person.leaves()
    });
    println!("{}", asked.1);
    assert_eq!(asked.0, Some(0), "{}", asked.1);
    assert!(asked.1.contains("table"), "{}", asked.1);
    let left = tokio::task::block_in_place(|| {
        let mut person = Person::says(&fleet, "keep 3 away from the lamp");
        person.reads("Your answer");
        person.types("");
        person.leaves()
    });
    assert_eq!(left.0, Some(4), "{}", left.1);
    fleet.stop().await.unwrap();
}
