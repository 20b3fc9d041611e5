//! A robot whose world is a scene: the plant, its sensors' threads, and what they hand over.
//!
//! Simulated time is the loop's own time. Rendering happens on threads of its own, from a copy of the
//! pose; the loop only fetches what is ready, so a slow picture never delays the motors.

use std::sync::{Arc, Mutex, PoisonError};

use geometry::{Pose2, Profile, Time, Twist};
use proto::{BaseFault, RgbdFrame, Scan};
use robot::{BaseState, Robot, Senses};
use service::Clock;

use crate::base::{Plant, Start};
use crate::beat::Beat;
use crate::config::{OdometryOrigin, SimulatorSettings};
use crate::kept_frames::KeptFrames;
use crate::raycast::RayCaster;
use crate::scene::{Hull, Scene};
use crate::sensor_noise::draws;
use crate::sensors::{Camera, Lidar, Snapshot};
use crate::truth::GroundTruth;
use crate::worker::Worker;

/// A robot in a scene.
pub struct SimulatedRobot {
    plant: Plant,
    truth: Arc<GroundTruth>,
    state: Arc<Mutex<State>>,
    clock: Clock,
    bumper: bool,
    odometry: Beat,
    scans: Beat,
    frames: Beat,
    lidar: Worker<Snapshot, Scan>,
    camera: Worker<Snapshot, RgbdFrame>,
}

/// What the robot really does, for the ground truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// The base in `map`.
    pub map_from_base: Pose2,
    /// How it moves.
    pub twist: Twist,
    /// Contacts since the start.
    pub n_collisions: u64,
    /// When this was so.
    pub at: Time,
}

/// A scene made ready for a robot: what it sees, what is true, and where it starts.
pub struct World {
    /// The scene.
    pub scene: Scene,
    /// What sensors see.
    pub rays: Arc<RayCaster>,
    /// What is true.
    pub truth: Arc<GroundTruth>,
    /// Where the robot starts.
    pub map_from_start: Pose2,
}

impl World {
    /// The world of a scene for a robot of this size, its start moved as the settings say.
    ///
    /// # Errors
    /// When the scene's surfaces cannot be rendered.
    pub fn new(scene: Scene, profile: &Profile, settings: &SimulatorSettings) -> anyhow::Result<Self> {
        let hull = Hull { radius_m: profile.radius_m, height_m: profile.height_m };
        let rays = Arc::new(RayCaster::new(&scene)?);
        let truth = Arc::new(GroundTruth::new(&scene, hull));
        let map_from_start = moved_start(&scene, &truth, settings);
        Ok(World { scene, rays, truth, map_from_start })
    }

    /// The base, at rest at the start.
    #[must_use]
    pub fn plant(&self, profile: &Profile, settings: &SimulatorSettings, now: Time) -> Plant {
        let odom_from_start = match settings.base.odometry_origin {
            OdometryOrigin::Map => self.map_from_start,
            OdometryOrigin::Start => Pose2::IDENTITY,
        };
        let start = Start { map_from_start: self.map_from_start, odom_from_start };
        Plant::new(settings.plant_limits(profile), settings.noise.wheels(), start, now)
    }
}

/// The start, moved by the seed to some place nearby that is free.
fn moved_start(scene: &Scene, truth: &GroundTruth, settings: &SimulatorSettings) -> Pose2 {
    use rand::RngExt;
    let mut random = draws(settings.seed, "start", 0);
    let start = scene.map_from_start;
    let n_tries = if settings.start_jitter_m > 0.0 { 100 } else { 0 };
    (0..n_tries)
        .map(|_| {
            let angle_rad = random.random::<f64>() * std::f64::consts::TAU;
            let way_m = settings.start_jitter_m * random.random::<f64>().sqrt();
            Pose2::new(
                start.x_m + way_m * angle_rad.cos(),
                start.y_m + way_m * angle_rad.sin(),
                start.yaw_rad,
            )
        })
        .find(|pose| truth.clearance_m(pose.position()) > 0.05)
        .unwrap_or(start)
}

