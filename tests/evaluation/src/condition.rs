//! What trials differ by: who keeps the rules, what the planner sees, how well the robot senses, what happens.
//!
//! Names only; [`crate::setup`] says what they mean in numbers.

use serde::{Deserialize, Serialize};

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

impl Planner {
    /// As on the command line.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Planner::Base => "base",
            Planner::Rules => "rules",
        }
    }
}

/// How well the robot senses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[clap(rename_all = "snake_case")]
pub enum Sensing {
    /// Nothing errs, as in the paper.
    Perfect,
    /// Depth scatters and drops out, ranges scatter, masks are missed, wrong, or fall apart.
    Noisy,
    /// One mask in three is missed; else perfect.
    MissedMasks,
    /// One answer in ten shows some other object too; else perfect.
    WrongMasks,
    /// Noisy, and the wheels drift: the pose comes from the LiDAR.
    Drift,
}

impl Sensing {
    /// As on the command line.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Sensing::Perfect => "perfect",
            Sensing::Noisy => "noisy",
            Sensing::MissedMasks => "missed_masks",
            Sensing::WrongMasks => "wrong_masks",
            Sensing::Drift => "drift",
        }
    }
}

/// What happens in a run beside driving.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
#[clap(rename_all = "snake_case")]
pub enum Event {
    /// Nothing: the words are said before the goal is given, as in the paper.
    #[default]
    None,
    /// A box appears on the robot's way.
    Obstacle,
    /// The words come in mid-run, about the last moment at which they can be heeded.
    ToldLate,
    /// The words come when the robot already breaks them.
    ToldInside,
    /// Two seconds after the goal the words are taken back.
    Revoked,
}

impl Event {
    /// As on the command line.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Event::None => "none",
            Event::Obstacle => "obstacle",
            Event::ToldLate => "told_late",
            Event::ToldInside => "told_inside",
            Event::Revoked => "revoked",
        }
    }
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
    /// What happens beside driving.
    pub event: Event,
    /// Where masks come from.
    pub masks: Masks,
    /// Whether the nominal command goes to the motors as it is.
    pub filter_off: bool,
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Each side of the camera's images is divided by this.
    pub camera_divisor: u32,
    /// How much the filter samples; as shipped when not given.
    pub search: Option<SearchSize>,
}

/// How much the filter samples, the paper's N, R and H.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SearchSize {
    /// Sequences in each round.
    pub n_samples: usize,
    /// Rounds.
    pub n_rounds: usize,
    /// Steps before the braking tail.
    pub n_steps: usize,
}

impl std::str::FromStr for SearchSize {
    type Err = String;

    /// Reads `50,2,20`.
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?} is not N,R,H, as in 50,2,20");
        let numbers: Vec<usize> =
            text.split(',').map(str::parse).collect::<Result<_, _>>().map_err(|_| wrong())?;
        match numbers[..] {
            [n_samples, n_rounds, n_steps] => Ok(SearchSize { n_samples, n_rounds, n_steps }),
            _ => Err(wrong()),
        }
    }
}
