//! NumPy in and out. Whatever has the array protocol is taken (NumPy of any strides, torch tensors
//! on the CPU, lists); what does not fit is refused by name.

use crate::errors::wrong;
use dsfms::geometry::{Isometry, Point3};
use dsfms::image::{Frame, Mask};
use dsfms::register::Match;
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn,
};
use numpy::{PyArrayDescrMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// A match as a row of `matches`: face, three barycentrics, x and y in px.
pub fn match_row(m: &Match) -> [f64; 6] {
    let [a, b, c] = m.barycentric;
    [f64::from(m.face), a, b, c, m.pixel.x, m.pixel.y]
}

/// `numpy.ascontiguousarray`, with an error that names the argument.
fn contiguous<'py>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyUntypedArray>> {
    let numpy = value.py().import("numpy")?;
    let array = numpy.call_method1("ascontiguousarray", (value,)).map_err(|error| {
        let kind = value.get_type().to_string();
        wrong(name, "something that NumPy can read on the CPU", format!("{kind} ({error})"))
    })?;
    Ok(array.cast_into::<PyUntypedArray>()?)
}

/// Type and shape, as messages show them.
fn described(array: &Bound<'_, PyUntypedArray>) -> String {
    format!("{} {:?}", array.dtype(), array.shape())
}

fn typed<'py, T: Element>(
    array: &Bound<'py, PyUntypedArray>,
) -> Option<PyReadonlyArrayDyn<'py, T>> {
    array.cast::<PyArrayDyn<T>>().ok().map(|a| a.readonly())
}

/// An image `(h, w, 3)`: `uint8`, `uint16` (of 65535) or floating point in `[0, 1]`, encoded as in
/// a file.
pub fn frame(value: &Bound<'_, PyAny>, argument: &str, name: String) -> PyResult<Frame> {
    const EXPECTED: &str = "an image (h, w, 3) of uint8, uint16 or floats in [0, 1]";
    let array = contiguous(value, argument)?;
    let shape = array.shape().to_vec();
    let &[h, w, 3] = shape.as_slice() else {
        return Err(wrong(argument, EXPECTED, described(&array)));
    };
    if h == 0 || w == 0 {
        return Err(wrong(argument, EXPECTED, described(&array)));
    }
    let bytes: Vec<[u8; 3]> = if let Some(a) = typed::<u8>(&array) {
        a.as_slice()?.as_chunks::<3>().0.to_vec()
    } else if let Some(a) = typed::<u16>(&array) {
        // As 16-bit files are read.
        let byte = |v: u16| ((u32::from(v) + 128) / 257) as u8;
        a.as_slice()?.as_chunks::<3>().0.iter().map(|p| p.map(byte)).collect()
    } else if let Some(a) = typed::<f32>(&array) {
        floats(a.as_slice()?.iter().map(|&v| f64::from(v)), argument)?
    } else if let Some(a) = typed::<f64>(&array) {
        floats(a.as_slice()?.iter().copied(), argument)?
    } else {
        return Err(wrong(argument, EXPECTED, described(&array)));
    };
    Ok(Frame { name, size: [w, h], rgb: bytes })
}

fn floats(values: impl Iterator<Item = f64>, argument: &str) -> PyResult<Vec<[u8; 3]>> {
    let bytes: Vec<u8> = values
        .map(|v| match v {
            // Rounding of resampled images may leave the range by a little.
            v if (-1e-3..=1.001).contains(&v) => Ok((v.clamp(0.0, 1.0) * 255.0).round() as u8),
            v => Err(wrong(
                argument,
                "finite values in [0, 1] in a floating point image",
                format!("{v}"),
            )),
        })
        .collect::<PyResult<_>>()?;
    Ok(bytes.as_chunks::<3>().0.to_vec())
}

/// A mask `(h, w)` of the size of its image: `bool`, or `uint8` where above 127 is true.
pub fn mask(value: &Bound<'_, PyAny>, argument: &str, size: [usize; 2]) -> PyResult<Mask> {
    let array = contiguous(value, argument)?;
    let expected = || format!("a mask ({}, {}) of bool or uint8", size[1], size[0]);
    if array.shape() != [size[1], size[0]] {
        return Err(wrong(argument, expected(), described(&array)));
    }
    let data = if let Some(a) = typed::<bool>(&array) {
        a.as_slice()?.to_vec()
    } else if let Some(a) = typed::<u8>(&array) {
        a.as_slice()?.iter().map(|&v| v > 127).collect()
    } else {
        return Err(wrong(argument, expected(), described(&array)));
    };
    Ok(Mask { size, data })
}

/// Finite numbers `(n, N)`.
pub fn rows<const N: usize>(value: &Bound<'_, PyAny>, argument: &str) -> PyResult<Vec<[f64; N]>> {
    let array = contiguous(value, argument)?;
    let expected = format!("finite numbers (n, {N})");
    let bad = |array: &Bound<'_, PyUntypedArray>| wrong(argument, &expected, described(array));
    if array.ndim() != 2 || array.shape()[1] != N {
        return Err(bad(&array));
    }
    let kind = array.dtype().kind();
    if !matches!(kind, b'f' | b'i' | b'u') {
        return Err(bad(&array));
    }
    let double = array.call_method1("astype", ("float64",))?.cast_into::<PyArray2<f64>>()?;
    let double = double.readonly();
    let values = double.as_slice()?;
    if let Some(at) = values.iter().position(|v| !v.is_finite()) {
        return Err(wrong(argument, &expected, format!("{} in row {}", values[at], at / N)));
    }
    Ok(values.as_chunks::<N>().0.to_vec())
}