impl SimulatedRobot {
    /// A robot at rest at the world's start. Instance images of its frames go to `kept`.
    ///
    /// # Errors
    /// When no threads can be had.
    pub fn new(
        world: &World,
        profile: &Profile,
        settings: &SimulatorSettings,
        clock: Clock,
        kept: Arc<KeptFrames>,
    ) -> anyhow::Result<Self> {
        let now = clock.now();
        let map_from_start = world.map_from_start;
        let plant = world.plant(profile, settings, now);
        let state = State { map_from_base: map_from_start, twist: Twist::ZERO, n_collisions: 0, at: now };
        Ok(SimulatedRobot {
            plant,
            truth: Arc::clone(&world.truth),
            state: Arc::new(Mutex::new(state)),
            clock,
            bumper: settings.base.bumper,
            odometry: Beat::new(settings.base.odometry_rate_hz, now),
            scans: Beat::new(settings.lidar.rate_hz, now),
            frames: Beat::new(settings.camera.rate_hz, now),
            lidar: lidar_thread(world, profile, settings)?,
            camera: camera_thread(world, profile, settings, kept)?,
        })
    }

    /// What the robot really does: shared with whoever publishes the ground truth.
    #[must_use]
    pub fn state(&self) -> Arc<Mutex<State>> {
        Arc::clone(&self.state)
    }

    fn advance(&mut self, now: Time) {
        let truth = &self.truth;
        self.plant.advance(now, &|point| truth.obstacle_distance_m(point));
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = State {
            map_from_base: self.plant.map_from_base(),
            twist: self.plant.twist(),
            n_collisions: self.plant.n_collisions(),
            at: now,
        };
    }

    fn base_state(&self, stamp_ns: u64) -> BaseState {
        BaseState {
            stamp_ns,
            odom_from_base: self.plant.odom_from_base(),
            twist: self.plant.twist(),
            fault: (self.bumper && self.plant.in_contact()).then_some(BaseFault::Bumper),
        }
    }
}

impl Robot for SimulatedRobot {
    fn sense(&mut self, now: Time) -> anyhow::Result<Senses> {
        self.advance(now);
        let stamp_ns = self.clock.stamp_ns();
        let map_from_base = self.plant.map_from_base();
        // A sensor that is still busy is asked again at the next turn.
        let seen = |beat: &Beat| Snapshot { map_from_base, stamp_ns, seq: beat.n() + 1 };
        if self.scans.is_due(now) && self.lidar.offer(seen(&self.scans)) {
            self.scans.done(now);
        }
        if self.frames.is_due(now) && self.camera.offer(seen(&self.frames)) {
            self.frames.done(now);
        }
        let odometry_due = self.odometry.is_due(now);
        if odometry_due {
            self.odometry.done(now);
        }
        Ok(Senses {
            base: odometry_due.then(|| self.base_state(stamp_ns)),
            scans: self.lidar.fetch().into_iter().collect(),
            frames: self.camera.fetch().into_iter().collect(),
        })
    }

    fn actuate(&mut self, now: Time, command: Twist) -> anyhow::Result<()> {
        self.advance(now);
        self.plant.command(now, command);
        Ok(())
    }
}

fn lidar_thread(
    world: &World,
    profile: &Profile,
    settings: &SimulatorSettings,
) -> anyhow::Result<Worker<Snapshot, Scan>> {
    let lidar = Lidar::new(world, profile, settings);
    Worker::start("lidar", move |snapshot: Snapshot| lidar.scan(&snapshot))
}

fn camera_thread(
    world: &World,
    profile: &Profile,
    settings: &SimulatorSettings,
    kept: Arc<KeptFrames>,
) -> anyhow::Result<Worker<Snapshot, RgbdFrame>> {
    let camera = Camera::new(world, profile, settings, kept)?;
    Worker::start("camera", move |snapshot: Snapshot| camera.frame(&snapshot))
}
