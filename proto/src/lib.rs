//! The contract between processes: which keys there are, what they carry, and how it is written.
//!
//! [`topics`] is the table from which all else follows. Deliberately not here: sockets, sessions and
//! clocks (`runtime/service`), and any decision.

pub mod codec;
pub mod header;
pub mod instruction;
pub mod keys;
pub mod maps;
pub mod motion;
pub mod places;
pub mod rule_set;
pub mod sensing;
pub mod status;
pub mod topics;

pub use codec::{DecodeError, EncodeError, Encoding, Invalid, Message, WIRE_VERSION, decode, encode};
pub use header::Header;
pub use instruction::{Instruction, InstructionReply};
pub use keys::Segment;
pub use maps::{
    BaseMap, CellSet, DepthObstacles, GridLayout, ObjectMap, PoseEstimate, PoseQuality, SemanticsBeat,
};
pub use motion::{BaseFault, Goal, NominalCommand, Odometry, SafeCommand};
pub use places::{Place, Places};
pub use rule_set::{Grounding, RuleHeld, RuleSet, RulesHeld};
pub use sensing::{HeatMaps, HeatMapsRequest, ModelImage, RgbdFrame, Scan, Segments, SegmentsRequest};
pub use status::{
    Binding, DroppedCount, FilterStatus, Health, InputAge, NavigatorStatus, ObjectDistance, RejectedCount,
    RobotStatus, Truth,
};
pub use topics::{Delivery, Topic};
