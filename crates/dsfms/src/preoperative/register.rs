//! All steps in a row.

use super::align::{Aligned, Residual, Schedule, align};
use super::ambiguity::{alternatives, better, landmark_rms};
use super::deform::{Deformed, deform};
use super::landmarks::{LandmarkFit, LandmarkPair, fit_landmarks};
use super::options::PreoperativeOptions;
use super::starts::{StartSearch, best_first, search};
use super::target::{SurfaceSample, Target, extent, samples};
use super::uncertainty::{Uncertainty, expected_target_error};
use super::verdict::{Alternative, Doubt, PreoperativeError};
use crate::geometry::{Point3, Similarity, median};
use crate::mesh::Mesh;
use crate::mesh::orientation::oriented_outward;
use crate::structures::{Carrier, Depth, StructureError, depths};
use rayon::prelude::*;

/// Points of the template that are laid on the preoperative surface.
const SAMPLES: usize = 1500;
/// Smallest eigenvalue of the surface's system with which it holds itself.
const CONDITION: f64 = 2e-3;
/// Share of the template on the preoperative surface below which the result is doubted.
const GOOD_OVERLAP: f64 = 0.75;
/// Residual, of the noise, up to which the surfaces alone tell the pose: above, cases without
/// landmarks were off by ten times what they showed (`docs/results/register_ct.md`).
const UNBENT: f64 = 2.0;

/// A preoperative surface on the template.
#[derive(Clone, Debug)]
pub struct Preoperative {
    /// `ct_from_template`.
    pub similarity: Similarity,
    /// What the landmarks said; `None` without any.
    pub landmarks: Option<LandmarkFit>,
    /// Vertices of the preoperative surface in the template frame and unit.
    pub vertices: Vec<Point3>,
    /// Of the similarity alone.
    pub rigid: Residual,
    /// After bending; `None` where that was not asked for.
    pub bent: Option<Residual>,
    /// Distance of every point of [`Preoperative::samples`] from the surface in the end, mm.
    pub distances: Vec<Option<f64>>,
    /// Points of the template that were laid on the surface.
    pub samples: Vec<SurfaceSample>,
    /// Largest displacement by bending, mm, and 95th percentile of the strain.
    pub bending: [f64; 2],
    /// What is known of the similarity's error.
    pub uncertainty: Uncertainty,
    /// Poses that fit nearly as well elsewhere and were excluded by the landmarks.
    pub excluded: Vec<Alternative>,
    /// Reasons not to believe it fully.
    pub doubts: Vec<Doubt>,
    /// Standard deviation of the template's surface that was taken for granted, mm.
    pub noise: f64,
    /// The preoperative surface where the similarity puts it.
    placed: Mesh,
}

/// Lay a preoperative surface (mm) on a template. `sigma`: standard deviation of the template's
/// vertices in its unit, empty where it is not known. `step` is told of the work: a stage, what is
/// done, of how much.
///
/// # Errors
/// [`PreoperativeError`] where the data do not tell one pose.
pub fn register_preoperative(
    (template, sigma): (&Mesh, &[f64]),
    ct: &Mesh,
    landmarks: &[LandmarkPair],
    options: &PreoperativeOptions,
    step: &(dyn Fn(&str, usize, usize) + Sync),
) -> Result<Preoperative, PreoperativeError> {
    options.validate()?;
    let points = samples(template, SAMPLES);
    let (_, size) = extent(points.iter().map(|s| &s.point));
    if points.len() < 16 || size.is_nan() || size <= 0.0 {
        return Err(PreoperativeError::Flat("template"));
    }
    let (ct, _) = oriented_outward(ct).map_err(|_| PreoperativeError::Flat("preoperative"))?;
    let noise = noise(sigma, size, options);
    let target = Target::new(&ct);
    let fit = match landmarks {
        [] => None,
        some => Some(fit_landmarks(some, options.scale, options.landmark_sigma, options.seed)?),
    };
    let agreeing = agreeing(landmarks, fit.as_ref());
    let work =
        Work { template, target: &target, points: &points, agreeing: &agreeing, noise, options };
    let (best, others) = work.pose(fit.as_ref(), step)?;
    let mut doubts = Vec::new();
    let uncertainty = work.judge(&best, &others, &mut doubts)?;
    if let Some(fit) = &fit {
        wrong_pairs(landmarks, fit, &mut doubts);
    }
    let excluded = alternatives(&best, &others, &points, &[], options.landmark_sigma);
    step("bending", 0, 1);
    let found = work.bent(best, fit, uncertainty, excluded, doubts);
    step("bending", 1, 1);
    Ok(found)
}