/// Points `(n, 3)`.
pub fn points(value: &Bound<'_, PyAny>, argument: &str) -> PyResult<Vec<Point3>> {
    Ok(rows::<3>(value, argument)?.into_iter().map(Point3::from).collect())
}

/// Faces `(m, 3)` of 0-based vertices.
pub fn faces(value: &Bound<'_, PyAny>, argument: &str) -> PyResult<Vec<[u32; 3]>> {
    let rows = rows::<3>(value, argument)?;
    let index = |v: f64| {
        let whole = v >= 0.0 && v.fract() == 0.0 && v < f64::from(u32::MAX);
        whole.then_some(v as u32)
    };
    let face = |row: &[f64; 3]| {
        let bad = || wrong(argument, "whole numbers from 0", format!("{row:?}"));
        Ok([
            index(row[0]).ok_or_else(bad)?,
            index(row[1]).ok_or_else(bad)?,
            index(row[2]).ok_or_else(bad)?,
        ])
    };
    rows.iter().map(face).collect()
}

/// Matches `(n, 6)`: face, three barycentrics, x and y in px.
pub fn matches(value: &Bound<'_, PyAny>, argument: &str, faces: usize) -> PyResult<Vec<Match>> {
    let one = |(i, row): (usize, [f64; 6])| {
        let [face, b1, b2, b3, x, y] = row;
        let whole = face >= 0.0 && face.fract() == 0.0 && face < faces as f64;
        if !whole || (b1 + b2 + b3 - 1.0).abs() > 1e-3 {
            let expected = format!("face (0 to {}), b1, b2, b3 of sum 1, x, y", faces.max(1) - 1);
            return Err(wrong(argument, expected, format!("row {i}: {row:?}")));
        }
        let pixel = [x, y].into();
        Ok(Match { face: face as u32, barycentric: [b1, b2, b3], pixel })
    };
    rows::<6>(value, argument)?.into_iter().enumerate().map(one).collect()
}

/// Booleans of a known length.
pub fn flags(value: &Bound<'_, PyAny>, argument: &str, length: usize) -> PyResult<Vec<bool>> {
    let array = contiguous(value, argument)?;
    match typed::<bool>(&array) {
        Some(a) if a.shape() == [length] => Ok(a.as_slice()?.to_vec()),
        _ => Err(wrong(argument, format!("bool ({length},)"), described(&array))),
    }
}

/// A rigid motion `(4, 4)`.
pub fn pose(value: &Bound<'_, PyAny>, argument: &str) -> PyResult<Isometry> {
    let rows = rows::<4>(value, argument)?;
    let bad = |found: String| wrong(argument, "a rigid motion (4, 4)", found);
    let [a, b, c, d] = rows.as_slice() else { return Err(bad(format!("{} rows", rows.len()))) };
    let r = nalgebra::Matrix3::from_rows(
        &[a, b, c].map(|r| nalgebra::RowVector3::new(r[0], r[1], r[2])),
    );
    let orthogonal = (r * r.transpose() - nalgebra::Matrix3::identity()).amax() < 1e-6;
    if !orthogonal || r.determinant() < 0.0 || *d != [0.0, 0.0, 0.0, 1.0] {
        return Err(bad("a matrix that is not one".into()));
    }
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(r);
    let translation = nalgebra::Translation3::new(a[3], b[3], c[3]);
    Ok(Isometry::from_parts(translation, rotation.into()))
}

/// `(n, N)` of rows.
pub fn array2<'py, T: Element + Copy, const N: usize>(
    py: Python<'py>,
    rows: impl ExactSizeIterator<Item = [T; N]>,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let n = rows.len();
    rows.flatten().collect::<Vec<T>>().into_pyarray(py).reshape([n, N])
}

/// `(n, 3)` of points.
pub fn points_out<'py>(py: Python<'py>, points: &[Point3]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    array2(py, points.iter().map(|p| [p.x, p.y, p.z]))
}

/// `(4, 4)` of a rigid motion.
pub fn pose_out<'py>(py: Python<'py>, pose: &Isometry) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let matrix = pose.to_homogeneous();
    array2(py, (0..4).map(|r| [0, 1, 2, 3].map(|c| matrix[(r, c)])))
}

/// `(n,)`.
pub fn array1<T: Element>(py: Python<'_>, values: Vec<T>) -> Bound<'_, PyArray1<T>> {
    values.into_pyarray(py)
}

/// Anything that `serde` can write, as plain Python values.
pub fn plain<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value)
        .map_err(|e| pyo3::exceptions::PyRuntimeError::new_err(e.to_string()))?;
    py.import("json")?.call_method1("loads", (text,))
}
