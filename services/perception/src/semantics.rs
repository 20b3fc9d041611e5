//! Semantics: frames and rules to object maps, and what the camera sees that the LiDAR does not.
//!
//! The way of a frame: it gets the pose of its own stamp ([`frame_door`]); every one that shows something new
//! is looked at for obstacles; the newest, in turn with keyframes from before a rule was said
//! ([`keyframes`]), goes to the models ([`models`]) with the phrases that are searched for ([`searches`]);
//! answers are fused into one map a phrase ([`object_maps`]), and each rule's region is cut from its map
//! ([`regions`]). How far a rule got is kept in [`groundings`]. The [`decider`] joins them; models and maps
//! work beside it, one job each at a time, the newest waits, the oldest gives way.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use proto::{DepthObstacles, ObjectMap, RulesHeld, Segment, SemanticsBeat, topics};
use service::{Inbox, Life, Publisher, Slot};

pub mod config;
pub mod decider;
pub mod evidence;
pub mod frame;
pub mod frame_door;
pub mod groundings;
pub mod keyframes;
pub mod models;
pub mod object_maps;
pub mod places;
pub mod questions;
pub mod regions;
pub mod replay;
pub mod report;
pub mod searches;

#[cfg(test)]
mod tests;

pub use config::Settings;
pub use decider::{Decider, Input, Output};

use config::ModelSource;
use models::configured::LocalModels;
use models::remote::RemoteModels;
use models::{Answer, Ask, Models};
use object_maps::{Job, ObjectMaps};
use places::Places;

/// How often the decider looks at the clock.
const TICK: Duration = Duration::from_millis(50);

/// Lives as semantics until it is asked to stop.
///
/// # Errors
/// When the network refuses.
pub async fn serve(life: Life, settings: Settings) -> anyhow::Result<()> {
    let inbox = Inbox::new();
    life.bus.subscribe(&topics::ODOMETRY, &inbox, 64, |r| Input::Odometry(r.message)).await?;
    life.bus.subscribe(&topics::POSE, &inbox, 8, |r| Input::Pose(r.message)).await?;
    life.bus.subscribe(&topics::RULES, &inbox, 4, |r| Input::Rules(r.message)).await?;
    life.bus.subscribe(&topics::BASE_MAP, &inbox, 1, |r| Input::BaseMap(r.message)).await?;
    life.bus.subscribe(&topics::PLACES, &inbox, 2, |r| Input::Places(r.message)).await?;
    // One frame: an older one is worth less than the wait for it.
    life.bus.subscribe(&topics::RGBD, &inbox, 1, |r| Input::Frame(Box::new(r.message))).await?;
    let mut shell = Shell::new(&life, &settings, &inbox).await?;
    let places = match &settings.places {
        Some(file) => Places::load(&life.folder.join(file), settings.resolution_m)?,
        None => Places::default(),
    };
    let mut decider = Decider::new(settings);
    decider.know_places(places);
    let mut tick = tokio::time::interval(TICK);
    tick.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    life.ready().await?;
    loop {
        let input = tokio::select! {
            () = life.stopped() => return Ok(()),
            input = inbox.next() => input,
            _ = tick.tick() => Input::Tick,
        };
        for output in decider.step(life.clock.now(), input) {
            shell.perform(output).await?;
        }
    }
}

/// Whoever plays the model roles.
enum Asked {
    Remote(RemoteModels),
    Local(LocalModels),
    /// They could not be opened. Semantics lives on: every rule is told to be searched for, and why.
    Missing(String),
}

impl Asked {
    async fn new(life: &Life, settings: &Settings) -> Self {
        Self::open(life, settings).await.unwrap_or_else(|e| {
            let reason = format!("{e:#}");
            tracing::error!(%reason, "models cannot be opened");
            Asked::Missing(reason)
        })
    }

