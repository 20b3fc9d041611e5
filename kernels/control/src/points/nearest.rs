//! The loops over points: who is nearest to a place, and who can be nearest in a square.
//!
//! Points come in whole blocks. Not here: which points are looked at (`points`).

use geometry::Point2;

use crate::fast::isa::Work;

/// Points looked at together.
pub(super) const N_BLOCK: usize = 8;
/// More than what rounding takes from the squares of distances within reach, m².
const ROUNDING_M2: f64 = 1e-9;

/// Both coordinates of points apart; whether all points are finite and no farther from a centre than a square, m².
pub(super) struct Apart<'a> {
    pub points: &'a [Point2],
    pub x_m: &'a mut [f64],
    pub y_m: &'a mut [f64],
    pub centre: Point2,
    pub square_m2: f64,
}

impl Work for Apart<'_> {
    type Output = bool;
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> bool {
        let Apart { points, x_m, y_m, centre, square_m2 } = self;
        let n = points.len().min(x_m.len()).min(y_m.len());
        let (points, x_m, y_m) = (&points[..n], &mut x_m[..n], &mut y_m[..n]);
        let mut n_near = 0_u64;
        for k in 0..n {
            (x_m[k], y_m[k]) = (points[k].x, points[k].y);
            let (dx, dy) = (points[k].x - centre.x, points[k].y - centre.y);
            n_near = n_near.wrapping_add(if dx * dx + dy * dy <= square_m2 { 1 } else { 0 });
        }
        n_near == n as u64
    }
}

/// The squared distance to the nearest of some points, m².
pub(super) struct Nearest<'a> {
    pub x_m: &'a [f64],
    pub y_m: &'a [f64],
    pub place: Point2,
}

impl Work for Nearest<'_> {
    type Output = f64;
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f64 {
        let mut least_m2 = [f64::INFINITY; N_BLOCK];
        let points = self.x_m.chunks_exact(N_BLOCK).zip(self.y_m.chunks_exact(N_BLOCK));
        for (x_m, y_m) in points {
            for k in 0..N_BLOCK {
                let (dx, dy) = (x_m[k] - self.place.x, y_m[k] - self.place.y);
                least_m2[k] = least(dx * dx + dy * dy, least_m2[k]);
            }
        }
        let [a, b, c, d, e, f, g, h] = least_m2;
        least(least(least(a, b), least(c, d)), least(least(e, f), least(g, h)))
    }
}

/// Which of some points can be nearest to some place in a square; how many.
///
/// Who is farther than the one nearest to the centre from all four corners, is so everywhere between them: the
/// difference of two squared distances is linear.
pub(super) struct Candidates<'a> {
    pub x_m: &'a [f64],
    pub y_m: &'a [f64],
    pub square_m2: &'a mut [f64],
    pub is_candidate: &'a mut [u8],
    pub centre: Point2,
    pub side_m: f64,
}

impl Work for Candidates<'_> {
    type Output = usize;
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> usize {
        let Candidates { x_m, y_m, square_m2, is_candidate, centre, side_m } = self;
        let n = x_m.len().min(y_m.len()).min(square_m2.len()).min(is_candidate.len());
        let (x_m, y_m) = (&x_m[..n], &y_m[..n]);
        let (square_m2, is_candidate) = (&mut square_m2[..n], &mut is_candidate[..n]);
        let (mut least_m2, mut at) = ([f64::INFINITY; N_BLOCK], [0_u64; N_BLOCK]);
        let points = x_m.chunks_exact(N_BLOCK).zip(y_m.chunks_exact(N_BLOCK));
        for (block, ((x_m, y_m), square_m2)) in points.zip(square_m2.chunks_exact_mut(N_BLOCK)).enumerate() {
            for k in 0..N_BLOCK {
                let (dx, dy) = (x_m[k] - centre.x, y_m[k] - centre.y);
                let square = dx * dx + dy * dy;
                square_m2[k] = square;
                at[k] = if square < least_m2[k] { block as u64 } else { at[k] };
                least_m2[k] = least(square, least_m2[k]);
            }
        }
        let mut lane = 0;
        for k in 1..N_BLOCK {
            lane = if least_m2[k] < least_m2[lane] { k } else { lane };
        }
        let nearest = at[lane] as usize * N_BLOCK + lane;
        let (Some(nearest_x), Some(nearest_y)) = (x_m.get(nearest), y_m.get(nearest)) else { return 0 };
        let limit_m2 = least_m2[lane] + ROUNDING_M2;
        for k in 0..n {
            let apart_m = (x_m[k] - nearest_x).abs() + (y_m[k] - nearest_y).abs();
            is_candidate[k] = u8::from(square_m2[k] - limit_m2 <= side_m * apart_m);
        }
        is_candidate.iter().map(|flag| u32::from(*flag)).fold(0, u32::wrapping_add) as usize
    }
}

/// The smaller of two: one instruction where NaN is not asked about.
#[inline(always)]
pub(super) fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}
