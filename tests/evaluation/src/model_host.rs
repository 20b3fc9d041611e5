//! Who answers for the two model roles in a trial.
//!
//! The simulator's oracle, with its errors; the ground truth, which knows the objects that the case means; or
//! a detector that draws a box around each object and takes all in it for the object, as Safe-Lang does.

use std::sync::Arc;

use heedway_perception::semantics::models::{Answer, Ask};
use heedway_simulator::answers;
use heedway_simulator::kept_frames::KeptFrames;
use heedway_simulator::nouns;
use heedway_simulator::oracle_models::{Heat, ModelErrors, Oracle};
use heedway_simulator::raycast::{INSTANCE_OBJECTS, InstanceImage};
use heedway_simulator::scene::{Case, Scene};
use proto::{HeatMaps, ModelImage, Segments};

/// How a host finds what a phrase means.
pub enum Role {
    /// The simulator's models.
    Oracle,
    /// For each class noun of the case, which instances it means.
    Truth(Vec<(String, Vec<bool>)>),
    /// Boxes around what the simulator's models find.
    Boxes,
}

/// A host of both models.
pub struct ModelHost {
    role: Role,
    oracle: Oracle,
    kept: Arc<KeptFrames>,
}

impl ModelHost {
    /// A host for the robot whose frames `kept` remembers.
    #[must_use]
    pub fn new(role: Role, scene: &Scene, errors: ModelErrors, seed: u64, kept: Arc<KeptFrames>) -> Self {
        ModelHost { role, oracle: Oracle::new(scene, errors, seed), kept }
    }

    /// The role that knows what a case means.
    #[must_use]
    pub fn truth(scene: &Scene, case: &Case) -> Role {
        let n_before = usize::from(INSTANCE_OBJECTS);
        let nouns = case.rules.iter().map(|rule| {
            let mut hot = vec![false; n_before];
            hot.extend(scene.objects.iter().map(|object| rule.objects.contains(&object.id)));
            (rule.obj.clone(), hot)
        });
        Role::Truth(nouns.collect())
    }

    /// What both models say of a frame.
    ///
    /// # Errors
    /// In words, when the frame is not kept.
    pub fn answer(&self, ask: &Ask) -> Result<Box<Answer>, String> {
        let intrinsics = &ask.frame.intrinsics;
        let image = ModelImage {
            seq: ask.frame.seq,
            stamp_ns: ask.frame.stamp_ns,
            width: intrinsics.width,
            height: intrinsics.height,
            // The host knows the frame by its number.
            rgb: Vec::new(),
        };
        let told = |e: heedway_simulator::kept_frames::UnknownFrame| e.to_string();
        match &self.role {
            Role::Oracle => Ok(Box::new(Answer {
                heat_maps: answers::heat_maps(&self.oracle, &self.kept, &image, &ask.phrases)
                    .map_err(told)?,
                segments: answers::segments(&self.oracle, &self.kept, &image).map_err(told)?,
                understood: Vec::new(),
            })),
            Role::Truth(nouns) => {
                let seen = self.kept.find(&image).map_err(told)?;
                let segments = answers::segments(&self.oracle, &self.kept, &image).map_err(told)?;
                let hot: Vec<_> = ask.phrases.iter().map(|phrase| meant(nouns, phrase)).collect();
                let heat_maps = heat_message(image.seq, Heat::of_instances(&seen, &hot), hot.len());
                Ok(Box::new(Answer { heat_maps, segments, understood: Vec::new() }))
            }
            Role::Boxes => {
                let seen = self.kept.find(&image).map_err(told)?;
                let hot = self.oracle.hot_instances(&seen, image.seq, &ask.phrases);
                Ok(Box::new(boxed(&seen, image.seq, &hot)))
            }
        }
    }
}

/// The instances of all nouns that a phrase may mean.
fn meant(nouns: &[(String, Vec<bool>)], phrase: &str) -> Vec<bool> {
    let labels: Vec<&str> = nouns.iter().map(|(noun, _)| noun.as_str()).collect();
    let mut hot = Vec::new();
    for ((_, instances), _) in
        nouns.iter().zip(nouns::meant(phrase, &labels)).filter(|(_, is_meant)| *is_meant)
    {
        hot.resize(instances.len(), false);
        hot.iter_mut().zip(instances).for_each(|(hot, meant)| *hot |= meant);
    }
    hot
}

