//! Keys on the network: `heedway/<robot>/<topic>`, so that several robots share one network.

use crate::topics::Topic;

/// The first segment of every key.
pub const ROOT: &str = "heedway";

/// Most characters in a robot's name or in one segment of a key.
pub const NAME_CHARS_MAX: usize = 64;

/// A robot's name, or one segment of a key: letters, digits, `-` and `_`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Segment(String);

/// A name that cannot stand in a key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("name {0:?} must be 1 to {NAME_CHARS_MAX} letters, digits, `-` or `_`")]
pub struct SegmentError(String);

impl Segment {
    /// A checked name.
    ///
    /// # Errors
    /// [`SegmentError`] carries the name.
    pub fn new(name: &str) -> Result<Self, SegmentError> {
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if (1..=NAME_CHARS_MAX).contains(&name.len()) && name.chars().all(plain) {
            return Ok(Segment(name.to_owned()));
        }
        Err(SegmentError(name.chars().take(NAME_CHARS_MAX).collect()))
    }

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Display for Segment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// The full key of a topic, its `*` kept: what a subscriber declares.
#[must_use]
pub fn key(robot: &Segment, topic: &Topic) -> String {
    format!("{ROOT}/{robot}/{}", topic.key)
}

/// The full key of one instance of a topic that ends in `*`; other topics ignore `instance`.
#[must_use]
pub fn instance_key(robot: &Segment, topic: &Topic, instance: &Segment) -> String {
    format!("{ROOT}/{robot}/{}", topic.key.replace('*', instance.as_str()))
}

/// The key of a service's liveliness token.
#[must_use]
pub fn alive_key(robot: &Segment, service: &Segment) -> String {
    format!("{ROOT}/{robot}/alive/{service}")
}

/// The last segment of a key: which instance of a topic that ends in `*` it is.
#[must_use]
pub fn instance_of(key: &str) -> &str {
    key.rsplit('/').next().unwrap_or(key)
}
