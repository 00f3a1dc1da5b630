//! `dsfms.calibrate`, `dsfms.evaluate`, `dsfms.synthesize`.

use crate::build::{Images, decode};
use crate::camera::Camera;
use crate::convert::{self, array1, array2, match_row, plain, points_out};
use crate::errors::{IntoPython, wrong};
use crate::template::{Template, mesh};
use crate::work;
use dsfms::calibrate::{Board, CalibrateOptions, calibrate as solve};
use dsfms::eval::zone::extent;
use dsfms::eval::{Alignment, EvaluateOptions, Truth, deformed_zone, evaluate as compare};
use dsfms::experiment::SeriesOrgan;
use dsfms::image::ToneCurve;
use dsfms::io::camera::CameraFile;
use dsfms::pipeline::sources::Purpose;
use dsfms::synth::{Cell, LightKind, Protocol};
use dsfms::video::SelectOptions;
use numpy::PyArrayMethods;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Intrinsics, and a dict for `dsfms.Calibration`.
#[pyfunction]
#[pyo3(signature = (images, board, square, third_radial, tangential, partial))]
pub fn _calibrate<'py>(
    py: Python<'py>,
    images: &Bound<'py, PyAny>,
    board: (usize, usize),
    square: f64,
    third_radial: bool,
    tangential: bool,
    partial: bool,
) -> PyResult<(Camera, Bound<'py, PyDict>)> {
    if board.0 < 3 || board.1 < 3 {
        return Err(wrong("board", "at least (3, 3) inner corners", format!("{board:?}")));
    }
    if !(square.is_finite() && square > 0.0) {
        return Err(wrong("square", "a length in mm above 0", square.to_string()));
    }
    let images = Images::of(images, "images", [0, 0])?;
    let board = Board { corners: [board.0, board.1], square };
    let options = CalibrateOptions { third_radial, tangential, partial };
    let (names, found) = work::run(py, None, move |told| {
        let frames = decode(images, Purpose::Template(&SelectOptions::default()), told)?;
        let found = solve(&frames, &board, &options).map_err(IntoPython::into_python)?;
        PyResult::Ok((frames.into_iter().map(|f| f.name).collect::<Vec<_>>(), found))
    })??;
    let result = PyDict::new(py);
    result.set_item("rms_px", found.rms_px())?;
    let (values, deviations) = (PyDict::new(py), PyDict::new(py));
    for e in &found.estimates {
        values.set_item(e.name, e.value)?;
        deviations.set_item(e.name, e.deviation)?;
    }
    result.set_item("intrinsics", values)?;
    result.set_item("deviations", deviations)?;
    let n = found.covariance.len();
    let flat: Vec<f64> = found.covariance.iter().flatten().copied().collect();
    result.set_item("covariance", array1(py, flat).reshape([n, n])?)?;
    let (poses, corners, rms) = (PyDict::new(py), PyDict::new(py), PyDict::new(py));
    for view in &found.views {
        let name = &names[view.frame];
        poses.set_item(name, convert::pose_out(py, &view.pose)?)?;
        let pixels = view.corners.iter().map(|c| [c.pixel.x, c.pixel.y]);
        corners.set_item(name, array2(py, pixels)?)?;
        rms.set_item(name, view.rms_px())?;
    }
    result.set_item("poses", poses)?;
    result.set_item("corners", corners)?;
    result.set_item("view_rms_px", rms)?;
    let rejected = PyDict::new(py);
    for (i, why) in &found.rejected {
        rejected.set_item(&names[*i], why.to_string())?;
    }
    result.set_item("rejected", rejected)?;
    Ok((Camera::of(found.camera), result))
}

