//! The surface that matches give: anew, or from the shape of the frame before.

use super::prepare::View;
use super::tracker::{Clock, Draft, Tracker};
use crate::geometry::{Isometry, Point2, Point3, align_rigid_robust, point_at};
use crate::light::LightModel;
use crate::refine::{Photograph, join, join_near};
use crate::register::objective::{depth_tolerance, errors_px, explained};
use crate::register::{
    Match, Posed, Registered, Scene, pose, pose_near, register_in, register_near,
};

impl Tracker<'_> {
    /// The surface that matches give with nothing known; the error says why there is none.
    pub(super) fn anew(
        &mut self,
        view: &View,
        matches: Vec<Match>,
        clock: &mut Clock,
    ) -> Result<Draft, String> {
        self.enough(&matches)?;
        let (rest, options) = (&self.template.mesh, &self.options.reconstruct);
        let posed = clock
            .time("pose", || pose(self.camera, rest, &matches, &options.register, options.seed));
        let posed = posed.map_err(|error| error.to_string())?;
        let memory = &mut self.memory.register;
        let (scene, coarse) = clock.time("register", || {
            let rigid = rest.positions.iter().map(|p| posed.pose * p).collect();
            let scene = Scene::new(self.camera, rest, rigid);
            let coarse = register_in(memory, &scene, &matches, &posed, &options.register);
            (scene, coarse)
        });
        let mut draft = Draft::of(&scene, &posed, matches, coarse);
        if let Some(photo) = self.photograph(view) {
            let kept = draft.kept();
            let (start, hold) = (&draft.vertices, draft.depth_uncertainty * scene.radius());
            let joined =
                clock.time("joint", || join(&scene, start, hold, &kept, &photo, &options.joint));
            (draft.vertices, draft.ambient) = (joined.vertices, joined.ambient);
            draft.measure(&scene);
        }
        Ok(draft)
    }

    /// The surface near the last one that followed matches give; the error says why there is none.
    pub(super) fn carried(
        &mut self,
        view: &View,
        matches: Vec<Match>,
        clock: &mut Clock,
    ) -> Result<Draft, String> {
        self.enough(&matches)?;
        let (near, posed, scene) = clock.time("pose", || {
            let (near, posed, base, visible) = self.near(&matches)?;
            let rest = &self.template.mesh;
            let rigid = rest.positions.iter().map(|p| base * p).collect();
            let laplacian = self.laplacian.clone();
            let scene = Scene::seen(self.camera, rest, rigid, visible, laplacian);
            Ok::<_, String>((near, posed, scene))
        })?;
        let mut memory = std::mem::take(&mut self.memory);
        let draft = match self.photograph(view) {
            None => {
                let memory = &mut memory.register;
                let options = &self.options.reconstruct.register;
                let coarse = clock.time("register", || {
                    register_near(memory, &scene, &matches, &posed, &near, options)
                });
                Draft::of(&scene, &posed, matches, coarse)
            }
            Some(photo) => {
                let memory = &mut memory.video;
                let ambient = self.last.as_ref().map_or(0.0, |l| l.ambient);
                let options = &self.options.reconstruct;
                let register = &options.register;
                let hold = depth_tolerance(&scene, &matches, &posed, &near, register);
                let start = (near.as_slice(), ambient);
                let (joint, video) = (&options.joint, &self.options.video);
                let found = clock.time("joint", || {
                    join_near(memory, &scene, start, hold, &matches, &photo, joint, video)
                });
                let (kept, residual_px) = explained(&scene, &matches, &found.vertices, register);
                let mut draft = Draft {
                    vertices: found.vertices,
                    pose: posed.pose,
                    matches: matches.into_iter().zip(kept).collect(),
                    residual_px,
                    reprojection_px: 0.0,
                    depth_uncertainty: hold / scene.radius(),
                    photometric: Some(found.residual),
                    ambient: found.ambient,
                };
                draft.measure(&scene);
                draft
            }
        };
        self.memory = memory;
        Ok(draft)
    }

    fn enough(&self, matches: &[Match]) -> Result<(), String> {
        let (found, needed) = (matches.len(), self.options.verdict.matches[0]);
        if found < needed {
            return Err(format!("only {found} matches, at least {needed} are needed"));
        }
        Ok(())
    }

    /// The last shape moved rigidly to where its matches now are, the pose of the rest shape, the
    /// pose from which the shape's bending is counted, and which vertices are seen.
    #[expect(clippy::type_complexity, reason = "four parts of one answer")]
    fn near(&self, matches: &[Match]) -> Result<(Vec<Point3>, Posed, Isometry, Vec<bool>), String> {
        let last = self.last.as_ref().ok_or("nothing to follow")?;
        let (rest, options) = (&self.template.mesh, &self.options.reconstruct.register);
        let pixels: Vec<Point2> = matches.iter().map(|m| m.pixel).collect();
        let on = |shape: &[Point3]| -> Vec<Point3> {
            let corners = |m: &Match| rest.topology.faces[m.face as usize].map(|v| v as usize);
            let point = |m: &Match| point_at(corners(m).map(|v| &shape[v]), m.barycentric);
            matches.iter().map(point).collect()
        };
        let to = |points: &[Point3], start: Isometry| {
            let found = pose_near(self.camera, points, &pixels, options, start);
            found.map_err(|error| error.to_string())
        };
        let moved = to(&on(&last.vertices), last.motion)?.pose;
        let near: Vec<Point3> = last.vertices.iter().map(|v| moved * v).collect();
        let posed = to(&on(&rest.positions), moved * last.pose)?;
        let visible = last.look.visible.clone();
        // A near light tells the distance of everything, so the shape knows the pose better than the
        // matches do; under a distant one only they hold it.
        let base = match self.light.light {
            LightModel::Point(_) => {
                let seen = |shape: &[Point3]| -> Vec<Point3> {
                    shape.iter().zip(&visible).filter(|s| *s.1).map(|s| *s.0).collect()
                };
                align_rigid_robust(&seen(&rest.positions), &seen(&near)).unwrap_or(posed.pose)
            }
            LightModel::Collinear => posed.pose,
        };
        Ok((near, posed, base, visible))
    }

    /// The frame as shading is read from it; `None` for the method without.
    fn photograph<'b>(&'b self, view: &'b View) -> Option<Photograph<'b>> {
        Some(Photograph {
            camera: &self.working.photo,
            picture: view.picture.as_ref()?,
            usable: &view.usable,
            light: &self.light,
            albedo: self.albedo,
            expected_log_gain: (!self.template.views.is_empty()).then_some(0.0),
        })
    }
}

impl Draft {
    fn of(scene: &Scene, posed: &Posed, matches: Vec<Match>, coarse: Registered) -> Self {
        let mut draft = Self {
            vertices: coarse.vertices,
            pose: posed.pose,
            matches: matches.into_iter().zip(coarse.kept).collect(),
            residual_px: coarse.residual_px,
            reprojection_px: 0.0,
            depth_uncertainty: coarse.depth_sigma / scene.radius(),
            photometric: None,
            ambient: 0.0,
        };
        draft.measure(scene);
        draft
    }

    fn kept(&self) -> Vec<Match> {
        self.matches.iter().filter(|m| m.1).map(|m| m.0).collect()
    }

    /// Mean distance of the kept matches.
    fn measure(&mut self, scene: &Scene) {
        let errors = errors_px(scene, &self.kept(), &self.vertices);
        self.reprojection_px = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    }
}
