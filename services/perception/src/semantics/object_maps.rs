//! The slow part: frames and answers of the models to maps, off the decider's loop, one job at a time.
//!
//! Rules with the same phrase share what was seen of it; each cuts its own region. Everything is of one
//! epoch of the map: a job of another one begins anew.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use geometry::{Pose2, Pose3, Profile};
use mapping::floor_area::FloorConfig;
use mapping::obstacle_layer::{ObstacleConfig, ObstacleLayer};
use mapping::occupancy::{Closing, HeightBand};
use mapping::tsdf::{Tsdf, TsdfConfig, TsdfConfigError};
use mapping::{DepthFrame, DepthImage, Fusion, Grid, ImageError, Layout, Occupancy, Segments, fuse};
use nalgebra::Vector2;
use proto::CellSet;
use rules::Rule;

use super::evidence::Evidence;
use super::frame::Frame;
use super::models::{Answer, Understood};
use super::places::Places;
use super::regions::{Finding, Known, phrases, region_of};
use crate::wire::cell_set;

/// How maps are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapConfig {
    /// How heat maps choose segments.
    pub fusion: Fusion,
    /// Things.
    pub tsdf: TsdfConfig,
    /// Areas of floor.
    pub floor: FloorConfig,
    /// Obstacles within the robot's height.
    pub obstacles: ObstacleConfig,
    /// Outlines.
    pub closing: Closing,
    /// Obstacles are told within this far around the robot, metres.
    pub obstacle_reach_m: f64,
    /// How far a region without an end of its own reaches, metres.
    pub region_reach_m: f64,
    /// Most phrases with a map.
    pub n_phrases_max: usize,
}

/// A frame, and where the base was in the map.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The frame.
    pub frame: Arc<Frame>,
    /// The base in `map` at the frame's stamp.
    pub map_from_base: Pose2,
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Task {
    /// Look for obstacles.
    Look(View),
    /// Take in what the models said of a frame.
    Fuse {
        /// The frame.
        view: View,
        /// What they were asked for.
        phrases: Vec<String>,
        /// What they said.
        answer: Box<Answer>,
        /// Whether regions are to be told afterwards.
        is_reviewed: bool,
    },
    /// Tell the regions as they are: the rules have changed.
    Review,
}

/// One piece of work.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// Epoch of the map in which the task's poses are.
    pub map_epoch: u64,
    /// Version of the rule set.
    pub rules_version: u64,
    /// The rules in force: what no rule speaks of is forgotten.
    pub rules: Arc<[Rule]>,
    /// The named places.
    pub places: Arc<Places>,
    /// What the LiDAR knows of the floor, when anything of this epoch has come.
    pub base: Option<Arc<Grid<Occupancy>>>,
    /// What is to be done.
    pub task: Task,
}

/// Obstacles after a look.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacles {
    /// Stamp of the newest frame in them.
    pub stamp_ns: u64,
    /// Their cells; `None` when there are none.
    pub cells: Option<CellSet>,
}

/// What came of a job.
#[derive(Clone, Debug, PartialEq)]
pub struct Done {
    /// Epoch of the map.
    pub map_epoch: u64,
    /// Version of the rule set that it was done for.
    pub rules_version: u64,
    /// The obstacles, after a look.
    pub obstacles: Option<Obstacles>,
    /// What is known of each rule that needs an object; `None` when it was not asked.
    pub findings: Option<Vec<Finding>>,
    /// What could not be done, in words.
    pub failure: Option<String>,
}

/// All maps that semantics holds.
pub struct ObjectMaps {
    config: MapConfig,
    base_from_camera: Pose3,
    band: HeightBand,
    map_epoch: u64,
    evidence: BTreeMap<String, Evidence>,
    obstacles: ObstacleLayer,
}

/// The phrases that maps are kept for: those of the oldest rules that name no place, up to the limit.
#[must_use]
pub fn phrases_of(rules: &[Rule], places: &Places, n_phrases_max: usize) -> BTreeSet<String> {
    let mut all = BTreeSet::new();
    let searched = |rule: &Rule| {
        phrases(rule).into_iter().filter(|p| !places.holds(rule, p)).map(str::to_owned).collect()
    };
    for phrase in rules.iter().flat_map(|rule| -> Vec<String> { searched(rule) }) {
        if all.len() < n_phrases_max && !phrase.trim().is_empty() {
            all.insert(phrase);
        }
    }
    all
}

impl ObjectMaps {
    /// No map yet.
    ///
    /// # Errors
    /// When the configuration cannot work.
    pub fn new(config: MapConfig, profile: &Profile) -> Result<Self, TsdfConfigError> {
        Tsdf::new(config.tsdf)?;
        Ok(ObjectMaps {
            config,
            base_from_camera: profile.camera.base_from_camera(),
            band: HeightBand { robot_height_m: profile.height_m },
            map_epoch: 0,
            evidence: BTreeMap::new(),
            obstacles: ObstacleLayer::new(config.obstacles),
        })
    }

