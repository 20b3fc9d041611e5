//! What LiDAR and camera make of one moment: rays, then noise, then a message as their drivers send it.
//!
//! Plain work on the caller's thread; who calls them, and when, is not their affair.

use std::sync::Arc;

use anyhow::Context;
use geometry::profile::{CameraMount, LidarMount};
use geometry::{Pose2, Profile};
use proto::{Header, RgbdFrame, Scan};

use crate::config::{CameraSettings, LidarSettings, SimulatorSettings};
use crate::kept_frames::KeptFrames;
use crate::raycast::RayCaster;
use crate::sensor_noise::{SensorNoise, draws};
use crate::simulated_robot::World;

/// How far the threads that render give way to everybody else.
const CAMERA_NICENESS: u8 = 10;

/// The moment that a sensor sees.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot {
    /// The base in `map`.
    pub map_from_base: Pose2,
    /// The moment, nanoseconds by the robot's wall clock.
    pub stamp_ns: u64,
    /// Counts this sensor's pictures, from 1.
    pub seq: u64,
}

/// The LiDAR of a robot in a scene.
pub struct Lidar {
    rays: Arc<RayCaster>,
    mount: LidarMount,
    settings: LidarSettings,
    noise: SensorNoise,
    seed: u64,
}

impl Lidar {
    /// The LiDAR that profile and settings describe.
    #[must_use]
    pub fn new(world: &World, profile: &Profile, settings: &SimulatorSettings) -> Self {
        Lidar {
            rays: Arc::clone(&world.rays),
            mount: profile.lidar,
            settings: settings.lidar,
            noise: settings.noise.sensors(),
            seed: settings.seed,
        }
    }

    /// One turn.
    #[must_use]
    pub fn scan(&self, snapshot: &Snapshot) -> Scan {
        let (mount, lidar) = (self.mount, self.settings);
        let map_from_lidar = snapshot.map_from_base * Pose2::new(mount.x_m, mount.y_m, mount.yaw_rad);
        let mut ranges_m = self.rays.scan(map_from_lidar, mount.z_m, lidar.n_beams, lidar.range_m_max);
        self.noise.spoil_ranges(&mut ranges_m, &mut draws(self.seed, "scan", snapshot.seq));
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
    }
}

/// The RGB-D camera of a robot in a scene.
pub struct Camera {
    rays: Arc<RayCaster>,
    mount: CameraMount,
    settings: CameraSettings,
    noise: SensorNoise,
    seed: u64,
    kept: Arc<KeptFrames>,
    pool: rayon::ThreadPool,
}

impl Camera {
    /// The camera that profile and settings describe; instance images of its frames go to `kept`.
    ///
    /// # Errors
    /// When no threads can be had.
    pub fn new(
        world: &World,
        profile: &Profile,
        settings: &SimulatorSettings,
        kept: Arc<KeptFrames>,
    ) -> anyhow::Result<Self> {
        let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
        let n_set = settings.camera.n_threads;
        let n_threads = if n_set == 0 { (n_cores / 2).max(1) } else { n_set };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(n_threads)
            .thread_name(|k| format!("camera-{k}"))
            .start_handler(|_| give_way())
            .build()
            .context("start the camera's threads")?;
        Ok(Camera {
            rays: Arc::clone(&world.rays),
            mount: profile.camera,
            settings: settings.camera,
            noise: settings.noise.sensors(),
            seed: settings.seed,
            kept,
            pool,
        })
    }

    /// One frame.
    #[must_use]
    pub fn frame(&self, snapshot: &Snapshot) -> RgbdFrame {
        let (mount, depth_m_max) = (self.mount, self.settings.depth_m_max);
        let map_from_camera = snapshot.map_from_base.lifted(0.0) * mount.base_from_camera();
        let render = || self.rays.image(&map_from_camera, &mount.intrinsics, depth_m_max);
        let mut image = self.pool.install(render);
        self.noise.spoil_depth(&mut image.depth_mm, &mut draws(self.seed, "depth", snapshot.seq));
        self.kept.keep(snapshot.seq, snapshot.stamp_ns, &image.seen);
        RgbdFrame {
            header: Header { seq: snapshot.seq, stamp_ns: snapshot.stamp_ns, echo: 0 },
            intrinsics: mount.intrinsics,
            rgb: image.rgb,
            depth_mm_le: RgbdFrame::depth_bytes(&image.depth_mm),
        }
    }
}

/// A picture may be late; the loop that drives the base may not.
fn give_way() {
    if let Err(error) = service::priority::lower_this_thread(CAMERA_NICENESS) {
        tracing::warn!(%error, "the camera's threads compete with the base's");
    }
}
