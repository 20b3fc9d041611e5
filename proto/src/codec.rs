//! Bytes to messages and back: one version, one size limit, never a panic.
//!
//! What a person reads is JSON. The rest is compact binary: the magic `HW`, the wire version, the
//! message's own kind, then postcard. Everything from outside is checked here and nowhere else:
//! size first, then form, then the numbers ([`Message::check`]).

use serde::{Serialize, de::DeserializeOwned};

/// Version of the binary and JSON forms. A message of another version is rejected, never guessed at.
pub const WIRE_VERSION: u8 = 1;

const MAGIC: [u8; 2] = *b"HW";
const N_HEADER_BYTES: usize = 4;

/// How a message is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Text that a person can read.
    Json,
    /// Compact; `kind` tells the messages apart.
    Binary {
        /// This message's number, unique among the binary messages.
        kind: u8,
    },
}

/// Something that crosses the network.
pub trait Message: Serialize + DeserializeOwned + Send + Sync + 'static {
    /// Its name, for errors and logs.
    const NAME: &'static str;
    /// How it is written.
    const ENCODING: Encoding;
    /// The longest encoding that is accepted, bytes.
    const N_BYTES_MAX: usize;

    /// Checks what the types do not: finite numbers, ranges, lengths.
    ///
    /// # Errors
    /// [`Invalid`] names the field, the value and the limit.
    fn check(&self) -> Result<(), Invalid>;

    /// Order, stamp and echo, for messages that have them.
    fn header(&self) -> Option<&crate::Header> {
        None
    }
}

/// A field that is out of its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field} is {value}, must be {limit}")]
pub struct Invalid {
    /// The field's name.
    pub field: &'static str,
    /// What was found.
    pub value: String,
    /// What is allowed.
    pub limit: String,
}

impl Invalid {
    /// An error that names field, value and limit.
    #[must_use]
    pub fn new(field: &'static str, value: impl ToString, limit: impl ToString) -> Self {
        Invalid { field, value: value.to_string(), limit: limit.to_string() }
    }
}

/// `Ok` when `low ≤ value ≤ high`; NaN is not.
///
/// # Errors
/// [`Invalid`] with the value and the range.
pub fn within(field: &'static str, value: f64, low: f64, high: f64) -> Result<(), Invalid> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Invalid::new(field, value, format_args!("{low} to {high}")))
}

/// `Ok` when `found == wanted` values are there.
///
/// # Errors
/// [`Invalid`] with both numbers.
pub fn n_values(field: &'static str, found: usize, wanted: usize) -> Result<(), Invalid> {
    if found == wanted {
        return Ok(());
    }
    Err(Invalid::new(field, format_args!("{found} values"), format_args!("{wanted} values")))
}

/// Bytes that are no message of the wanted kind.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// Longer than the topic allows; nothing was read.
    #[error("{name}: {n_bytes} bytes, at most {n_bytes_max}")]
    Oversized {
        /// The message.
        name: &'static str,
        /// Bytes received.
        n_bytes: usize,
        /// Bytes allowed.
        n_bytes_max: usize,
    },
    /// Too short for a header, or another magic.
    #[error("{name}: not a heedway message ({n_bytes} bytes, no `HW` in front)")]
    NotOurs {
        /// The message.
        name: &'static str,
        /// Bytes received.
        n_bytes: usize,
    },
    /// Another wire version.
    #[error("{name}: wire version {found}, this program speaks {WIRE_VERSION}")]
    Version {
        /// The message.
        name: &'static str,
        /// Version received.
        found: u8,
    },
    /// Another kind of message on this key.
    #[error("{name}: message kind {found}, this key carries {wanted}")]
    Kind {
        /// The message.
        name: &'static str,
        /// Kind received.
        found: u8,
        /// Kind of this key.
        wanted: u8,
    },
    /// The body does not parse.
    #[error("{name}: {reason}")]
    Malformed {
        /// The message.
        name: &'static str,
        /// What the parser said.
        reason: String,
    },
    /// It parses, and a value is out of range.
    #[error("{name}: {invalid}")]
    Invalid {
        /// The message.
        name: &'static str,
        /// Which value.
        invalid: Invalid,
    },
}

