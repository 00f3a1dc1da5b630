//! `dsfms.Template`.

use crate::camera::Camera;
use crate::convert::{array1, array2, plain, points_out, pose_out};
use crate::errors::{IntoPython, wrong};
use dsfms::geometry::Point2;
use dsfms::image::ToneCurve;
use dsfms::io::camera::CameraFile;
use dsfms::io::template::{read_template, write_template};
use dsfms::mesh::Mesh;
use dsfms::pipeline::{Silent, TemplateOptions, template_from_mesh};
use dsfms::sfm::NoPose;
use dsfms::synth::render::encoder;
use dsfms::template::bake::bake;
use dsfms::template::{LengthUnit, Template as Inner};
use image::ImageEncoder;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;
use std::sync::Arc;

/// The organ at rest: surface, flattening, albedo, descriptors, exploration views.
///
/// Made by `build_template`, `Template.load` or `Template.from_mesh`; immutable.
/// Lengths are in `unit`, positions in the template frame.
#[pyclass(module = "dsfms", frozen, name = "Template")]
pub struct Template {
    pub inner: Arc<Inner>,
    /// Frames that were left out when it was built, and why.
    rejected: Vec<(String, NoPose)>,
}

impl Template {
    pub fn new(inner: Inner) -> Self {
        Self { inner: Arc::new(inner), rejected: Vec::new() }
    }

    pub fn built(inner: Inner, rejected: Vec<(String, NoPose)>) -> Self {
        Self { inner: Arc::new(inner), rejected }
    }
}

/// A mesh of arrays.
pub fn mesh(
    vertices: &Bound<'_, PyAny>,
    faces: &Bound<'_, PyAny>,
    names: [&str; 2],
) -> PyResult<Mesh> {
    let positions = crate::convert::points(vertices, names[0])?;
    let faces = crate::convert::faces(faces, names[1])?;
    Mesh::new(positions, faces)
        .map_err(|error| wrong(names[1], "a manifold surface", error.to_string()))
}

/// The unit of a mesh.
pub fn unit(name: &str) -> PyResult<LengthUnit> {
    match name {
        "mm" => Ok(LengthUnit::Millimetre),
        "template_units" => Ok(LengthUnit::TemplateUnit),
        _ => Err(wrong("unit", "\"mm\" or \"template_units\"", format!("{name:?}"))),
    }
}

