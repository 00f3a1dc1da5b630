//! `dsfms.Surface`: what one frame gave, from `reconstruct` and `Tracker` alike.

use crate::camera::Camera;
use crate::convert::{array1, array2, match_row, points_out, pose_out};
use crate::template::{Template, bridge};
use dsfms::geometry::{Isometry, Point3};
use dsfms::pipeline::Reconstruction;
use dsfms::register::Match;
use dsfms::solver::Summary;
use dsfms::track::Tracked;
use dsfms::verdict::{Level, Reason, Region};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The surface of one frame.
///
/// Arrays have the template's vertex order, whatever happened: of a lost frame `vertices` and
/// `pose` are NaN and nothing is visible. Lengths are in ``template.unit``, positions in camera
/// axes (x right, y down, z forward).
#[pyclass(module = "dsfms", frozen, name = "Surface")]
pub struct Surface {
    /// The template that was fitted.
    #[pyo3(get)]
    template: Py<Template>,
    /// Camera of the frame.
    #[pyo3(get)]
    camera: Py<Camera>,
    /// Name of the frame.
    #[pyo3(get)]
    frame: String,
    status: &'static str,
    reasons: Vec<Reason>,
    vertices: Option<Vec<Point3>>,
    pose: Option<Isometry>,
    visible: Option<Vec<bool>>,
    expected_error: Option<Vec<f64>>,
    error_bound: Option<f64>,
    observed: Option<Vec<bool>>,
    regions: Option<Vec<u8>>,
    gain: f64,
    ambient: f64,
    tracked: Quality,
    /// `camera_from_template` by what lies around the organ.
    camera_pose: Option<Isometry>,
    matches: Vec<(Match, bool)>,
    stages: Vec<(String, f64, Option<Summary>)>,
}

/// How well a tracked surface fits its frame.
#[derive(Default)]
struct Quality {
    photometric: Option<f64>,
    agreement: Option<f64>,
    depth_uncertainty: Option<f64>,
}

impl Surface {
    pub fn reconstructed(
        template: Py<Template>,
        camera: Py<Camera>,
        frame: String,
        found: Reconstruction,
    ) -> Self {
        // What is not believed is not handed out.
        let believed = found.verdict.level != Level::Lost;
        Self {
            template,
            camera,
            frame,
            status: found.verdict.level.label(),
            reasons: found.verdict.reasons,
            vertices: believed.then_some(found.vertices),
            pose: believed.then_some(found.pose),
            visible: believed.then_some(found.visible),
            expected_error: found.expected_error.filter(|_| believed),
            error_bound: found.error_bound.filter(|_| believed),
            observed: found.observed.filter(|_| believed),
            regions: believed.then(|| found.regions.iter().map(|&r| r as u8).collect()),
            gain: found.gain,
            ambient: found.ambient,
            tracked: Quality::default(),
            camera_pose: None,
            matches: found.matches,
            stages: found.stages.into_iter().map(|s| (s.name, s.seconds, s.summary)).collect(),
        }
    }

    pub fn tracked(
        template: Py<Template>,
        camera: Py<Camera>,
        frame: String,
        found: Tracked,
    ) -> Self {
        let tracked = found.surface.as_ref().map_or_else(Quality::default, |s| Quality {
            photometric: s.photometric,
            agreement: Some(s.agreement),
            depth_uncertainty: Some(s.depth_uncertainty),
        });
        let numbers = |regions: &[Region]| regions.iter().map(|&r| r as u8).collect();
        let regions = found.surface.as_ref().map(|s| numbers(&s.regions));
        let (vertices, pose, matches, visible) = match found.surface {
            Some(s) => (Some(s.vertices), Some(s.pose), s.matches, Some(s.visible)),
            None => (None, None, Vec::new(), None),
        };
        Self {
            template,
            camera,
            frame,
            status: found.status.label(),
            reasons: found.reasons,
            vertices,
            pose,
            visible,
            expected_error: None,
            error_bound: None,
            observed: None,
            regions,
            gain: f64::NAN,
            ambient: f64::NAN,
            tracked,
            camera_pose: found.camera.map(|sight| sight.pose),
            matches,
            stages: found.stages.into_iter().map(|(n, s)| (n.to_owned(), s, None)).collect(),
        }
    }

    fn count(&self) -> usize {
        self.template.get().inner.mesh.positions.len()
    }
}

