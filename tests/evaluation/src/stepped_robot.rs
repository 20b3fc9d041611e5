//! The simulated robot, asked turn by turn: the same plant and sensors as the simulator's, without threads.
//!
//! A picture is made when its moment has come, and handed over as much later as it takes the simulator to
//! make one: who uses it never sees the present. Deliberately not here: the guard before the motors.

use std::sync::Arc;

use geometry::{Pose2, Profile, Time, Twist};
use heedway_simulator::SimulatorSettings;
use heedway_simulator::base::Plant;
use heedway_simulator::beat::Beat;
use heedway_simulator::kept_frames::KeptFrames;
use heedway_simulator::sensors::{Camera, Lidar, Snapshot};
use heedway_simulator::simulated_robot::World;
use heedway_simulator::truth::GroundTruth;
use proto::BaseFault;
use robot::{BaseState, Senses};

/// A robot in a scene, under a simulated clock.
pub struct SteppedRobot {
    plant: Plant,
    truth: Arc<GroundTruth>,
    lidar: Lidar,
    camera: Camera,
    bumper: bool,
    odometry: Beat,
    scans: Beat,
    frames: Beat,
}

impl SteppedRobot {
    /// A robot at rest at the world's start.
    ///
    /// # Errors
    /// When no thread can be had for the camera.
    pub fn new(
        world: &World,
        profile: &Profile,
        settings: &SimulatorSettings,
        kept: Arc<KeptFrames>,
    ) -> anyhow::Result<Self> {
        let now = Time::ZERO;
        Ok(SteppedRobot {
            plant: world.plant(profile, settings, now),
            truth: Arc::clone(&world.truth),
            lidar: Lidar::new(world, profile, settings),
            camera: Camera::new(world, profile, settings, kept)?,
            bumper: settings.base.bumper,
            odometry: Beat::new(settings.base.odometry_rate_hz, now),
            scans: Beat::new(settings.lidar.rate_hz, now),
            frames: Beat::new(settings.camera.rate_hz, now),
        })
    }

    /// What is sensed at this moment; stamps are `stamp_ns`.
    pub fn sense(&mut self, now: Time, stamp_ns: u64) -> Senses {
        self.advance(now);
        let map_from_base = self.plant.map_from_base();
        let seen = |beat: &Beat| Snapshot { map_from_base, stamp_ns, seq: beat.n() };
        let mut senses = Senses::default();
        if self.scans.take(now) {
            senses.scans.push(self.lidar.scan(&seen(&self.scans)));
        }
        if self.frames.take(now) {
            senses.frames.push(self.camera.frame(&seen(&self.frames)));
        }
        senses.base = self.odometry.take(now).then(|| BaseState {
            stamp_ns,
            odom_from_base: self.plant.odom_from_base(),
            twist: self.plant.twist(),
            fault: (self.bumper && self.plant.in_contact()).then_some(BaseFault::Bumper),
        });
        senses
    }

    /// Gives the motors a set-point.
    pub fn actuate(&mut self, now: Time, command: Twist) {
        self.advance(now);
        self.plant.command(now, command);
    }

    /// Puts the robot, as it stands and moves, into another world.
    ///
    /// # Errors
    /// When no thread can be had for the camera.
    pub fn move_to(
        &mut self,
        world: &World,
        profile: &Profile,
        settings: &SimulatorSettings,
        kept: Arc<KeptFrames>,
    ) -> anyhow::Result<()> {
        self.truth = Arc::clone(&world.truth);
        self.plant.look_anew();
        self.lidar = Lidar::new(world, profile, settings);
        self.camera = Camera::new(world, profile, settings, kept)?;
        Ok(())
    }

    fn advance(&mut self, now: Time) {
        let truth = &self.truth;
        self.plant.advance(now, &|point| truth.obstacle_distance_m(point));
    }

    /// Where the base really is.
    #[must_use]
    pub fn map_from_base(&self) -> Pose2 {
        self.plant.map_from_base()
    }

    /// How it really moves.
    #[must_use]
    pub fn twist(&self) -> Twist {
        self.plant.twist()
    }

    /// Contacts since the start.
    #[must_use]
    pub fn n_collisions(&self) -> u64 {
        self.plant.n_collisions()
    }
}
