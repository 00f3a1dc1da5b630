//! What the kept values of the stages depend on, and whether they are whole.

use super::exploration::Exploration;
use super::options::TemplateOptions;
use crate::checkpoint::Digest;
use crate::dense::DepthMap;
use crate::image::{Frame, Mask};
use crate::sfm::SfmOptions;

/// Everything that features, matches and poses depend on.
pub(super) fn sparse_key(
    key: &mut Digest,
    exploration: &Exploration,
    usable: &[Option<Mask>],
    options: &SfmOptions,
) {
    frames(key, exploration.frames);
    masks(key, usable);
    key.value(exploration.camera);
    key.value(options);
}

/// Everything that the depth maps depend on, beside poses and points.
pub(super) fn dense_key(key: &mut Digest, exploration: &Exploration, options: &TemplateOptions) {
    masks(key, exploration.valid);
    masks(key, exploration.organ);
    frames(key, exploration.also);
    key.value(&options.dense);
    key.value(&options.organ);
}

fn frames(key: &mut Digest, frames: &[Frame]) {
    key.value(&frames.len());
    for frame in frames {
        key.bytes(frame.name.as_bytes());
        key.value(&frame.size);
        key.bytes(frame.rgb.as_flattened());
    }
}

fn masks(key: &mut Digest, masks: &[Option<Mask>]) {
    key.value(&masks.len());
    for mask in masks {
        key.value(&mask.as_ref().map(|m| m.size));
        mask.iter().for_each(|m| key.bytes(&pack(&m.data)));
    }
}

/// Depth maps of so many frames, every grid filled.
pub(super) fn whole_maps(maps: &[DepthMap], frames: usize) -> bool {
    let filled = |map: &DepthMap| {
        let [w, h] = map.camera.size;
        let grid = w.checked_mul(h);
        let lengths = [map.depth.len(), map.normal.len(), map.sigma.len(), map.confidence.len()];
        map.camera.validate().is_ok() && lengths.iter().all(|n| Some(*n) == grid)
    };
    maps.len() == frames && maps.iter().all(filled)
}

/// Eight values a byte, the first lowest.
pub(super) fn pack(values: &[bool]) -> Vec<u8> {
    let byte = |eight: &[bool]| eight.iter().rev().fold(0, |byte, &bit| byte << 1 | u8::from(bit));
    values.chunks(8).map(byte).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::pipeline::Organ;

    type Change<'a> = &'a dyn Fn(&mut Frame, &mut Mask, &mut TemplateOptions);

    #[test]
    fn whatever_a_stage_depends_on_changes_its_key() {
        use crate::checkpoint::{Keep, tests::MemoryStore};
        let store = MemoryStore::default();
        let camera = crate::synth::Case::example(1).camera;
        let frame = Frame { name: "a".into(), size: [2, 1], rgb: vec![[7; 3]; 2] };
        let key = |change: Change| {
            let (mut frame, mut options) = (frame.clone(), TemplateOptions::default());
            let mut mask = Mask::filled([2, 1], true);
            change(&mut frame, &mut mask, &mut options);
            let (frames, masks) = ([frame], [Some(mask)]);
            let seen = Exploration::new(&frames, &camera).organ(&masks);
            let keep = Keep::new(&store).with(|d| sparse_key(d, &seen, &masks, &options.sfm));
            [keep.key(), keep.with(|d| dense_key(d, &seen, &options)).key()]
        };
        let usual = key(&|_, _, _| ());
        assert_eq!(key(&|_, _, options| options.vertices = 500), usual);
        let changes: [Change; 4] = [
            &|frame, _, _| frame.rgb[1][2] = 8,
            &|frame, _, _| frame.name = "b".into(),
            &|_, mask, _| mask.data[1] = false,
            &|_, _, options| options.sfm.ratio -= 0.01,
        ];
        for change in changes {
            let found = key(change);
            assert!(found[0] != usual[0] && found[1] != usual[1]);
        }
        // Of the surface alone: the poses serve it still.
        let surface = key(&|_, _, options| options.organ = Organ::Whole);
        assert!(surface[0] == usual[0] && surface[1] != usual[1]);
    }

    #[test]
    fn every_bit_of_a_mask_counts() {
        let bits = |on: usize| pack(&(0..11).map(|i| i == on).collect::<Vec<_>>());
        assert_eq!((bits(0), bits(9)), (vec![1, 0], vec![0, 2]));
    }

    #[test]
    fn a_grid_that_is_not_filled_is_found() {
        let camera = CameraModel {
            size: [2, 1],
            centre: [0.5, 0.0],
            ..crate::synth::Case::example(1).camera
        };
        let map = DepthMap {
            camera,
            pose: crate::geometry::Isometry::identity(),
            depth: vec![1.0; 2],
            normal: vec![[0.0; 3]; 2],
            sigma: vec![1.0; 2],
            confidence: vec![1.0; 2],
        };
        assert!(whole_maps(std::slice::from_ref(&map), 1));
        assert!(!whole_maps(std::slice::from_ref(&map), 2));
        assert!(!whole_maps(&[DepthMap { sigma: vec![1.0], ..map }], 1));
    }
}
