//! A place, and where it lies among the cells of the fields that are asked about it.

use geometry::Point2;
use mapping::{DistanceField, Layout, Spot};

/// A place that many layers are asked about: those that lie on one layout share its spot there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub point: Point2,
    on: Option<(Layout, Spot)>,
}

impl Place {
    #[inline]
    pub(crate) fn at(point: Point2) -> Place {
        Place { point, on: None }
    }

    /// The same as [`DistanceField::sample`].
    #[inline]
    pub(super) fn sample(&mut self, field: &DistanceField) -> f64 {
        match &self.on {
            Some((layout, spot)) if layout == field.layout() => field.sample_at(spot),
            _ => {
                let spot = Spot::of(field.layout(), self.point);
                self.on = Some((*field.layout(), spot));
                field.sample_at(&spot)
            }
        }
    }
}