    /// Does one piece of work.
    pub fn perform(&mut self, job: &Job) -> Done {
        if job.map_epoch != self.map_epoch {
            self.map_epoch = job.map_epoch;
            self.evidence.clear();
            self.obstacles = ObstacleLayer::new(self.config.obstacles);
        }
        let wanted = phrases_of(&job.rules, &job.places, self.config.n_phrases_max);
        self.evidence.retain(|phrase, _| wanted.contains(phrase));
        let mut done = Done {
            map_epoch: job.map_epoch,
            rules_version: job.rules_version,
            obstacles: None,
            findings: None,
            failure: None,
        };
        match &job.task {
            Task::Look(view) => match self.look(view) {
                Ok(obstacles) => done.obstacles = Some(obstacles),
                Err(reason) => done.failure = Some(reason),
            },
            Task::Fuse { view, phrases, answer, is_reviewed } => {
                let asked = phrases.iter().enumerate().filter(|(_, phrase)| wanted.contains(*phrase));
                done.failure = self.take_in(view, asked, answer).err();
                done.findings = is_reviewed.then(|| self.review(job));
            }
            Task::Review => done.findings = Some(self.review(job)),
        }
        done
    }

    fn look(&mut self, view: &View) -> Result<Obstacles, String> {
        let frame = depth_frame(view, &self.base_from_camera).map_err(|e| e.to_string())?;
        self.obstacles.integrate(&frame);
        let centre = view.map_from_base.position();
        let reach = Vector2::repeat(self.config.obstacle_reach_m);
        let layout = Layout::covering(centre - reach, centre + reach, self.config.obstacles.resolution_m);
        let cells = self.obstacles.occupied(layout.map_err(|e| e.to_string())?);
        let any = cells.values().iter().any(|occupied| *occupied);
        Ok(Obstacles { stamp_ns: view.frame.stamp_ns, cells: any.then(|| cell_set(&cells)) })
    }

    fn take_in<'p>(
        &mut self,
        view: &View,
        asked: impl Iterator<Item = (usize, &'p String)>,
        answer: &Answer,
    ) -> Result<(), String> {
        let frame = depth_frame(view, &self.base_from_camera).map_err(|e| e.to_string())?;
        let segments = segments_of(answer, &view.frame)?;
        for (idx, phrase) in asked {
            let understood = answer.understood(idx);
            let found = fuse(&answer.heat_map(idx)?, &segments, self.config.fusion);
            let evidence = match self.evidence.entry(phrase.clone()) {
                std::collections::btree_map::Entry::Occupied(entry) => entry.into_mut(),
                std::collections::btree_map::Entry::Vacant(entry) => {
                    entry.insert(Evidence::new(&self.config).map_err(|e| e.to_string())?)
                }
            };
            if matches!(understood, Understood::NotAtAll(_)) {
                // Not having found it says nothing.
                evidence.understood = understood;
                continue;
            }
            evidence.understood = understood;
            evidence
                .observe(&frame, found.as_ref().map(|f| &f.mask), view.frame.stamp_ns)
                .map_err(|e| e.to_string())?;
        }
        Ok(())
    }

    fn review(&self, job: &Job) -> Vec<Finding> {
        let needing = job.rules.iter().filter(|rule| rule.needs_grounding());
        let known = Known { places: job.places.in_map(job.map_epoch), base: job.base.as_deref() };
        needing
            .map(|rule| {
                let seen: Vec<_> = phrases(rule).into_iter().map(|p| self.evidence.get(p)).collect();
                Finding {
                    rule_id: rule.id.clone(),
                    stamp_ns: seen.iter().flatten().map(|e| e.newest_ns()).max().unwrap_or(0),
                    region: region_of(rule, &seen, known, self.band, &self.config),
                }
            })
            .collect()
    }
}

/// The segments of an answer, without what is seen through them.
///
/// # Errors
/// In words, when they cannot be, or are of another size than the frame.
pub fn segments_of(answer: &Answer, frame: &Frame) -> Result<Segments, String> {
    let camera = &frame.intrinsics;
    let depth = DepthImage::new(camera.width, camera.height, &frame.depth_mm).map_err(|e| e.to_string())?;
    answer.segments()?.without_seen_through(&depth).map_err(|e| e.to_string())
}

fn depth_frame<'a>(view: &'a View, base_from_camera: &Pose3) -> Result<DepthFrame<'a>, ImageError> {
    let frame = &view.frame;
    let depth = DepthImage::new(frame.intrinsics.width, frame.intrinsics.height, &frame.depth_mm)?;
    let base_from_camera = frame.base_from_camera.as_ref().unwrap_or(base_from_camera);
    DepthFrame::new(depth, frame.intrinsics, view.map_from_base.lifted(0.0) * base_from_camera)
}
