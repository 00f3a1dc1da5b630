//! COLMAP's camera models and ours.

use crate::camera::{CameraModel, Lens};

/// COLMAP's number, name and parameter count of the models that can be expressed here.
const MODELS: [(i32, &str, usize); 7] = [
    (0, "SIMPLE_PINHOLE", 3),
    (1, "PINHOLE", 4),
    (2, "SIMPLE_RADIAL", 4),
    (3, "RADIAL", 5),
    (4, "OPENCV", 8),
    (5, "OPENCV_FISHEYE", 8),
    (6, "FULL_OPENCV", 12),
];

/// Name and parameter count of a model number.
pub(super) fn by_number(number: i32) -> Result<(&'static str, usize), String> {
    let found = MODELS.iter().find(|m| m.0 == number);
    found.map(|m| (m.1, m.2)).ok_or_else(|| unsupported(&format!("number {number}")))
}

fn unsupported(model: &str) -> String {
    let known: Vec<&str> = MODELS.iter().map(|m| m.1).collect();
    format!("camera model {model} is not supported; expected {}", known.join(", "))
}

/// The camera of a named model, COLMAP's pixel convention undone.
pub(in crate::io) fn from_colmap(
    model: &str,
    size: [usize; 2],
    parameters: &[f64],
) -> Result<CameraModel, String> {
    let brown = |k: [f64; 3], p: [f64; 2]| {
        if k == [0.0; 3] && p == [0.0; 2] { Lens::Pinhole } else { Lens::BrownConrady { k, p } }
    };
    let (focal, centre, lens) = match (model, parameters) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f], [cx, cy], Lens::Pinhole),
        ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy], [cx, cy], Lens::Pinhole),
        ("SIMPLE_RADIAL", &[f, cx, cy, k]) => ([f, f], [cx, cy], brown([k, 0.0, 0.0], [0.0; 2])),
        ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f], [cx, cy], brown([k1, k2, 0.0], [0.0; 2])),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
            ([fx, fy], [cx, cy], brown([k1, k2, 0.0], [p1, p2]))
        }
        ("OPENCV_FISHEYE", &[fx, fy, cx, cy, k1, k2, k3, k4]) => {
            ([fx, fy], [cx, cy], Lens::KannalaBrandt { k: [k1, k2, k3, k4] })
        }
        ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]) => {
            ([fx, fy], [cx, cy], brown([k1, k2, k3], [p1, p2]))
        }
        ("FULL_OPENCV", p) if p.len() == 12 => {
            return Err(
                "FULL_OPENCV with k4, k5 or k6 is a rational model, which is not supported".into(),
            );
        }
        (name, p) => match MODELS.iter().find(|m| m.1 == name) {
            Some(_) => return Err(format!("{} parameters do not fit the model {name}", p.len())),
            None => return Err(unsupported(&format!("{name:?}"))),
        },
    };
    Ok(CameraModel { size, focal, centre: centre.map(|c| c - 0.5), lens })
}

/// Number, name and parameters of the smallest model that holds a camera.
pub(super) fn to_colmap(camera: &CameraModel) -> (i32, &'static str, Vec<f64>) {
    let ([fx, fy], [cx, cy]) = (camera.focal, camera.centre.map(|c| c + 0.5));
    let (number, more) = match camera.lens {
        Lens::Pinhole => (1, vec![]),
        Lens::BrownConrady { k: [k1, k2, 0.0], p: [p1, p2] } => (4, vec![k1, k2, p1, p2]),
        Lens::BrownConrady { k: [k1, k2, k3], p: [p1, p2] } => {
            (6, vec![k1, k2, p1, p2, k3, 0.0, 0.0, 0.0])
        }
        Lens::KannalaBrandt { k } => (5, k.to_vec()),
    };
    let name = MODELS.iter().find(|m| m.0 == number).map_or("PINHOLE", |m| m.1);
    (number, name, [vec![fx, fy, cx, cy], more].concat())
}
