//! The true place of every template vertex in every frame.
//!
//! A template from frames has its own faces and frame, and its unit from the true way of the camera
//! ([`steps`]). One similarity, from its camera centres to the true ones, brings it into the true
//! world; there every template vertex is tied to the closest point of the true surface at rest,
//! whose place in every deformed frame is known.

use super::scene::{DeformedFrame, Scene};
use anyhow::Context;
use dsfms::eval::zone::extent;
use dsfms::eval::{ErrorStats, EvaluateOptions, Evaluation, Truth, deformed_zone, evaluate};
use dsfms::geometry::{Isometry, Point3, Similarity, align_similarity, point_at};
use dsfms::mesh::Mesh;
use dsfms::mesh::surface_points::{ClosestPoints, SurfacePoint};
use dsfms::register::Match;
use dsfms::template::scale::ScaleReference;
use dsfms::template::{LengthUnit, Template};

/// Matches farther than this from the template's surface are on a part that it lacks, mm.
const MATCH_REACH_MM: f64 = 2.0;

/// The template tied to the true surface.
pub struct Tie {
    pub world_from_template: Similarity,
    /// Length unit of the template, mm.
    pub mm: f64,
    /// Per template vertex: the closest point of the true surface at rest.
    anchors: Vec<SurfacePoint>,
    /// Distance of camera centres from the truth after alignment, mm.
    pub centres: ErrorStats,
    /// Distance of template vertices from the true surface, mm.
    pub surface: ErrorStats,
}

/// Truth of one frame on the template's vertices.
pub struct FrameTruth {
    /// True positions, camera axes, mm; the template's faces.
    pub mesh: Mesh,
    pub visible: Vec<bool>,
    /// Distance from the place at rest, mm.
    pub displacement: Vec<f64>,
    pub zone: Vec<bool>,
}

impl Tie {
    /// Align and tie.
    pub fn new(template: &Template, scene: &Scene) -> anyhow::Result<Self> {
        let (found, truth) = centres(template, scene);
        let world_from_template = align_similarity(&found, &truth)
            .context("too few registered frames to compare with the truth")?;
        let off = |(f, t): (&Point3, &Point3)| (world_from_template * f - t).norm();
        let rest = ClosestPoints::new(&scene.rest);
        let on_rest = |p: &Point3| rest.closest(&(world_from_template * p));
        let anchors: Option<Vec<_>> = template.mesh.positions.iter().map(on_rest).collect();
        let anchors = anchors.context("the true surface is empty")?;
        let mm = match template.unit {
            LengthUnit::Millimetre => 1.0,
            LengthUnit::TemplateUnit => world_from_template.scaling(),
        };
        Ok(Self {
            world_from_template,
            mm,
            centres: ErrorStats::of(found.iter().zip(&truth).map(off)).unwrap_or_default(),
            surface: ErrorStats::of(anchors.iter().map(|a| a.distance)).unwrap_or_default(),
            anchors,
        })
    }

    /// Distance of every template vertex from the true surface, mm.
    pub fn distances(&self) -> Vec<f64> {
        self.anchors.iter().map(|a| a.distance).collect()
    }

    /// Truth of a frame on the template's vertices.
    pub fn carry(&self, template: &Template, deformed: &DeformedFrame) -> FrameTruth {
        let faces = &deformed.mesh.topology.faces;
        let positions = self
            .anchors
            .iter()
            .map(|a| point_at(deformed.mesh.corners(a.face as usize), a.barycentric));
        let mix = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let at = |a: &SurfacePoint| {
                faces[a.face as usize]
                    .iter()
                    .zip(a.barycentric)
                    .map(|(&v, w)| w * value(v as usize))
                    .sum()
            };
            self.anchors.iter().map(at).collect()
        };
        let displacement = mix(&|v| deformed.vertices.displacement[v]);
        let visible: Vec<bool> =
            mix(&|v| f64::from(deformed.vertices.visible[v])).iter().map(|&s| s >= 0.5).collect();
        let mesh = template.mesh.with_positions(positions.collect());
        FrameTruth {
            zone: deformed_zone(&displacement, Some(&visible), extent(&mesh.positions)),
            mesh,
            displacement,
            visible,
        }
    }

    /// Errors of vertices in camera axes, template's unit.
    pub fn evaluate(
        &self,
        template: &Template,
        vertices: &[Point3],
        truth: &FrameTruth,
        scene: &Scene,
    ) -> anyhow::Result<Evaluation> {
        let reference = Truth {
            mesh: &truth.mesh,
            visible: Some(&truth.visible),
            zone: Some(&truth.zone),
            camera: Some(&scene.camera.file.camera),
        };
        let found = template.mesh.with_positions(self.in_mm(vertices));
        Ok(evaluate(&found, &reference, &EvaluateOptions::default())?)
    }

    /// Camera axes are the truth's: only the unit may differ.
    pub fn in_mm(&self, vertices: &[Point3]) -> Vec<Point3> {
        vertices.iter().map(|p| p * self.mm).collect()
    }

    /// Matches on the true surface moved to the closest points of the template.
    pub fn matches(&self, template: &Template, scene: &Scene, given: &[Match]) -> Vec<Match> {
        let surface = ClosestPoints::new(&template.mesh);
        let back = self.world_from_template.inverse();
        let reach = MATCH_REACH_MM / self.world_from_template.scaling();
        let convert = |m: &Match| {
            let point = point_at(scene.rest.corners(m.face as usize), m.barycentric);
            let on = surface.closest(&(back * point)).filter(|on| on.distance <= reach)?;
            Some(Match { face: on.face, barycentric: on.barycentric, pixel: m.pixel })
        };
        given.iter().filter_map(convert).collect()
    }
}

/// How far the camera is, at every frame, from the frame where it is farthest from this one: what a
/// tracked laparoscope would tell.
pub fn steps(scene: &Scene) -> Vec<ScaleReference> {
    let centres: Vec<Point3> = scene.poses.iter().map(|p| p.inverse() * Point3::origin()).collect();
    let step = |(i, from): (usize, &Point3)| {
        let far = centres.iter().map(|to| (to - from).norm()).enumerate();
        let (j, millimetres) = far.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let frames = [i, j].map(|k| scene.exploration[k].name.clone());
        Some(ScaleReference::CameraStep { frames, millimetres })
    };
    centres.iter().enumerate().filter_map(step).collect()
}

/// Camera centres of the registered frames: template frame, true world.
fn centres(template: &Template, scene: &Scene) -> (Vec<Point3>, Vec<Point3>) {
    let centre = |pose: &Isometry| pose.inverse() * Point3::origin();
    let pair = |view: &dsfms::template::TemplateView| {
        let i = scene.exploration.iter().position(|f| f.name == view.name)?;
        Some((centre(&view.camera_from_template), centre(&scene.poses[i])))
    };
    template.views.iter().filter_map(pair).unzip()
}