/// What the template says of its own error, or the option.
fn noise(sigma: &[f64], size: f64, options: &PreoperativeOptions) -> f64 {
    let mut known: Vec<f64> = sigma.iter().copied().filter(|s| s.is_finite() && *s > 0.0).collect();
    // Stereo that is too sure of itself must not make the surface rough.
    median(&mut known).map_or(options.noise * size, |s| s.max(0.2 * options.noise * size))
}

fn agreeing(landmarks: &[LandmarkPair], fit: Option<&LandmarkFit>) -> Vec<LandmarkPair> {
    let Some(fit) = fit else { return Vec::new() };
    landmarks.iter().zip(&fit.agree).filter(|(_, a)| **a).map(|(l, _)| l.clone()).collect()
}

fn wrong_pairs(landmarks: &[LandmarkPair], fit: &LandmarkFit, doubts: &mut Vec<Doubt>) {
    let wrong = landmarks.iter().zip(&fit.agree).filter(|(_, agree)| !**agree);
    let names: Vec<String> = wrong.map(|(l, _)| l.name.clone()).collect();
    if !names.is_empty() {
        doubts.push(Doubt::WrongPairs { names });
    }
}

struct Work<'a> {
    template: &'a Mesh,
    target: &'a Target<'a>,
    points: &'a [SurfaceSample],
    agreeing: &'a [LandmarkPair],
    noise: f64,
    options: &'a PreoperativeOptions,
}

impl Work<'_> {
    /// The pose, and others that the surface would allow.
    fn pose(
        &self,
        fit: Option<&LandmarkFit>,
        step: &(dyn Fn(&str, usize, usize) + Sync),
    ) -> Result<(Aligned, Vec<Aligned>), PreoperativeError> {
        let scale = self.start_scale(fit);
        let schedule = Schedule {
            cut: [self.options.max_deformation / scale, 3.0 * self.noise],
            landmark_sigma: self.options.landmark_sigma,
            scale: self.options.scale,
            steps: 30,
        };
        let told = |done: usize, total: usize| step("poses", done, total);
        let how = StartSearch { landmarks: &[], schedule, step: &told };
        let others = search(self.template, self.target, self.points, &how);
        let Some(fit) = fit else {
            let best = others.first().cloned().ok_or(PreoperativeError::NoPose)?;
            return Ok((best, others));
        };
        let mut starts = vec![fit.similarity];
        // Poses of the search that the landmarks allow may start too.
        let allowed = |a: &&Aligned| {
            landmark_rms(&a.similarity, self.agreeing) <= 3.0 * self.options.landmark_sigma
        };
        starts.extend(others.iter().filter(allowed).map(|a| a.similarity));
        let mut tried: Vec<Aligned> = starts
            .par_iter()
            .map(|s| align(self.target, self.points, self.agreeing, *s, self.noise, self.options))
            .collect();
        best_first(&mut tried);
        Ok((tried.first().cloned().ok_or(PreoperativeError::NoPose)?, [others, tried].concat()))
    }

    /// Rough mm per unit of the template.
    fn start_scale(&self, fit: Option<&LandmarkFit>) -> f64 {
        if !self.options.scale.is_free() {
            return 1.0;
        }
        let (_, own) = extent(self.points.iter().map(|s| &s.point));
        let (_, whole) = extent(self.target.mesh.positions.iter());
        fit.map_or(0.8 * whole / own, |f| f.similarity.scaling())
    }

    /// Refuse, or say what is doubted.
    fn judge(
        &self,
        best: &Aligned,
        others: &[Aligned],
        doubts: &mut Vec<Doubt>,
    ) -> Result<Uncertainty, PreoperativeError> {
        let share = self.rigid(best).overlap;
        let needed = self.options.min_overlap;
        if share < needed {
            return Err(PreoperativeError::Overlap { share, needed });
        }
        if share < GOOD_OVERLAP {
            doubts.push(Doubt::LittleOverlap { share });
        }
        let (rms_mm, noise_mm) = (self.rigid(best).rms, self.noise * best.similarity.scaling());
        if self.agreeing.is_empty() && rms_mm > UNBENT * noise_mm {
            doubts.push(Doubt::FitsOnlyBent { rms_mm, noise_mm });
        }
        let told = Uncertainty::of(
            self.target,
            self.points,
            self.agreeing,
            best,
            self.noise,
            self.options,
        );
        let (condition, motion) = (told.condition, told.weakest());
        match (condition < CONDITION, self.agreeing.is_empty()) {
            (true, true) => {
                return Err(PreoperativeError::Slides { condition, needed: CONDITION, motion });
            }
            (true, false) => doubts.push(Doubt::HeldByLandmarks { condition, motion }),
            _ => {}
        }
        let landmarks = !self.agreeing.is_empty();
        let sigma = self.options.landmark_sigma;
        let mut found = alternatives(best, others, self.points, self.agreeing, sigma);
        if !found.is_empty() {
            found.sort_by(|a, b| a.apart_mm.total_cmp(&b.apart_mm));
            return Err(PreoperativeError::Ambiguous { others: found, landmarks });
        }
        if let Some(pose) = better(best, others, self.points) {
            doubts.push(Doubt::BetterElsewhere { pose });
        }
        let ([low, high], scale) = (self.options.scale.bounds(), best.similarity.scaling());
        if low < high && (scale <= low * (1.0 + 1e-9) || scale >= high * (1.0 - 1e-9)) {
            doubts.push(Doubt::ScaleAtBound { scale });
        }
        Ok(told)
    }

    /// Residuals of the similarity: all that a deformation within the bound would explain is
    /// overlap.
    fn rigid(&self, aligned: &Aligned) -> Residual {
        let limit = (aligned.cut * aligned.similarity.scaling()).max(self.options.max_deformation);
        Residual::of(&aligned.distances, limit)
    }

    fn bent(
        &self,
        best: Aligned,
        landmarks: Option<LandmarkFit>,
        uncertainty: Uncertainty,
        excluded: Vec<Alternative>,
        mut doubts: Vec<Doubt>,
    ) -> Preoperative {
        let scale = best.similarity.scaling();
        let back = best.similarity.inverse();
        let ct = self.target.mesh;
        let placed = ct.with_positions(ct.positions.iter().map(|p| back * p).collect());
        let rigid = self.rigid(&best);
        let bound = self.options.max_deformation;
        let mut found = Preoperative {
            similarity: best.similarity,
            landmarks,
            vertices: placed.positions.clone(),
            rigid,
            bent: None,
            distances: best.distances,
            samples: self.points.to_vec(),
            bending: [0.0; 2],
            uncertainty,
            excluded,
            doubts: Vec::new(),
            noise: self.noise * scale,
            placed,
        };
        if self.options.deform {
            let bent = deform(&found.placed, self.points, self.noise, bound / scale, self.options);
            let Deformed { vertices, largest, strain } = bent;
            found.bending = [largest * scale, strain];
            found.distances =
                self.distances_to(&found.placed.with_positions(vertices.clone()), scale);
            found.bent = Some(Residual::of(&found.distances, bound));
            found.vertices = vertices;
            if found.bending[0] > bound {
                let [largest_mm, _] = found.bending;
                doubts.push(Doubt::LargeDeformation { largest_mm, bound_mm: bound });
            }
        }
        found.doubts = doubts;
        found
    }

    fn distances_to(&self, surface: &Mesh, scale: f64) -> Vec<Option<f64>> {
        let target = Target::new(surface);
        let away = |s: &SurfaceSample| Some(target.hit(&s.point, &s.normal)?.distance * scale);
        self.points.par_iter().map(away).collect()
    }
}

