//! The decider under a fake clock, with a disk and a parser that the tests hold in their hands.

use std::time::Duration;

use geometry::{Pose2, Twist};
use proptest::prelude::*;
use proto::{Grounding, Header, PoseQuality, RuleHeld};
use rules::{Outcome, RefuseReason, Relation, ReplyOption};

use super::*;
use crate::admission::{clarify, refuse, revocation};
use crate::audit::Event;

/// "rug", "rug for 60" (a lifetime), "7 from rug" (too far), "left of table", "forget all", "forget s1",
/// "keep 2 from rug" (a question with options), "that" (a question without).
fn parse(active: &[Rule], _: &Profile, words: &str) -> Reply {
    let accept = |rule: Rule| Reply { specs: vec![rule], say: "yes".into(), ..Reply::of(Outcome::Accept) };
    let words: Vec<&str> = words.split(' ').collect();
    match words.as_slice() {
        ["forget", "all"] => revocation(active.iter().map(|rule| rule.id.clone()).collect(), "gone".into()),
        ["forget", id] => revocation(vec![(*id).to_owned()], "gone".into()),
        ["7", "from", obj] => accept(Rule { buffer_m: 7.0, ..Rule::exclusion(Relation::Near, obj) }),
        [metres, "m", "from", obj] => {
            let buffer_m = metres.parse().unwrap();
            accept(Rule { buffer_m, ..Rule::exclusion(Relation::Near, obj) })
        }
        ["keep", number, "from", obj] => {
            let option = |unit: &str, buffer_m: f64| ReplyOption {
                label: format!("{number} {unit}"),
                reply: accept(Rule { buffer_m, ..Rule::exclusion(Relation::Near, obj) }),
            };
            clarify("metres or feet?", vec![option("metres", 2.0), option("feet", 0.6)])
        }
        ["left", "of", obj] => accept(Rule::exclusion(Relation::LeftOf, obj)),
        [obj, "for", seconds] => {
            accept(Rule { ttl_s: seconds.parse().ok(), ..Rule::exclusion(Relation::On, obj) })
        }
        ["avoid", "that"] => clarify("avoid what?", vec![]),
        ["avoid", obj] => accept(Rule::exclusion(Relation::On, obj)),
        ["coffee"] => refuse(RefuseReason::NotSafety, "no"),
        _ => clarify("what?", vec![]),
    }
}

const START_UNIX_MS: u64 = 1_000_000_000;

/// The service with a disk that works at once, unless told otherwise.
struct Bench {
    decider: Decider,
    now: Time,
    disk: Rulebook,
    disk_refuses: bool,
    published: Vec<RuleSet>,
    replies: Vec<InstructionReply>,
    events: Vec<Event>,
    asked: Vec<ModelTask>,
    trouble: String,
}

fn setup(parser: ParserChoice) -> Setup {
    Setup {
        profile: Profile::sim(),
        n_rules_max: 3,
        question_timeout: Duration::from_secs(30),
        parser,
        parse,
        boot: boot("first", Time::ZERO),
    }
}

/// The host's own clock, when the service's reads `now`.
fn boot(boot_id: &str, now: Time) -> Option<BootClock> {
    Some(BootClock { boot_id: boot_id.into(), uptime_ms: 500_000 + now.as_nanos() / 1_000_000 })
}

impl Bench {
    fn new() -> Bench {
        Bench::with(ParserChoice::Offline)
    }

    fn with(parser: ParserChoice) -> Bench {
        let book = Rulebook::default();
        Bench {
            decider: Decider::new(setup(parser), book.clone(), Time::ZERO, START_UNIX_MS),
            now: Time::ZERO,
            disk: book,
            disk_refuses: false,
            published: vec![],
            replies: vec![],
            events: vec![],
            asked: vec![],
            trouble: String::new(),
        }
    }

    /// Steps, with a disk that answers, until nothing is left to do.
    fn step(&mut self, input: Input) {
        let mut inputs = vec![input];
        while let Some(input) = inputs.pop() {
            for output in self.decider.step(self.now, input) {
                match output {
                    Output::PublishRules(rules) => self.published.push(rules),
                    Output::PublishReply(reply) => {
                        assert!(reply.rules_version <= self.disk.version, "acknowledged before it is stored");
                        self.replies.push(reply);
                    }
                    Output::Record(record) => inputs.push(Input::Recorded(self.store(*record))),
                    Output::AskModel(task) => self.asked.push(task),
                    Output::Progress(_) => {}
                    Output::Trouble(words) => self.trouble = words,
                }
            }
        }
    }