    async fn open(life: &Life, settings: &Settings) -> anyhow::Result<Self> {
        let (onnx, folder) = (settings.onnx.clone().within(&life.folder), life.folder.clone());
        Ok(match settings.models {
            ModelSource::Remote => {
                Asked::Remote(RemoteModels::new(life.bus.clone(), settings.model_patience()))
            }
            ModelSource::Yolo => {
                let files = settings.yolo.clone().within(&folder);
                let opened = tokio::task::spawn_blocking(move || LocalModels::open_yolo(&onnx, &files));
                Asked::Local(opened.await??)
            }
            ModelSource::Clipseg => {
                let export = folder.join(&settings.clipseg.folder);
                let opened = tokio::task::spawn_blocking(move || LocalModels::open_clipseg(&onnx, &export));
                Asked::Local(opened.await??)
            }
        })
    }

    async fn answer(&self, ask: &Ask) -> anyhow::Result<Box<Answer>> {
        match self {
            Asked::Remote(models) => models.answer(ask).await,
            Asked::Local(models) => models.answer(ask).await,
            Asked::Missing(reason) => Err(anyhow::anyhow!("{reason}")),
        }
    }
}

/// Performs what the decider wants.
struct Shell<'a> {
    life: &'a Life,
    obstacles: Publisher<DepthObstacles>,
    beat: Publisher<SemanticsBeat>,
    rules_held: Publisher<RulesHeld>,
    object_maps: BTreeMap<String, Publisher<ObjectMap>>,
    models: Arc<Asked>,
    maps: Arc<Mutex<ObjectMaps>>,
    back: Arc<Slot<Input>>,
}

impl<'a> Shell<'a> {
    async fn new(life: &'a Life, settings: &Settings, inbox: &Inbox<Input>) -> anyhow::Result<Self> {
        Ok(Shell {
            life,
            obstacles: life.bus.publisher(&topics::DEPTH_OBSTACLES).await?,
            beat: life.bus.publisher(&topics::SEMANTICS_BEAT).await?,
            rules_held: life.bus.instance_publisher(&topics::RULES_HELD, &life.name).await?,
            object_maps: BTreeMap::new(),
            models: Arc::new(Asked::new(life, settings).await),
            maps: Arc::new(Mutex::new(ObjectMaps::new(settings.maps(&life.profile), &life.profile)?)),
            // One question and one job are under way at most.
            back: Arc::new(inbox.slot(4)),
        })
    }

    async fn perform(&mut self, output: Output) -> anyhow::Result<()> {
        match output {
            Output::Ask(ask) => self.ask(ask),
            Output::Work(job) => self.work(job),
            Output::ObjectMap(message) => {
                let rule_id = message.rule_id.clone();
                if !self.object_maps.contains_key(&rule_id) {
                    let instance = Segment::new(&rule_id)?;
                    let publisher = self.life.bus.instance_publisher(&topics::OBJECT_MAP, &instance).await?;
                    self.object_maps.insert(rule_id.clone(), publisher);
                }
                if let Some(publisher) = self.object_maps.get(&rule_id) {
                    publisher.put(&message)?;
                }
            }
            Output::RuleEnded(rule_id) => drop(self.object_maps.remove(&rule_id)),
            Output::DepthObstacles(message) => self.obstacles.put(&message)?,
            Output::Beat(message) => self.beat.put(&message)?,
            Output::RulesHeld(message) => self.rules_held.put(&message)?,
            Output::Trouble(words) => self.life.counters.trouble(&words),
        }
        Ok(())
    }

    fn ask(&self, ask: Ask) {
        let (models, back) = (Arc::clone(&self.models), Arc::clone(&self.back));
        tokio::spawn(async move {
            let answer = models.answer(&ask).await.map_err(|e| format!("{e:#}"));
            back.push(Input::Answer { ask_id: ask.id, answer });
        });
    }

    fn work(&self, job: Job) {
        let (maps, back) = (Arc::clone(&self.maps), Arc::clone(&self.back));
        tokio::task::spawn_blocking(move || {
            let done = maps.lock().unwrap_or_else(PoisonError::into_inner).perform(&job);
            back.push(Input::Done(Box::new(done)));
        });
    }
}
