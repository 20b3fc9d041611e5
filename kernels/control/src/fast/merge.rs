//! Many layers on one lattice become one grid of packed cells: their smallest margin, whoever's it is.
//!
//! The minimum of the corners, interpolated, is not the minimum of the layers: where two of them cross inside
//! a cell it lies up to half a cell too low. Those cells (*ridges*) are marked and list the layers that can be
//! smallest in them; everywhere else one layer is smallest at all corners, hence in all the cell, and is known
//! by name. So the merged grid gives every margin exactly, in one look-up nearly always, however many layers
//! there are. Done when maps change, not at every tick.

use super::isa::Isa;
use super::packed::RIDGE;

mod loops;

use loops::{Pack, Quantise, Scale, Smallest, Steepest, Steps};

/// One layer of a merge: values at the lattice's points, row-major, and what is subtracted from them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MergeLayer<'a> {
    /// Distances, metres.
    pub values_m: &'a [f32],
    /// What the distance must exceed, metres.
    pub keep_m: f32,
}

/// What of the margins matters, and how much room words have for their first corners.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    /// Below this, and above `high_m`, it is all one how far, metres.
    pub low_m: f32,
    /// See `low_m`.
    pub high_m: f32,
    /// Quanta.
    pub base_max: i32,
}

/// Finest quantum, metres: finer would only shorten the range.
const QUANTUM_M_MIN: f32 = 0.001;
/// A margin is lowered by this before it is rounded down, metres: what rounding to f32 may have added.
const SLACK_M: f32 = 2e-6;
/// Crossing layers that differ by no more than this at every corner make no ridge, metres.
const GAP_M: f32 = 0.0001;
/// In `owners`, marks where the layers of a ridge begin.
const RIDGE_OWNER: u32 = 1 << 31;

/// The layers of a lattice, merged.
#[derive(Clone, Debug, Default)]
pub(crate) struct Merged {
    /// Points of the lattice along x and y.
    pub n_cols: usize,
    /// See `n_cols`.
    pub n_rows: usize,
    /// Size of a quantum, metres.
    pub quantum_m: f32,
    /// What words count quanta from, metres.
    pub lowest_m: f32,
    /// The most that the margin changes over the length of a cell side, metres: its true Lipschitz constant.
    pub slope_m: f32,
    /// For each cell the layer that is smallest in it, or where its layers begin in `ridge_layers`.
    owners: Vec<u32>,
    ridge_layers: Vec<u16>,
    /// The words of those layers in the ridge's cell; bit 31 marks the last of each ridge.
    ridge_words: Vec<u32>,
}

