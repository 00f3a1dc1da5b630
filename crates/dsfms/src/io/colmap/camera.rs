//! COLMAP's camera models and ours.

use crate::camera::{CameraModel, Lens, LensKind};

/// A model of COLMAP that can be expressed here.
struct ColmapLens {
    number: i32,
    /// Its lens is the one that this name tells ([`LensKind::told`]).
    name: &'static str,
    /// 1: the same focal length across and down.
    focals: usize,
    /// Coefficients after focal lengths and principal point.
    coefficients: &'static [&'static str],
}

impl ColmapLens {
    const fn new(
        number: i32,
        name: &'static str,
        focals: usize,
        coefficients: &'static [&'static str],
    ) -> Self {
        Self { number, name, focals, coefficients }
    }

    fn count(&self) -> usize {
        self.focals + 2 + self.coefficients.len()
    }

    /// Whether it holds a camera of two focal lengths with this lens.
    fn holds(&self, lens: &Lens) -> bool {
        let perspective = |kind: &LensKind| kind.perspective;
        let has = |c: &(&str, f64)| c.1 == 0.0 || self.coefficients.contains(&c.0);
        self.focals == 2
            && LensKind::told(self.name).map(perspective) == Some(lens.kind().perspective)
            && lens.coefficients().iter().all(has)
    }
}

/// Of those that hold a camera the first is written.
const MODELS: [ColmapLens; 7] = [
    ColmapLens::new(0, "SIMPLE_PINHOLE", 1, &[]),
    ColmapLens::new(1, "PINHOLE", 2, &[]),
    ColmapLens::new(2, "SIMPLE_RADIAL", 1, &["k1"]),
    ColmapLens::new(3, "RADIAL", 1, &["k1", "k2"]),
    ColmapLens::new(4, "OPENCV", 2, &["k1", "k2", "p1", "p2"]),
    ColmapLens::new(5, "OPENCV_FISHEYE", 2, &["k1", "k2", "k3", "k4"]),
    ColmapLens::new(6, "FULL_OPENCV", 2, &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]),
];

/// Name and parameter count of a model number.
pub(super) fn by_number(number: i32) -> Result<(&'static str, usize), String> {
    let found = MODELS.iter().find(|m| m.number == number);
    found.map(|m| (m.name, m.count())).ok_or_else(|| unsupported(&format!("number {number}")))
}

fn unsupported(model: &str) -> String {
    let known: Vec<&str> = MODELS.iter().map(|m| m.name).collect();
    format!("camera model {model} is not supported; expected {}", known.join(", "))
}

/// The camera of a named model, COLMAP's pixel convention undone.
pub(in crate::io) fn from_colmap(
    name: &str,
    size: [usize; 2],
    parameters: &[f64],
) -> Result<CameraModel, String> {
    let model = MODELS.iter().find(|m| m.name == name);
    let model = model.ok_or_else(|| unsupported(&format!("{name:?}")))?;
    if parameters.len() != model.count() {
        return Err(format!("{} parameters do not fit the model {name}", parameters.len()));
    }
    let (focal, rest) = parameters.split_at(model.focals);
    let named: Vec<_> = model.coefficients.iter().copied().zip(rest[2..].iter().copied()).collect();
    let lens = LensKind::told(name).map_or(Lens::default(), |kind| kind.named_coefficients(&named));
    Ok(CameraModel {
        size,
        focal: [focal[0], focal[model.focals - 1]],
        centre: [rest[0] - 0.5, rest[1] - 0.5],
        lens: lens.simplest(),
    })
}

/// Number, name and parameters of the first model that holds a camera.
pub(super) fn to_colmap(camera: &CameraModel) -> (i32, &'static str, Vec<f64>) {
    let model = MODELS.iter().find(|m| m.holds(&camera.lens)).unwrap_or(&MODELS[1]);
    let named = camera.lens.coefficients();
    let value = |name: &&str| named.iter().find(|c| c.0 == *name).map_or(0.0, |c| c.1);
    let ([fx, fy], [cx, cy]) = (camera.focal, camera.centre.map(|c| c + 0.5));
    let lens: Vec<f64> = model.coefficients.iter().map(value).collect();
    (model.number, model.name, [vec![fx, fy, cx, cy], lens].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_lens_comes_back() {
        for kind in Lens::KINDS {
            let named: Vec<_> = kind.coefficients.iter().map(|name| (*name, 0.01)).collect();
            let lens = kind.named_coefficients(&named);
            let (size, focal) = ([640, 480], [500.0, 510.0]);
            let camera = CameraModel { size, focal, centre: [319.5, 239.5], lens };
            let (number, name, parameters) = to_colmap(&camera);
            assert_eq!(from_colmap(name, size, &parameters), Ok(camera), "{name}");
            assert_eq!(by_number(number), Ok((name, parameters.len())));
        }
    }
}
