//! The growing reconstruction: poses, tracks and their points.

use super::bundle::{Bundle, BundleError, BundleObservation, BundleOptions, adjust};
use super::features::{Features2d, sigma_of_scale};
use super::intrinsics::RefineIntrinsics;
use super::reconstruction::FoundModel;
use super::tracks::Member;
use super::triangulation::{Sighting, TriangulationLimits, largest_parallax_deg, triangulate};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point2, Point3, median};
use crate::solver::{Loss, Summary};
use rayon::prelude::*;

/// A track and, once triangulated, its point and the members that agree with it.
#[derive(Clone, Debug)]
pub(super) struct MapTrack {
    pub members: Vec<Member>,
    pub used: Vec<bool>,
    pub point: Option<Point3>,
}

impl MapTrack {
    pub(super) fn new(members: Vec<Member>) -> Self {
        Self { used: vec![false; members.len()], members, point: None }
    }

    /// Members that agree with the point.
    pub(super) fn seen(&self) -> impl Iterator<Item = Member> {
        self.members.iter().zip(&self.used).filter(|(_, used)| **used).map(|(m, _)| *m)
    }
}

/// Poses and points found so far; poses are `camera_from_world`.
#[derive(Clone)]
pub(super) struct Map<'a> {
    pub camera: CameraModel,
    /// The camera as it was given: the centre of the priors.
    pub prior: CameraModel,
    pub features: &'a [Features2d],
    pub poses: Vec<Option<Isometry>>,
    pub tracks: Vec<MapTrack>,
}

