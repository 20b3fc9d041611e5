//! Laws of the wire: what is written is read back, and nothing else is.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

use geometry::{CameraIntrinsics, Point2, Pose2, Twist};
use proptest::prelude::*;
use proto::codec::Encoding;
use proto::{
    BaseMap, CellSet, DecodeError, GridLayout, Grounding, Header, HeatMaps, Instruction, Message,
    NominalCommand, ObjectMap, Odometry, PoseEstimate, PoseQuality, RgbdFrame, RuleSet, SafeCommand, Scan,
    Segments, decode, encode, topics,
};
use rules::{Relation, Rule, RuleType};

fn any_header() -> impl Strategy<Value = Header> {
    (any::<u64>(), any::<u64>(), any::<u64>()).prop_map(|(seq, stamp_ns, echo)| Header {
        seq,
        stamp_ns,
        echo,
    })
}

fn any_pose() -> impl Strategy<Value = Pose2> {
    (-1e3..1e3, -1e3..1e3, -3.1..3.1).prop_map(|(x, y, yaw)| Pose2::new(x, y, yaw))
}

fn any_layout() -> impl Strategy<Value = GridLayout> {
    (-50.0..50.0, -50.0..50.0, 0.01..0.5, 1..40_u32, 1..40_u32).prop_map(
        |(x, y, resolution_m, n_cols, n_rows)| GridLayout {
            origin_map: Point2::new(x, y),
            resolution_m,
            n_cols,
            n_rows,
        },
    )
}

fn rule() -> Rule {
    Rule {
        id: "s1".into(),
        rule_type: RuleType::Exclusion,
        relation: Relation::Beneath,
        obj: "standing desk".into(),
        obj2: None,
        reference: "standing desk".into(),
        except: vec![],
        buffer_m: 0.0,
        vel_max: None,
        ang_vel_max: None,
        ttl_s: None,
        defaults: vec![],
        anchor: Some([1.0, 2.0, 0.5]),
        text: "don't go under the standing desk".into(),
        parser: "offline".into(),
    }
}

#[track_caller]
fn comes_back<M: Message + PartialEq + std::fmt::Debug>(message: &M) {
    assert_eq!(&decode::<M>(&encode(message).unwrap()).unwrap(), message);
}

proptest! {
    #[test]
    fn motion_comes_back(
        header in any_header(), pose in any_pose(), v in -3.0..3.0, w in -3.0..3.0,
        quality in prop::sample::select(vec![PoseQuality::Good, PoseQuality::Uncertain, PoseQuality::Lost]),
    ) {
        let twist = Twist::new(v, w);
        comes_back(&Odometry { header, odom_from_base: pose, twist, fault: None });
        comes_back(&NominalCommand { header, twist });
        comes_back(&SafeCommand { header, twist });
        comes_back(&PoseEstimate { header, map_epoch: 3, map_from_odom: pose, quality });
    }

    #[test]
    fn maps_come_back(header in any_header(), layout in any_layout(), seed in any::<u64>()) {
        let bits: Vec<bool> = (0..layout.n_cells()).map(|i| (seed >> (i % 64)) & 1 == 1).collect();
        let region = CellSet::pack(layout, &bits);
        prop_assert_eq!(region.unpack(), bits.clone());
        let (rule_id, remark) = ("s1".to_owned(), String::new());
        let grounding = Grounding::Grounded;
        comes_back(&ObjectMap { header, map_epoch: 1, rule_id, grounding, region: Some(region), remark });
        let cells = bits.iter().map(|bit| u8::from(*bit) * 2).collect();
        comes_back(&BaseMap { header, map_epoch: 1, layout, cells });
    }

    #[test]
    fn scans_come_back(header in any_header(), ranges_m in prop::collection::vec(0.0..30.0_f32, 1..400)) {
        comes_back(&Scan {
            header,
            angle_min_rad: -3.1,
            angle_step_rad: 0.017,
            duration_s: 0.1,
            range_m_min: 0.1,
            range_m_max: 12.0,
            ranges_m,
        });
    }

    #[test]
    fn no_bytes_make_a_decoder_panic(bytes in prop::collection::vec(any::<u8>(), 0..600), kind in 0..20_u8) {
        let _ = Instruction::from_payload(&bytes);
        let _ = decode::<RuleSet>(&bytes);
        let mut dressed = vec![b'H', b'W', proto::WIRE_VERSION, kind];
        dressed.extend(bytes);
        let _ = (decode::<Odometry>(&dressed), decode::<Scan>(&dressed), decode::<RgbdFrame>(&dressed));
        let _ = (decode::<BaseMap>(&dressed), decode::<ObjectMap>(&dressed), decode::<HeatMaps>(&dressed));
        let _ = (decode::<Segments>(&dressed), decode::<SafeCommand>(&dressed));
    }

    #[test]
    fn a_flipped_byte_is_refused_or_read_as_a_valid_message(at in 0..60_usize, flip in 1..=255_u8) {
        let header = Header { seq: 1, stamp_ns: 2, echo: 3 };
        let whole = Odometry { header, odom_from_base: Pose2::IDENTITY, twist: Twist::ZERO, fault: None };
        let mut bytes = encode(&whole).unwrap();
        let at = at % bytes.len();
        bytes[at] ^= flip;
        if let Ok(read) = decode::<Odometry>(&bytes) {
            prop_assert!(read.check().is_ok());
        }
    }
}

