//! The real binary over real zenoh: what it acknowledged survives kill -9, in order and with its version.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "the steps of a test may end it")]

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use proto::{Instruction, InstructionReply, RuleSet, Segment, topics};
use rules::Outcome;
use service::config::Network;
use service::{Bus, Clock, Counters, Inbox, PeerChange, Publisher};

enum Heard {
    Reply(InstructionReply),
    Rules(RuleSet),
    Peer(PeerChange),
}

/// A robot's network with one listener: the test.
struct Bench {
    folder: tempfile::TempDir,
    /// Holds the subscriptions.
    _bus: Bus,
    inbox: Inbox<Heard>,
    words: Publisher<Instruction>,
    language: Option<Child>,
    rules: RuleSet,
}

/// A bus that listens, and where: the port is free when it is found, and may be another's when it is wanted.
async fn listening() -> (Bus, String) {
    let mut n_tries = 0;
    loop {
        n_tries += 1;
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let endpoint = format!("tcp/127.0.0.1:{port}");
        let network = Network { mode: "peer".into(), listen: vec![endpoint.clone()], ..Network::default() };
        match service::session::open(&network, Path::new(".")).await {
            Ok(session) => {
                let robot = Segment::new("r1").unwrap();
                return (Bus::new(session, robot, Clock::start(), Counters::default()), endpoint);
            }
            Err(e) => assert!(n_tries < 20, "{e:#}"),
        }
    }
}

impl Bench {
    async fn new() -> Bench {
        let (bus, endpoint) = listening().await;
        let inbox = Inbox::new();
        bus.subscribe(&topics::REPLY, &inbox, 64, |received| Heard::Reply(received.message)).await.unwrap();
        bus.subscribe(&topics::RULES, &inbox, 64, |received| Heard::Rules(received.message)).await.unwrap();
        bus.watch_peers(&inbox, Heard::Peer).await.unwrap();
        let words = bus.publisher(&topics::INSTRUCTION).await.unwrap();
        let folder = tempfile::tempdir().unwrap();
        let profile = serde_json::to_value(geometry::Profile::sim()).unwrap();
        std::fs::write(folder.path().join("sim.toml"), toml_of(&profile)).unwrap();
        let config = format!(
            "robot = \"r1\"\nprofile = \"sim.toml\"\nlog = \"info\"\n[network]\nmode = \"peer\"\n\
             connect = [{endpoint:?}]\nmulticast = false\n[language]\njournal = \"state/rules.redb\"\n"
        );
        std::fs::write(folder.path().join("language.toml"), config).unwrap();
        let rules = RuleSet { version: 0, specs: vec![] };
        Bench { folder, _bus: bus, inbox, words, language: None, rules }
    }

    fn start(&mut self) {
        let child = Command::new(env!("CARGO_BIN_EXE_heedway-language"))
            .arg("--config")
            .arg(self.folder.path().join("language.toml"))
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        self.language = Some(child);
    }

    fn kill(&mut self) {
        if let Some(mut child) = self.language.take() {
            child.kill().unwrap();
            child.wait().unwrap();
        }
    }

    /// The next thing heard; the rules never go back in version.
    async fn hear(&mut self) -> Heard {
        let heard = tokio::time::timeout(Duration::from_secs(20), self.inbox.next()).await.expect("silence");
        if let Heard::Rules(rules) = &heard {
            assert!(rules.version >= self.rules.version, "{} after {}", rules.version, self.rules.version);
            self.rules = rules.clone();
        }
        heard
    }

    async fn wait_for_version(&mut self, version: u64) {
        while self.rules.version < version {
            self.hear().await;
        }
    }

    /// Waits until the old process is gone and the new one has published its rules: then it listens.
    async fn hear_restart(&mut self) {
        while !matches!(self.hear().await, Heard::Peer(PeerChange { alive: false, .. })) {}
        while !matches!(self.hear().await, Heard::Rules(_)) {}
    }

    async fn say(&mut self, id: &str, text: &str) -> InstructionReply {
        let instruction = Instruction { id: id.into(), ..Instruction::plain(text) };
        self.words.put(&instruction).unwrap();
        loop {
            match self.hear().await {
                Heard::Reply(reply) if reply.id == id => return reply,
                _ => {}
            }
        }
    }

    fn ids(&self) -> Vec<&str> {
        self.rules.specs.iter().map(|rule| rule.id.as_str()).collect()
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Just enough TOML for a profile: tables of numbers and words.
fn toml_of(value: &serde_json::Value) -> String {
    fn write(out: &mut String, path: &str, map: &serde_json::Map<String, serde_json::Value>) {
        for (key, value) in map.iter().filter(|(_, value)| !value.is_object()) {
            out.push_str(&format!("{key} = {value}\n"));
        }
        for (key, value) in map {
            if let Some(inner) = value.as_object() {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                out.push_str(&format!("[{path}]\n"));
                write(out, &path, inner);
            }
        }
    }
    let mut out = String::new();
    write(&mut out, "", value.as_object().unwrap());
    out
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_acknowledged_survives_a_kill_and_no_version_goes_back() {
    let mut bench = Bench::new().await;
    bench.start();
    bench.wait_for_version(1).await;
    assert!(bench.rules.specs.is_empty());
    let mut wanted: Vec<String> = Vec::new();
    for (round, noun) in ["rug", "sofa", "table", "lamp"].into_iter().enumerate() {
        let reply = bench.say(&format!("i{round}"), &format!("stay off the {noun}")).await;
        assert_eq!(reply.reply.outcome, Outcome::Accept, "{}", reply.reply.say);
        wanted.extend(reply.reply.specs.iter().map(|rule| rule.id.clone()));
        // At the very moment the reply is here, and with another change under way.
        bench.words.put(&Instruction::plain("slow down near the door")).unwrap();
        bench.kill();
        bench.start();
        bench.hear_restart().await;
        assert!(bench.rules.version >= reply.rules_version);
        let held = bench.ids();
        assert!(wanted.iter().all(|id| held.contains(&id.as_str())), "{wanted:?} not all in {held:?}");
    }
    bench.kill();
    let audit = bench.folder.path().join("state/rules.audit.jsonl");
    let report = heedway_language::verify_audit(&audit).unwrap();
    assert!(report.n_entries >= 8, "{report:?}");
}

#[test]
fn a_damaged_journal_stops_the_start_and_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let profile = serde_json::to_value(geometry::Profile::sim()).unwrap();
    std::fs::write(folder.path().join("sim.toml"), toml_of(&profile)).unwrap();
    std::fs::write(folder.path().join("rules.redb"), "not a journal").unwrap();
    let config = "robot = \"r1\"\nprofile = \"sim.toml\"\nlog = \"info\"\n[network]\nmode = \"peer\"\n\
                  multicast = false\n[language]\njournal = \"rules.redb\"\n";
    let file = folder.path().join("language.toml");
    std::fs::write(&file, config).unwrap();
    let end =
        Command::new(env!("CARGO_BIN_EXE_heedway-language")).arg("--config").arg(&file).output().unwrap();
    assert_eq!(end.status.code(), Some(1));
    let said = String::from_utf8_lossy(&end.stderr);
    assert!(said.contains("rules.redb"), "{said}");
    assert_eq!(std::fs::read(folder.path().join("rules.redb")).unwrap(), b"not a journal");
}
