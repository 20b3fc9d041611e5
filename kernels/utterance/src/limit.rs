//! The limits an order sets: said numbers first, vague words else.

use geometry::Profile;

use crate::draft::Draft;
use crate::lexicon::Sense;
use crate::quantity::{Bound, Kind, Quantity};
use crate::resolve::Trouble;
use crate::vague;

/// Limits and which of them were filled in.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limit {
    /// m/s.
    pub vel_max: Option<f64>,
    /// rad/s.
    pub ang_vel_max: Option<f64>,
    vel_filled_in: bool,
    ang_filled_in: bool,
}

impl Limit {
    /// What care and quiet mean.
    #[must_use]
    pub fn careful(profile: &Profile) -> Limit {
        Limit {
            vel_max: Some(vague::slow_m_s(profile)),
            ang_vel_max: Some(vague::turn_slow_rad_s(profile)),
            vel_filled_in: true,
            ang_filled_in: true,
        }
    }

    /// The same with a speed limit: its own, or else that of `other`.
    #[must_use]
    pub fn with_speed_of(self, other: Limit) -> Limit {
        match self.vel_max {
            Some(_) => self,
            None => Limit { vel_max: other.vel_max, vel_filled_in: other.vel_filled_in, ..self },
        }
    }

    /// Whether a number was said.
    #[must_use]
    pub fn is_said(&self) -> bool {
        self.vel_max.is_some() && !self.vel_filled_in || self.ang_vel_max.is_some() && !self.ang_filled_in
    }

    /// The fields that were filled in.
    pub fn defaults(&self) -> impl Iterator<Item = String> {
        let vel = (self.vel_filled_in && self.vel_max.is_some()).then(|| "vel_max".to_owned());
        let ang = (self.ang_filled_in && self.ang_vel_max.is_some()).then(|| "ang_vel_max".to_owned());
        vel.into_iter().chain(ang)
    }
}

/// The limits of an order.
///
/// # Errors
/// [`Trouble`] when it asks for a minimum, for more than the robot has, or for opposites.
pub fn limit_of(draft: &Draft, profile: &Profile) -> Result<Limit, Trouble> {
    let negated = draft.is_negated();
    let slow_words = draft.has_any(&[
        Sense::Slow,
        Sense::Slower,
        Sense::Crawl,
        Sense::WalkPace,
        Sense::TurnSlow,
        Sense::Halt,
    ]);
    let spins = draft.has(Sense::TurnFast) && !slow_words;
    let spins = spins && draft.quantity(Kind::TurnRate).is_none();
    if !negated && (spins || draft.has_any(&[Sense::Fast, Sense::Faster])) {
        let plain = draft.regions.is_empty()
            && draft.names.is_empty()
            && draft.quantities.is_empty()
            && draft.leftover.is_empty();
        return Err(if slow_words || !plain {
            Trouble::Ask("I can promise a top speed, not to be fast. How fast at most?".into())
        } else {
            Trouble::Unsupported("promise to be fast".into())
        });
    }
    let mut limit = Limit::default();
    let turns = draft.has_any(&[Sense::Turn, Sense::TurnFast, Sense::TurnSlow]);
    for quantity in &draft.quantities {
        match quantity.kind {
            Kind::Speed | Kind::Bare if !turns || quantity.kind == Kind::Speed => {
                limit.vel_max = lower(limit.vel_max, speed(quantity, negated, profile)?);
            }
            Kind::Fraction => {
                let share = if quantity.by { 1.0 - quantity.value } else { quantity.value };
                if !(0.0..=1.0).contains(&share) {
                    return Err(Trouble::Ask(format!(
                        "{} is more than I have. How fast at most?",
                        quantity.said
                    )));
                }
                upper(quantity, negated)?;
                if turns && !draft.has_any(&[Sense::Motion, Sense::SpeedNoun]) {
                    limit.ang_vel_max =
                        lower(limit.ang_vel_max, vague::floor(share * profile.yaw_rate_rad_s_max));
                } else {
                    limit.vel_max = lower(limit.vel_max, vague::floor(share * profile.speed_m_s_max));
                }
            }
            Kind::TurnRate => {
                upper(quantity, negated)?;
                if quantity.value > profile.yaw_rate_rad_s_max {
                    return Err(Trouble::Ask(format!(
                        "I never turn faster than {} rad/s. How fast at most?",
                        profile.yaw_rate_rad_s_max
                    )));
                }
                limit.ang_vel_max = lower(limit.ang_vel_max, quantity.value);
            }
            _ => {}
        }
    }
    if negated && slow_words && limit == Limit::default() && !draft.has_any(&[Sense::Fast, Sense::TurnFast]) {
        return Err(Trouble::Loosens);
    }
    fill_in(draft, profile, turns, &mut limit);
    if limit == Limit::default() {
        return Err(Trouble::Ask("How fast may I go at most?".into()));
    }
    Ok(limit)
}