#[pymethods]
impl Surface {
    /// Whether the surface can be trusted, a `Status`.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("dsfms._types")?.getattr("Status")?.call1((self.status,))
    }

    /// Why not ``Status.OK``, a tuple of `Reason`.
    #[getter]
    fn reasons<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let of = |reason: &Reason| match serde_json::to_string(reason) {
            Ok(figures) => Ok((reason.to_string(), figures)),
            Err(error) => Err(PyRuntimeError::new_err(error.to_string())),
        };
        let reasons: Vec<_> = self.reasons.iter().map(of).collect::<PyResult<_>>()?;
        py.import("dsfms._types")?.call_method1("reasons", (reasons,))
    }

    /// Positions, float64 (n, 3), camera axes; NaN where the frame is lost.
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        match &self.vertices {
            Some(vertices) => points_out(py, vertices),
            None => array2(py, (0..self.count()).map(|_| [f64::NAN; 3])),
        }
    }

    /// Vertices of every face, uint32 (m, 3): those of the template.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        array2(py, self.template.get().inner.mesh.topology.faces.iter().copied())
    }

    /// Rigid part ``camera_from_template``, float64 (4, 4); NaN where the frame is lost.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        match &self.pose {
            Some(pose) => pose_out(py, pose),
            None => array2(py, (0..4).map(|_| [f64::NAN; 4])),
        }
    }

    /// ``camera_from_template`` by what lies around the organ and does not deform, float64 (4, 4),
    /// whatever becomes of the organ; None from `reconstruct`, and where template or frame show too
    /// little of that.
    #[getter]
    fn camera_pose<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.camera_pose.as_ref().map(|pose| pose_out(py, pose)).transpose()
    }

    /// Seen by the camera (and not hidden by an instrument, where its mask was given), bool (n,).
    #[getter]
    fn visible<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        array1(py, self.visible.clone().unwrap_or_else(|| vec![false; self.count()]))
    }

    /// Expected error of every vertex, float64 (n,), length units; None where the method gives
    /// none.
    #[getter]
    fn expected_error<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.expected_error.clone().map(|values| array1(py, values))
    }

    /// Nine vertices of ten, and the deformed zone in nine frames of ten, are off by less than this
    /// multiple of their expected error; None where there is none.
    #[getter]
    fn expected_error_bound(&self) -> Option<f64> {
        self.error_bound
    }

    /// False where nothing in the frame spoke of a vertex, bool (n,); None where the method does
    /// not tell.
    #[getter]
    fn observed<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<bool>>> {
        self.observed.clone().map(|values| array1(py, values))
    }

    /// What is known of every vertex, uint8 (n,) of `Region`; None where the frame is lost, and
    /// from a tracker.
    #[getter]
    fn regions<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<u8>>> {
        self.regions.clone().map(|values| array1(py, values))
    }

    /// Exposure gain relative to the template's albedo; NaN from a tracker.
    #[getter]
    fn gain(&self) -> f64 {
        self.gain
    }

    /// Ambient light, linear; NaN from a tracker.
    #[getter]
    fn ambient(&self) -> f64 {
        self.ambient
    }

    /// Mean relative difference of the frame's brightness from what the surface predicts; NaN from
    /// `reconstruct`, and where no shading was read.
    #[getter]
    fn photometric(&self) -> f64 {
        self.tracked.photometric.unwrap_or(f64::NAN)
    }

    /// Share of the textured places in view that look like the template's, 0 to 1; NaN from
    /// `reconstruct`.
    #[getter]
    fn agreement(&self) -> f64 {
        self.tracked.agreement.unwrap_or(f64::NAN)
    }

    /// Expected error of the whole surface's depth, of its visible radius; NaN from `reconstruct`.
    #[getter]
    fn depth_uncertainty(&self) -> f64 {
        self.tracked.depth_uncertainty.unwrap_or(f64::NAN)
    }

    /// Matches, float64 (k, 6): face, three barycentrics, x and y in px.
    #[getter]
    fn matches<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, self.matches.iter().map(|(m, _)| match_row(m)))
    }

    /// Which of `matches` the surface explains, bool (k,).
    #[getter]
    fn matches_kept<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        array1(py, self.matches.iter().map(|m| m.1).collect())
    }

    /// Cost of every energy term, ``{stage: {term: (before, after)}}``; empty from a tracker.
    #[getter]
    fn costs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let costs = PyDict::new(py);
        for (name, _, summary) in &self.stages {
            let Some(summary) = summary else { continue };
            let terms = PyDict::new(py);
            for term in &summary.terms {
                terms.set_item(&term.label, (term.before, term.after))?;
            }
            costs.set_item(name, terms)?;
        }
        Ok(costs)
    }

    /// Wall time of every stage, seconds.
    #[getter]
    fn seconds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let seconds = PyDict::new(py);
        for (name, time, _) in &self.stages {
            seconds.set_item(name, time)?;
        }
        Ok(seconds)
    }

    /// Open3D mesh in camera axes (extra ``open3d``).
    fn to_open3d<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        bridge(slf.as_any(), "to_open3d")
    }

    /// PyVista mesh in camera axes (extra ``pyvista``); visible, observed and expected error as
    /// point data.
    fn to_pyvista<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        bridge(slf.as_any(), "to_pyvista")
    }

    /// trimesh mesh in camera axes (extra ``trimesh``).
    fn to_trimesh<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        bridge(slf.as_any(), "to_trimesh")
    }

    fn __repr__(&self) -> String {
        let Self { frame, status, .. } = self;
        let reasons: Vec<String> = self.reasons.iter().map(ToString::to_string).collect();
        let reasons = reasons.join("; ");
        let colon = if reasons.is_empty() { "" } else { ": " };
        format!("Surface({frame}, {} vertices, {status}{colon}{reasons})", self.count())
    }
}
