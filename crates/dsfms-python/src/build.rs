//! `dsfms.build_template`.

use crate::camera::Camera;
use crate::convert;
use crate::errors::{self, FileError, IntoPython, wrong};
use crate::template::{Template, mesh, unit};
use crate::work;
use dsfms::geometry::Isometry;
use dsfms::image::{Frame, Mask};
use dsfms::io::InputError;
use dsfms::io::masks::MaskKind;
use dsfms::io::poses::{PoseList, match_poses, read_poses};
use dsfms::mesh::Mesh;
use dsfms::pipeline::inputs::{CameraInput, check_size, mask_of};
use dsfms::pipeline::sources::{Purpose, Source, sources};
use dsfms::pipeline::{
    BuiltTemplate, OrganClick, OrganOptions, Progress, TemplateOptions, template_from_frames,
    template_from_posed_frames, template_from_poses,
};
use dsfms::sfm::RefineIntrinsics;
use dsfms::template::LengthUnit;
use pyo3::prelude::*;
use pyo3::types::PyString;
use std::path::{Path, PathBuf};

/// Build a template from frames of the organ at rest, seen by a moving camera.
///
/// Parameters
/// ----------
/// frames : path, or list of paths or of arrays (h, w, 3)
///     A folder of images, a video, image files, or images in memory (named ``frame_000``, ...):
///     uint8, uint16 or floats in [0, 1], all of the size of the camera.
/// camera : Camera or path
///     Intrinsics of all frames.
/// masks, organ_masks : path, or list of arrays (h, w) or None, optional
///     True (above 127) where a pixel may be used, and where it shows the organ.
/// organ_click : (x, y), optional
///     A pixel of the first frame that shows the organ; only the connected surface there stays.
/// vertices : int, optional
///     Vertices of the mesh, 100 to 50,000; default 1,000.
/// poses : path, or list of arrays (4, 4) or None, optional
///     Known ``camera_from_world`` of every frame; they are kept as they are.
/// mesh : (vertices, faces), optional
///     The surface, in the world of `poses`; kept as it is.
/// unit : {"mm", "template_units"}
///     Unit of `mesh`.
/// whole : bool
///     Keep what lies behind the organ too.
/// refine_by_shading : bool
///     Refine the surface by the shading of all views.
/// self_calibrate : bool
///     Refine focal length, principal point and distortion too.
/// options : str, optional
///     Weights and thresholds as TOML text, as the command line's ``--options``.
/// seed : int, optional
///     Seed of every random draw; default that of `options`, or 0.
/// progress : callable (stage: str, done: int, total: int), optional
///     Told how far the work is; what it raises stops the work.
///
/// Returns
/// -------
/// Template
///     In template units, or in the unit of `mesh`.
///
/// Raises
/// ------
/// ValueError
///     An argument of the wrong kind, shape or value.
/// FileError
///     A file that is missing or damaged.
/// BuildError
///     No template came of the frames; the message says why.
#[pyfunction]
#[pyo3(signature = (frames, camera, *, masks=None, organ_masks=None, organ_click=None, vertices=None,
    poses=None, mesh=None, unit="mm", whole=false, refine_by_shading=true, self_calibrate=false, options=None,
    seed=None, progress=None))]
#[allow(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub fn build_template(
    py: Python<'_>,
    frames: &Bound<'_, PyAny>,
    camera: &Bound<'_, PyAny>,
    masks: Option<&Bound<'_, PyAny>>,
    organ_masks: Option<&Bound<'_, PyAny>>,
    organ_click: Option<(f64, f64)>,
    vertices: Option<usize>,
    poses: Option<&Bound<'_, PyAny>>,
    mesh: Option<(Bound<'_, PyAny>, Bound<'_, PyAny>)>,
    unit: &str,
    whole: bool,
    refine_by_shading: bool,
    self_calibrate: bool,
    options: Option<&str>,
    seed: Option<u64>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Template> {
    let camera = camera_input(camera)?;
    let base = options.map(|text| errors::options(TemplateOptions::from_toml(text))).transpose()?;
    let mut options = base.unwrap_or_default();
    options.vertices = vertices.unwrap_or(options.vertices);
    options.refine_by_shading &= refine_by_shading;
    let click = |(x, y): (f64, f64)| OrganClick { frame: None, pixel: [x, y].into() };
    let mut organ = OrganOptions::from(options.organ);
    organ.whole |= whole;
    organ.click = organ_click.map(click).or(organ.click);
    options.organ = organ.into();
    if let Some(seed) = seed {
        (options.sfm.seed, options.dense.seed) = (seed, seed);
    }
    if self_calibrate {
        options.sfm.refine = RefineIntrinsics {
            focal: true,
            centre: true,
            distortion: true,
            second_distortion: false,
        };
    }
    if mesh.is_some() && poses.is_none() {
        return Err(wrong("poses", "the poses of the frames in the world of `mesh`", "None"));
    }
    let size = camera.file.camera.size;
    let images = Images::of(frames, "frames", size)?;
    let job = Job {
        valid: Masks::of(masks, "masks", size)?,
        organ: Masks::of(organ_masks, "organ_masks", size)?,
        poses: poses.map(Poses::of).transpose()?,
        mesh: mesh.map(|(v, f)| self::mesh(&v, &f, ["mesh[0]", "mesh[1]"])).transpose()?,
        unit: self::unit(unit)?,
        images,
        camera,
        options,
    };
    // `PyErr` is made on this thread: the work only says which error it met.
    let built = work::run(py, progress, move |told| job.run(told))??;
    Ok(Template::built(built.template, built.rejected))
}

