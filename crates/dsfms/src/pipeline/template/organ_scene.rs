//! What tells the organ from the rest, kept: other strokes give another part without stereo.

use super::error::TemplateError;
use super::guess::{OrganGuess, guess_of};
use super::strokes::{OrganStroke, seeds};
use crate::camera::CameraModel;
use crate::checkpoint::digest;
use crate::dense::{Colours, DepthMap, Parting, PosedFrame};
use crate::geometry::{Isometry, Point3};
use crate::guard;
use crate::image::{Frame, Mask};
use crate::io::atomic::{WriteError, write_atomic};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// First line of the file.
const MAGIC: &[u8] = b"dsfms organ scene 1\n";
/// Most frames, registered ones and points that move.
const MOST_FRAMES: usize = 1000;
const MOST_POINTS: usize = 10_000_000;
/// No length is larger, template units.
const FAR: f64 = 1e9;

/// The depth maps by which the organ of a template was told, and what else the labelling reads of
/// its frames.
///
/// [`Self::part`] gives the part that a template built with the same strokes holds: labels are made
/// of the same values in the same way, bit by bit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct OrganScene {
    camera: CameraModel,
    /// Name and `camera_from_world` of every registered frame.
    registered: Vec<(String, Isometry)>,
    frames: Vec<SceneFrame>,
    /// Points of the surface, world axes, and how far they move in deformed frames.
    pub(super) moved: Vec<(Point3, f64)>,
    /// What was drawn when the template was built, a click among it.
    pub(super) strokes: Vec<OrganStroke>,
}

/// A frame by which the organ is told.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct SceneFrame {
    /// Its place among those registered.
    registered: usize,
    /// Spread and trust are left out: the labelling does not read them.
    map: DepthMap,
    colours: Colours,
    organ: Option<PackedMask>,
    /// Its picture as an image file, for whoever draws on it; empty = none.
    photo: Vec<u8>,
}

/// A mask of the organ that was given, eight pixels a byte.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct PackedMask(Vec<u8>);

impl PackedMask {
    fn of(mask: &Mask) -> Self {
        Self(super::kept::pack(&mask.data))
    }

    fn mask(&self, size: [usize; 2]) -> Mask {
        let bit = |i: usize| self.0[i / 8] >> (i % 8) & 1 == 1;
        Mask { size, data: (0..size[0] * size[1]).map(bit).collect() }
    }
}

/// Why a kept scene could not be read.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct OrganSceneError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong.
    pub reason: String,
}

impl OrganScene {
    /// Frames of one camera with their depth maps; all registered frames are among them.
    pub fn new(views: &[PosedFrame], maps: &[DepthMap], camera: &CameraModel) -> Self {
        let named: Vec<(&str, Isometry)> =
            views.iter().map(|view| (view.frame.name.as_str(), view.pose)).collect();
        Self::among(&named, views, maps, camera)
    }

    /// Frames with their depth maps, of those registered (name and `camera_from_world`).
    pub(super) fn among(
        registered: &[(&str, Isometry)],
        views: &[PosedFrame],
        maps: &[DepthMap],
        camera: &CameraModel,
    ) -> Self {
        let frame = |(view, map): (&PosedFrame, &DepthMap)| {
            let own = registered.iter().position(|(name, _)| *name == view.frame.name)?;
            let slim = DepthMap { sigma: Vec::new(), confidence: Vec::new(), ..map.clone() };
            Some(SceneFrame {
                registered: own,
                colours: Colours::of(view, map),
                map: slim,
                organ: view.organ.map(PackedMask::of),
                photo: Vec::new(),
            })
        };
        Self {
            camera: camera.clone(),
            registered: registered.iter().map(|(name, pose)| (name.to_string(), *pose)).collect(),
            frames: views.iter().zip(maps).filter_map(frame).collect(),
            moved: Vec::new(),
            strokes: Vec::new(),
        }
    }

