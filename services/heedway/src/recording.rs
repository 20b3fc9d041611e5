//! A run as an MCAP file that Foxglove and Lichtblick open: images, points, grids, paths, rules and reasons.
//!
//! Messages of the network become messages of Foxglove's well-known schemas, as JSON. Not here: where they come from
//! (the network in `record`, the evaluation's own queue), and reading a file back.

mod schemas;
mod shapes;

use std::collections::BTreeMap;
use std::io::{Seek, Write};

use anyhow::Context;
use geometry::{Pose2, Profile};
use proto::{
    BaseMap, DepthObstacles, FilterStatus, InstructionReply, NavigatorStatus, ObjectMap, Odometry,
    PoseEstimate, RgbdFrame, RuleSet, Scan,
};
use serde_json::Value;

use schemas::Sort;
use shapes::Stamp;

/// Every how many-th pixel of a depth image becomes a point.
const CLOUD_STRIDE_PX: u32 = 4;

/// Something that can be recorded.
#[derive(Clone, Copy, Debug)]
pub enum Heard<'a> {
    /// An image with depth.
    Frame(&'a RgbdFrame),
    /// A turn of the LiDAR.
    Scan(&'a Scan),
    /// The wheels.
    Odometry(&'a Odometry),
    /// Where `odom` lies in `map`.
    Pose(&'a PoseEstimate),
    /// The LiDAR's map.
    BaseMap(&'a BaseMap),
    /// What the camera found in the way.
    DepthObstacles(&'a DepthObstacles),
    /// The region of a rule.
    ObjectMap(&'a ObjectMap),
    /// The navigator's path.
    Navigator(&'a NavigatorStatus),
    /// The rules in force.
    Rules(&'a RuleSet),
    /// What was made of words.
    Reply(&'a InstructionReply),
    /// What the filter did, and why.
    Filter(&'a FilterStatus),
}

/// Writes a recording.
pub struct Recorder<W: Write + Seek> {
    writer: mcap::Writer<W>,
    profile: Profile,
    schemas: BTreeMap<&'static str, u16>,
    channels: BTreeMap<String, (u16, u32)>,
}

impl<W: Write + Seek> Recorder<W> {
    /// Begins a recording of a robot with this profile.
    ///
    /// # Errors
    /// When nothing can be written.
    pub fn new(to: W, profile: &Profile) -> anyhow::Result<Self> {
        let options = mcap::WriteOptions::new().compression(Some(mcap::Compression::Lz4)).library("heedway");
        let writer = options.create(to).context("begin the recording")?;
        Ok(Recorder { writer, profile: profile.clone(), schemas: BTreeMap::new(), channels: BTreeMap::new() })
    }

    /// Records something that was heard at a moment, nanoseconds since the Unix epoch.
    ///
    /// # Errors
    /// When it cannot be written, or an image cannot be compressed.
    pub fn hear(&mut self, at_ns: u64, heard: Heard<'_>) -> anyhow::Result<()> {
        match heard {
            Heard::Frame(frame) => {
                let stamp = Stamp(frame.header.stamp_ns);
                self.put(at_ns, "/camera/image", Sort::CompressedImage, &shapes::colour(frame)?)?;
                self.put(at_ns, "/camera/depth", Sort::CompressedImage, &shapes::depth(frame)?)?;
                let points = shapes::cloud(frame, CLOUD_STRIDE_PX);
                self.put(at_ns, "/camera/points", Sort::PointCloud, &points)?;
                let mount = shapes::from_camera(stamp, &self.profile.camera.base_from_camera());
                self.put(at_ns, "/tf", Sort::FrameTransform, &mount)
            }
            Heard::Scan(scan) => {
                let mount = self.profile.lidar;
                let base_from_lidar = Pose2::new(mount.x_m, mount.y_m, mount.yaw_rad);
                let points = shapes::scan(scan, base_from_lidar, mount.z_m);
                self.put(at_ns, "/lidar/points", Sort::PointCloud, &points)
            }
            Heard::Odometry(m) => {
                let place = shapes::transform(Stamp(m.header.stamp_ns), "odom", "base", m.odom_from_base);
                self.put(at_ns, "/tf", Sort::FrameTransform, &place)
            }
            Heard::Pose(m) => {
                let place = shapes::transform(Stamp(m.header.stamp_ns), "map", "odom", m.map_from_odom);
                self.put(at_ns, "/tf", Sort::FrameTransform, &place)
            }
            Heard::BaseMap(m) => {
                let grid = shapes::grid(Stamp(m.header.stamp_ns), &m.layout, &m.cells);
                self.put(at_ns, "/map/base", Sort::Grid, &grid)
            }
            Heard::DepthObstacles(m) => {
                let Some(cells) = &m.cells else { return Ok(()) };
                let grid = shapes::cell_set(Stamp(m.header.stamp_ns), cells);
                self.put(at_ns, "/map/depth_obstacles", Sort::Grid, &grid)
            }
            Heard::ObjectMap(m) => {
                let Some(region) = &m.region else { return Ok(()) };
                let grid = shapes::cell_set(Stamp(m.header.stamp_ns), region);
                self.put(at_ns, &format!("/map/object/{}", m.rule_id), Sort::Grid, &grid)
            }
            Heard::Navigator(m) => {
                let path = shapes::path(Stamp(at_ns), &m.path);
                self.put(at_ns, "/path", Sort::PosesInFrame, &path)
            }
            Heard::Rules(m) => {
                let words: Vec<String> = m.specs.iter().map(rules::english::status).collect();
                let words = if words.is_empty() { "no rules".to_owned() } else { words.join("; ") };
                self.say(at_ns, "/rules", "rules", &words)
            }
            Heard::Reply(m) => {
                self.say(at_ns, "/words", "language", &format!("“{}”: {}", m.text, m.reply.say))
            }
            Heard::Filter(m) => {
                let words = format!("{}: {}", m.action, m.words);
                let words =
                    if m.stop_reason.is_empty() { words } else { format!("{words} ({})", m.stop_reason) };
                self.say(at_ns, "/filter", "filter", &words)
            }
        }
    }

    fn say(&mut self, at_ns: u64, topic: &str, name: &str, words: &str) -> anyhow::Result<()> {
        self.put(at_ns, topic, Sort::Log, &shapes::log(Stamp(at_ns), name, words))
    }

    fn put(&mut self, at_ns: u64, topic: &str, sort: Sort, message: &Value) -> anyhow::Result<()> {
        let channel = match self.channels.get(topic) {
            Some(channel) => *channel,
            None => (self.open(topic, sort)?, 0),
        };
        let (channel_id, sequence) = channel;
        self.channels.insert(topic.to_owned(), (channel_id, sequence.wrapping_add(1)));
        let header =
            mcap::records::MessageHeader { channel_id, sequence, log_time: at_ns, publish_time: at_ns };
        let text = serde_json::to_vec(message)?;
        self.writer.write_to_known_channel(&header, &text).with_context(|| format!("record {topic}"))
    }

    fn open(&mut self, topic: &str, sort: Sort) -> anyhow::Result<u16> {
        let name = sort.name();
        let schema_id = match self.schemas.get(name) {
            Some(id) => *id,
            None => self.writer.add_schema(name, "jsonschema", sort.schema().to_string().as_bytes())?,
        };
        self.schemas.insert(name, schema_id);
        Ok(self.writer.add_channel(schema_id, topic, "json", &BTreeMap::new())?)
    }

    /// Ends the recording: without this a file has no index.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(mut self) -> anyhow::Result<W> {
        self.writer.finish().context("end the recording")?;
        Ok(self.writer.into_inner())
    }
}

#[cfg(test)]
mod tests;
