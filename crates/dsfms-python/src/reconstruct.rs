//! `dsfms.reconstruct`.

use crate::build::sized;
use crate::camera::Camera;
use crate::convert;
use crate::errors::{self, IntoPython, wrong};
use crate::surface::Surface;
use crate::template::Template;
use crate::work;
use dsfms::image::Frame;
use dsfms::io::camera::CameraFile;
use dsfms::io::images::read_frame;
use dsfms::io::matches::read_matches;
use dsfms::pipeline::inputs::CameraInput;
use dsfms::pipeline::{
    Method, Observation, ReconstructOptions, Reconstruction, reconstruct as solve,
};
use dsfms::template::Template as Inner;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// The method of a name.
pub fn method_of(name: &str) -> PyResult<Method> {
    let all = [Method::Rigid, Method::Sfs, Method::Dsfm, Method::Dsfms, Method::Joint];
    let expected = "\"rigid\", \"sfs\", \"dsfm\", \"dsfms\" or \"joint\"";
    let found = all.into_iter().find(|method| method.name() == name);
    found.ok_or_else(|| wrong("method", expected, format!("{name:?}")))
}

/// What a template and the camera of its frames make together.
pub struct Sight {
    pub template: Arc<Inner>,
    pub camera: CameraInput,
    /// The camera as Python sees it.
    pub shown: Py<Camera>,
}

impl Sight {
    pub fn new(
        py: Python<'_>,
        template: &Template,
        camera: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let given = camera.map(crate::build::camera_input).transpose()?;
        let template = template.inner.clone();
        let found = given.or_else(|| CameraInput::of_template(&template, None));
        let Some(input) = found else {
            return Err(wrong("camera", "a Camera, for the template holds none", "None"));
        };
        let tone = Some(input.tone.clone());
        let file = CameraFile { tone, light: None, vignetting: None, ..input.file.clone() };
        let shown = match camera.and_then(|c| c.cast::<Camera>().ok()) {
            Some(camera) => camera.clone().unbind(),
            None => Py::new(py, Camera { file })?,
        };
        Ok(Self { template, camera: input, shown })
    }
}

/// An image, which gets a name, or its file.
pub fn image(
    value: &Bound<'_, PyAny>,
    argument: &str,
    name: &str,
    size: [usize; 2],
) -> PyResult<Frame> {
    let frame = match value.extract::<PathBuf>() {
        Ok(path) => read_frame(&path).map_err(IntoPython::into_python)?,
        Err(_) => convert::frame(value, argument, name.into())?,
    };
    sized(&frame, argument, size)?;
    Ok(frame)
}

/// Reconstruct the deformed organ in one image.
///
/// Parameters
/// ----------
/// template : Template
///     The organ at rest.
/// image : array (h, w, 3) or path
///     uint8, uint16 or floats in [0, 1], RGB, of the camera's size.
/// camera : Camera or path, optional
///     Camera of the image; default the template's own.
/// method : {"rigid", "sfs", "dsfm", "dsfms", "joint"}, optional
///     Default joint, or dsfm where the template has no albedo. Pose only; shading alone; motion (eq. 3); motion, then shading (eq. 4); both in one problem.
/// matches : array (k, 6) or path of a CSV, optional
///     Face, three barycentrics, x and y in px; default found by the template's descriptors.
/// instrument_mask : array (h, w), optional
///     True (above 127) where an instrument covers the organ.
/// organ_mask : array (h, w), optional
///     True (above 127) where the organ is the first surface hit.
/// options : str, optional
///     Weights and thresholds as TOML text, as the command line's ``--options``.
/// seed : int, optional
///     Seed of every random draw; default that of `options`, or 0.
///
/// Returns
/// -------
/// Surface
///     Its status is ok, degraded, or lost where the surface cannot be believed.
///
/// Raises
/// ------
/// ValueError
///     An argument of the wrong kind, shape or value.
/// ReconstructionError
///     The frame gives no surface: black, too few matches, no albedo for the method.
#[pyfunction]
#[pyo3(signature = (template, image, camera=None, *, method=None, matches=None, instrument_mask=None,
    organ_mask=None, options=None, seed=None))]
#[allow(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub fn reconstruct(
    py: Python<'_>,
    template: &Bound<'_, Template>,
    image: &Bound<'_, PyAny>,
    camera: Option<&Bound<'_, PyAny>>,
    method: Option<&str>,
    matches: Option<&Bound<'_, PyAny>>,
    instrument_mask: Option<&Bound<'_, PyAny>>,
    organ_mask: Option<&Bound<'_, PyAny>>,
    options: Option<&str>,
    seed: Option<u64>,
) -> PyResult<Surface> {
    let method = method.map(method_of).transpose()?;
    let method = method.unwrap_or_else(|| Method::best_for(&template.get().inner));
    let sight = Sight::new(py, template.get(), camera)?;
    let frame = self::image(image, "image", "frame_000", sight.camera.file.camera.size)?;
    let size = frame.size;
    let base =
        options.map(|text| errors::options(ReconstructOptions::from_toml(text))).transpose()?;
    let mut options = base.unwrap_or_default();
    options.seed = seed.unwrap_or(options.seed);
    let faces = sight.template.mesh.topology.faces.len();
    let matches = matches
        .map(|value| match value.extract::<PathBuf>() {
            Ok(path) => read_matches(&path, faces, size).map_err(IntoPython::into_python),
            Err(_) => convert::matches(value, "matches", faces),
        })
        .transpose()?;
    let mask = |value: Option<&Bound<'_, PyAny>>, name| {
        value.map(|value| convert::mask(value, name, size)).transpose()
    };
    let instrument = mask(instrument_mask, "instrument_mask")?;
    let organ = mask(organ_mask, "organ_mask")?;
    let name = frame.name.clone();
    let Sight { template: inner, camera: input, shown } = sight;
    let found = work::run(py, None, move |_| {
        let observation =
            input.observation(&frame).instrument(instrument.as_ref()).organ(organ.as_ref());
        let observation = Observation { matches: matches.as_deref(), ..observation };
        let found = solve(&inner, &observation, method, &options);
        Reconstruction::even_refused(found).map_err(IntoPython::into_python)
    })??;
    Ok(Surface::reconstructed(template.clone().unbind(), shown, name, found))
}