    /// Names of the frames by which the organ is told, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.frames.iter().map(|frame| self.registered[frame.registered].0.as_str())
    }

    /// Width and height of every frame, px.
    pub fn size(&self) -> [usize; 2] {
        self.camera.size
    }

    /// What was drawn when the template was built.
    pub fn strokes(&self) -> &[OrganStroke] {
        &self.strokes
    }

    /// Whether the frame of a stroke is one of those registered.
    pub fn shows(&self, stroke: &OrganStroke) -> bool {
        stroke.frame_of(&self.named()).is_ok()
    }

    fn named(&self) -> Vec<(&str, Isometry)> {
        self.registered.iter().map(|(name, pose)| (name.as_str(), *pose)).collect()
    }

    /// The picture of a frame by its place in [`Self::names`], as the bytes of an image file; empty
    /// where none was kept.
    pub fn photo(&self, frame: usize) -> Option<&[u8]> {
        self.frames.get(frame).map(|frame| frame.photo.as_slice())
    }

    /// Keep pictures of the frames: the bytes of image files of the frames' size, by name.
    ///
    /// # Errors
    /// Those of `photo`.
    pub fn with_photos<E>(mut self, photo: impl Fn(&str) -> Result<Vec<u8>, E>) -> Result<Self, E> {
        for frame in &mut self.frames {
            frame.photo = photo(&self.registered[frame.registered].0)?;
        }
        Ok(self)
    }

    /// The part of the frames that strokes say is the organ; without strokes what the frames look
    /// at. `pictures`: the frames in the order of [`Self::names`], of [`Self::size`]; they give the
    /// outline its last pixels.
    ///
    /// # Errors
    /// A stroke on a frame that is not registered, or on nothing that stereo saw.
    ///
    /// # Panics
    /// Where there are fewer pictures than frames, or of another size.
    pub fn part(
        &self,
        pictures: &[Frame],
        strokes: &[OrganStroke],
    ) -> Result<OrganGuess, TemplateError> {
        assert!(pictures.iter().all(|p| p.size == self.size()), "pictures of the frames' size");
        let organ: Vec<Option<Mask>> = (self.frames.iter())
            .map(|frame| frame.organ.as_ref().map(|mask| mask.mask(self.size())))
            .collect();
        let views: Vec<PosedFrame> = (0..self.frames.len())
            .map(|i| PosedFrame {
                frame: &pictures[i],
                camera: &self.camera,
                pose: self.registered[self.frames[i].registered].1,
                valid: None,
                organ: organ[i].as_ref(),
            })
            .collect();
        let maps: Vec<DepthMap> = self.frames.iter().map(|frame| frame.map.clone()).collect();
        let colours: Vec<Colours> = self.frames.iter().map(|frame| frame.colours.clone()).collect();
        let seeds = seeds(strokes, &self.named(), &maps, &self.camera)?;
        let part = Parting::of_colours(&views, &maps, &colours, &seeds, &self.moved).best();
        Ok(guess_of(&part, &views, &maps, None))
    }

    /// Read a file that [`Self::write`] wrote.
    ///
    /// # Errors
    /// A file that cannot be read, is none, or holds what no frames can give.
    pub fn read(path: &Path) -> Result<Self, OrganSceneError> {
        let wrong = |reason: String| OrganSceneError { path: path.to_path_buf(), reason };
        let bytes = guard::read(path).map_err(|error| wrong(error.to_string()))?;
        Self::of_bytes(&bytes).map_err(wrong)
    }

    /// The scene in the bytes of a file.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn of_bytes(bytes: &[u8]) -> Result<Self, String> {
        let rest = bytes.strip_prefix(MAGIC).ok_or("expected an organ scene, version 1")?;
        let (sum, value) = rest.split_at_checked(8).ok_or("the file ends too early")?;
        if sum != digest(value).to_le_bytes() {
            return Err("the file is damaged".into());
        }
        Self::of_value(value)
    }

    /// Bytes of a file before what [`Self::of_value`] reads.
    pub const HEAD: usize = MAGIC.len() + 8;

    /// The scene in the bytes of a file behind its head, which says that they are whole.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn of_value(value: &[u8]) -> Result<Self, String> {
        let (scene, rest) = postcard::take_from_bytes::<Self>(value).map_err(|e| e.to_string())?;
        match scene.is_sound() && rest.is_empty() {
            true => Ok(scene),
            false => Err("it holds what no frames can give".into()),
        }
    }

    /// Write to a file, whole or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        let value = postcard::to_allocvec(self)
            .map_err(|e| WriteError::new(path, std::io::Error::other(e.to_string())))?;
        write_atomic(path, |file| {
            file.write_all(MAGIC)?;
            file.write_all(&digest(&value).to_le_bytes())?;
            file.write_all(&value)
        })
    }

    /// Whether everything has the size that it must have, and every number is one.
    fn is_sound(&self) -> bool {
        let near = |p: &Point3| p.iter().all(|v| v.abs() < FAR);
        let placed = |pose: &Isometry| pose.to_homogeneous().iter().all(|v| v.abs() < FAR);
        self.camera.validate().is_ok()
            && (1..=MOST_FRAMES).contains(&self.frames.len())
            && self.registered.len() <= MOST_FRAMES
            && self.moved.len() <= MOST_POINTS
            && self.registered.iter().all(|(_, pose)| placed(pose))
            && self.moved.iter().all(|(p, value)| near(p) && value.is_finite())
            && self.strokes.iter().all(OrganStroke::is_sound)
            && self.frames.iter().all(|frame| self.holds(frame))
    }

    fn holds(&self, frame: &SceneFrame) -> bool {
        let [w, h] = self.camera.size;
        let [gw, gh] = frame.map.camera.size;
        let grid = gw.checked_mul(gh);
        let filled = |n: usize| Some(n) == grid;
        let packed = w.checked_mul(h).map(|n| n.div_ceil(8));
        let pose = frame.map.pose.to_homogeneous();
        frame.registered < self.registered.len()
            && frame.map.camera.validate().is_ok()
            && filled(frame.map.depth.len())
            && filled(frame.map.normal.len())
            && filled(frame.colours.count())
            && frame.map.depth.iter().all(|z| (0.0..FAR as f32).contains(z))
            && frame.map.normal.as_flattened().iter().all(|v| v.abs() <= 2.0)
            && pose.iter().all(|v| v.abs() < FAR)
            && frame.organ.as_ref().is_none_or(|mask| Some(mask.0.len()) == packed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Lens;
    use crate::geometry::Point2;

    const SIZE: [usize; 2] = [60, 45];

    fn camera() -> CameraModel {
        CameraModel { size: SIZE, focal: [50.0; 2], centre: [29.5, 22.0], lens: Lens::default() }
    }

    /// A bright plate before a dark wall in three frames, one with a mask of its own.
    fn plates() -> (Vec<Frame>, Vec<DepthMap>, Mask) {
        let n = SIZE[0] * SIZE[1];
        let plate = |i: usize, p: usize| {
            let [u, v] = [(p % 60) as f64 - 29.5, (p / 60) as f64 - 22.0];
            (u - 4.0 * (i as f64 - 1.0)).abs() < 11.0 && v.abs() < 11.0
        };
        let frame = |i: usize| Frame {
            name: format!("f_{i}"),
            size: SIZE,
            rgb: (0..n).map(|p| if plate(i, p) { [180, 90, 70] } else { [60; 3] }).collect(),
        };
        let map = |i: usize| DepthMap {
            camera: camera(),
            pose: Isometry::translation(3.2 * (i as f64 - 1.0), 0.0, 0.0),
            depth: (0..n).map(|p| if plate(i, p) { 40.0 } else { 60.0 }).collect(),
            normal: vec![[0.0, 0.0, -1.0]; n],
            sigma: vec![0.1; n],
            confidence: vec![1.0; n],
        };
        let mask = Mask { size: SIZE, data: (0..n).map(|p| plate(0, p)).collect() };
        ((0..3).map(frame).collect(), (0..3).map(map).collect(), mask)
    }

    fn stroke(organ: bool, px: &[[f64; 2]]) -> OrganStroke {
        let px = px.iter().map(|&p| Point2::from(p)).collect();
        OrganStroke { frame: Some("f_1.png".into()), organ, px }
    }

    #[test]
    fn a_scene_that_was_kept_gives_the_labels_of_the_frames() {
        let (frames, maps, mask) = plates();
        let camera = camera();
        let mut views: Vec<PosedFrame> = (0..3)
            .map(|i| PosedFrame {
                frame: &frames[i],
                camera: &camera,
                pose: maps[i].pose,
                valid: None,
                organ: None,
            })
            .collect();
        for masked in [false, true] {
            views[0].organ = masked.then_some(&mask);
            let scene = OrganScene::new(&views, &maps, &camera);
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("organ.scene");
            scene.write(&path).unwrap();
            let scene = OrganScene::read(&path).unwrap();
            assert_eq!(scene.names().collect::<Vec<_>>(), ["f_0", "f_1", "f_2"]);
            // Colours are kept: the pictures only draw the outline.
            let grey: Vec<Frame> =
                frames.iter().map(|f| Frame { rgb: vec![[9; 3]; 2700], ..f.clone() }).collect();
            let wall = [stroke(true, &[[4.0, 4.0], [55.0, 4.0]]), stroke(false, &[[29.0, 22.0]])];
            for strokes in [&[][..], &wall] {
                let seeds = seeds(strokes, &scene.named(), &maps, &camera).unwrap();
                let labels = Parting::new(&views, &maps, &seeds, &[]).best();
                let again = scene.part(&grey, strokes).unwrap();
                assert_eq!([again.marked, again.stepping], [labels.marked, labels.stepping]);
                let wanted = guess_of(&labels, &views, &maps, None);
                let again = scene.part(&frames, strokes).unwrap();
                assert!(again.masks == wanted.masks && again.borders == wanted.borders);
            }
            assert!(scene.part(&frames, &[stroke(true, &[[-90.0, 4.0]])]).is_err());
        }
    }

    #[test]
    fn what_is_no_scene_is_refused() {
        let (frames, maps, _) = plates();
        let camera = camera();
        let view = PosedFrame {
            frame: &frames[0],
            camera: &camera,
            pose: maps[0].pose,
            valid: None,
            organ: None,
        };
        let scene = OrganScene::new(&[view], &maps[..1], &camera);
        assert!(scene.is_sound());
        assert!(scene.shows(&OrganStroke { frame: None, ..stroke(true, &[[1.0, 1.0]]) }));
        assert!(!scene.shows(&stroke(true, &[[1.0, 1.0]])));
        type Change = fn(&mut OrganScene);
        let changes: [Change; 8] = [
            |s| s.frames.clear(),
            |s| s.frames[0].map.depth[3] = f32::NAN,
            |s| _ = s.frames[0].map.normal.pop(),
            |s| s.frames[0].map.camera.size[0] = usize::MAX,
            |s| s.frames[0].registered = 1,
            |s| s.frames[0].organ = Some(PackedMask(vec![0; 3])),
            |s| s.moved.push((Point3::origin(), f64::NAN)),
            |s| s.camera.focal[0] = 0.0,
        ];
        for (i, change) in changes.iter().enumerate() {
            let mut other = scene.clone();
            change(&mut other);
            assert!(!other.is_sound(), "{i}");
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        scene.write(&path).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for at in (0..whole.len()).step_by(211) {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            assert!(OrganScene::of_bytes(&bytes).is_err(), "{at}");
            assert!(OrganScene::of_bytes(&whole[..at]).is_err(), "{at}");
        }
    }
}
