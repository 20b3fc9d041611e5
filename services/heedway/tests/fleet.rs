//! A fleet as the demonstration and the process tests use it: real processes, started, killed, restarted.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail")]

use std::path::{Path, PathBuf};
use std::time::Duration;

use heedway_cli::carry::ServiceName;
use heedway_cli::fleet::{Fleet, FleetOptions, SceneSource};

const PATIENCE: Duration = Duration::from_secs(30);

fn options() -> FleetOptions {
    FleetOptions::office(PathBuf::from(env!("CARGO_BIN_EXE_heedway")))
}

/// A small part of the system is enough to see processes come and go.
fn two_services() -> FleetOptions {
    FleetOptions { services: vec![ServiceName::Language, ServiceName::Navigator], ..options() }
}

/// Waits until a process is gone, or only waits to be reaped.
async fn eventually_gone(pid: u32) {
    let stat = PathBuf::from(format!("/proc/{pid}/stat"));
    let is_running = || std::fs::read_to_string(&stat).is_ok_and(|text| !text.contains(") Z "));
    let gone = async {
        while is_running() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    tokio::time::timeout(PATIENCE, gone).await.unwrap_or_else(|_| panic!("process {pid} still runs"));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_killed_service_is_restarted_and_an_orderly_stop_ends_all() {
    let mut fleet = Fleet::launch(two_services()).await.unwrap();
    fleet.wait_until_alive(PATIENCE).await.unwrap();
    let first = fleet.pid(ServiceName::Navigator).unwrap();
    let language = fleet.pid(ServiceName::Language).unwrap();

    fleet.kill9(ServiceName::Navigator).await.unwrap();
    eventually_gone(first).await;
    fleet.check().unwrap();
    fleet.restart(ServiceName::Navigator).unwrap();
    fleet.wait_until_alive(PATIENCE).await.unwrap();
    let second = fleet.pid(ServiceName::Navigator).unwrap();
    assert_ne!(first, second);
    assert_eq!(fleet.pid(ServiceName::Language), Some(language));

    fleet.stop().await.unwrap();
    for pid in [second, language] {
        eventually_gone(pid).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_dropped_fleet_leaves_no_process_and_no_folder() {
    let mut fleet = Fleet::launch(two_services()).await.unwrap();
    fleet.wait_until_alive(PATIENCE).await.unwrap();
    let pids = [ServiceName::Language, ServiceName::Navigator].map(|name| fleet.pid(name).unwrap());
    let folder = fleet.folder().to_owned();
    assert!(folder.join("language.toml").exists());
    drop(fleet);
    for pid in pids {
        eventually_gone(pid).await;
    }
    assert!(!folder.exists());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_that_dies_early_is_reported_with_its_code_and_its_log() {
    let options = FleetOptions {
        services: vec![ServiceName::Simulator],
        // A scene that is there and is none.
        scene: SceneSource::File(Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml")),
        ..options()
    };
    let mut fleet = Fleet::launch(options).await.unwrap();
    // It says that it is alive before it reads the scene: it is the watch over the process that tells.
    let died = async {
        loop {
            if let Err(e) = fleet.check() {
                return e.to_string();
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    let said = tokio::time::timeout(PATIENCE, died).await.unwrap();
    for word in ["simulator has died", "exit status: 1", "Cargo.toml", "simulator.log"] {
        assert!(said.contains(word), "{said:?} does not name {word:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn two_fleets_do_not_meet() {
    let mut one = Fleet::launch(two_services()).await.unwrap();
    let two = Fleet::launch(FleetOptions { services: vec![], ..options() }).await.unwrap();
    one.wait_until_alive(PATIENCE).await.unwrap();
    assert_ne!(one.robot(), two.robot());
    assert_ne!(one.endpoint(), two.endpoint());
    let strangers = two.bus().session().info().peers_zid().await.count();
    assert_eq!(strangers, 0);
}