#[pymethods]
impl Template {
    /// Read a template folder, as `save` or ``dsfms template`` wrote it.
    ///
    /// Raises
    /// ------
    /// FileError
    ///     Missing, damaged, or of another version.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        read_template(&path).map(Self::new).map_err(IntoPython::into_python)
    }

    /// A template of a bare mesh: no albedo, no descriptors; motion with given matches works on it.
    ///
    /// Parameters
    /// ----------
    /// vertices : array (n, 3)
    ///     Template frame.
    /// faces : integer array (m, 3)
    ///     0-based vertices, counter-clockwise seen from outside.
    /// unit : {"mm", "template_units"}
    ///     Unit of the vertices.
    #[staticmethod]
    #[pyo3(signature = (vertices, faces, *, unit="mm"))]
    fn from_mesh(
        vertices: &Bound<'_, PyAny>,
        faces: &Bound<'_, PyAny>,
        unit: &str,
    ) -> PyResult<Self> {
        let mesh = mesh(vertices, faces, ["vertices", "faces"])?;
        let unit = self::unit(unit)?;
        Ok(Self::new(template_from_mesh(mesh, unit, None, &TemplateOptions::default(), &Silent)))
    }

    /// Write a template folder, whole or not at all; an older template there is replaced.
    ///
    /// Raises
    /// ------
    /// FileError
    ///     Something else lies there, or the folder cannot be written.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| write_template(&path, &self.inner)).map_err(IntoPython::into_python)
    }

    /// Rest positions, float64 (n, 3), template frame.
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points_out(py, &self.inner.mesh.positions)
    }

    /// Vertices of every face, uint32 (m, 3), counter-clockwise seen from outside.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        array2(py, self.inner.mesh.topology.faces.iter().copied())
    }

    /// Texture coordinates of the corners of every face, float64 (m, 3, 2) in [0, 1], v upward;
    /// None where the surface could not be flattened.
    #[getter]
    fn uv<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<f64>>>> {
        let Some(flat) = &self.inner.flattening else { return Ok(None) };
        let pair = |p: &Point2| [p.x, p.y];
        let values: Vec<f64> = flat.corners.iter().flatten().flat_map(pair).collect();
        array1(py, values).reshape([flat.corners.len(), 3, 2]).map(Some)
    }

    /// "mm" or "template_units".
    #[getter]
    fn unit(&self) -> &'static str {
        self.inner.unit.label()
    }

    /// Camera of the exploration; None without frames.
    #[getter]
    fn camera(&self) -> Option<Camera> {
        let camera = self.inner.camera.clone()?;
        let tone = Some(self.inner.tone.clone());
        let vignetting = Some(self.inner.coat.vignetting).filter(|a| *a != 0.0);
        Some(Camera { file: CameraFile { camera, tone, light: None, vignetting } })
    }

    /// Name of every registered exploration frame and its ``camera_from_template``, float64 (4, 4).
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let poses = PyDict::new(py);
        for view in &self.inner.views {
            poses.set_item(&view.name, pose_out(py, &view.camera_from_template)?)?;
        }
        Ok(poses)
    }

    /// Name of every exploration frame that was left out when this template was built, and why.
    #[getter]
    fn rejected(&self) -> std::collections::BTreeMap<String, String> {
        self.rejected.iter().map(|(name, why)| (name.clone(), why.to_string())).collect()
    }

    /// Light as calibrated on the exploration, a dict; None where it is not known.
    #[getter]
    fn light<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.inner.light.as_ref().map(|light| plain(py, light)).transpose()
    }

    /// Sparse points of structure from motion, float64 (k, 3), template frame.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, self.inner.points.iter().map(|p| [p.position.x, p.position.y, p.position.z]))
    }

    /// Colour of `points`, uint8 (k, 3).
    #[getter]
    fn point_colors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        array2(py, self.inner.points.iter().map(|p| p.rgb))
    }

    /// Standard deviation expected of every vertex across the surface, float64 (n,), in `unit`;
    /// infinite where no depth map spoke of it, empty where the mesh was given.
    #[getter]
    fn sigma<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.inner.sigma.clone())
    }

    /// Number of descriptors on the surface.
    #[getter]
    fn feature_count(&self) -> usize {
        self.inner.features.as_ref().map_or(0, |f| f.descriptors.len())
    }

    /// Albedo in the UV of the surface.
    ///
    /// Parameters
    /// ----------
    /// size : int
    ///     Side of the square image, 16 to 8192 px.
    ///
    /// Returns
    /// -------
    /// float32 (size, size, 3) or None
    ///     Linear RGB, row 0 at v = 1, black outside the charts; None without albedo or flattening.
    #[pyo3(signature = (size=1024))]
    fn albedo_texture<'py>(
        &self,
        py: Python<'py>,
        size: usize,
    ) -> PyResult<Option<Bound<'py, PyArray3<f32>>>> {
        let Some(image) = self.baked(py, size)? else { return Ok(None) };
        let values: Vec<f32> = image.into_iter().flatten().collect();
        array1(py, values).reshape([size, size, 3]).map(Some)
    }

    /// Albedo at the vertices, float32 (n, 3), linear RGB; None without albedo.
    #[getter]
    fn albedo_vertices<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        let Some(albedo) = &self.inner.albedo else { return Ok(None) };
        let topology = &self.inner.mesh.topology;
        let colour = |v: usize| -> [f32; 3] {
            let mut sum = [0.0; 3];
            let around = &topology.vertex_faces[v];
            for &face in around {
                let corner = topology.faces[face as usize].iter().position(|&c| c as usize == v);
                let mut at = [0.0; 3];
                at[corner.unwrap_or(0)] = 1.0;
                let texel = albedo.value[albedo.index(face as usize, at)];
                sum.iter_mut().zip(texel).for_each(|(s, t)| *s += t);
            }
            sum.map(|s| s / around.len().max(1) as f32)
        };
        array2(py, (0..topology.vertex_count).map(colour)).map(Some)
    }

    /// The albedo as the bytes of a PNG (sRGB), for pages and viewers; None as in `albedo_texture`.
    #[pyo3(signature = (size=512))]
    fn albedo_png<'py>(
        &self,
        py: Python<'py>,
        size: usize,
    ) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let Some(pixels) = self.baked(py, size)? else { return Ok(None) };
        let encode = encoder(&ToneCurve::Srgb);
        let brightest = pixels.iter().flatten().copied().fold(1e-6, f32::max).min(1.0);
        let byte = |v: f32| encode(f64::from((v / brightest).clamp(0.0, 1.0))).round() as u8;
        let bytes: Vec<u8> = pixels.into_iter().flatten().map(byte).collect();
        let mut file = Vec::new();
        image::codecs::png::PngEncoder::new(&mut file)
            .write_image(&bytes, size as u32, size as u32, image::ExtendedColorType::Rgb8)
            .map_err(|e| pyo3::exceptions::PyRuntimeError::new_err(e.to_string()))?;
        Ok(Some(PyBytes::new(py, &file)))
    }

    /// Open3D mesh at rest (extra ``open3d``): vertices, faces, vertex colours.
    fn to_open3d<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        bridge(slf.as_any(), "to_open3d")
    }

    /// PyVista mesh at rest (extra ``pyvista``): vertices, faces, texture coordinates, albedo.
    fn to_pyvista<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        bridge(slf.as_any(), "to_pyvista")
    }

    /// trimesh mesh at rest (extra ``trimesh``): vertices, faces, vertex colours.
    fn to_trimesh<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        bridge(slf.as_any(), "to_trimesh")
    }

    /// ``pycolmap.Reconstruction`` of the exploration (extra ``pycolmap``): camera, images with
    /// their poses, points with their colours.
    fn to_pycolmap<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        bridge(slf.as_any(), "to_pycolmap")
    }

    /// A table and the albedo, for notebooks.
    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("dsfms._html")?.call_method1("template", (slf,))
    }

    fn __repr__(&self) -> String {
        let Inner { mesh, views, unit, .. } = &*self.inner;
        let (v, f) = (mesh.positions.len(), mesh.topology.faces.len());
        format!("Template({v} vertices, {f} faces, {} views, {})", views.len(), unit.label())
    }
}

impl Template {
    fn baked(&self, py: Python<'_>, size: usize) -> PyResult<Option<Vec<[f32; 3]>>> {
        if !(16..=8192).contains(&size) {
            return Err(wrong("size", "16 to 8192", size.to_string()));
        }
        let Some((albedo, flat)) = self.inner.albedo.as_ref().zip(self.inner.flattening.as_ref())
        else {
            return Ok(None);
        };
        let baked = py.detach(|| bake(albedo, flat, size, 4));
        baked
            .map(|b| Some(b.image.data))
            .map_err(|e| pyo3::exceptions::PyRuntimeError::new_err(e.to_string()))
    }
}

/// Call a function of `dsfms.bridges` on an object.
pub fn bridge<'py>(object: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    object.py().import("dsfms.bridges")?.call_method1(name, (object,))
}
