//! Conformal flattening of the template (paper §4), of any surface: what is not a disc is cut.

mod conformal;
mod cut;
mod energy;
mod lscm;
mod pack;
mod spectral;

use super::Flattening;
use crate::geometry::{Point2, Vector2, area, signed_area};
use crate::mesh::Mesh;
use crate::mesh::boundary::boundary_loops;
use crate::mesh::components::components;
use crate::options::{OptionError, check};
use cut::Cut;
use nalgebra::Matrix2;
use serde::{Deserialize, Serialize};

/// Which conformal map of a disc.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlattenMethod {
    /// Constant scale along the boundary: the least area distortion.
    #[default]
    Bff,
    /// Least squares, two vertices held.
    Lscm,
    /// Least squares with a boundary of given size, nothing held.
    Spectral,
}

/// Which map (`docs/results/flattening.md`), and how far a surface may be cut open for it (not
/// measured).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FlattenOptions {
    /// The map of each disc.
    pub method: FlattenMethod,
    /// Largest area ratio between the most and the least magnified face of one component (the
    /// extreme per cent left out) before its cut is lengthened to the most shrunken place; above 1.
    /// 8: two or three arms of the seam on a closed organ, after which more gains little.
    pub max_area_ratio: f64,
    /// At most this many lengthenings per component; 0 cuts only what the topology demands.
    pub max_extra_cuts: usize,
}

impl Default for FlattenOptions {
    fn default() -> Self {
        Self { method: FlattenMethod::default(), max_area_ratio: 8.0, max_extra_cuts: 6 }
    }
}

impl FlattenOptions {
    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        let ratio = self.max_area_ratio > 1.0 && self.max_area_ratio.is_finite();
        check(&[("flatten.max_area_ratio", ratio, "a number above 1")])
    }
}

/// Why a surface could not be flattened.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FlattenError {
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
    /// A face without area has no angles to keep.
    #[error("face {face} has no area, so it has no angles to keep; remove degenerate faces first")]
    DegenerateFace {
        /// 0-based face.
        face: usize,
    },
    /// The cut did not make a disc: the surface is pinched at a vertex or inconsistent.
    #[error(
        "component {component} is not a disc after cutting (Euler characteristic {euler}, {boundaries} boundary loops); expected 1 and 1; repair vertices where two fans touch"
    )]
    NotADisc {
        /// 0-based component.
        component: usize,
        /// `V − E + F` after cutting.
        euler: i64,
        /// Boundary loops after cutting.
        boundaries: usize,
    },
    /// The linear system has no solution in double precision.
    #[error(
        "the flattening of component {component} ({faces} faces) could not be solved; its triangles are too thin: remesh it"
    )]
    Singular {
        /// 0-based component.
        component: usize,
        /// Its faces.
        faces: usize,
    },
}

/// Flatten a surface conformally. Every component becomes one chart; charts keep their relative
/// areas and are packed into `[0, 1]²`, v upwards. Closed surfaces, handles and several boundaries
/// are cut along short paths of edges first, and a cut is lengthened where the map would shrink a
/// part too much. Faces are counter-clockwise in UV unless the map folds there:
/// [`Flattening::flipped`] counts those.
///
/// # Errors
/// An option out of range, a face without area, or a piece that cannot be cut to a disc.
#[doc(alias("UV map", "parametrisation", "conformal map", "LSCM", "BFF"))]
pub fn flatten(mesh: &Mesh, options: &FlattenOptions) -> Result<Flattening, FlattenError> {
    options.validate()?;
    let faces = mesh.topology.faces.len();
    if let Some(face) = (0..faces).find(|&f| mesh.is_degenerate(f)) {
        return Err(FlattenError::DegenerateFace { face });
    }
    let parts = components(&mesh.topology);
    let mut corners = vec![[Point2::origin(); 3]; faces];
    let (mut seam, mut charts) = (Vec::new(), Vec::new());
    for component in 0..parts.count {
        let own: Vec<usize> =
            (0..faces).filter(|&f| parts.of_face[f] as usize == component).collect();
        let (part, old) = mesh.subset(&own);
        let (uv, open) = flatten_component(&part, component, options)?;
        seam.extend(open.iter().map(|e| e.map(|v| old[v as usize])));
        own.iter().zip(uv).for_each(|(&f, uv)| corners[f] = uv);
        charts.push(own);
    }
    pack::pack(&mut corners, &charts);
    let (quasi_conformal, log_area) = distortion(mesh, &corners);
    seam.sort_unstable();
    Ok(Flattening { corners, seam, quasi_conformal, log_area })
}

type Chart = (Vec<[Point2; 3]>, Vec<[u32; 2]>);