/// A camera object or its file.
pub fn camera_input(camera: &Bound<'_, PyAny>) -> PyResult<CameraInput> {
    if let Ok(camera) = camera.cast::<Camera>() {
        return Ok(camera.get().input());
    }
    let Ok(path) = camera.extract::<PathBuf>() else {
        return Err(wrong("camera", "a Camera or a path", camera.get_type().to_string()));
    };
    CameraInput::read(&path, None).map_err(IntoPython::into_python)
}

/// Frames as given.
pub enum Images {
    Paths(Vec<PathBuf>),
    Memory(Vec<Frame>),
}

impl Images {
    /// Of a path, a list of paths, or a list of arrays.
    pub fn of(value: &Bound<'_, PyAny>, argument: &str, size: [usize; 2]) -> PyResult<Self> {
        if let Ok(path) = value.extract::<PathBuf>() {
            return Ok(Self::Paths(vec![path]));
        }
        let mut all = Self::Memory(Vec::new());
        for (i, item) in value.try_iter()?.enumerate() {
            let item = item?;
            let name = format!("{argument}[{i}]");
            let path = if item.is_instance_of::<PyString>() || item.hasattr("__fspath__")? {
                Some(item.extract::<PathBuf>()?)
            } else {
                None
            };
            match (path, &mut all) {
                (Some(path), Self::Paths(paths)) => paths.push(path),
                (Some(path), Self::Memory(frames)) if frames.is_empty() => {
                    all = Self::Paths(vec![path]);
                }
                (None, Self::Memory(frames)) => {
                    let frame = convert::frame(&item, &name, format!("frame_{i:03}"))?;
                    sized(&frame, &name, size)?;
                    frames.push(frame);
                }
                _ => return Err(wrong(&name, "paths alone or arrays alone", "both")),
            }
        }
        match &all {
            Self::Memory(frames) if frames.is_empty() => Err(wrong(argument, "frames", "none")),
            _ => Ok(all),
        }
    }

    fn sources(self, purpose: Purpose, progress: &dyn Progress) -> PyResult<Vec<Source>> {
        match self {
            Self::Paths(paths) => {
                sources(&paths, purpose, progress).map_err(IntoPython::into_python)
            }
            Self::Memory(frames) => {
                Ok(frames.into_iter().map(|frame| Source::Decoded(frame, None)).collect())
            }
        }
    }
}

/// A frame has the camera's size; a camera of no pixels fits every frame.
pub fn sized(frame: &Frame, argument: &str, size: [usize; 2]) -> PyResult<()> {
    if size == [0, 0] || frame.size == size {
        return Ok(());
    }
    let shown = |[w, h]: [usize; 2]| format!("({h}, {w}, 3)");
    Err(wrong(argument, format!("the camera's size {}", shown(size)), shown(frame.size)))
}

/// Values in memory belong to the frames by their order.
fn one_each(argument: &str, found: usize, frames: usize) -> PyResult<()> {
    if found == frames {
        return Ok(());
    }
    Err(wrong(argument, format!("one for each of {frames} frames"), found.to_string()))
}

/// Masks as given.
enum Masks {
    Nothing,
    Path(PathBuf),
    Memory(Vec<Option<Mask>>),
}

impl Masks {
    fn of(value: Option<&Bound<'_, PyAny>>, argument: &str, size: [usize; 2]) -> PyResult<Self> {
        let Some(value) = value else { return Ok(Self::Nothing) };
        if let Ok(path) = value.extract::<PathBuf>() {
            return Ok(Self::Path(path));
        }
        let one = |(i, item): (usize, PyResult<Bound<'_, PyAny>>)| {
            let item = item?;
            let name = format!("{argument}[{i}]");
            (!item.is_none()).then(|| convert::mask(&item, &name, size)).transpose()
        };
        Ok(Self::Memory(value.try_iter()?.enumerate().map(one).collect::<PyResult<_>>()?))
    }

