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
use serde::{Deserialize, Serialize};
use service::Settings;
use toml::Table;

/// How far the start may lie from where the scene says, metres: "randomised" as the paper has it, and little
/// enough that the nominal way stays the nominal way.
const START_JITTER_M: f64 = 0.15;

/// Who keeps the rules, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[clap(rename_all = "snake_case")]
pub enum Method {
    /// Ours: leaves the nominal command alone until the last moment.
    LeastRestrictive,
    /// Ours: steers away early and gently.
    SmoothBlending,
    /// Obstacles only: nobody tells the robot the words.
    SafeGeom,
    /// Boxes of an open-vocabulary detector, projected to the floor; exclusions only.
    SafeLang,
    /// The paper's least-restrictive filter as printed.
    PaperLiteral,
}

impl Method {
    /// Every method, in the order of reports.
    pub const ALL: [Method; 5] = [
        Method::LeastRestrictive,
        Method::SmoothBlending,
        Method::SafeGeom,
        Method::SafeLang,
        Method::PaperLiteral,
    ];

    /// As on the command line.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Method::LeastRestrictive => "least_restrictive",
            Method::SmoothBlending => "smooth_blending",
            Method::SafeGeom => "safe_geom",
            Method::SafeLang => "safe_lang",
            Method::PaperLiteral => "paper_literal",
        }
    }
}

/// What the nominal planner sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Planner {
    /// Obstacles only: the filter alone keeps the rules.
    Base,
    /// Obstacles, and the regions that rules keep the robot out of.
    Rules,
}

/// How well the robot senses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Sensing {
    /// Nothing errs, as in the paper.
    Perfect,
    /// Depth scatters and drops out, ranges scatter, masks are missed, wrong, or fall apart.
    Noisy,
}

/// Where masks come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Masks {
    /// The models, with their errors.
    Models,
    /// The ground truth: the pixels of the objects that the case means.
    Truth,
}

/// Everything that a trial differs by, but the scene and the words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Condition {
    /// Who keeps the rules.
    pub method: Method,
    /// What the planner sees.
    pub planner: Planner,
    /// How well the robot senses.
    pub sensing: Sensing,
    /// Where masks come from.
    pub masks: Masks,
    /// Whether the nominal command goes to the motors as it is.
    pub filter_off: bool,
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Each side of the camera's images is divided by this.
    pub camera_divisor: u32,
}

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
        if condition.sensing == Sensing::Noisy {
            setup.simulator.noise = noise();
            if condition.masks == Masks::Models {
                setup.simulator.models = mask_errors();
            }
        }
        setup.filter.seed = condition.seed;
        setup.filter.method = match condition.method {
            Method::LeastRestrictive => MethodName::LeastRestrictive,
            Method::SmoothBlending | Method::SafeGeom | Method::SafeLang => MethodName::SmoothBlending,
            Method::PaperLiteral => MethodName::PaperLiteral,
        };
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

/// A RealSense D435's scatter at close range is about 2 mm at 1 m (datasheet: under 2 % at 2 m); dropout and
/// range error as of common indoor sensors.
fn noise() -> NoiseSettings {
    NoiseSettings { depth_m_at_1_m: 0.003, depth_dropout: 0.05, range_m: 0.01, ..NoiseSettings::default() }
}

/// Chosen: one object in twenty is missed in a frame, one map in fifty shows another object too.
fn mask_errors() -> ModelSettings {
    ModelSettings { missed: 0.05, wrong: 0.02, split: 0.1, delay_s: 0.0 }
}

fn section<S: Settings>(file: &str) -> anyhow::Result<S> {
    let mut table: Table = toml::from_str(file)?;
    let value = table.remove(S::SECTION).with_context(|| format!("no section [{}]", S::SECTION))?;
    value.try_into().with_context(|| format!("section [{}]", S::SECTION))
}
