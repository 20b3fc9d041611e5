//! The whole robot in one thread: the services' deciders, a simulated robot, and a clock that is told to go on.
//!
//! What the network and the processes do is done here ([`routes`]): a message reaches everybody who subscribes
//! to it, slow work takes a fixed simulated time, every decider is ticked at its own rate. The control loop
//! turns a hundred times a second, as it does on the robot. Nothing waits and nothing is drawn, so that the
//! same settings give the same run.

mod routes;

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use geometry::{Pose2, Time, Twist};
use heedway_cli::recording::{Heard, Recorder};
use heedway_filter::fields::Fields;
use heedway_filter::{FilterDecider, Input as FilterInput};
use heedway_language::decider::{Decider as LanguageDecider, Input as LanguageInput, Setup as LanguageSetup};
use heedway_language::rulebook::Rulebook;
use heedway_navigator::{Input as NavigatorInput, NavigatorDecider};
use heedway_perception::semantics::object_maps::ObjectMaps;
use heedway_perception::{localisation, semantics};
use heedway_simulator::beat::Beat;
use heedway_simulator::kept_frames::KeptFrames;
use heedway_simulator::scene::Scene;
use heedway_simulator::simulated_robot::World;
use proto::{
    BaseFault, BaseMap, FilterStatus, Header, InstructionReply, NavigatorStatus, ObjectMap, Odometry,
};
use robot::Keeper;
use service::Clock;

use crate::condition::{Condition, Method};
use crate::model_host::{ModelHost, Role};
use crate::setup::Setup;
use crate::stepped_robot::SteppedRobot;
pub use routes::Message;

/// One turn of the loop that drives the base.
pub const TURN: Duration = Duration::from_millis(10);
/// The wall clock at the start, nanoseconds since the Unix epoch: some day, and the same in every run.
const WALL_NS: u64 = 1_700_000_000_000_000_000;

/// The robot with all its services.
pub struct System {
    setup: Setup,
    condition: Condition,
    kept: Arc<KeptFrames>,
    /// Measures how long a tick of the filter takes; nothing else.
    clock: Clock,
    now: Time,
    robot: SteppedRobot,
    keeper: Keeper,
    fault: Option<BaseFault>,
    language: LanguageDecider,
    localisation: localisation::Decider,
    semantics: semantics::Decider,
    maps: ObjectMaps,
    models: ModelHost,
    filter: FilterDecider,
    fields: Fields,
    navigator: NavigatorDecider,
    beats: Beats,
    queue: VecDeque<Message>,
    later: BTreeMap<(Time, u64), Message>,
    n_later: u64,
    n_odometry: u64,
    recorder: Option<Recorder<BufWriter<File>>>,
    /// What was told that a trial wants to know.
    pub told: Told,
}

/// Who is ticked when: phases differ, as those of processes do.
struct Beats {
    language: Beat,
    localisation: Beat,
    semantics: Beat,
    plan: Beat,
    track: Beat,
    filter: Beat,
}

/// The last of what was told, and counts.
#[derive(Default)]
pub struct Told {
    /// By the filter.
    pub filter: Option<FilterStatus>,
    /// By the navigator.
    pub navigator: Option<NavigatorStatus>,
    /// By language.
    pub replies: Vec<InstructionReply>,
    /// The region of each rule.
    pub regions: BTreeMap<String, ObjectMap>,
    /// The base map.
    pub base_map: Option<BaseMap>,
    /// How long each tick of the filter took, microseconds of this machine.
    pub filter_us: Vec<u64>,
    /// Ticks in which the filter changed the nominal command.
    pub n_interventions: u64,
    /// Messages that were refused, with the last reason.
    pub refused: BTreeMap<&'static str, (u64, String)>,
    /// Troubles that services told.
    pub troubles: Vec<String>,
}

impl System {
    /// A system at its start in a world; `role` plays the models.
    ///
    /// # Errors
    /// When the settings do not go together: says which.
    pub fn new(world: &World, setup: Setup, condition: Condition, role: Role) -> anyhow::Result<Self> {
        let profile = &setup.profile;
        let kept = Arc::new(KeptFrames::default());
        let (errors, seed) = (setup.simulator.models.errors(), setup.simulator.seed);
        let language = LanguageSetup {
            profile: profile.clone(),
            n_rules_max: setup.language.n_rules_max,
            question_timeout: setup.language.question_timeout(),
            parser: setup.language.parser,
            parse: utterance::parse,
            // Nothing outlives a trial: there is no boot to tell from another.
            boot: None,
        };
        let after = |ms: u64| Time::ZERO + Duration::from_millis(ms);
        Ok(System {
            clock: Clock::start(),
            now: Time::ZERO,
            robot: SteppedRobot::new(world, profile, &setup.simulator, Arc::clone(&kept))?,
            keeper: Keeper::new(robot::drive::envelope_of(profile)?),
            fault: None,
            language: LanguageDecider::new(language, Rulebook::default(), Time::ZERO, WALL_NS / 1_000_000),
            localisation: localisation::Decider::new(setup.localisation.clone(), profile),
            semantics: semantics::Decider::new(setup.semantics.clone()),
            maps: ObjectMaps::new(setup.semantics.maps(profile), profile)?,
            models: ModelHost::new(role, &world.scene, errors, seed, Arc::clone(&kept)),
            kept,
            filter: FilterDecider::new(&setup.filter, profile)?,
            fields: Fields::default(),
            navigator: NavigatorDecider::new(&setup.navigator, profile),
            beats: Beats {
                language: Beat::new(10.0, after(0)),
                localisation: Beat::new(20.0, after(20)),
                semantics: Beat::new(20.0, after(40)),
                plan: Beat::new(setup.navigator.plan_rate_hz, after(30)),
                track: Beat::new(setup.navigator.track_rate_hz, after(0)),
                filter: Beat::new(setup.filter.rate_hz, after(10)),
            },
            queue: VecDeque::new(),
            later: BTreeMap::new(),
            n_later: 0,
            n_odometry: 0,
            recorder: None,
            told: Told::default(),
            setup,
            condition,
        })
    }

