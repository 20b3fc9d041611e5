//! What is recorded can be read back, by another program than the one that wrote it where that is there.

use std::io::Cursor;

use super::*;
use geometry::{Point2, Twist};
use proto::{CellSet, GridLayout, Grounding, Header};

const HEADER: Header = Header { seq: 1, stamp_ns: 1_700_000_000_123_456_789, echo: 0 };

fn frame(profile: &Profile) -> RgbdFrame {
    let mut intrinsics = profile.camera.intrinsics;
    (intrinsics.width, intrinsics.height) = (8, 4);
    RgbdFrame {
        header: HEADER,
        intrinsics,
        rgb: vec![100; 8 * 4 * 3],
        depth_mm_le: RgbdFrame::depth_bytes(&[1500; 32]),
    }
}

fn layout() -> GridLayout {
    GridLayout { origin_map: Point2::new(-1.0, 2.0), resolution_m: 0.05, n_cols: 3, n_rows: 2 }
}

/// One message of each sort.
fn recording() -> Vec<u8> {
    let profile = Profile::sim();
    let mut recorder = Recorder::new(Cursor::new(Vec::new()), &profile).unwrap();
    let frame = frame(&profile);
    let odometry = Odometry {
        header: HEADER,
        odom_from_base: Pose2::new(1.0, 2.0, 0.5),
        twist: Twist::ZERO,
        fault: None,
    };
    let base = BaseMap { header: HEADER, map_epoch: 1, layout: layout(), cells: vec![0, 1, 2, 1, 1, 0] };
    let region = CellSet::pack(layout(), &[true, false, false, true, true, false]);
    let object = ObjectMap {
        header: HEADER,
        map_epoch: 1,
        rule_id: "s1".into(),
        grounding: Grounding::Grounded,
        region: Some(region),
        remark: String::new(),
    };
    let navigator = NavigatorStatus {
        state: "driving".into(),
        words: String::new(),
        path: vec![[0.0, 0.0], [1.0, 0.0]],
        goal: None,
    };
    let rules = RuleSet { version: 1, specs: vec![] };
    for (k, heard) in [
        Heard::Frame(&frame),
        Heard::Odometry(&odometry),
        Heard::BaseMap(&base),
        Heard::ObjectMap(&object),
        Heard::Navigator(&navigator),
        Heard::Rules(&rules),
    ]
    .into_iter()
    .enumerate()
    {
        recorder.hear(HEADER.stamp_ns + k as u64, heard).unwrap();
    }
    recorder.finish().unwrap().into_inner()
}

#[test]
fn each_sort_has_its_channel_and_its_schema() {
    let bytes = recording();
    let mut found: Vec<(String, String)> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(|message| message.unwrap().channel)
        .map(|channel| (channel.topic.clone(), channel.schema.as_ref().unwrap().name.clone()))
        .collect();
    found.sort();
    found.dedup();
    let wanted = [
        ("/camera/depth", "CompressedImage"),
        ("/camera/image", "CompressedImage"),
        ("/camera/points", "PointCloud"),
        ("/map/base", "Grid"),
        ("/map/object/s1", "Grid"),
        ("/path", "PosesInFrame"),
        ("/rules", "Log"),
        ("/tf", "FrameTransform"),
    ];
    let wanted: Vec<_> = wanted.map(|(topic, name)| (topic.to_owned(), format!("foxglove.{name}"))).into();
    assert_eq!(found, wanted);
}

/// Counts, and values that went in, as PyPI's `mcap` reads them.
const READ_BACK: &str = r#"
import base64, json, sys
from mcap.reader import make_reader
with open(sys.argv[1], "rb") as file:
    seen = {}
    for schema, channel, message in make_reader(file).iter_messages():
        assert schema.encoding == "jsonschema" and channel.message_encoding == "json"
        fields, value = json.loads(schema.data)["properties"], json.loads(message.data)
        assert set(value) == set(fields), (channel.topic, set(value) ^ set(fields))
        seen.setdefault(channel.topic, []).append(value)
assert base64.b64decode(seen["/map/base"][0]["data"]) == bytes([0, 1, 2, 1, 1, 0])
assert base64.b64decode(seen["/map/object/s1"][0]["data"]) == bytes([1, 0, 0, 1, 1, 0])
assert base64.b64decode(seen["/camera/image"][0]["data"])[:2] == b"\xff\xd8"
assert len(base64.b64decode(seen["/camera/points"][0]["data"])) == 2 * 12
assert seen["/tf"][1]["translation"] == {"x": 1.0, "y": 2.0, "z": 0.0}
assert seen["/path"][0]["timestamp"]["sec"] == 1700000000
assert seen["/rules"][0]["message"] == "no rules"
print("read", len(seen), "topics")
"#;

#[test]
fn another_program_reads_a_recording_back() {
    let Some(python) = std::env::var_os("HEEDWAY_TEST_PYTHON") else {
        eprintln!("skipped: HEEDWAY_TEST_PYTHON is not set (./test sets it up)");
        return;
    };
    let has_mcap = std::process::Command::new(&python).args(["-c", "import mcap"]).output().unwrap();
    if !has_mcap.status.success() {
        eprintln!("skipped: {} has no `mcap`", python.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    std::fs::write(&file, recording()).unwrap();
    let read = std::process::Command::new(&python).arg("-c").arg(READ_BACK).arg(&file).output().unwrap();
    let words = String::from_utf8_lossy(&read.stderr);
    assert!(read.status.success(), "{words}");
    assert_eq!(String::from_utf8_lossy(&read.stdout).trim(), "read 8 topics");
}