fn heat_message(seq: u64, heat: Heat, n_phrases: usize) -> HeatMaps {
    let Heat { width, height, values } = heat;
    let n_phrases = u32::try_from(n_phrases).unwrap_or(u32::MAX);
    HeatMaps { seq, model: "evaluation".into(), width, height, values, n_phrases }
}

/// Columns and rows of a box, both ends within it.
#[derive(Clone, Copy)]
struct PixelBox {
    columns: (usize, usize),
    rows: (usize, usize),
}

/// The box around each instance that is seen.
fn boxes(image: &InstanceImage, n_instances: usize) -> Vec<Option<PixelBox>> {
    let mut found: Vec<Option<PixelBox>> = vec![None; n_instances];
    for (row, pixels) in image.instances.chunks(image.width.max(1) as usize).enumerate() {
        for (column, instance) in pixels.iter().enumerate() {
            let Some(slot) = found.get_mut(usize::from(*instance)) else { continue };
            let b = slot.get_or_insert(PixelBox { columns: (column, column), rows: (row, row) });
            b.columns = (b.columns.0.min(column), b.columns.1.max(column));
            b.rows.1 = row;
        }
    }
    found
}

/// An image in which each box is an instance of its own, and its heat.
fn boxed(image: &InstanceImage, seq: u64, hot: &[Vec<bool>]) -> Answer {
    let n_instances = hot.iter().map(Vec::len).max().unwrap_or(0);
    let boxes = boxes(image, n_instances);
    let width = image.width.max(1) as usize;
    let mut labels = vec![0_u16; image.instances.len()];
    let mut owners: Vec<usize> = Vec::new();
    for (instance, found) in boxes.iter().enumerate() {
        let is_hot = hot.iter().any(|map| map.get(instance) == Some(&true));
        let Some(b) = found.filter(|_| is_hot) else { continue };
        owners.push(instance);
        let label = u16::try_from(owners.len()).unwrap_or(u16::MAX);
        for pixels in labels.chunks_mut(width).take(b.rows.1 + 1).skip(b.rows.0) {
            pixels.iter_mut().take(b.columns.1 + 1).skip(b.columns.0).for_each(|pixel| *pixel = label);
        }
    }
    let by_label: Vec<Vec<bool>> = hot
        .iter()
        .map(|map| {
            let owned = owners.iter().map(|instance| map.get(*instance) == Some(&true));
            std::iter::once(false).chain(owned).collect()
        })
        .collect();
    let drawn = InstanceImage { width: image.width, height: image.height, instances: labels };
    let heat_maps = heat_message(seq, Heat::of_instances(&drawn, &by_label), hot.len());
    let segments = Segments {
        seq,
        model: "evaluation".into(),
        width: image.width,
        height: image.height,
        n_segments: u16::try_from(owners.len()).unwrap_or(u16::MAX),
        labels_le: Segments::label_bytes(&drawn.instances),
    };
    Answer { heat_maps, segments, understood: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_takes_in_what_stands_behind_the_object() {
        // A thin diagonal thing, instance 3, before a wall, instance 2.
        let instances = vec![3, 2, 2, 2, 3, 2, 2, 2, 3];
        let image = InstanceImage { width: 3, height: 3, instances };
        let answer = boxed(&image, 1, &[vec![false, false, false, true]]);
        assert_eq!(answer.segments.labels(), vec![1; 9]);
        assert!(answer.heat_maps.values.iter().all(|heat| *heat == 255));
    }

    #[test]
    fn what_is_not_meant_has_no_box() {
        let image = InstanceImage { width: 2, height: 1, instances: vec![3, 4] };
        let answer = boxed(&image, 1, &[vec![false, false, false, false, true]]);
        assert_eq!(answer.segments.labels(), [0, 1]);
    }
}