impl Preoperative {
    /// Where points of the preoperative frame (mm) come to lie in the template frame and unit: by
    /// the similarity, and by the deformation of the surface continued into space.
    ///
    /// # Errors
    /// A surface that carries nothing.
    pub fn carry(&self, points: &[Point3]) -> Result<Vec<Point3>, StructureError> {
        let back = self.similarity.inverse();
        let placed: Vec<Point3> = points.iter().map(|p| back * p).collect();
        if self.bent.is_none() {
            return Ok(placed);
        }
        let carrier = Carrier::new(&self.placed)?;
        let carried = carrier.carry(&self.vertices)?;
        Ok(placed.par_iter().map(|p| carried.at(p)).collect())
    }

    /// Expected error of carried points, mm; `points` in the preoperative frame, `carried` in the
    /// template's; `template` the surface that was registered.
    ///
    /// # Errors
    /// A template without faces, from which nothing has a depth.
    pub fn expected(
        &self,
        points: &[Point3],
        carried: &[Point3],
        template: &Mesh,
    ) -> Result<Vec<f64>, StructureError> {
        let scale = self.similarity.scaling();
        let (middle, _) = extent(template.positions.iter());
        let half = template.positions.iter().map(|p| (p - middle).norm()).fold(0.0, f64::max);
        let surface = self.bent.unwrap_or(self.rigid).rms;
        let deformation = (self.rigid.rms.powi(2) - self.noise.powi(2)).max(0.0).sqrt();
        let under = depths(template, carried)
            .ok_or(StructureError::Degenerate { vertices: template.positions.len() })?;
        let error = |(p, d): (&Point3, &Depth)| {
            let open = self.uncertainty.at(p);
            expected_target_error(open, surface, d.distance * scale, half * scale, deformation)
        };
        Ok(points.iter().zip(&under).map(error).collect())
    }
}