impl Merged {
    /// Merges layers of `n_cols × n_rows` points and writes each cell's word through `write`.
    ///
    /// At least two points a side, at least one layer, at most 65535; values finite.
    pub(crate) fn of(
        isa: Isa,
        (n_cols, n_rows): (usize, usize),
        layers: &[MergeLayer<'_>],
        reach: Reach,
        mut write: impl FnMut(usize, u32),
    ) -> Merged {
        debug_assert!(n_cols >= 2 && n_rows >= 2 && !layers.is_empty() && layers.len() <= 65_535);
        let n = n_cols * n_rows;
        let (mut least_m, mut owners) = (vec![f32::INFINITY; n], vec![0_u32; n]);
        let mut row_least_m = vec![0.0_f32; layers.len() * n_rows];
        isa.run(Smallest {
            n_cols,
            layers,
            least_m: &mut least_m,
            owners: &mut owners,
            row_least_m: &mut row_least_m,
        });
        let mut merged = Merged { n_cols, n_rows, owners, ..Merged::default() };
        let mut steepest = isa.run(Steepest { n_cols, least_m: &least_m });
        let (mut marked, mut ridge_cells) = (Vec::new(), Vec::new());
        if layers.len() > 1 {
            let mut found = Ridges { steepest: &mut steepest, marked: &mut marked, cells: &mut ridge_cells };
            for row in 0..n_rows - 1 {
                merged.find_ridges(row, layers, &row_least_m, &least_m, &mut found);
            }
        }
        let scale = Scale::of(&steepest, reach);
        merged.slope_m = steepest.x_m.hypot(steepest.y_m);
        (merged.quantum_m, merged.lowest_m) = (scale.quantum_m, scale.lowest_m);
        let mut quanta = vec![0_i32; n];
        isa.run(Quantise { least_m: &least_m, scale, quanta: &mut quanta });
        let mut words = vec![0_u32; n_cols - 1];
        for (row, quanta) in (0..n_rows - 1).map(|row| (row, &quanta[row * n_cols..(row + 2) * n_cols])) {
            isa.run(Pack { quanta, scale, words: &mut words });
            for (col, word) in words.iter().enumerate() {
                write(row * n_cols + col, *word);
            }
        }
        for cell_idx in marked {
            let [a, b, c, d] = [0, 1, n_cols, n_cols + 1].map(|at| quanta[cell_idx + at]);
            write(cell_idx, scale.word([a, b, c, d]) | RIDGE);
        }
        let mut ridge_words = Vec::with_capacity(merged.ridge_layers.len());
        for (cell_idx, to) in ridge_cells {
            while ridge_words.len() < to {
                let layer = layers[usize::from(merged.ridge_layers[ridge_words.len()])];
                let corners_m = first_corners_of(layer, n_cols, cell_idx);
                let last = if ridge_words.len() + 1 == to { RIDGE } else { 0 };
                ridge_words.push(scale.word(corners_m.map(|margin_m| scale.quanta_of(margin_m))) | last);
            }
        }
        Merged { ridge_words, ..merged }
    }

    /// No layers: what asks must not look cells up.
    pub(crate) fn nothing() -> Merged {
        Merged { quantum_m: 1.0, ..Merged::default() }
    }

    /// Names the layer of each cell of a row, and lists the layers of its ridges.
    fn find_ridges(
        &mut self,
        row: usize,
        layers: &[MergeLayer<'_>],
        row_least_m: &[f32],
        least_m: &[f32],
        found: &mut Ridges<'_>,
    ) {
        let n_cols = self.n_cols;
        let row_start = row * n_cols;
        let is_ridge = |owners: &[u32], cell_idx: usize| {
            let [a, b, c, d] = [0, 1, n_cols, n_cols + 1].map(|at| owners[cell_idx + at]);
            a != b || a != c || a != d
        };
        let ridges: Vec<usize> = (row_start..row_start + n_cols - 1)
            .filter(|cell_idx| is_ridge(&self.owners, *cell_idx))
            .collect();
        let first_corners = |cell_idx: usize| {
            let owner = layers[self.owners[cell_idx] as usize];
            corners(owner.values_m, n_cols, cell_idx).map(|v| v - owner.keep_m)
        };
        let highest_m = ridges.iter().flat_map(|idx| first_corners(*idx)).fold(f32::NEG_INFINITY, f32::max);
        // Layers that are larger all along the row than any ridge's first layer matter to none of them.
        let matter: Vec<usize> = (0..layers.len())
            .filter(|idx| {
                row_least_m[idx * self.n_rows + row].min(row_least_m[idx * self.n_rows + row + 1]) < highest_m
            })
            .collect();
        for cell_idx in ridges {
            let owner = self.owners[cell_idx] as usize;
            let first = first_corners_of(layers[owner], n_cols, cell_idx);
            let least = corners(least_m, n_cols, cell_idx);
            let mut gap_m = widest(&first, &least);
            self.owners[cell_idx] = RIDGE_OWNER | self.ridge_layers.len() as u32;
            self.ridge_layers.push(owner as u16);
            found.steepest.note(&first);
            for idx in &matter {
                let here = first_corners_of(layers[*idx], n_cols, cell_idx);
                let is_smaller = (0..4).fold(false, |any, k| any | (here[k] < first[k]));
                if *idx == owner || !is_smaller {
                    continue;
                }
                gap_m = gap_m.min(widest(&here, &least));
                found.steepest.note(&here);
                self.ridge_layers.push(*idx as u16);
            }
            found.cells.push((cell_idx, self.ridge_layers.len()));
            if gap_m > GAP_M {
                found.marked.push(cell_idx);
            }
        }
    }

    /// By how much the packed value may lie below the true margin, metres, up to the top of the
    /// range: a margin above it is known to be above it, and no more.
    pub(crate) fn error_m(&self) -> f32 {
        self.quantum_m + GAP_M + 2.0 * SLACK_M
    }

    /// The words of the layers that can be smallest in a cell of a ridge, the margin there to a quantum below the true
    /// one: two or more of them.
    #[inline(always)]
    pub(crate) fn ridge_words_of(&self, cell_idx: usize) -> &[u32] {
        let owner = self.owners.get(cell_idx).copied().unwrap_or(0);
        &self.ridge_words[self.ridge_of(owner)]
    }

    /// Where the layers of a ridge are, by its owner; of none where there is no ridge.
    #[inline(always)]
    fn ridge_of(&self, owner: u32) -> std::ops::Range<usize> {
        if owner & RIDGE_OWNER == 0 {
            return 0..0;
        }
        let from = (owner ^ RIDGE_OWNER) as usize;
        let mut to = from;
        while self.ridge_words[to] & RIDGE == 0 {
            to += 1;
        }
        from..to + 1
    }

    /// The exact margin in a cell, metres, and the layer that it is to.
    #[inline]
    pub(crate) fn exact_m(
        &self,
        layers: &[MergeLayer<'_>],
        cell_idx: usize,
        (x, y): (f64, f64),
    ) -> (f64, usize) {
        let margin_m = |idx: usize| {
            let layer = layers[idx];
            let [a, b, c, d] = corners(layer.values_m, self.n_cols, cell_idx).map(f64::from);
            (1.0 - y) * ((1.0 - x) * a + x * b) + y * ((1.0 - x) * c + x * d) - f64::from(layer.keep_m)
        };
        let owner = self.owners[cell_idx];
        if owner & RIDGE_OWNER == 0 {
            return (margin_m(owner as usize), owner as usize);
        }
        let mut least = (f64::INFINITY, 0);
        for idx in self.ridge_layers[self.ridge_of(owner)].iter().map(|idx| usize::from(*idx)) {
            let margin_m = margin_m(idx);
            if margin_m < least.0 {
                least = (margin_m, idx);
            }
        }
        least
    }
}

/// What is found along with the ridges: slopes, the cells to mark, the cells of all and where their layers end.
struct Ridges<'a> {
    steepest: &'a mut Steps,
    marked: &'a mut Vec<usize>,
    cells: &'a mut Vec<(usize, usize)>,
}

#[inline(always)]
fn corners(values: &[f32], n_cols: usize, cell_idx: usize) -> [f32; 4] {
    let (lower, upper) = (&values[cell_idx..cell_idx + 2], &values[cell_idx + n_cols..cell_idx + n_cols + 2]);
    [lower[0], lower[1], upper[0], upper[1]]
}

#[inline(always)]
fn first_corners_of(layer: MergeLayer<'_>, n_cols: usize, cell_idx: usize) -> [f32; 4] {
    corners(layer.values_m, n_cols, cell_idx).map(|v| v - layer.keep_m)
}

fn widest(of: &[f32; 4], above: &[f32; 4]) -> f32 {
    (0..4).map(|k| of[k] - above[k]).fold(0.0, f32::max)
}