/// Vague words, where no number was said.
fn fill_in(draft: &Draft, profile: &Profile, turns: bool, limit: &mut Limit) {
    if limit.vel_max.is_none() {
        let plain_slow = draft.has_any(&[Sense::Slow, Sense::Slower])
            || draft.has(Sense::Dampen) && draft.has(Sense::SpeedNoun)
            || draft.is_negated() && draft.has(Sense::Fast);
        let value = if draft.has(Sense::Halt) {
            Some((0.0, false))
        } else if draft.has(Sense::Crawl) {
            Some((vague::crawl_m_s(profile), true))
        } else if draft.has(Sense::WalkPace) {
            Some((vague::walk_m_s(profile), true))
        } else if plain_slow && (!turns || draft.has(Sense::TurnSlow) && draft.has_any(&[Sense::Motion])) {
            Some((vague::slow_m_s(profile), true))
        } else {
            None
        };
        if let Some((speed_m_s, filled_in)) = value {
            limit.vel_max = Some(speed_m_s);
            limit.vel_filled_in = filled_in;
        }
    }
    let slow_turn = draft.has(Sense::TurnSlow)
        || draft.is_negated() && (draft.has(Sense::TurnFast) || turns && draft.has(Sense::Fast))
        || turns && draft.has_any(&[Sense::Slow, Sense::Crawl, Sense::Slower, Sense::Careful]);
    if limit.ang_vel_max.is_none() && slow_turn && limit.vel_max != Some(0.0) {
        limit.ang_vel_max = Some(vague::turn_slow_rad_s(profile));
        limit.ang_filled_in = true;
    }
}

fn speed(quantity: &Quantity, negated: bool, profile: &Profile) -> Result<f64, Trouble> {
    upper(quantity, negated)?;
    if quantity.value > profile.speed_m_s_max {
        let max = profile.speed_m_s_max;
        return Err(if quantity.bound == Bound::Plain && !negated && quantity.kind == Kind::Speed {
            Trouble::Unsafe(format!("go faster than {max} m/s"))
        } else {
            Trouble::Ask(format!("I never go faster than {max} m/s. How fast at most?"))
        });
    }
    Ok(quantity.value)
}

/// Whether the number is a maximum; a minimum cannot be promised.
fn upper(quantity: &Quantity, negated: bool) -> Result<(), Trouble> {
    let minimum = match quantity.bound {
        Bound::Lower => true,
        Bound::Over => !negated,
        Bound::Upper => {
            negated
                && ["under", "below", "less", "slower", "lower"]
                    .iter()
                    .any(|word| quantity.said.contains(word))
        }
        Bound::Plain | Bound::Within => false,
    };
    if minimum { Err(Trouble::Unsupported("promise a minimum speed".into())) } else { Ok(()) }
}

fn lower(a: Option<f64>, b: f64) -> Option<f64> {
    Some(a.map_or(b, |a| a.min(b)))
}
