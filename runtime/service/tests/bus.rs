//! The bus over real sessions on loopback: late joiners, garbage, questions, coming and going.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

use std::net::TcpListener;
use std::path::Path;
use std::time::Duration;

use geometry::Twist;
use proto::{Header, HeatMaps, HeatMapsRequest, ModelImage, RuleSet, SafeCommand, Segment, keys, topics};
use service::config::Network;
use service::{Bus, Clock, Counters, Inbox, PeerChange, Question, Received};

/// Long enough for a loaded machine; a condition that holds is seen at once.
const PATIENCE: Duration = Duration::from_secs(20);

/// A free port at this moment: the listener is closed, so that zenoh can take it.
fn free_endpoint() -> String {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    format!("tcp/127.0.0.1:{port}")
}

struct Host {
    bus: Bus,
    counters: Counters,
}

async fn host(listen: &[String], connect: &[String]) -> Host {
    let network = Network {
        zenoh: None,
        mode: "peer".into(),
        connect: connect.to_vec(),
        listen: listen.to_vec(),
        multicast: false,
    };
    let session = service::session::open(&network, Path::new(".")).await.unwrap();
    let counters = Counters::default();
    let robot = Segment::new("r1").unwrap();
    Host { bus: Bus::new(session, robot, Clock::start(), counters.clone()), counters }
}

/// Two hosts that know each other.
async fn pair() -> (Host, Host) {
    let here = free_endpoint();
    let first = host(std::slice::from_ref(&here), &[]).await;
    let second = host(&["tcp/127.0.0.1:0".into()], &[here]).await;
    (first, second)
}

async fn next<I>(inbox: &Inbox<I>) -> I {
    tokio::time::timeout(PATIENCE, inbox.next()).await.expect("nothing came")
}

fn rules(version: u64) -> RuleSet {
    RuleSet { version, specs: vec![] }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_late_joiner_hears_the_last_value_at_once() {
    let (language, filter) = pair().await;
    let publisher = language.bus.publisher::<RuleSet>(&topics::RULES).await.unwrap();
    publisher.put(&rules(6)).unwrap();
    publisher.put(&rules(7)).unwrap();
    let inbox: Inbox<Received<RuleSet>> = Inbox::new();
    filter.bus.subscribe(&topics::RULES, &inbox, 4, |r| r).await.unwrap();
    // The publisher was silent since before the subscription: only the kept value can come, after what may
    // still be on its way. The link may come up later than the first question; the publisher's liveliness
    // then makes the bus ask again.
    language.bus.declare_alive(&Segment::new("language").unwrap()).await.unwrap();
    let mut versions = vec![next(&inbox).await.message.version];
    if versions == [6] {
        versions.push(next(&inbox).await.message.version);
    }
    assert_eq!(versions.last(), Some(&7), "{versions:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn garbage_is_counted_with_a_reason_and_good_messages_still_come() {
    let (robot, stranger) = pair().await;
    let inbox: Inbox<Received<SafeCommand>> = Inbox::new();
    robot.bus.subscribe(&topics::SAFE, &inbox, 4, |r| r).await.unwrap();
    let key = keys::key(robot.bus.robot(), &topics::SAFE);
    let raw = stranger.bus.session().declare_publisher(key).await.unwrap();
    let matched = tokio::time::timeout(PATIENCE, async {
        while !raw.matching_status().await.unwrap().matching() {
            tokio::task::yield_now().await;
        }
    });
    matched.await.expect("the subscriber was never seen");
    let good = SafeCommand { header: Header::default(), twist: Twist::new(0.5, 0.0) };
    let encoded = proto::encode(&good).unwrap();
    let mut newer = encoded.clone();
    newer[2] = 99;
    for payload in [b"garbage".to_vec(), vec![], vec![0; 100_000], newer, encoded] {
        raw.put(payload).await.unwrap();
    }
    assert_eq!(next(&inbox).await.message, good);
    let (rejected, _, _) = robot.counters.snapshot();
    assert_eq!(rejected.len(), 1);
    assert_eq!((rejected[0].key.as_str(), rejected[0].count), ("command/safe", 4));
    assert!(rejected[0].last_reason.contains("wire version 99"), "{rejected:?}");
}

fn question(seq: u64) -> HeatMapsRequest {
    let image = ModelImage { seq, stamp_ns: 0, width: 2, height: 1, rgb: vec![0; 6] };
    HeatMapsRequest { image, phrases: vec!["desk".into()] }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_question_gets_an_answer_a_refusal_or_a_time_out() {
    let (asking, answering) = pair().await;
    let silence = Duration::from_millis(300);
    let silent = asking.bus.ask::<_, HeatMaps>(&topics::HEAT_MAPS, &question(0), silence).await;
    let said = format!("{:#}", silent.unwrap_err());
    assert!(said.contains("models/heat_maps") && said.contains("no answer within 300 ms"), "{said}");

    let inbox: Inbox<Question<HeatMapsRequest, HeatMaps>> = Inbox::new();
    answering.bus.answer(&topics::HEAT_MAPS, &inbox, 4, |q| q).await.unwrap();
    let host = tokio::spawn(async move {
        loop {
            let question = inbox.next().await;
            let seq = question.request.image.seq;
            let model = "test".to_owned();
            let maps = HeatMaps { seq, model, width: 1, height: 1, values: vec![9], n_phrases: 1 };
            if seq == 2 { question.refuse("frame 2 is not known") } else { question.answer(&maps).unwrap() }
        }
    });
    let answer = loop {
        // Until the link is up there is nobody to answer.
        let asked = asking.bus.ask::<_, HeatMaps>(&topics::HEAT_MAPS, &question(1), PATIENCE).await;
        if let Ok(answer) = asked {
            break answer;
        }
    };
    assert_eq!((answer.seq, answer.values.as_slice()), (1, [9].as_slice()));
    let refused = asking.bus.ask::<_, HeatMaps>(&topics::HEAT_MAPS, &question(2), PATIENCE).await;
    let said = format!("{:#}", refused.unwrap_err());
    assert!(said.contains("frame 2 is not known"), "{said}");
    host.abort();
}

#[tokio::test(flavor = "multi_thread")]
async fn services_are_seen_coming_and_going() {
    let (console, filter) = pair().await;
    let inbox: Inbox<PeerChange> = Inbox::new();
    console.bus.watch_peers(&inbox, |change| change).await.unwrap();
    filter.bus.declare_alive(&Segment::new("filter").unwrap()).await.unwrap();
    assert_eq!(next(&inbox).await, PeerChange { service: "filter".into(), alive: true });
    filter.bus.session().close().await.unwrap();
    assert_eq!(next(&inbox).await, PeerChange { service: "filter".into(), alive: false });
}