    fn store(&mut self, record: Record) -> Recorded {
        if let Some(book) = record.book {
            if self.disk_refuses {
                return Recorded { stored: Err("disk full".into()), audited: Err("not tried".into()) };
            }
            self.disk = book;
        }
        self.events.push(record.entry.event);
        Recorded { stored: Ok(()), audited: Ok(()) }
    }

    fn wait(&mut self, seconds: u64) {
        for _ in 0..seconds * 10 {
            self.now = self.now + Duration::from_millis(100);
            self.step(Input::Tick(START_UNIX_MS + self.now.as_nanos() / 1_000_000));
        }
    }

    fn say(&mut self, text: &str) -> InstructionReply {
        self.say_as(Instruction::plain(text))
    }

    fn say_as(&mut self, instruction: Instruction) -> InstructionReply {
        self.step(Input::Said(instruction));
        self.replies.last().unwrap().clone()
    }

    fn ids(&self) -> Vec<String> {
        self.decider.book().active().into_iter().map(|rule| rule.id).collect()
    }

    #[track_caller]
    fn check(&mut self, text: &str, outcome: Outcome, ids: &[&str]) {
        assert_eq!(
            (self.say(text).reply.outcome, self.ids()),
            (outcome, ids.iter().map(|id| (*id).to_owned()).collect())
        );
    }

    /// The service is started again on a host that was not.
    fn restarted(&self) -> Bench {
        self.restarted_on("first")
    }

    fn restarted_on(&self, boot_id: &str) -> Bench {
        let mut next = Bench::new();
        next.disk = self.disk.clone();
        next.now = self.now;
        let unix_ms = START_UNIX_MS + self.now.as_nanos() / 1_000_000;
        let setup = Setup { boot: boot(boot_id, self.now), ..setup(ParserChoice::Offline) };
        next.decider = Decider::new(setup, self.disk.clone(), self.now, unix_ms);
        next
    }
}

#[test]
fn an_empty_rule_set_is_published_at_the_first_start_and_again_each_second() {
    let mut bench = Bench::new();
    bench.step(Input::Tick(START_UNIX_MS));
    assert_eq!(bench.published, [RuleSet { version: 1, specs: vec![] }]);
    bench.wait(10);
    assert_eq!(bench.published.len(), 11);
}

#[test]
fn a_rule_is_stored_then_published_then_acknowledged() {
    let mut bench = Bench::new();
    let outputs = bench.decider.step(Time::ZERO, Input::Said(Instruction::plain("avoid rug")));
    let [Output::Record(record)] = outputs.as_slice() else { panic!("{outputs:?}") };
    assert_eq!(record.book.as_ref().unwrap().version, 2);
    assert_eq!(record.entry.version_before, 1);
    assert!(bench.ids().is_empty());
    let stored = Recorded { stored: Ok(()), audited: Ok(()) };
    let outputs = bench.decider.step(Time::ZERO, Input::Recorded(stored));
    let [Output::PublishRules(rules), Output::PublishReply(reply)] = outputs.as_slice() else {
        panic!("{outputs:?}")
    };
    assert_eq!((rules.version, rules.specs[0].id.as_str()), (2, "s1"));
    assert_eq!((reply.rules_version, reply.reply.specs[0].id.as_str()), (2, "s1"));
}

#[test]
fn instructions_are_answered_in_order_while_the_disk_is_slow() {
    let mut bench = Bench::new();
    let outputs = bench.decider.step(Time::ZERO, Input::Said(Instruction::plain("avoid rug")));
    for text in ["forget s1", "avoid sofa"] {
        assert!(bench.decider.step(Time::ZERO, Input::Said(Instruction::plain(text))).is_empty());
    }
    let [Output::Record(record)] = outputs.as_slice() else { panic!("{outputs:?}") };
    let recorded = bench.store((**record).clone());
    bench.step(Input::Recorded(recorded));
    let texts: Vec<_> =
        bench.replies.iter().map(|reply| (reply.text.as_str(), reply.rules_version)).collect();
    assert_eq!(texts, [("avoid rug", 2), ("forget s1", 3), ("avoid sofa", 4)]);
    assert_eq!(bench.ids(), ["s2"]);
}

#[test]
fn too_many_waiting_instructions_are_told_so() {
    let mut bench = Bench::new();
    bench.decider.step(Time::ZERO, Input::Said(Instruction::plain("avoid rug")));
    for _ in 0..N_WAITING_MAX {
        assert!(bench.decider.step(Time::ZERO, Input::Said(Instruction::plain("avoid sofa"))).is_empty());
    }
    let outputs = bench.decider.step(Time::ZERO, Input::Said(Instruction::plain("avoid bed")));
    assert!(matches!(&outputs[..], [Output::PublishReply(reply)] if reply.reply.outcome == Outcome::Clarify));
}

