//! The offline parser: active rules and words to a reply.
//!
//! A pure function, total and linear in the words. The way through it: `text` (its turns of speech from `frames.txt`) → `item` (with
//! `quantity` and `lexicon`) → `segment` → `scan` → (`background`) → `combine` → `dialogue` or `resolve` → `answer`.
//! What a phrase means is data (`lexicon.toml`, `nouns.toml`, `gate.toml`). Its one promise is not
//! that it understands, but that it does not guess: every word is consumed by a slot that means it,
//! is a known filler, or leads to a question.

pub mod fidelity;
pub mod gate;
pub mod quantity;

mod answer;
mod background;
mod clause;
mod combine;
mod condition;
mod demand;
mod dialogue;
mod doubt;
mod draft;
mod exclusion;
mod item;
mod kinematic;
mod lexicon;
mod limit;
mod noun;
mod number;
mod phrase;
mod reading;
mod resolve;
mod scan;
mod segment;
mod speech;
mod spelling;
mod steps;
mod text;
mod update;
pub mod vague;

pub use reading::parse;
pub use text::CHARS_MAX;
