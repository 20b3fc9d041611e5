//! Wavefront OBJ: the `v` and `f` lines, which is all that a solid needs.
//!
//! Normals, texture coordinates, groups and materials are passed over. Faces of more than three corners
//! are cut into triangles; indices may count from the end, as the format allows.

use geometry::Point3;

use crate::triangulate;

/// Most triangles of one mesh.
pub const N_TRIANGLES_MAX: usize = 200_000;

/// Triangles in the mesh's own frame.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Mesh {
    /// Corners, metres.
    pub vertices: Vec<Point3>,
    /// Indices into `vertices`.
    pub triangles: Vec<[u32; 3]>,
}

/// A text that is no usable OBJ file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MeshError {
    /// A line that cannot be read.
    #[error("line {line}: {reason}")]
    Line {
        /// Counted from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
    },
    /// Nothing to see or to bump into.
    #[error("has no faces, must have at least one")]
    Empty,
    /// Too much.
    #[error("has more than {N_TRIANGLES_MAX} triangles")]
    TooLarge,
}

/// The mesh in the text of an OBJ file.
///
/// # Errors
/// [`MeshError`] names the line; a mesh without faces is an error too.
pub fn parse(text: &str) -> Result<Mesh, MeshError> {
    let mut mesh = Mesh::default();
    for (idx, line) in text.lines().enumerate() {
        let in_line = |reason| MeshError::Line { line: idx + 1, reason };
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => mesh.vertices.push(vertex(words).map_err(in_line)?),
            Some("f") => {
                let corners = face_corners(words, mesh.vertices.len()).map_err(in_line)?;
                add_face(&mut mesh, &corners);
            }
            _ => {}
        }
        if mesh.triangles.len() > N_TRIANGLES_MAX || mesh.vertices.len() > 3 * N_TRIANGLES_MAX {
            return Err(MeshError::TooLarge);
        }
    }
    if mesh.triangles.is_empty() { Err(MeshError::Empty) } else { Ok(mesh) }
}

fn vertex<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Point3, String> {
    let mut part = |name| {
        let word = words.next().ok_or_else(|| format!("vertex has no {name}"))?;
        let value: f64 = word.parse().map_err(|_| format!("{name} is {word:?}, must be a number"))?;
        let limit = crate::scene::COORDINATE_M_MAX;
        if value.abs() <= limit { Ok(value) } else { Err(format!("{name} is {value}, at most {limit}")) }
    };
    Ok(Point3::new(part("x")?, part("y")?, part("z")?))
}

/// Indices from 0 of a face line's words `7`, `7/1`, `7//3`, `7/1/3` or `-1`.
fn face_corners<'a>(words: impl Iterator<Item = &'a str>, n_vertices: usize) -> Result<Vec<u32>, String> {
    let corner = |word: &str| {
        let index = word.split('/').next().unwrap_or_default();
        let number: i64 = index.parse().map_err(|_| format!("{word:?} is no vertex index"))?;
        let n = n_vertices as i64;
        let from_zero = if number < 0 { n + number } else { number - 1 };
        if number == 0 || !(0..n).contains(&from_zero) {
            return Err(format!("vertex index {number}, there are {n} vertices so far"));
        }
        Ok(from_zero as u32)
    };
    // A trailing comment is no corner.
    let corners = words.take_while(|w| !w.starts_with('#')).map(corner).collect::<Result<Vec<u32>, _>>()?;
    if corners.len() < 3 || corners.len() > 1000 {
        return Err(format!("face has {} corners, must have 3 to 1000", corners.len()));
    }
    Ok(corners)
}

fn add_face(mesh: &mut Mesh, corners: &[u32]) {
    let vertex = |idx: &u32| mesh.vertices.get(*idx as usize).copied().unwrap_or_default();
    let points: Vec<Point3> = corners.iter().map(vertex).collect();
    let named = |triangle: [u32; 3]| triangle.map(|k| corners.get(k as usize).copied().unwrap_or_default());
    mesh.triangles.extend(triangulate::face(&points).into_iter().map(named));
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: &str = "# a square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    #[test]
    fn quads_slashes_and_negative_indices_are_read() {
        let positive = parse(&format!("{SQUARE}vn 0 0 1\nf 1//1 2//1 3//1 4//1\n")).unwrap();
        let negative = parse(&format!("{SQUARE}f -4/2/1 -3 -2/7 -1 # all of it\n")).unwrap();
        assert_eq!(positive, negative);
        assert_eq!(positive.triangles.len(), 2);
        let corners: std::collections::BTreeSet<u32> = positive.triangles.iter().flatten().copied().collect();
        assert_eq!(corners.len(), 4);
    }

    #[test]
    fn a_face_that_is_not_convex_is_cut_into_its_own_area() {
        let text = "v 0 0 2\nv 2 0 2\nv 2 2 2\nv 1 0.5 2\nv 0 2 2\nf 1 2 3 4 5\n";
        let mesh = parse(text).unwrap();
        let area: f64 = mesh
            .triangles
            .iter()
            .map(|t| t.map(|k| mesh.vertices[k as usize]))
            .map(|[a, b, c]| (b - a).cross(&(c - a)).norm() / 2.0)
            .sum();
        assert!((area - 2.5).abs() < 1e-12, "{area}");
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let check = |text: &str, wanted: &str| {
            let told = parse(text).unwrap_err().to_string();
            assert!(told.contains(wanted), "{told}");
        };
        check("v 1 2\n", "line 1: vertex has no z");
        check("v 1 2 three\n", "line 1: z is \"three\"");
        check("v 1 2 nan\n", "z is NaN");
        check(&format!("{SQUARE}f 1 2 5\n"), "line 6: vertex index 5, there are 4");
        check(&format!("{SQUARE}f 0 1 2\n"), "vertex index 0");
        check(&format!("{SQUARE}f -5 1 2\n"), "vertex index -5");
        check(&format!("{SQUARE}f 1 2\n"), "face has 2 corners");
        check(&format!("{SQUARE}f a b c\n"), "\"a\" is no vertex index");
        check(SQUARE, "has no faces");
        check("", "has no faces");
    }
}
