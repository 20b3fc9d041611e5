//! What a trial is run with: the shipped configurations, and what the trial changes of them.

use anyhow::{Context, bail};
use geometry::Profile;
use heedway_filter::FilterSettings;
use heedway_filter::config::MethodName;
use heedway_language::LanguageSettings;
use heedway_navigator::NavigatorSettings;
use heedway_navigator::config::Planner as PlannerSetting;
use heedway_perception::{localisation, semantics};
use heedway_simulator::SimulatorSettings;
use heedway_simulator::config::{ModelSettings, NoiseSettings};
use service::Settings;
use toml::Table;

use crate::condition::{Condition, Masks, Method, Planner, SearchSize, Sensing};

/// How far the start may lie from where the scene says, metres: "randomised" as the paper has it, and little
/// enough that the nominal way stays the nominal way.
pub const START_JITTER_M: f64 = 0.15;
/// What a pose from matched scans is taken to err by at most, metres …
const POSE_ERROR_M: f64 = 0.03;
/// … and radians.
const POSE_ERROR_RAD: f64 = 0.01;

/// The settings of every part.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The robot.
    pub profile: Profile,
    /// The simulator's.
    pub simulator: SimulatorSettings,
    /// Localisation's.
    pub localisation: localisation::Settings,
    /// Semantics'.
    pub semantics: semantics::Settings,
    /// Language's.
    pub language: LanguageSettings,
    /// The filter's.
    pub filter: FilterSettings,
    /// The navigator's.
    pub navigator: NavigatorSettings,
}

impl Setup {
    /// The shipped settings of the simulated robot, with what the condition changes.
    ///
    /// # Errors
    /// When a shipped file does not hold what its service needs: names the section.
    pub fn new(condition: &Condition) -> anyhow::Result<Self> {
        let mut setup = Setup {
            profile: profile(condition.camera_divisor)?,
            simulator: section(include_str!("../../../deploy/config/sim/simulator.toml"))?,
            localisation: section(include_str!("../../../deploy/config/sim/localisation.toml"))?,
            semantics: section(include_str!("../../../deploy/config/sim/semantics.toml"))?,
            language: section(include_str!("../../../deploy/config/sim/language.toml"))?,
            filter: section(include_str!("../../../deploy/config/sim/filter.toml"))?,
            navigator: section(include_str!("../../../deploy/config/sim/navigator.toml"))?,
        };
        setup.simulator.seed = condition.seed;
        setup.simulator.start_jitter_m = START_JITTER_M;
        setup.simulator.camera.n_threads = 1;
        setup.sense(condition);
        setup.filter.seed = condition.seed;
        setup.filter.method = match condition.method {
            Method::LeastRestrictive => MethodName::LeastRestrictive,
            Method::SmoothBlending | Method::SafeGeom | Method::SafeLang => MethodName::SmoothBlending,
            Method::PaperLiteral => MethodName::PaperLiteral,
        };
        if let Some(SearchSize { n_samples, n_rounds, n_steps }) = condition.search {
            setup.filter.n_samples = n_samples;
            setup.filter.n_rounds = n_rounds;
            setup.filter.n_steps = n_steps;
        }
        setup.navigator.planner = match (condition.method, condition.planner) {
            (Method::SafeGeom, _) | (_, Planner::Base) => PlannerSetting::Base,
            _ => PlannerSetting::BaseAndRules,
        };
        // As many pixels apart on the sensor as with the full image.
        setup.semantics.obstacle_stride_px =
            (setup.semantics.obstacle_stride_px / condition.camera_divisor as usize).max(1);
        setup.check()?;
        Ok(setup)
    }

    /// Makes the sensors and the models err as the condition says.
    fn sense(&mut self, condition: &Condition) {
        let (noise, models) = match condition.sensing {
            Sensing::Perfect => (NoiseSettings::default(), ModelSettings::default()),
            Sensing::Noisy => (noise(), mask_errors()),
            Sensing::MissedMasks => {
                (NoiseSettings::default(), ModelSettings { missed: 0.33, ..ModelSettings::default() })
            }
            Sensing::WrongMasks => {
                (NoiseSettings::default(), ModelSettings { wrong: 0.1, ..ModelSettings::default() })
            }
            Sensing::Drift => (drifting(), mask_errors()),
        };
        self.simulator.noise = noise;
        if condition.masks == Masks::Models {
            self.simulator.models = models;
        }
        if condition.sensing == Sensing::Drift {
            self.localisation.pose = localisation::config::PoseBy::Slam;
            // What a matched pose errs by; wheels alone err less over a scan's time.
            self.filter.disturbance.position_m = POSE_ERROR_M;
            self.filter.disturbance.yaw_rad = POSE_ERROR_RAD;
        }
    }

    fn check(&self) -> anyhow::Result<()> {
        let profile = &self.profile;
        self.simulator.check(profile).context("[simulator]")?;
        self.localisation.check(profile).context("[localisation]")?;
        self.semantics.check(profile).context("[semantics]")?;
        self.language.check(profile).context("[language]")?;
        self.filter.check(profile).context("[filter]")?;
        self.navigator.check(profile).context("[navigator]")
    }
}

/// The shipped profile of the simulated robot, with a coarser camera.
///
/// # Errors
/// When the camera cannot be divided so.
pub fn profile(camera_divisor: u32) -> anyhow::Result<Profile> {
    let mut profile: Profile = toml::from_str(include_str!("../../../deploy/profiles/sim.toml"))?;
    let camera = &mut profile.camera.intrinsics;
    if camera_divisor == 0
        || !camera.width.is_multiple_of(camera_divisor)
        || !camera.height.is_multiple_of(camera_divisor)
    {
        let (width, height) = (camera.width, camera.height);
        bail!("camera divisor is {camera_divisor}, must divide {width} and {height}");
    }
    let share = 1.0 / f64::from(camera_divisor);
    camera.width /= camera_divisor;
    camera.height /= camera_divisor;
    camera.fx *= share;
    camera.fy *= share;
    // Pixel centres are at whole numbers: the border lies half a pixel before the first.
    camera.cx = (camera.cx + 0.5) * share - 0.5;
    camera.cy = (camera.cy + 0.5) * share - 0.5;
    profile.checked().context("profile")
}

/// A RealSense D435's scatter at close range is about 2 mm at 1 m (datasheet: under 2 % at 2 m), growing with the
/// square of the distance; one pixel in ten is missing; range error as of common indoor scanners.
fn noise() -> NoiseSettings {
    NoiseSettings { depth_m_at_1_m: 0.003, depth_dropout: 0.1, range_m: 0.01, ..NoiseSettings::default() }
}

/// The same, and wheels that measure ways 2 % too long and turn one degree a metre that is not made.
fn drifting() -> NoiseSettings {
    NoiseSettings { odometry_scale: 0.02, odometry_yaw_rad_per_m: 0.0175, ..noise() }
}

/// Chosen: one object in ten is missed in a frame, one map in fifty shows another object too.
fn mask_errors() -> ModelSettings {
    ModelSettings { missed: 0.1, wrong: 0.02, split: 0.1, delay_s: 0.0 }
}

fn section<S: Settings>(file: &str) -> anyhow::Result<S> {
    let mut table: Table = toml::from_str(file)?;
    let value = table.remove(S::SECTION).with_context(|| format!("no section [{}]", S::SECTION))?;
    value.try_into().with_context(|| format!("section [{}]", S::SECTION))
}
