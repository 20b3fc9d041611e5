//! A robot whose world is a scene: the plant, its sensors' threads, and what they hand over.
//!
//! Simulated time is the loop's own time. Rendering happens on threads of its own, from a copy of the
//! pose; the loop only fetches what is ready, so a slow picture never delays the motors.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::Context;
use geometry::{Pose2, Profile, Time, Twist};
use proto::{BaseFault, Header, RgbdFrame, Scan};
use robot::{BaseState, Robot, Senses};
use service::Clock;

use crate::base::{Plant, Start};
use crate::config::{OdometryOrigin, SimulatorSettings};
use crate::kept_frames::KeptFrames;
use crate::raycast::RayCaster;
use crate::scene::{Hull, Scene};
use crate::sensor_noise::draws;
use crate::truth::GroundTruth;
use crate::worker::Worker;

/// How far the threads that render give way to everybody else.
const CAMERA_NICENESS: u8 = 10;

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

/// The moment that a sensor sees.
#[derive(Clone, Copy, Debug)]
struct Snapshot {
    map_from_base: Pose2,
    stamp_ns: u64,
    /// Counts this sensor's pictures, from 1.
    seq: u64,
}

/// Something that happens at a steady rate.
#[derive(Clone, Copy, Debug)]
struct Beat {
    period: Duration,
    next: Time,
    /// How often it has happened.
    n: u64,
}

impl Beat {
    fn new(rate_hz: f64, now: Time) -> Self {
        Beat { period: Duration::from_secs_f64(1.0 / rate_hz.max(0.01)), next: now, n: 0 }
    }

    fn is_due(&self, now: Time) -> bool {
        now >= self.next
    }

    /// It has happened; what was missed is not made up for.
    fn done(&mut self, now: Time) {
        let late = now.since(self.next) >= self.period;
        self.next = if late { now + self.period } else { self.next + self.period };
        self.n += 1;
    }
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
        let odom_from_start = match settings.base.odometry_origin {
            OdometryOrigin::Map => map_from_start,
            OdometryOrigin::Start => Pose2::IDENTITY,
        };
        let start = Start { map_from_start, odom_from_start };
        let plant = Plant::new(settings.plant_limits(profile), settings.noise.wheels(), start, now);
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
        let seen = |beat: &Beat| Snapshot { map_from_base, stamp_ns, seq: beat.n + 1 };
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
    let (rays, mount, lidar) = (Arc::clone(&world.rays), profile.lidar, settings.lidar);
    let (noise, seed) = (settings.noise.sensors(), settings.seed);
    let base_from_lidar = Pose2::new(mount.x_m, mount.y_m, mount.yaw_rad);
    Worker::start("lidar", move |snapshot: Snapshot| {
        let map_from_lidar = snapshot.map_from_base * base_from_lidar;
        let mut ranges_m = rays.scan(map_from_lidar, mount.z_m, lidar.n_beams, lidar.range_m_max);
        noise.spoil_ranges(&mut ranges_m, &mut draws(seed, "scan", snapshot.seq));
        for range_m in &mut ranges_m {
            if f64::from(*range_m) < lidar.range_m_min {
                *range_m = f32::NAN;
            } else if f64::from(*range_m) > lidar.range_m_max {
                *range_m = f32::INFINITY;
            }
        }
        Scan {
            header: Header { seq: snapshot.seq, stamp_ns: snapshot.stamp_ns, echo: 0 },
            angle_min_rad: 0.0,
            angle_step_rad: std::f64::consts::TAU / f64::from(lidar.n_beams),
            duration_s: 0.0,
            range_m_min: lidar.range_m_min,
            range_m_max: lidar.range_m_max,
            ranges_m,
        }
    })
}

fn camera_thread(
    world: &World,
    profile: &Profile,
    settings: &SimulatorSettings,
    kept: Arc<KeptFrames>,
) -> anyhow::Result<Worker<Snapshot, RgbdFrame>> {
    let (rays, mount, camera) = (Arc::clone(&world.rays), profile.camera, settings.camera);
    let (noise, seed) = (settings.noise.sensors(), settings.seed);
    let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
    let n_threads = if camera.n_threads == 0 { (n_cores / 2).max(1) } else { camera.n_threads };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(n_threads)
        .thread_name(|k| format!("camera-{k}"))
        .start_handler(|_| give_way())
        .build()
        .context("start the camera's threads")?;
    Worker::start("camera", move |snapshot: Snapshot| {
        let map_from_camera = snapshot.map_from_base.lifted(0.0) * mount.base_from_camera();
        let mut image = pool.install(|| rays.image(&map_from_camera, &mount.intrinsics, camera.depth_m_max));
        noise.spoil_depth(&mut image.depth_mm, &mut draws(seed, "depth", snapshot.seq));
        kept.keep(snapshot.seq, snapshot.stamp_ns, &image.seen);
        RgbdFrame {
            header: Header { seq: snapshot.seq, stamp_ns: snapshot.stamp_ns, echo: 0 },
            intrinsics: mount.intrinsics,
            rgb: image.rgb,
            depth_mm_le: RgbdFrame::depth_bytes(&image.depth_mm),
        }
    })
}

/// A picture may be late; the loop that drives the base may not.
fn give_way() {
    if let Err(error) = service::priority::lower_this_thread(CAMERA_NICENESS) {
        tracing::warn!(%error, "the camera's threads compete with the base's");
    }
}