/// A message that cannot be written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// The sender's own message breaks its own rules.
    #[error("{name}: {invalid}")]
    Invalid {
        /// The message.
        name: &'static str,
        /// Which value.
        invalid: Invalid,
    },
    /// It is longer than the topic allows.
    #[error("{name}: {n_bytes} bytes, at most {n_bytes_max}")]
    Oversized {
        /// The message.
        name: &'static str,
        /// Bytes needed.
        n_bytes: usize,
        /// Bytes allowed.
        n_bytes_max: usize,
    },
    /// The serialiser refused.
    #[error("{name}: {reason}")]
    Serialiser {
        /// The message.
        name: &'static str,
        /// What it said.
        reason: String,
    },
}

/// The bytes of a message.
///
/// # Errors
/// [`EncodeError`] when the message breaks its own rules: nothing that a receiver would reject is sent.
pub fn encode<M: Message>(message: &M) -> Result<Vec<u8>, EncodeError> {
    let name = M::NAME;
    message.check().map_err(|invalid| EncodeError::Invalid { name, invalid })?;
    let bytes = match M::ENCODING {
        Encoding::Json => serde_json::to_vec(message)
            .map_err(|e| EncodeError::Serialiser { name, reason: e.to_string() })?,
        Encoding::Binary { kind } => {
            let front = vec![MAGIC[0], MAGIC[1], WIRE_VERSION, kind];
            postcard::to_extend(message, front)
                .map_err(|e| EncodeError::Serialiser { name, reason: e.to_string() })?
        }
    };
    if bytes.len() > M::N_BYTES_MAX {
        return Err(EncodeError::Oversized { name, n_bytes: bytes.len(), n_bytes_max: M::N_BYTES_MAX });
    }
    Ok(bytes)
}

/// The message in some bytes.
///
/// # Errors
/// [`DecodeError`] for anything that is not exactly one valid message of this kind.
pub fn decode<M: Message>(bytes: &[u8]) -> Result<M, DecodeError> {
    let name = M::NAME;
    let n_bytes = bytes.len();
    if n_bytes > M::N_BYTES_MAX {
        return Err(DecodeError::Oversized { name, n_bytes, n_bytes_max: M::N_BYTES_MAX });
    }
    let message: M = match M::ENCODING {
        Encoding::Json => serde_json::from_slice(bytes)
            .map_err(|e| DecodeError::Malformed { name, reason: e.to_string() })?,
        Encoding::Binary { kind } => decode_binary(name, bytes, kind)?,
    };
    message.check().map_err(|invalid| DecodeError::Invalid { name, invalid })?;
    Ok(message)
}

fn decode_binary<M: DeserializeOwned>(
    name: &'static str,
    bytes: &[u8],
    wanted: u8,
) -> Result<M, DecodeError> {
    let Some((&[h, w, version, kind], body)) = bytes.split_first_chunk::<N_HEADER_BYTES>() else {
        return Err(DecodeError::NotOurs { name, n_bytes: bytes.len() });
    };
    if [h, w] != MAGIC {
        return Err(DecodeError::NotOurs { name, n_bytes: bytes.len() });
    }
    if version != WIRE_VERSION {
        return Err(DecodeError::Version { name, found: version });
    }
    if kind != wanted {
        return Err(DecodeError::Kind { name, found: kind, wanted });
    }
    match postcard::take_from_bytes(body) {
        Ok((message, [])) => Ok(message),
        Ok((_, rest)) => {
            Err(DecodeError::Malformed { name, reason: format!("{} bytes left over", rest.len()) })
        }
        Err(e) => Err(DecodeError::Malformed { name, reason: e.to_string() }),
    }
}
