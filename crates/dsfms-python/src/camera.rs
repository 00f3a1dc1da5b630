//! `dsfms.Camera` and `dsfms.read_camera`.

use crate::convert::{array2, points, rows};
use crate::errors::{IntoPython, wrong};
use dsfms::camera::{Camera as _, CameraModel, Lens};
use dsfms::geometry::Point2;
use dsfms::image::ToneCurve;
use dsfms::io::camera::{CameraFile, read_camera as read, write_camera};
use dsfms::pipeline::inputs::CameraInput;
use numpy::PyArray2;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Intrinsics of a camera, its lens, and how its pixels encode light.
///
/// Pixel centres lie at integers (OpenCV); axes are x right, y down, z forward.
///
/// Parameters
/// ----------
/// width, height : int
///     Size of its images, px.
/// fx, fy : float
///     Focal lengths, px.
/// cx, cy : float
///     Principal point, px.
/// distortion : sequence of float, optional
///     ``k1, k2, p1, p2[, k3]`` of OpenCV, or ``k1, k2, k3, k4`` with ``model="kannala_brandt"``.
/// model : {"brown_conrady", "kannala_brandt"}
///     What the coefficients mean.
/// tone : {"srgb", "linear"} or float, optional
///     How pixels encode light; a number is a gamma (``light = value ** gamma``). Default sRGB.
/// vignetting : float, optional
///     The ``a`` of ``1 + a r**2``, r in focal lengths from the principal point.
///
/// Raises
/// ------
/// ValueError
///     A size, focal length or coefficient out of range.
#[pyclass(module = "dsfms", frozen, name = "Camera")]
#[derive(Clone)]
pub struct Camera {
    pub file: CameraFile,
}

impl Camera {
    /// With its tone curve, as a file named by `--camera` would be taken.
    pub fn input(&self) -> CameraInput {
        CameraInput::new(self.file.clone(), None)
    }

    /// Of bare intrinsics.
    pub fn of(camera: CameraModel) -> Self {
        Self { file: CameraFile { camera, tone: None, light: None, vignetting: None } }
    }
}

fn tone(value: &Bound<'_, PyAny>) -> PyResult<ToneCurve> {
    if let Ok(gamma) = value.extract::<f64>()
        && gamma.is_finite()
        && gamma > 0.0
    {
        return Ok(ToneCurve::Gamma(gamma));
    }
    match value.extract::<String>().as_deref() {
        Ok("srgb") => Ok(ToneCurve::Srgb),
        Ok("linear") => Ok(ToneCurve::Linear),
        _ => {
            Err(wrong("tone", "\"srgb\", \"linear\" or a gamma above 0", value.repr()?.to_string()))
        }
    }
}

fn lens(distortion: Option<Vec<f64>>, model: &str) -> PyResult<Lens> {
    let given = distortion.unwrap_or_default();
    let Some(kind) = Lens::KINDS.iter().find(|kind| kind.name == model) else {
        let names: Vec<_> = Lens::KINDS.iter().map(|kind| format!("{:?}", kind.name)).collect();
        return Err(wrong("model", names.join(", "), format!("{model:?}")));
    };
    kind.listed_coefficients(&given)
        .map_err(|_| wrong("distortion", kind.coefficients.join(", "), format!("{given:?}")))
}

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (width, height, fx, fy, cx, cy, *, distortion=None, model="brown_conrady", tone=None, vignetting=None))]
    #[allow(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn new(
        width: usize,
        height: usize,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        distortion: Option<Vec<f64>>,
        model: &str,
        tone: Option<Bound<'_, PyAny>>,
        vignetting: Option<f64>,
    ) -> PyResult<Self> {
        let lens = lens(distortion, model)?;
        let camera = CameraModel { size: [width, height], focal: [fx, fy], centre: [cx, cy], lens };
        camera.validate().map_err(|e| pyo3::exceptions::PyValueError::new_err(e.to_string()))?;
        let [least, most] = dsfms::light::vignetting::BOUNDS;
        if vignetting.is_some_and(|a| !(least..=most).contains(&a)) {
            return Err(wrong(
                "vignetting",
                format!("{least} to {most}"),
                format!("{vignetting:?}"),
            ));
        }
        let tone = tone.as_ref().map(self::tone).transpose()?;
        Ok(Self { file: CameraFile { camera, tone, light: None, vignetting } })
    }

    /// Width and height, px.
    #[getter]
    fn size(&self) -> (usize, usize) {
        let [w, h] = self.file.camera.size;
        (w, h)
    }

    /// Calibration matrix ``K``, float64 (3, 3).
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let k = self.file.camera.matrix();
        array2(py, (0..3).map(|r| [0, 1, 2].map(|c| k[(r, c)])))
    }

    /// Distortion coefficients by name; empty for a pinhole.
    #[getter]
    fn distortion(&self) -> std::collections::BTreeMap<&'static str, f64> {
        self.file.camera.lens.coefficients().into_iter().collect()
    }

    /// Light at the camera as its file says it, a dict; None where it says nothing.
    #[getter]
    fn light<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.file.light.as_ref().map(|light| crate::convert::plain(py, light)).transpose()
    }

    /// Pixels of points in camera axes.
    ///
    /// Parameters
    /// ----------
    /// points : array (n, 3)
    ///     In camera axes.
    ///
    /// Returns
    /// -------
    /// float64 (n, 2)
    ///     px; NaN behind the camera and where the distortion has no meaning.
    fn project<'py>(&self, points: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let given = self::points(points, "points")?;
        let pixel = |p| match self.file.camera.project(p) {
            Some(found) => [found.pixel.x, found.pixel.y],
            None => [f64::NAN; 2],
        };
        array2(points.py(), given.iter().map(pixel))
    }

    /// Directions of the sightlines of pixels.
    ///
    /// Parameters
    /// ----------
    /// pixels : array (n, 2)
    ///     px, pixel centres at integers.
    ///
    /// Returns
    /// -------
    /// float64 (n, 3)
    ///     Unit vectors in camera axes; NaN where the distortion has no inverse.
    fn unproject<'py>(&self, pixels: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let given = rows::<2>(pixels, "pixels")?;
        let ray = |p: &[f64; 2]| match self.file.camera.unproject(&Point2::from(*p)) {
            Some(ray) => [ray.x, ray.y, ray.z],
            None => [f64::NAN; 3],
        };
        array2(pixels.py(), given.iter().map(ray))
    }

    /// Write a ``camera.json`` that `read_camera` and the command line read.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        write_camera(&path, &self.file).map_err(IntoPython::into_python)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.file.camera == other.file.camera && self.file.tone == other.file.tone
    }

    fn __repr__(&self) -> String {
        let CameraModel { size: [w, h], focal: [fx, fy], centre: [cx, cy], lens } =
            &self.file.camera;
        let mut text = format!("Camera({w}, {h}, fx={fx}, fy={fy}, cx={cx}, cy={cy}");
        for (name, value) in lens.coefficients() {
            text += &format!(", {name}={value}");
        }
        text + ")"
    }
}

/// Read a camera: camera.json, OpenCV YAML or JSON, or COLMAP's cameras.txt, cameras.bin or model
/// folder.
///
/// Parameters
/// ----------
/// path : str or os.PathLike
///     The file or folder.
///
/// Raises
/// ------
/// FileError
///     Missing, damaged, or without a field that is needed; the message names it.
#[pyfunction]
pub fn read_camera(path: PathBuf) -> PyResult<Camera> {
    Ok(Camera { file: read(&path).map_err(IntoPython::into_python)? })
}
