//! What a base is told to do: a forward speed and a turn rate.

/// A set-point for a differential base, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Twist {
    /// Forward speed, m/s; negative is backwards.
    pub speed_m_s: f64,
    /// Turn rate, rad/s; positive is to the left.
    pub yaw_rate_rad_s: f64,
}

impl Twist {
    /// Standing still.
    pub const ZERO: Twist = Twist { speed_m_s: 0.0, yaw_rate_rad_s: 0.0 };

    /// A set-point from its parts.
    #[must_use]
    pub const fn new(speed_m_s: f64, yaw_rate_rad_s: f64) -> Self {
        Twist { speed_m_s, yaw_rate_rad_s }
    }

    /// True when no part is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.speed_m_s.is_finite() && self.yaw_rate_rad_s.is_finite()
    }
}
