//! What is told whether or not anything happened: the beat, the rules held, and what is wrong.

use std::time::Duration;

use geometry::Time;
use proto::{RulesHeld, SemanticsBeat};

/// The beat comes three times a second.
const BEAT_PERIOD: Duration = Duration::from_millis(333);
/// The rules held are repeated this often.
const HELD_PERIOD: Duration = Duration::from_millis(500);
/// The log hears of trouble at most this often.
const LOG_PERIOD: Duration = Duration::from_secs(1);
/// Longest trouble of one kind, and of all together.
const ONE_CHARS_MAX: usize = 200;
const ALL_CHARS_MAX: usize = 450;

/// What is wrong, by kind; empty when nothing is.
#[derive(Clone, Debug, Default)]
pub struct Troubles {
    /// No frame comes through the door.
    pub door: String,
    /// Frames cannot be placed in the map.
    pub place: String,
    /// The models do not answer, or not what was asked.
    pub models: String,
    /// Frames cannot be looked at for obstacles.
    pub looking: String,
    /// Answers cannot be taken in.
    pub fusing: String,
    /// Work does not come to an end.
    pub overdue: String,
    /// Rules are left out.
    pub rules: String,
}

impl Troubles {
    /// Whether nothing can be looked at: all that is wrong but rules that are left out, which are not kept
    /// from being found by blindness and count as not grounded anyway.
    #[must_use]
    pub fn is_blind(&self) -> bool {
        let Troubles { door, place, models, looking, fusing, overdue, rules: _ } = self;
        [door, place, models, looking, fusing, overdue].into_iter().any(|words| !words.is_empty())
    }

    /// All of it, in words; empty when nothing is wrong.
    #[must_use]
    pub fn words(&self) -> String {
        let Troubles { door, place, models, looking, fusing, overdue, rules } = self;
        let all = [door, place, models, looking, fusing, overdue, rules];
        let short = all.into_iter().filter(|words| !words.is_empty()).map(|words| cut(words, ONE_CHARS_MAX));
        cut(&short.collect::<Vec<_>>().join("; "), ALL_CHARS_MAX)
    }
}

fn cut(words: &str, n_chars_max: usize) -> String {
    words.chars().take(n_chars_max).collect()
}

/// Knows what was told last, and when.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// What is wrong.
    pub troubles: Troubles,
    n_beats: u64,
    beaten: Option<Time>,
    held: Option<(Time, RulesHeld)>,
    logged: String,
    logged_at: Time,
}

impl Report {
    /// The rules held, when they have changed or are to be repeated.
    pub fn held(&mut self, now: Time, held: RulesHeld) -> Option<RulesHeld> {
        if let Some((told, last)) = &self.held
            && *last == held
            && now.since(*told) < HELD_PERIOD
        {
            return None;
        }
        self.held = Some((now, held.clone()));
        Some(held)
    }

    /// The beat, numbered and with what is wrong, when it is due.
    pub fn beat(&mut self, now: Time, beat: SemanticsBeat) -> Option<SemanticsBeat> {
        if self.beaten.is_some_and(|beaten| now.since(beaten) < BEAT_PERIOD) {
            return None;
        }
        self.beaten = Some(now);
        self.n_beats += 1;
        let header = proto::Header { seq: self.n_beats, ..beat.header };
        let (is_blind, trouble) = (self.troubles.is_blind(), self.troubles.words());
        Some(SemanticsBeat { header, is_blind, trouble, ..beat })
    }

    /// What is wrong, when that has changed since the log heard of it.
    pub fn news(&mut self, now: Time) -> Option<String> {
        let trouble = self.troubles.words();
        if trouble == self.logged || now.since(self.logged_at) < LOG_PERIOD {
            return None;
        }
        self.logged_at = now;
        self.logged.clone_from(&trouble);
        Some(trouble)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::Message;

    #[test]
    fn however_much_is_wrong_the_beat_can_be_sent() {
        let long = "\u{1f4a5}".repeat(3000);
        let mut report = Report::default();
        let Troubles { door, place, models, looking, fusing, overdue, rules } = &mut report.troubles;
        for words in [door, place, models, looking, fusing, overdue, rules] {
            words.clone_from(&long);
        }
        let header = proto::Header::default();
        let empty = SemanticsBeat {
            header,
            rules_version: 1,
            n_frames: 0,
            n_frames_dropped: 0,
            is_blind: false,
            trouble: String::new(),
        };
        let beat = report.beat(Time::ZERO, empty).unwrap();
        assert!(beat.is_blind && !beat.trouble.is_empty());
        assert_eq!(beat.check(), Ok(()));
        assert!(proto::encode(&beat).is_ok());
    }

    #[test]
    fn the_log_hears_of_a_change_once_and_not_more_than_once_a_second() {
        let mut report = Report::default();
        let at = |ms: u64| Time::ZERO + Duration::from_millis(ms);
        assert_eq!(report.news(at(5000)), None);
        report.troubles.place = "lost".into();
        assert_eq!(report.news(at(5000)), Some("lost".into()));
        report.troubles.place.clear();
        assert_eq!(report.news(at(5999)), None);
        assert_eq!(report.news(at(6000)), Some(String::new()));
    }
}
