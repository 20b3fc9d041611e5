//! The raw files of a standard problem, checked.

/// Most layers; the packed grid names them in 16 bits.
const N_LAYERS_MAX: usize = 4096;
/// Most points along a side.
const N_SIDE_MAX: usize = 8192;

/// One standard problem: fields, states to start from, primitives to choose from.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Points along each side.
    pub n_side: usize,
    /// Each layer's `n_side × n_side` distances, row-major, y along rows, metres.
    pub layers_m: Vec<Vec<f32>>,
    /// Position x, y (m), heading (rad), speed (m/s), nominal turn rate (rad/s) and acceleration (m/s²).
    pub states: Vec<[f64; 6]>,
    /// Turn rate (rad/s) and acceleration (m/s²).
    pub primitives: Vec<[f64; 2]>,
}

/// Files that are no standard problem.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SceneError {
    /// A file whose length does not fit.
    #[error("{what}: {found} numbers, must be {wanted}")]
    Length {
        /// Which file.
        what: &'static str,
        /// The numbers found.
        found: usize,
        /// What was expected.
        wanted: String,
    },
    /// A number that is NaN, infinite or absurdly large.
    #[error("{what}: number {idx} must be finite and within ±100000")]
    Number {
        /// Which file.
        what: &'static str,
        /// Its position.
        idx: usize,
    },
    /// A size out of range.
    #[error("{n_side} points a side and {n_layers} layers, must be 2 to 8192 and 1 to 4096")]
    Size {
        /// Points a side.
        n_side: usize,
        /// Layers.
        n_layers: usize,
    },
}

impl Scene {
    /// A problem from the bytes of its files, little-endian f32 throughout.
    ///
    /// # Errors
    /// [`SceneError`] names the file and what is wrong with it.
    pub fn from_raw(
        (n_side, n_layers): (usize, usize),
        sdf: &[u8],
        states: &[u8],
        primitives: &[u8],
    ) -> Result<Scene, SceneError> {
        if !(2..=N_SIDE_MAX).contains(&n_side) || !(1..=N_LAYERS_MAX).contains(&n_layers) {
            return Err(SceneError::Size { n_side, n_layers });
        }
        let n_points = n_side * n_side;
        let values_m = numbers("sdf", sdf, |n| n == n_points * n_layers, n_points * n_layers)?;
        let states = numbers("states", states, |n| n > 0 && n.is_multiple_of(6), "a multiple of 6")?;
        let primitives = numbers("prims", primitives, |n| n > 0 && n.is_multiple_of(2), "a multiple of 2")?;
        Ok(Scene {
            n_side,
            layers_m: values_m.chunks_exact(n_points).map(<[f32]>::to_vec).collect(),
            states: rows(&states),
            primitives: rows(&primitives),
        })
    }
}

fn numbers(
    what: &'static str,
    bytes: &[u8],
    fits: impl Fn(usize) -> bool,
    wanted: impl ToString,
) -> Result<Vec<f32>, SceneError> {
    let (found, rest) = (bytes.len() / 4, bytes.len() % 4);
    if rest != 0 || !fits(found) {
        return Err(SceneError::Length { what, found, wanted: wanted.to_string() });
    }
    let values: Vec<f32> =
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    match values.iter().position(|v| v.is_nan() || v.abs() > 1e5) {
        Some(idx) => Err(SceneError::Number { what, idx }),
        None => Ok(values),
    }
}

fn rows<const N: usize>(values: &[f32]) -> Vec<[f64; N]> {
    values.chunks_exact(N).map(|row| std::array::from_fn(|k| f64::from(row[k]))).collect()
}
