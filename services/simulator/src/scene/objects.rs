//! The `objects` of a scene: meshes, parts and boxes, set down in `map`.

use std::collections::BTreeSet;

use geometry::Pose2;

use super::node::Node;
use super::{Kind, MeshSource, N_OBJECTS_MAX, N_TRIANGLES_MAX, Object, SceneError, read_mesh, read_outline};
use crate::solid::{Placement, Solid};

/// Most parts of one object.
const N_PARTS_MAX: usize = 2000;
/// Largest extent of a shape, metres.
const SIZE_M_MAX: f64 = 1000.0;

/// The objects of a scene, in the file's order.
///
/// # Errors
/// [`SceneError`] names the object and the field.
pub(super) fn read(root: &Node<'_>, meshes: MeshSource<'_>) -> Result<Vec<Object>, SceneError> {
    let mut objects = Vec::new();
    let mut ids = BTreeSet::new();
    let mut n_triangles = 0;
    for node in root.items_of("objects", N_OBJECTS_MAX)? {
        let id_node = node.get("id")?;
        let id = id_node.name()?;
        if !ids.insert(id.clone()) {
            return Err(id_node.fail(format_args!("is {id:?}, which another object has already")));
        }
        let node = node.of_object(&id);
        let object = read_one(&node, id, meshes)?;
        n_triangles += object.solids.iter().map(|s| s.surface().len()).sum::<usize>();
        if n_triangles > N_TRIANGLES_MAX {
            return Err(node.fail(format_args!(
                "with it the objects have {n_triangles} triangles, at most {N_TRIANGLES_MAX}"
            )));
        }
        objects.push(object);
    }
    Ok(objects)
}

fn read_one(node: &Node<'_>, id: String, meshes: MeshSource<'_>) -> Result<Object, SceneError> {
    let placement = read_placement(&node.get("pose")?)?;
    let kind = match node.find("kind")?.map(|n| Ok((n.text(40)?, n))).transpose()? {
        None => Kind::Thing,
        Some((text, _)) if text == "thing" => Kind::Thing,
        Some((text, _)) if text == "floor_area" => Kind::FloorArea,
        Some((text, n)) => {
            return Err(n.fail(format_args!("is {text:?}, must be \"thing\" or \"floor_area\"")));
        }
    };
    let solids = if let Some(mesh) = node.find("mesh")? {
        vec![Solid::mesh(placement, read_mesh(&mesh, meshes)?)]
    } else if let Some(parts) = node.find("parts")? {
        let list = parts.items(N_PARTS_MAX)?;
        if list.is_empty() {
            return Err(parts.fail("is empty, must have at least one part"));
        }
        list.iter().map(|part| read_part(part, placement)).collect::<Result<_, _>>()?
    } else {
        vec![Solid::cuboid(placement, read_box_size(&node.get("size")?)?)]
    };
    Ok(Object {
        label: node.get("label")?.name()?,
        rgb: node.find("rgb")?.map(|n| read_rgb(&n)).transpose()?,
        extra: node.others(&["id", "label", "pose", "size", "mesh", "parts", "kind", "rgb"])?,
        id,
        kind,
        placement,
        solids,
    })
}

fn read_placement(node: &Node<'_>) -> Result<Placement, SceneError> {
    let [x_m, y_m, base_m, yaw_rad] = node.coordinates()?;
    Ok(Placement { map_from_shape: Pose2::new(x_m, y_m, yaw_rad), base_m })
}

fn read_part(node: &Node<'_>, object: Placement) -> Result<Solid, SceneError> {
    let relative = node.find("pose")?.map(|n| read_placement(&n)).transpose()?;
    let at = relative.map_or(object, |part| object.then(part));
    let shape = node.get("shape")?;
    let size = node.get("size")?;
    match shape.text(40)?.as_str() {
        "box" => Ok(Solid::cuboid(at, read_box_size(&size)?)),
        "cylinder" => {
            let [radius_m, height_m] = size.coordinates()?;
            check_above_zero(&size, &[radius_m, height_m])?;
            Ok(Solid::cylinder(at, radius_m, height_m))
        }
        "prism" => {
            // The outline gives the plan; of the size, whatever its form, the last number is the height.
            let numbers = size.items(3)?;
            let height = numbers.last().ok_or_else(|| size.fail("is empty, must end with the height"))?;
            let height_m = height.coordinate()?;
            check_above_zero(&size, &[height_m])?;
            let outline = node.get("polygon")?;
            Solid::prism(at, &read_outline(&outline, 500)?, height_m).map_err(|e| outline.fail(e))
        }
        other => Err(shape.fail(format_args!("is {other:?}, must be \"box\", \"cylinder\" or \"prism\""))),
    }
}

/// A box of [sx, sy, sz]; one of them may be 0: a rug has no height, a poster no depth.
fn read_box_size(node: &Node<'_>) -> Result<[f64; 3], SceneError> {
    let size_m: [f64; 3] = node.coordinates()?;
    let n_flat = size_m.iter().filter(|s| **s == 0.0).count();
    if n_flat > 1 || size_m.iter().any(|s| !(0.0..=SIZE_M_MAX).contains(s)) {
        return Err(node.fail(format_args!(
            "is {size_m:?} m, must be 0 to {SIZE_M_MAX} each, and not more than one of them 0"
        )));
    }
    Ok(size_m)
}

fn check_above_zero(node: &Node<'_>, size_m: &[f64]) -> Result<(), SceneError> {
    if size_m.iter().all(|s| *s > 0.0) {
        return Ok(());
    }
    Err(node.fail(format_args!("is {size_m:?} m, must be above 0")))
}

fn read_rgb(node: &Node<'_>) -> Result<[u8; 3], SceneError> {
    let list = node.items(usize::MAX)?;
    let parts = list.iter().map(|n| n.number(0.0, 255.0)).collect::<Result<Vec<_>, _>>()?;
    let [r, g, b] = <[f64; 3]>::try_from(parts)
        .map_err(|v| node.fail(format_args!("has {} numbers, must have 3", v.len())))?;
    // Both habits are met with: parts of 1, and of 255.
    let scale = if r <= 1.0 && g <= 1.0 && b <= 1.0 { 255.0 } else { 1.0 };
    Ok([r, g, b].map(|part| (part * scale).round() as u8))
}