    /// Simulated time since the start.
    #[must_use]
    pub fn now(&self) -> Time {
        self.now
    }

    /// Where the base really is, how it really moves, and how often it has touched something.
    #[must_use]
    pub fn truth(&self) -> (Pose2, Twist, u64) {
        (self.robot.map_from_base(), self.robot.twist(), self.robot.n_collisions())
    }

    /// Puts a message on the network, from outside.
    pub fn put(&mut self, message: Message) {
        self.queue.push_back(message);
        self.pump();
    }

    /// From now on the world is another one: this scene's, of which nothing may have gone that was there.
    ///
    /// # Errors
    /// When its surfaces cannot be rendered.
    pub fn appear(&mut self, scene: Scene) -> anyhow::Result<World> {
        let (profile, simulator) = (&self.setup.profile, &self.setup.simulator);
        let world = World::new(scene, profile, simulator)?;
        self.robot.move_to(&world, profile, simulator, Arc::clone(&self.kept))?;
        Ok(world)
    }

    /// Records from now on.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn record(&mut self, file: &Path) -> anyhow::Result<()> {
        let to = File::create(file).with_context(|| format!("create {} (--mcap)", file.display()))?;
        self.recorder = Some(Recorder::new(BufWriter::new(to), &self.setup.profile)?);
        Ok(())
    }

    /// Ends the recording, if there is one.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn end_recording(&mut self) -> anyhow::Result<()> {
        self.recorder.take().map_or(Ok(()), |recorder| recorder.finish().map(drop))
    }

    fn note(&mut self, heard: Heard<'_>) {
        let at_ns = self.wall_ns();
        let Some(recorder) = &mut self.recorder else { return };
        if let Err(e) = recorder.hear(at_ns, heard) {
            self.recorder = None;
            self.told.troubles.push(format!("the recording ended early: {e:#}"));
        }
    }

    /// One turn of the loop that drives the base, and all that happens meanwhile.
    pub fn turn(&mut self) {
        self.now = self.now + TURN;
        while let Some(entry) = self.later.first_entry().filter(|entry| entry.key().0 <= self.now) {
            self.queue.push_back(entry.remove());
        }
        self.pump();
        self.sense();
        self.tick();
        let kept = self.keeper.motors(self.now, self.fault);
        self.robot.actuate(self.now, kept.command);
    }

    fn wall_ns(&self) -> u64 {
        WALL_NS + self.now.as_nanos()
    }

    fn sense(&mut self) {
        let (now, wall_ns, echo) = (self.now, self.wall_ns(), self.keeper.last_seq());
        let senses = self.robot.sense(now, wall_ns);
        if let Some(base) = senses.base {
            self.n_odometry += 1;
            self.fault = base.fault;
            self.keeper.odometry_sent(self.n_odometry, now);
            self.queue.push_back(Message::Odometry(Odometry {
                header: Header { seq: self.n_odometry, stamp_ns: base.stamp_ns, echo },
                odom_from_base: base.odom_from_base,
                twist: base.twist,
                fault: base.fault,
            }));
        }
        for mut scan in senses.scans {
            scan.header.echo = echo;
            self.put_later(routes::SCAN_TIME, Message::Scan(scan));
        }
        for mut frame in senses.frames {
            frame.header.echo = echo;
            self.put_later(routes::FRAME_TIME, Message::Frame(Box::new(frame)));
        }
        self.pump();
    }

    fn tick(&mut self) {
        let (now, wall_ns) = (self.now, self.wall_ns());
        if self.beats.language.take(now) {
            self.tell_language(LanguageInput::Tick(wall_ns / 1_000_000));
        }
        if self.beats.localisation.take(now) {
            self.tell_localisation(localisation::Input::Tick);
        }
        if self.beats.semantics.take(now) {
            self.tell_semantics(semantics::Input::Tick);
        }
        if self.beats.plan.take(now) {
            self.tell_navigator(NavigatorInput::PlanTick);
        }
        if self.beats.track.take(now) {
            self.tell_navigator(NavigatorInput::TrackTick { wall_ns });
        }
        self.pump();
        if self.beats.filter.take(now) {
            let begun = self.clock.now();
            self.tell_filter(FilterInput::Tick { due: now, wall_ns });
            let used = self.clock.now().since(begun);
            self.told.filter_us.push(u64::try_from(used.as_micros()).unwrap_or(u64::MAX));
        }
        self.pump();
    }

    /// Whether the words reach the robot at all.
    #[must_use]
    pub fn listens(&self) -> bool {
        self.condition.method != Method::SafeGeom
    }
}