#[test]
fn rules_are_added_changed_and_lifted() {
    let mut bench = Bench::new();
    bench.check("avoid rug", Outcome::Accept, &["s1"]);
    bench.check("1 m from sofa", Outcome::Accept, &["s1", "s2"]);
    bench.check("2 m from sofa", Outcome::Accept, &["s1", "s3"]);
    assert_eq!(bench.replies.last().unwrap().reply.revoked, ["s2"]);
    bench.check("forget s2", Outcome::Revoke, &["s1", "s3"]);
    bench.check("forget all", Outcome::Revoke, &[]);
    bench.check("avoid rug", Outcome::Accept, &["s4"]);
}

#[test]
fn what_cannot_be_held_changes_nothing() {
    let mut bench = Bench::new();
    bench.check("7 from rug", Outcome::Clarify, &[]);
    bench.check("coffee", Outcome::Refuse, &[]);
    assert_eq!((bench.disk.version, bench.events.len()), (1, 2));
}

#[test]
fn a_full_list_asks_which_rule_may_go() {
    let mut bench = Bench::new();
    for text in ["avoid a", "b for 60", "avoid c"] {
        bench.say(text);
    }
    bench.check("avoid d", Outcome::Clarify, &["s1", "s2", "s3"]);
    bench.check("the second", Outcome::Accept, &["s1", "s3", "s4"]);
    assert_eq!(bench.decider.book().active()[2].obj, "d");
}

#[test]
fn a_question_is_answered_by_number_label_or_id() {
    for (answer, named, metres) in [("feet", false, 0.6), ("1", false, 2.0), ("2 feet", true, 0.6)] {
        let mut bench = Bench::new();
        let question = bench.say_as(Instruction { id: "q7".into(), ..Instruction::plain("keep 2 from rug") });
        assert_eq!((question.id.as_str(), question.reply.options.len()), ("q7", 2));
        let answers = if named { "q7" } else { "" };
        let reply = bench.say_as(Instruction { answers: answers.into(), ..Instruction::plain(answer) });
        assert_eq!(reply.reply.specs[0].buffer_m, metres);
        assert!(reply.text.starts_with("keep 2 from rug"));
        // It is closed now: the same words are words again.
        bench.check(answer, Outcome::Clarify, &["s1"]);
    }
}

#[test]
fn an_answer_without_options_is_read_together_with_what_was_said() {
    let mut bench = Bench::new();
    bench.say("avoid that");
    let reply = bench.say("rug");
    assert_eq!((reply.reply.outcome, reply.text.as_str()), (Outcome::Accept, "avoid rug"));
}

#[test]
fn a_question_can_be_dismissed_and_lifts_no_rule() {
    let mut bench = Bench::new();
    bench.say("avoid rug");
    bench.say("keep 2 from sofa");
    bench.check("never mind", Outcome::Revoke, &["s1"]);
    assert!(bench.replies.last().unwrap().reply.revoked.is_empty());
    bench.check("feet", Outcome::Clarify, &["s1"]);
}

#[test]
fn another_speaker_answers_only_by_naming_the_question() {
    let mut bench = Bench::new();
    let by = |speaker: &str, text: &str, answers: &str| Instruction {
        speaker: speaker.into(),
        answers: answers.into(),
        ..Instruction::plain(text)
    };
    let question = bench.say_as(by("ann", "keep 2 from rug", ""));
    assert_eq!(bench.say_as(by("bob", "feet", "")).reply.outcome, Outcome::Clarify);
    assert_eq!(bench.say_as(by("bob", "feet", &question.id)).reply.outcome, Outcome::Accept);
    assert_eq!(bench.say_as(by("bob", "feet", &question.id)).reply.outcome, Outcome::Clarify);
    assert_eq!(bench.decider.book().kept[0].speaker, "bob");
}

#[test]
fn a_question_without_an_answer_is_dropped_and_that_is_said() {
    let mut bench = Bench::new();
    let question = bench.say("keep 2 from rug");
    bench.wait(29);
    assert_eq!(bench.replies.len(), 1);
    bench.wait(2);
    let dropped = bench.replies.last().unwrap();
    assert_eq!((bench.replies.len(), &dropped.id), (2, &question.id));
    assert!(dropped.reply.say.contains("nothing changed"));
    bench.check("feet", Outcome::Clarify, &[]);
}

