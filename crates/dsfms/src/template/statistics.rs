//! What is inside a template, in numbers: for `dsfms inspect`.

use super::{LengthUnit, Template};
use crate::geometry::Point3;
use crate::mesh::boundary::boundary_loops;
use crate::mesh::components::components;
use serde::Serialize;

/// Figures of a template; lengths in `unit`, areas in its square.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TemplateStatistics {
    /// Unit of every length.
    pub unit: LengthUnit,
    /// Vertices, unused ones included.
    pub vertices: usize,
    /// Faces.
    pub faces: usize,
    /// Separate pieces.
    pub components: usize,
    /// Boundary loops; 0 = closed.
    pub boundary_loops: usize,
    /// `V − E + F`.
    pub euler_characteristic: i64,
    /// Surface area.
    pub area: f64,
    /// Extent along x, y, z.
    pub extent: [f64; 3],
    /// Mean edge length.
    pub mean_edge: f64,
    /// Smallest angle of any face, degrees.
    pub min_angle_deg: f64,
    /// Vertices that at least one exploration frame saw; `None` without frames.
    pub seen_vertices: Option<usize>,
    /// Median of the standard deviations expected of the vertices; `None` where none is known.
    pub median_sigma: Option<f64>,
    /// Share of the area, 0 to 1, that no depth map agrees with (to 1 % of its distance): closed
    /// holes, and what was continued at the rim; `None` where no deviation is known.
    pub unmeasured: Option<f64>,
    /// The flattening's distortion.
    pub flattening: Option<FlatteningStatistics>,
    /// Registered exploration frames.
    pub frames: usize,
    /// Median of the frames' RMS reprojection errors, px; `None` without frames.
    pub median_reprojection_px: Option<f64>,
    /// The albedo.
    pub albedo: Option<AlbedoStatistics>,
    /// Descriptors.
    pub features: usize,
}

/// Distortion of a flattening.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FlatteningStatistics {
    /// Median quasi-conformal ratio; 1 = conformal.
    pub quasi_conformal_median: f64,
    /// 95th percentile of it.
    pub quasi_conformal_p95: f64,
    /// Area ratio between the 99th and the 1st percentile of the faces.
    pub area_ratio: f64,
    /// Faces where the map folds.
    pub flipped: usize,
    /// Edges of the seam.
    pub seam_edges: usize,
}

/// Grey albedo (mean of the channels) over the texels that some view observed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AlbedoStatistics {
    /// All texels.
    pub texels: usize,
    /// Fraction observed.
    pub observed: f64,
    /// Mean.
    pub mean: f64,
    /// 5th percentile.
    pub p5: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Median standard deviation across views, linear units.
    pub median_spread: f64,
}

/// A template of whose area more is [unmeasured](TemplateStatistics::unmeasured) is no surface to
/// rely on. On seven of eight generated scenes it is 0.04 to 0.15; on the eighth, of faint texture,
/// 0.32, and the surface is up to 5 mm off.
pub const MOST_UNMEASURED: f64 = 0.25;

/// See [`TemplateStatistics::unmeasured`].
pub fn unmeasured(template: &Template) -> Option<f64> {
    let unknown = |&v: &u32| template.sigma[v as usize].is_infinite();
    let faces = || template.mesh.topology.faces.iter().zip(template.mesh.face_areas());
    let share = |(face, area): (&[u32; 3], f64)| {
        area * face.iter().filter(|v| unknown(v)).count() as f64 / 3.0
    };
    (!template.sigma.is_empty())
        .then(|| faces().map(share).sum::<f64>() / faces().map(|(_, area)| area).sum::<f64>())
}

/// Count and measure.
pub fn template_statistics(template: &Template) -> TemplateStatistics {
    let (mesh, topology) = (&template.mesh, &template.mesh.topology);
    let [low, high]: [Point3; 2] = mesh.bounding_box();
    let errors = sorted(template.views.iter().map(|v| v.reprojection_px));
    TemplateStatistics {
        unit: template.unit,
        vertices: mesh.positions.len(),
        faces: topology.faces.len(),
        components: components(topology).count,
        boundary_loops: boundary_loops(topology).len(),
        euler_characteristic: topology.euler_characteristic(),
        area: mesh.face_areas().iter().sum(),
        extent: (high - low).into(),
        mean_edge: mesh.mean_edge_length(),
        min_angle_deg: mesh
            .min_angles()
            .into_iter()
            .fold(180.0, |m, a| f64::min(m, a.to_degrees())),
        seen_vertices: (!template.seen.is_empty())
            .then(|| template.seen.iter().filter(|&&n| n > 0).count()),
        median_sigma: (!template.sigma.is_empty())
            .then(|| quantile(&sorted(template.sigma.iter().copied()), 0.5)),
        unmeasured: unmeasured(template),
        flattening: template.flattening.as_ref().map(|map| {
            let ratios = sorted(map.quasi_conformal.iter().copied());
            let areas = sorted(map.log_area.iter().copied());
            FlatteningStatistics {
                quasi_conformal_median: quantile(&ratios, 0.5),
                quasi_conformal_p95: quantile(&ratios, 0.95),
                area_ratio: (quantile(&areas, 0.99) - quantile(&areas, 0.01)).exp(),
                flipped: map.flipped(),
                seam_edges: map.seam.len(),
            }
        }),
        frames: template.views.len(),
        median_reprojection_px: (!errors.is_empty()).then(|| quantile(&errors, 0.5)),
        albedo: template.albedo.as_ref().map(albedo_statistics),
        features: template.features.as_ref().map_or(0, |f| f.descriptors.len()),
    }
}

fn albedo_statistics(texels: &super::SurfaceTexels) -> AlbedoStatistics {
    let observed = |i: &usize| texels.views[*i] > 0;
    let places: Vec<usize> = (0..texels.value.len()).filter(observed).collect();
    let grey = |&i: &usize| texels.value[i].iter().map(|&v| v as f64).sum::<f64>() / 3.0;
    let values = sorted(places.iter().map(grey));
    let spread = sorted(places.iter().map(|&i| texels.spread[i] as f64).filter(|s| s.is_finite()));
    AlbedoStatistics {
        texels: texels.value.len(),
        observed: places.len() as f64 / texels.value.len().max(1) as f64,
        mean: values.iter().sum::<f64>() / values.len().max(1) as f64,
        p5: quantile(&values, 0.05),
        p95: quantile(&values, 0.95),
        median_spread: quantile(&spread, 0.5),
    }
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Nearest-rank quantile; NaN of nothing.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let rank = (sorted.len().saturating_sub(1) as f64 * q).round() as usize;
    sorted.get(rank).copied().unwrap_or(f64::NAN)
}