fn flatten_component(
    mesh: &Mesh,
    component: usize,
    options: &FlattenOptions,
) -> Result<Chart, FlattenError> {
    let mut cut = Cut::to_disc(mesh);
    let mut best: Option<(f64, Chart)> = None;
    for round in 0..=options.max_extra_cuts {
        let (corners, shrunken, ratio) = flatten_cut(&cut, component, options.method)?;
        if best.as_ref().is_none_or(|(known, _)| ratio < *known) {
            let edges = mesh.topology.edges.iter().zip(&cut.open);
            let seam = edges.filter(|(_, open)| **open).map(|(e, _)| *e).collect();
            best = Some((ratio, (corners, seam)));
        }
        let enough = ratio <= options.max_area_ratio || round == options.max_extra_cuts;
        if enough || !cut.extend_to(shrunken) {
            break;
        }
    }
    let singular = FlattenError::Singular { component, faces: mesh.topology.faces.len() };
    best.map(|(_, chart)| chart).ok_or(singular)
}

/// UV per corner, the most shrunken vertex, and the area ratio between extreme faces.
fn flatten_cut(
    cut: &Cut,
    component: usize,
    method: FlattenMethod,
) -> Result<(Vec<[Point2; 3]>, u32, f64), FlattenError> {
    let (disc, old) = cut.opened();
    let euler = disc.topology.euler_characteristic();
    let boundaries = boundary_loops(&disc.topology).len();
    if (euler, boundaries) != (1, 1) {
        return Err(FlattenError::NotADisc { component, euler, boundaries });
    }
    let map = match method {
        FlattenMethod::Bff => conformal::flatten_disc,
        FlattenMethod::Lscm => lscm::flatten_disc,
        FlattenMethod::Spectral => spectral::flatten_disc,
    };
    let uv =
        map(&disc).ok_or(FlattenError::Singular { component, faces: disc.topology.faces.len() })?;
    let corners: Vec<_> =
        disc.topology.faces.iter().map(|face| face.map(|v| uv[v as usize])).collect();
    let (_, log_area) = distortion(&disc, &corners);
    let smallest = (0..log_area.len())
        .filter(|&f| !disc.topology.faces[f].iter().any(|&v| disc.topology.boundary[v as usize]))
        .min_by(|&a, &b| log_area[a].total_cmp(&log_area[b]))
        .unwrap_or(0);
    let shrunken = old[disc.topology.faces[smallest][0] as usize];
    let mut sorted = log_area;
    sorted.sort_by(f64::total_cmp);
    let at = |q: f64| sorted[((sorted.len() - 1) as f64 * q).round() as usize];
    Ok((corners, shrunken, (at(0.99) - at(0.01)).exp()))
}

/// Ratio of the singular values and ln of the area ratio of every face.
fn distortion(mesh: &Mesh, corners: &[[Point2; 3]]) -> (Vec<f64>, Vec<f64>) {
    let (mut quasi_conformal, mut log_area) = (Vec::new(), Vec::new());
    let (mut mean, mut total) = (0.0, 0.0);
    for (f, uv) in corners.iter().enumerate() {
        let [a, b, c] = mesh.corners(f);
        let surface = area(a, b, c);
        quasi_conformal.push(ratio_of_singular_values(uv, mesh, f));
        let log = (signed_area(uv).abs().max(1e-300) / surface).ln();
        log_area.push(log);
        mean += surface * log;
        total += surface;
    }
    log_area.iter_mut().for_each(|value| *value -= mean / total);
    (quasi_conformal, log_area)
}

fn ratio_of_singular_values(uv: &[Point2; 3], mesh: &Mesh, face: usize) -> f64 {
    let [a, b, c] = mesh.corners(face);
    let (p, q) = (b - a, c - a);
    let x = p.norm();
    let (along, height) = (p.dot(&q) / x, p.cross(&q).norm() / x);
    let target = Matrix2::from_columns(&[uv[1] - uv[0], uv[2] - uv[0]]);
    // Inverse of the upper triangular frame [x along; 0 height] of the face's own plane.
    let map = target * Matrix2::new(1.0 / x, -along / (x * height), 0.0, 1.0 / height);
    let (sum, difference) = (
        Vector2::new(map.m11 + map.m22, map.m21 - map.m12).norm(),
        Vector2::new(map.m11 - map.m22, map.m21 + map.m12).norm(),
    );
    (sum + difference) / (sum - difference).abs().max(1e-300)
}

impl Flattening {
    /// Faces that are clockwise or empty in UV, where the map folds: 0 for a sound flattening.
    pub fn flipped(&self) -> usize {
        self.corners.iter().filter(|uv| signed_area(uv) <= 0.0).count()
    }
}

#[cfg(test)]
mod tests;
