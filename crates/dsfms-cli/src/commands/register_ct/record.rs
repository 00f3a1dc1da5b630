//! `registration.json`.

use super::args::RegisterCtArgs;
use super::carried::Carried;
use super::input::LoadedCt;
use dsfms::geometry::{Point3, Similarity};
use dsfms::preoperative::{Alternative, Doubt, Preoperative, PreoperativeError, Residual};
use dsfms::template::Template;
use serde::Serialize;

#[derive(Serialize)]
pub struct Record<'a> {
    generator: &'static str,
    /// `ok`, `degraded` or `failed`.
    status: &'static str,
    reasons: Vec<String>,
    #[serde(skip_serializing_if = "<[Doubt]>::is_empty")]
    doubts: &'a [Doubt],
    template: String,
    ct: String,
    landmarks: Vec<Landmark>,
    #[serde(skip_serializing_if = "Option::is_none")]
    found: Option<Found<'a>>,
}

#[derive(Serialize)]
struct Landmark {
    name: String,
    /// mm, CT frame.
    ct: [f64; 3],
    template: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    agrees: Option<bool>,
    /// Distance under the similarity of the landmarks, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    residual_mm: Option<f64>,
    /// Distance under the similarity of the other landmarks, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    left_out_mm: Option<f64>,
    /// Distance under the final similarity, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    final_mm: Option<f64>,
}

#[derive(Serialize)]
struct Found<'a> {
    /// `mm` or `template_units`: of the template and of every mesh of this folder.
    unit: &'static str,
    mm_per_unit: f64,
    /// 4 x 4, row by row: template to CT (mm).
    ct_from_template: [[f64; 4]; 4],
    /// Its inverse.
    template_from_ct: [[f64; 4]; 4],
    /// Distances of the template from the CT surface, mm: of the similarity, and after bending.
    residual_rigid: Residual,
    #[serde(skip_serializing_if = "Option::is_none")]
    residual: Option<Residual>,
    /// Largest displacement by bending, mm; 95th percentile of the strain.
    bending_mm: f64,
    bending_strain: f64,
    /// Turn (rad), shift and growth (of the template's size) about its placed middle, CT axes.
    covariance: [[f64; 7]; 7],
    /// Smallest eigenvalue of the surface's system.
    condition: f64,
    /// Poses that fit as well and that only the landmarks exclude.
    excluded: &'a [Alternative],
    structures: Vec<StructureRecord<'a>>,
}

#[derive(Serialize)]
struct StructureRecord<'a> {
    name: &'a str,
    file: String,
    /// Expected error, mm: root mean square, largest.
    expected_error_mm: f64,
    expected_error_largest_mm: f64,
    /// Part of it that the similarity leaves open, at its middle, mm.
    similarity_error_mm: f64,
}

const GENERATOR: &str = concat!("dsfms ", env!("CARGO_PKG_VERSION"));

/// Of a registration.
pub fn record<'a>(
    args: &RegisterCtArgs,
    template: &Template,
    loaded: &LoadedCt,
    found: &'a Preoperative,
    carried: &'a [Carried],
) -> Record<'a> {
    let structures =
        carried.iter().zip(&loaded.structures).map(|(item, (_, at))| StructureRecord {
            name: &item.name,
            file: format!("structures/{}.ply", item.name),
            expected_error_mm: item.error(),
            expected_error_largest_mm: item.expected.iter().copied().fold(0.0, f64::max),
            similarity_error_mm: found.uncertainty.at(&middle(&at.positions)),
        });
    let found_record = Found {
        unit: template.unit.label(),
        mm_per_unit: found.similarity.scaling(),
        ct_from_template: matrix(&found.similarity),
        template_from_ct: matrix(&found.similarity.inverse()),
        residual_rigid: found.rigid,
        residual: found.bent,
        bending_mm: found.bending[0],
        bending_strain: found.bending[1],
        covariance: found.uncertainty.covariance,
        condition: found.uncertainty.condition,
        excluded: &found.excluded,
        structures: structures.collect(),
    };
    Record {
        generator: GENERATOR,
        status: if found.doubts.is_empty() { "ok" } else { "degraded" },
        reasons: found.doubts.iter().map(ToString::to_string).collect(),
        doubts: &found.doubts,
        template: args.template.display().to_string(),
        ct: args.ct.display().to_string(),
        landmarks: landmarks(loaded, Some(found)),
        found: Some(found_record),
    }
}

/// Of a refusal.
pub fn failed(
    error: &PreoperativeError,
    args: &RegisterCtArgs,
    loaded: &LoadedCt,
) -> Record<'static> {
    Record {
        generator: GENERATOR,
        status: "failed",
        reasons: vec![error.to_string()],
        doubts: &[],
        template: args.template.display().to_string(),
        ct: args.ct.display().to_string(),
        landmarks: landmarks(loaded, None),
        found: None,
    }
}

fn landmarks(loaded: &LoadedCt, found: Option<&Preoperative>) -> Vec<Landmark> {
    let of = |(k, pair): (usize, &dsfms::preoperative::LandmarkPair)| {
        let fit = found.and_then(|f| f.landmarks.as_ref());
        Landmark {
            name: pair.name.clone(),
            ct: pair.ct.coords.into(),
            template: pair.template.coords.into(),
            agrees: fit.map(|f| f.agree[k]),
            residual_mm: fit.map(|f| f.residuals[k]),
            left_out_mm: fit.and_then(|f| f.left_out[k]),
            final_mm: found.map(|f| (f.similarity * pair.template - pair.ct).norm()),
        }
    };
    loaded.landmarks.iter().enumerate().map(of).collect()
}

fn matrix(similarity: &Similarity) -> [[f64; 4]; 4] {
    let m = similarity.to_homogeneous();
    std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]))
}

fn middle(points: &[Point3]) -> Point3 {
    let sum: dsfms::geometry::Vector3 = points.iter().map(|p| p.coords).sum();
    Point3::from(sum / points.len().max(1) as f64)
}