#[test]
fn images_come_back() {
    let intrinsics = CameraIntrinsics { width: 4, height: 3, fx: 4.0, fy: 4.0, cx: 1.5, cy: 1.0 };
    let depth_mm: Vec<u16> = (0..12).map(|i| i * 500).collect();
    let header = Header { seq: 1, stamp_ns: 2, echo: 3 };
    let depth_mm_le = RgbdFrame::depth_bytes(&depth_mm);
    let frame = RgbdFrame { header, intrinsics, rgb: vec![7; 36], depth_mm_le };
    assert_eq!(frame.depth_mm(), depth_mm);
    comes_back(&frame);
    let short = RgbdFrame { rgb: vec![7; 35], ..frame };
    assert!(encode(&short).unwrap_err().to_string().contains("35 values, must be 36 values"));
}

#[test]
fn a_rule_set_is_json_with_the_names_of_the_schema() {
    let set = RuleSet { version: 4, specs: vec![rule()] };
    comes_back(&set);
    let text = String::from_utf8(encode(&set).unwrap()).unwrap();
    for name in ["\"type\":\"exclusion\"", "\"relation\":\"beneath\"", "\"ref\":", "\"buffer_m\":"] {
        assert!(text.contains(name), "{text}");
    }
}

#[test]
fn numbers_that_are_none_are_refused_with_field_and_limit() {
    let header = Header::default();
    let bad = SafeCommand { header, twist: Twist::new(f64::NAN, 0.0) };
    let said = encode(&bad).unwrap_err().to_string();
    assert!(said.contains("speed_m_s is NaN, must be -20 to 20"), "{said}");
    // The same bytes from somebody who does not check before sending.
    let mut bytes = vec![b'H', b'W', proto::WIRE_VERSION, 3];
    bytes = postcard::to_extend(&bad, bytes).unwrap();
    assert!(matches!(decode::<SafeCommand>(&bytes), Err(DecodeError::Invalid { .. })));
}

#[test]
fn another_version_kind_or_size_is_refused_by_name() {
    let good = encode(&SafeCommand { header: Header::default(), twist: Twist::ZERO }).unwrap();
    let mut newer = good.clone();
    newer[2] += 1;
    assert!(matches!(decode::<SafeCommand>(&newer), Err(DecodeError::Version { .. })));
    assert!(matches!(decode::<NominalCommand>(&good), Err(DecodeError::Kind { found: 3, wanted: 2, .. })));
    assert!(matches!(decode::<SafeCommand>(&good[1..]), Err(DecodeError::NotOurs { .. })));
    assert!(matches!(
        decode::<SafeCommand>(&[good.clone(), vec![0; 3]].concat()),
        Err(DecodeError::Malformed { .. })
    ));
    assert!(matches!(decode::<SafeCommand>(&[0; 4000]), Err(DecodeError::Oversized { n_bytes: 4000, .. })));
}

#[test]
fn an_instruction_is_plain_text_or_json() {
    let plain = Instruction::from_payload(b"  Don't go under the standing desk\n").unwrap();
    assert_eq!(plain.text, "Don't go under the standing desk");
    let json = Instruction::from_payload(br#"{"text":"be quiet","speaker":"nurse"}"#).unwrap();
    assert_eq!((json.text.as_str(), json.speaker.as_str()), ("be quiet", "nurse"));
    assert!(Instruction::from_payload(b"   ").is_err());
    assert!(Instruction::from_payload(&[0xff, 0xfe]).is_err());
    assert!(Instruction::from_payload(br#"{"txt":"be quiet"}"#).is_err());
    assert!(Instruction::from_payload(b"stop\0now").is_err());
    assert!(Instruction::from_payload(&[b'a'; 9000]).is_err());
    assert!(Instruction::from_payload(&[b'a'; 2001]).is_err());
    assert!(Instruction::from_payload(&[b'a'; 2000]).is_ok());
}

#[test]
fn the_topic_table_has_each_key_once_and_each_binary_kind_once() {
    let mut keys: Vec<_> = topics::ALL.iter().map(|topic| topic.key).collect();
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys.len(), topics::ALL.len());
    let kinds = [
        Odometry::ENCODING,
        NominalCommand::ENCODING,
        SafeCommand::ENCODING,
        Scan::ENCODING,
        RgbdFrame::ENCODING,
        proto::HeatMapsRequest::ENCODING,
        HeatMaps::ENCODING,
        proto::SegmentsRequest::ENCODING,
        Segments::ENCODING,
        PoseEstimate::ENCODING,
        BaseMap::ENCODING,
        proto::DepthObstacles::ENCODING,
        ObjectMap::ENCODING,
        proto::SemanticsBeat::ENCODING,
    ];
    let mut kinds: Vec<u8> = kinds
        .iter()
        .map(|encoding| match encoding {
            Encoding::Binary { kind } => *kind,
            Encoding::Json => panic!("listed as binary"),
        })
        .collect();
    let n_kinds = kinds.len();
    kinds.sort_unstable();
    kinds.dedup();
    assert_eq!(kinds.len(), n_kinds);
}

#[test]
fn the_page_of_topics_is_fresh() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/topics.md");
    let wanted = proto::topics::as_markdown();
    if std::env::var_os("HEEDWAY_BLESS").is_some() {
        std::fs::write(page, &wanted).unwrap();
    }
    let found = std::fs::read_to_string(page).unwrap();
    assert_eq!(found, wanted, "docs/topics.md is not the table: HEEDWAY_BLESS=1 cargo test writes it");
}