/// Errors of a surface as plain values for `dsfms.Evaluation`.
#[pyfunction]
#[pyo3(signature = (found, truth, faces, visible, zone, rest, camera, align))]
#[allow(clippy::too_many_arguments, reason = "called by dsfms.evaluate alone")]
pub fn _evaluate<'py>(
    py: Python<'py>,
    found: &Bound<'py, PyAny>,
    truth: &Bound<'py, PyAny>,
    faces: &Bound<'py, PyAny>,
    visible: Option<&Bound<'py, PyAny>>,
    zone: Option<&Bound<'py, PyAny>>,
    rest: Option<&Bound<'py, PyAny>>,
    camera: Option<&Bound<'py, Camera>>,
    align: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let truth = mesh(truth, faces, ["truth", "faces"])?;
    let positions = convert::points(found, "found")?;
    let n = truth.positions.len();
    if positions.len() != n {
        return Err(wrong(
            "found",
            format!("({n}, 3), as the truth"),
            format!("({}, 3)", positions.len()),
        ));
    }
    let found = truth.with_positions(positions);
    let visible = visible.map(|v| convert::flags(v, "visible", n)).transpose()?;
    let zone = zone.map(|v| convert::flags(v, "zone", n)).transpose()?;
    let rest = rest.map(|r| convert::points(r, "rest")).transpose()?;
    let zone = zone.or_else(|| {
        let moved = dsfms::eval::displacement_from_rest(rest.as_deref()?, &truth.positions)?;
        Some(deformed_zone(&moved, visible.as_deref(), extent(&truth.positions)))
    });
    let alignment = match align {
        "none" => Alignment::None,
        "rigid" => Alignment::Rigid,
        "similarity" => Alignment::Similarity,
        _ => {
            let expected = "\"none\", \"rigid\" or \"similarity\"";
            return Err(wrong("align", expected, format!("{align:?}")));
        }
    };
    let camera = camera.map(|c| c.get().file.camera.clone());
    let result = py.detach(|| {
        let reference = Truth {
            mesh: &truth,
            visible: visible.as_deref(),
            zone: zone.as_deref(),
            camera: camera.as_ref(),
        };
        compare(&found, &reference, &EvaluateOptions { alignment })
    });
    plain(py, &result.map_err(IntoPython::into_python)?)
}

/// A synthetic case as a dict for `dsfms.Case`.
#[pyfunction]
#[pyo3(signature = (organ, extension, noise, vertices, light, matches, everywhere, index, seed))]
#[allow(clippy::too_many_arguments, reason = "called by dsfms.synthesize alone")]
pub fn _synthesize<'py>(
    py: Python<'py>,
    organ: String,
    extension: f64,
    noise: f64,
    vertices: usize,
    light: &str,
    matches: usize,
    everywhere: bool,
    index: usize,
    seed: u64,
) -> PyResult<Bound<'py, PyDict>> {
    if !(0.0..=100.0).contains(&extension) {
        return Err(wrong("extension", "0 to 100 percent", extension.to_string()));
    }
    if !(0.0..=100.0).contains(&noise) {
        return Err(wrong("noise", "0 to 100 px", noise.to_string()));
    }
    if !(50..=50_000).contains(&vertices) {
        return Err(wrong("vertices", "50 to 50,000", vertices.to_string()));
    }
    let Some(light) = LightKind::named(light) else {
        let names = LightKind::ALL.map(|l| format!("{:?}", l.name())).join(", ");
        return Err(wrong("light", format!("one of {names}"), format!("{light:?}")));
    };
    let protocol = Protocol { vertices, light, matches, everywhere, seed, ..Default::default() };
    let case = work::run(py, None, move |_| {
        let organ = SeriesOrgan::named(&organ).map_err(IntoPython::into_python)?;
        organ.case(&protocol, Cell { extension, noise }, index).map_err(IntoPython::into_python)
    })??;
    let result = PyDict::new(py);
    let rest = &case.template.mesh.positions;
    let moved = case.deformation.vertices.iter().zip(rest).map(|(a, b)| (a - b).norm()).collect();
    result.set_item("displacement", array1::<f64>(py, moved))?;
    result.set_item("zone", array1(py, case.deformation.zone.clone()))?;
    result.set_item("visible", array1(py, case.visible.clone()))?;
    result.set_item("truth", points_out(py, &case.truth)?)?;
    result.set_item("matches", array2(py, case.matches.iter().map(match_row))?)?;
    let [w, h] = case.frame.size;
    let image = array1(py, case.frame.rgb.into_flattened()).reshape([h, w, 3])?;
    result.set_item("image", image)?;
    let light = case.template.light.clone();
    let file =
        CameraFile { camera: case.camera, tone: Some(ToneCurve::Srgb), light, vignetting: None };
    result.set_item("camera", Camera { file })?;
    result.set_item("template", Template::new(case.template))?;
    Ok(result)
}