    /// Masks in memory belong to the frames by their order.
    fn check(&self, argument: &str, frames: usize) -> PyResult<()> {
        match self {
            Self::Memory(masks) => one_each(argument, masks.len(), frames),
            _ => Ok(()),
        }
    }

    fn at(
        &self,
        i: usize,
        frame: &Frame,
        path: Option<&Path>,
        kind: MaskKind,
        progress: &dyn Progress,
    ) -> PyResult<Option<Mask>> {
        match self {
            Self::Nothing => Ok(None),
            Self::Path(source) => match (mask_of(frame, path, source, kind, progress), kind) {
                // The organ outlined in some of the frames tells it in the others.
                (Err(InputError::NoPartner { .. }), MaskKind::Organ) => Ok(None),
                (mask, _) => mask.map(Some).map_err(IntoPython::into_python),
            },
            Self::Memory(masks) => Ok(masks.get(i).cloned().flatten()),
        }
    }
}

/// Poses as given.
enum Poses {
    Path(PathBuf),
    Memory(Vec<Option<Isometry>>),
}

impl Poses {
    fn of(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        if let Ok(path) = value.extract::<PathBuf>() {
            return Ok(Self::Path(path));
        }
        let one = |(i, item): (usize, PyResult<Bound<'_, PyAny>>)| {
            let item = item?;
            (!item.is_none()).then(|| convert::pose(&item, &format!("poses[{i}]"))).transpose()
        };
        Ok(Self::Memory(value.try_iter()?.enumerate().map(one).collect::<PyResult<_>>()?))
    }

    /// Poses of `frames`, which were the ones at these places of `all` frames.
    fn of_frames(
        self,
        frames: &[Frame],
        places: &[usize],
        all: usize,
    ) -> PyResult<Vec<Option<Isometry>>> {
        match self {
            Self::Path(path) => {
                let poses =
                    read_poses(&path, PoseList::Exploration).map_err(IntoPython::into_python)?;
                let names: Vec<&str> = frames.iter().map(|f| f.name.as_str()).collect();
                Ok(match_poses(&poses, &names))
            }
            Self::Memory(poses) => {
                one_each("poses", poses.len(), all)?;
                Ok(places.iter().map(|&i| poses[i]).collect())
            }
        }
    }
}

struct Job {
    images: Images,
    valid: Masks,
    organ: Masks,
    poses: Option<Poses>,
    mesh: Option<Mesh>,
    unit: LengthUnit,
    camera: CameraInput,
    options: TemplateOptions,
}

impl Job {
    fn run(self, progress: &dyn Progress) -> PyResult<BuiltTemplate> {
        let list = self.images.sources(Purpose::Template(&self.options.video), progress)?;
        self.valid.check("masks", list.len())?;
        self.organ.check("organ_masks", list.len())?;
        let (mut frames, mut valid, mut organ) = (Vec::new(), Vec::new(), Vec::new());
        let mut places = Vec::new();
        let mut first_error = None;
        for (i, source) in list.iter().enumerate() {
            // As the command line: a frame that cannot be used is left out with a warning.
            let frame = source.frame().and_then(|frame| {
                check_size(&frame, &self.camera.file.camera, Path::new("the camera"))?;
                Ok(frame)
            });
            match frame {
                Ok(frame) => {
                    let path = source.path();
                    valid.push(self.valid.at(i, &frame, path, MaskKind::Valid, progress)?);
                    organ.push(self.organ.at(i, &frame, path, MaskKind::Organ, progress)?);
                    frames.push(frame);
                    places.push(i);
                }
                Err(error) => {
                    progress.warn(&format!("{error}; the frame is left out"));
                    first_error.get_or_insert(error);
                }
            }
        }
        if let (Some(error), true) = (first_error, frames.len() < 2) {
            let (used, all) = (frames.len(), list.len());
            return Err(FileError::new_err(format!("{used} of {all} frames can be used: {error}")));
        }
        let exploration = self.camera.exploration(&frames).valid(&valid).organ(&organ);
        let options = &self.options;
        let poses = self.poses.map(|p| p.of_frames(&frames, &places, list.len())).transpose()?;
        let built = match (self.mesh, poses) {
            (Some(mesh), Some(poses)) => {
                template_from_posed_frames(&exploration, mesh, self.unit, &poses, options, progress)
            }
            (None, Some(poses)) => template_from_poses(&exploration, &poses, options, progress),
            _ => template_from_frames(&exploration, options, progress),
        };
        built.map_err(IntoPython::into_python)
    }
}

/// Frames of images or a video in memory, as named by Python.
pub fn decode(images: Images, purpose: Purpose, progress: &dyn Progress) -> PyResult<Vec<Frame>> {
    let list = images.sources(purpose, progress)?;
    list.iter().map(|source| source.frame().map_err(IntoPython::into_python)).collect()
}