#[test]
fn a_rule_ends_after_its_lifetime_never_before_and_that_is_said() {
    let mut bench = Bench::new();
    bench.say("rug for 60");
    bench.wait(59);
    assert_eq!(bench.ids(), ["s1"]);
    bench.wait(2);
    assert!(bench.ids().is_empty());
    let end = bench.replies.last().unwrap();
    assert_eq!((end.reply.outcome, end.reply.revoked.as_slice()), (Outcome::Revoke, &["s1".to_owned()][..]));
    assert_eq!(bench.published.last().unwrap(), &RuleSet { version: 3, specs: vec![] });
}

#[test]
fn a_restart_has_the_same_rules_goes_on_counting_and_keeps_deadlines() {
    let mut bench = Bench::new();
    bench.say("avoid rug");
    bench.say("sofa for 60");
    bench.wait(30);
    let mut again = bench.restarted();
    again.step(Input::Tick(START_UNIX_MS + 30_000));
    assert_eq!(again.published[0], bench.decider.book().rule_set());
    again.check("avoid bed", Outcome::Accept, &["s1", "s2", "s3"]);
    again.wait(29);
    assert_eq!(again.ids(), ["s1", "s2", "s3"]);
    again.wait(2);
    assert_eq!(again.ids(), ["s1", "s3"]);
    assert!(again.published.iter().map(|rules| rules.version).is_sorted());
}

#[test]
fn after_a_restart_of_the_host_a_rule_with_a_lifetime_goes_on_and_somebody_is_asked() {
    let mut bench = Bench::new();
    bench.say("avoid rug");
    bench.say("sofa for 60");
    // The wall clock was set a day ahead while the host was off.
    let mut again = bench.restarted_on("second");
    again.step(Input::Tick(START_UNIX_MS + 86_400_000));
    assert_eq!(again.ids(), ["s1", "s2"]);
    let asked = again.replies.last().unwrap();
    assert_eq!((asked.reply.outcome, asked.reply.options.len()), (Outcome::Clarify, 2));
    assert!(asked.reply.say.contains("sofa") && !asked.reply.say.contains("rug"), "{}", asked.reply.say);
    again.check("yes", Outcome::Revoke, &["s1", "s2"]);
    let mut dropped = bench.restarted_on("third");
    dropped.step(Input::Tick(START_UNIX_MS));
    dropped.check("no", Outcome::Revoke, &["s1"]);
}

#[test]
fn what_cannot_be_stored_is_not_in_force_and_can_be_tried_again() {
    let mut bench = Bench::new();
    bench.say("avoid rug");
    bench.disk_refuses = true;
    bench.check("avoid sofa", Outcome::Clarify, &["s1"]);
    assert!(bench.replies.last().unwrap().reply.say.contains("could not store"));
    assert_eq!((bench.published.last().unwrap().version, bench.disk.version), (2, 2));
    bench.wait(1);
    assert!(bench.trouble.contains("disk full"));
    bench.disk_refuses = false;
    // Version 3 and s2 may be on the disk all the same, so they are not used again.
    bench.check("try again", Outcome::Accept, &["s1", "s3"]);
    assert_eq!(bench.decider.book().version, 4);
    bench.wait(1);
    assert_eq!(bench.trouble, "");
}

#[test]
fn a_rule_whose_end_cannot_be_stored_stays_in_force() {
    let mut bench = Bench::new();
    bench.say("rug for 10");
    bench.disk_refuses = true;
    bench.wait(12);
    assert_eq!(bench.ids(), ["s1"]);
    bench.disk_refuses = false;
    bench.wait(6);
    assert!(bench.ids().is_empty());
}

#[test]
fn an_unwritable_audit_log_is_trouble_and_the_rule_still_protects() {
    let mut bench = Bench::new();
    bench.decider.step(Time::ZERO, Input::Said(Instruction::plain("avoid rug")));
    let recorded = Recorded { stored: Ok(()), audited: Err("disk full".into()) };
    bench.disk.version = 2;
    bench.step(Input::Recorded(recorded));
    bench.step(Input::Tick(START_UNIX_MS));
    assert_eq!(bench.ids(), ["s1"]);
    assert!(bench.trouble.contains("audit"));
}

#[test]
fn accepted_rules_are_anchored_where_the_robot_stands() {
    let mut bench = Bench::new();
    assert!(bench.say("left of table").reply.say.contains("don't know where I stand"));
    assert_eq!(bench.decider.book().active()[0].anchor, None);
    let pose = |x| Pose2::new(x, 0.0, 0.0);
    bench.step(Input::Pose(PoseEstimate {
        header: Header::default(),
        map_epoch: 0,
        map_from_odom: pose(1.0),
        quality: PoseQuality::Good,
    }));
    bench.step(Input::Odometry(Odometry {
        header: Header::default(),
        odom_from_base: pose(2.0),
        twist: Twist::default(),
        fault: None,
    }));
    assert_eq!(bench.say("left of table").reply.say, "yes");
    assert_eq!(bench.decider.book().active()[0].anchor, Some([3.0, 0.0, 0.0]));
}