impl Map<'_> {
    pub(super) fn registered(&self) -> usize {
        self.poses.iter().flatten().count()
    }

    pub(super) fn points(&self) -> usize {
        self.tracks.iter().filter(|t| t.point.is_some()).count()
    }

    /// Its frames and how many points they found.
    pub(super) fn summary(&self) -> FoundModel {
        let frames = (0..self.poses.len()).filter(|&v| self.poses[v].is_some()).collect();
        FoundModel { frames, points: self.points() }
    }

    /// Number of sightings that agree with their point.
    pub(super) fn sightings(&self) -> usize {
        let used = |t: &MapTrack| t.used.iter().filter(|used| **used).count();
        self.tracks.iter().filter(|t| t.point.is_some()).map(used).sum()
    }

    pub(super) fn pixel(&self, m: Member) -> Point2 {
        self.features[m.view as usize].points[m.feature as usize]
    }

    fn sighting(&self, m: Member) -> Option<Sighting> {
        let pose = self.poses[m.view as usize]?;
        let pixel = self.pixel(m);
        Some(Sighting { pose, ray: self.camera.unproject(&pixel)?, pixel })
    }

    /// Triangulate every track that has no point, and let points gain the members that agree.
    pub(super) fn triangulate(&mut self, limits: &TriangulationLimits) {
        let update = |track: &MapTrack| -> Option<(Point3, Vec<bool>)> {
            let sightings: Vec<Option<Sighting>> =
                track.members.iter().map(|&m| self.sighting(m)).collect();
            let agrees = |s: &Option<Sighting>, p: &Point3| {
                s.is_some_and(|s| s.error_px(&self.camera, p) <= limits.max_error_px)
            };
            if let Some(point) = track.point {
                return Some((point, sightings.iter().map(|s| agrees(s, &point)).collect()));
            }
            let known: Vec<Sighting> = sightings.iter().flatten().copied().collect();
            if known.len() < 2 {
                return None;
            }
            let (point, used) = triangulate(&self.camera, &known, limits)?;
            let mut used = used.into_iter();
            let spread = sightings.iter().map(|s| s.is_some() && used.next().unwrap_or(false));
            Some((point, spread.collect()))
        };
        let updates: Vec<_> = self.tracks.par_iter().with_min_len(64).map(update).collect();
        for (track, update) in self.tracks.iter_mut().zip(updates) {
            if let Some((point, used)) = update {
                (track.point, track.used) = (Some(point), used);
            }
        }
        self.drop_weak(limits.min_parallax_deg);
    }

    /// Drop sightings farther than `max_error_px` from their point, then weak points.
    pub(super) fn filter(&mut self, limits: &TriangulationLimits) {
        let keep = |track: &MapTrack| -> Vec<bool> {
            let Some(point) = track.point else { return track.used.clone() };
            let near = |m: Member| {
                self.sighting(m)
                    .is_some_and(|s| s.error_px(&self.camera, &point) <= limits.max_error_px)
            };
            track.members.iter().zip(&track.used).map(|(m, u)| *u && near(*m)).collect()
        };
        let used: Vec<Vec<bool>> = self.tracks.par_iter().with_min_len(256).map(keep).collect();
        for (track, used) in self.tracks.iter_mut().zip(used) {
            track.used = used;
        }
        self.drop_weak(limits.min_parallax_deg);
    }

    /// Drop points with fewer than two sightings or too little parallax.
    fn drop_weak(&mut self, min_parallax_deg: f64) {
        let centres: Vec<Option<Point3>> =
            self.poses.iter().map(|p| p.as_ref().map(super::triangulation::centre_of)).collect();
        for track in &mut self.tracks {
            let Some(point) = track.point else { continue };
            let seen: Vec<Point3> = track.seen().filter_map(|m| centres[m.view as usize]).collect();
            if seen.len() < 2 || largest_parallax_deg(&point, &seen) < min_parallax_deg {
                track.point = None;
                track.used.fill(false);
            }
        }
    }

    /// Points and pixels that a view could be resected from, with the tracks they come from.
    pub(super) fn known_in(&self, view: usize) -> Vec<(usize, Point3, Point2)> {
        let member = |(i, track): (usize, &MapTrack)| {
            let point = track.point?;
            let m = track.members.iter().find(|m| m.view as usize == view)?;
            Some((i, point, self.pixel(*m)))
        };
        self.tracks.iter().enumerate().filter_map(member).collect()
    }

    /// Bundle adjustment of everything registered. `fixed` views keep their pose.
    pub(super) fn adjust(
        &mut self,
        fixed: &dyn Fn(usize) -> bool,
        loss: Loss,
        refine: RefineIntrinsics,
        max_steps: usize,
    ) -> Result<Summary, BundleError> {
        let views: Vec<usize> =
            (0..self.poses.len()).filter(|&v| self.poses[v].is_some()).collect();
        let tracks: Vec<usize> =
            (0..self.tracks.len()).filter(|&t| self.tracks[t].point.is_some()).collect();
        let mut at = vec![usize::MAX; self.poses.len()];
        views.iter().enumerate().for_each(|(i, &v)| at[v] = i);
        let mut observations = Vec::new();
        for (point, &t) in tracks.iter().enumerate() {
            observations.extend(self.tracks[t].seen().map(|m| BundleObservation {
                view: at[m.view as usize],
                point,
                pixel: self.pixel(m),
                sigma_px: self.sigma_px(m),
            }));
        }
        let mut bundle = Bundle {
            cameras: vec![self.camera.clone()],
            priors: vec![self.prior.clone()],
            camera_of: vec![0; views.len()],
            poses: views.iter().filter_map(|&v| self.poses[v]).collect(),
            fixed: views.iter().map(|&v| fixed(v)).collect(),
            points: tracks.iter().filter_map(|&t| self.tracks[t].point).collect(),
            observations,
        };
        let options = BundleOptions { loss, max_steps, refine, ..Default::default() };
        let summary = adjust(&mut bundle, &options)?;
        views.iter().zip(&bundle.poses).for_each(|(&v, pose)| self.poses[v] = Some(*pose));
        tracks.iter().zip(&bundle.points).for_each(|(&t, p)| self.tracks[t].point = Some(*p));
        self.camera = bundle.cameras.swap_remove(0);
        Ok(summary)
    }

    /// Standard deviation of a feature's position, px, growing with its scale.
    fn sigma_px(&self, m: Member) -> f64 {
        let scale = self.features[m.view as usize].scale[m.feature as usize] as f64;
        sigma_of_scale(scale)
    }

    /// Error of every used sighting, px: `(track, view, error)` in track order.
    pub(super) fn errors(&self) -> Vec<(usize, usize, f64)> {
        let mut errors = Vec::new();
        for (t, track) in self.tracks.iter().enumerate() {
            let Some(point) = track.point else { continue };
            for m in track.seen() {
                let error = self.sighting(m).map_or(0.0, |s| s.error_px(&self.camera, &point));
                errors.push((t, m.view as usize, error));
            }
        }
        errors
    }

    /// Move and scale the world: `point ↦ scale · point`, poses following.
    pub(super) fn rescale(&mut self, scale: f64) {
        for pose in self.poses.iter_mut().flatten() {
            pose.translation.vector *= scale;
        }
        for point in self.tracks.iter_mut().filter_map(|t| t.point.as_mut()) {
            *point *= scale;
        }
    }

    /// Median depth of the sightings, length units; 0 without points.
    pub(super) fn median_depth(&self) -> f64 {
        let mut depths: Vec<f64> = Vec::new();
        for track in &self.tracks {
            let Some(point) = track.point else { continue };
            depths.extend(
                track.seen().filter_map(|m| Some((self.poses[m.view as usize]? * point).z)),
            );
        }
        median(&mut depths).unwrap_or(0.0)
    }
}
