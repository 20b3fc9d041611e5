//! The schemas of Foxglove that recordings use, as JSON Schema (names and fields: foxglove.dev/docs, "schemas").
//!
//! Only the fields that are written are described; a reader takes the rest to be absent.

use serde_json::{Value, json};

/// What a message is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sort {
    CompressedImage,
    PointCloud,
    Grid,
    PosesInFrame,
    FrameTransform,
    Log,
}

impl Sort {
    /// By which readers know it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Sort::CompressedImage => "foxglove.CompressedImage",
            Sort::PointCloud => "foxglove.PointCloud",
            Sort::Grid => "foxglove.Grid",
            Sort::PosesInFrame => "foxglove.PosesInFrame",
            Sort::FrameTransform => "foxglove.FrameTransform",
            Sort::Log => "foxglove.Log",
        }
    }

    /// What it consists of.
    pub(super) fn schema(self) -> Value {
        let framed = |more: &[(&str, Value)]| {
            let first = [("timestamp", time()), ("frame_id", text())];
            object(self.name(), first.into_iter().chain(more.iter().map(|(k, v)| (*k, v.clone()))))
        };
        match self {
            Sort::CompressedImage => framed(&[("data", bytes()), ("format", text())]),
            Sort::PointCloud => framed(&[
                ("pose", pose()),
                ("point_stride", whole()),
                ("fields", list(&field())),
                ("data", bytes()),
            ]),
            Sort::Grid => framed(&[
                ("pose", pose()),
                ("column_count", whole()),
                ("cell_size", vector("foxglove.Vector2", &["x", "y"])),
                ("row_stride", whole()),
                ("cell_stride", whole()),
                ("fields", list(&field())),
                ("data", bytes()),
            ]),
            Sort::PosesInFrame => framed(&[("poses", list(&pose()))]),
            Sort::FrameTransform => object(
                self.name(),
                [
                    ("timestamp", time()),
                    ("parent_frame_id", text()),
                    ("child_frame_id", text()),
                    ("translation", vector("foxglove.Vector3", &["x", "y", "z"])),
                    ("rotation", vector("foxglove.Quaternion", &["x", "y", "z", "w"])),
                ],
            ),
            Sort::Log => object(
                self.name(),
                [("timestamp", time()), ("level", whole()), ("message", text()), ("name", text())],
            ),
        }
    }
}

fn object<'a>(title: &str, fields: impl IntoIterator<Item = (&'a str, Value)>) -> Value {
    let fields: serde_json::Map<String, Value> = fields.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
    json!({ "title": title, "type": "object", "properties": fields })
}

fn time() -> Value {
    let part = json!({ "type": "integer", "minimum": 0 });
    json!({ "title": "time", "type": "object", "properties": { "sec": part, "nsec": part } })
}

fn text() -> Value {
    json!({ "type": "string" })
}

fn whole() -> Value {
    json!({ "type": "integer", "minimum": 0 })
}

fn bytes() -> Value {
    json!({ "type": "string", "contentEncoding": "base64" })
}

fn list(of: &Value) -> Value {
    json!({ "type": "array", "items": of })
}

fn vector(title: &str, axes: &[&'static str]) -> Value {
    object(title, axes.iter().map(|axis| (*axis, json!({ "type": "number" }))))
}

fn pose() -> Value {
    let position = vector("foxglove.Vector3", &["x", "y", "z"]);
    let orientation = vector("foxglove.Quaternion", &["x", "y", "z", "w"]);
    object("foxglove.Pose", [("position", position), ("orientation", orientation)])
}

fn field() -> Value {
    let fields = [("name", text()), ("offset", whole()), ("type", whole())];
    object("foxglove.PackedElementField", fields)
}
