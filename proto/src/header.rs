//! What every message of the machines carries in front: order, stamp, echo.

use serde::{Deserialize, Serialize};

/// Order, stamp and echo of a message.
///
/// A stamp orders the data of one publisher and relates frames to poses; it never proves data new:
/// freshness is judged by the receiver's own clock. The echo carries back the last sequence number the
/// publisher has heard from the *receiver*, so that a steady delay does not look fresh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    /// Counts the publisher's messages on this key since its start, from 1.
    pub seq: u64,
    /// When the content was true: nanoseconds since the Unix epoch, by the publisher's clock.
    pub stamp_ns: u64,
    /// Last sequence number heard from whoever acts on this message; 0 when none was.
    pub echo: u64,
}