#[test]
fn a_filter_that_stays_behind_is_trouble() {
    let mut bench = Bench::new();
    let held = |version| RulesHeld {
        service: "filter".into(),
        version,
        rules: vec![RuleHeld { id: "s1".into(), grounding: Grounding::Searching }],
    };
    bench.step(Input::Held(held(1)));
    bench.say("avoid rug");
    bench.step(Input::Held(held(1)));
    bench.wait(4);
    assert!(bench.trouble.contains("filter"));
    bench.step(Input::Held(held(2)));
    bench.wait(1);
    assert_eq!(bench.trouble, "");
}

fn reading(reply: Result<Reply, String>) -> Input {
    let raw = vec!["{}".into()];
    Input::ModelRead(Reading { reply, parser: "llm:m".into(), raw, prompt_sha256: "ab".into() })
}

#[test]
fn the_model_is_asked_one_instruction_at_a_time_and_its_rules_carry_its_name() {
    let mut bench = Bench::with(ParserChoice::Llm);
    bench.step(Input::Said(Instruction::plain("mind the rug")));
    bench.step(Input::Said(Instruction::plain("and the sofa")));
    assert_eq!(bench.asked.len(), 1);
    bench.step(reading(Ok(parse(&[], &Profile::sim(), "avoid rug"))));
    assert_eq!(bench.decider.book().active()[0].parser, "llm:m");
    assert_eq!((bench.asked.len(), bench.asked[1].active.len()), (2, 1));
    bench.step(reading(Err("timeout".into())));
    assert_eq!(bench.replies[1].reply.outcome, Outcome::Clarify);
    assert!(bench.replies[1].reply.say.contains("timeout"));
}

#[test]
fn when_the_model_gives_nothing_the_offline_parser_does() {
    let mut bench = Bench::with(ParserChoice::LlmThenOffline);
    bench.step(Input::Said(Instruction::plain("avoid rug")));
    bench.step(reading(Err("refused".into())));
    assert_eq!(bench.decider.book().active()[0].parser, "offline");
}

#[test]
fn rules_are_repeated_and_end_while_the_model_thinks_and_late_answers_mean_nothing() {
    let mut bench = Bench::with(ParserChoice::Llm);
    bench.step(reading(Ok(parse(&[], &Profile::sim(), "avoid rug"))));
    assert!(bench.ids().is_empty());
    bench.step(Input::Said(Instruction::plain("mind the rug")));
    bench.wait(5);
    assert_eq!(bench.published.len(), 5);
}

fn any_words() -> impl Strategy<Value = String> {
    prop_oneof![
        "avoid [a-e]",
        "[a-e] for [1-9]",
        "[0-4] m from [a-e]",
        "keep 2 from [a-e]",
        "forget s[1-9]",
        Just("forget all".to_owned()),
        Just("avoid that".to_owned()),
        "[12]",
        Just("try again".to_owned()),
        Just("never mind".to_owned()),
        "\\PC{0,20}",
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn ids_are_unique_versions_grow_and_a_kill_loses_nothing_acknowledged(
        said in proptest::collection::vec((any_words(), any::<bool>(), 0u64..3, 0u8..8), 1..30),
    ) {
        let mut bench = Bench::new();
        let mut given = std::collections::BTreeSet::new();
        let mut last_version = 0;
        for (text, disk_refuses, seconds, dice) in said {
            if text.trim().is_empty() { continue; }
            bench.disk_refuses = disk_refuses && dice < 4;
            let n_before = bench.replies.len();
            bench.say(&text);
            bench.wait(seconds);
            for reply in &bench.replies[n_before..] {
                for spec in &reply.reply.specs {
                    prop_assert!(given.insert(spec.id.clone()), "{} given twice", spec.id);
                }
            }
            prop_assert!(bench.ids().len() <= 3);
            prop_assert!(bench.published.iter().map(|rules| rules.version).is_sorted());
            prop_assert!(bench.published.last().is_none_or(|rules| rules.version >= last_version));
            last_version = bench.published.last().map_or(last_version, |rules| rules.version);
            prop_assert_eq!(&bench.disk.active(), &bench.decider.book().active());
            if dice == 7 { bench = bench.restarted(); }
        }
    }
}
