//! How far a surface of a video may be off, for who watches it: the tracker itself does not ask.

use super::prepare::Prepared;
use super::{Surface, Tracker};
use crate::expected_error::{ExpectedErrors, Model, Solved, expected_errors};
use crate::geometry::{Point3, align_rigid_few};
use crate::pipeline::Method;
use crate::register::Scene;
use std::borrow::Cow;

impl Tracker<'_> {
    /// Expected error of every vertex of the surface that [`solve`](Self::solve) gave for this
    /// frame, by the model of single frames (it was fitted on none of a video); length units of the
    /// template. `None` where the frame is black or nothing is seen of the surface.
    pub fn expected_errors(
        &self,
        prepared: &Prepared,
        surface: &Surface,
    ) -> Option<ExpectedErrors> {
        let view = prepared.view.as_ref()?;
        let (rest, visible) = (&self.template.mesh, &surface.visible);
        let seen = |shape: &[Point3]| -> Vec<Point3> {
            shape.iter().zip(visible).filter(|s| *s.1).map(|s| *s.0).collect()
        };
        if !visible.contains(&true) {
            return None;
        }
        let base = align_rigid_few(&seen(&rest.positions), &seen(&surface.vertices));
        let base = base.unwrap_or(surface.pose);
        let rigid = rest.positions.iter().map(|p| base * p).collect();
        let laplacian = Cow::Borrowed(&self.laplacian);
        let scene = Scene::seen(self.camera, rest, rigid, visible.clone(), laplacian);
        let photo = self.photograph(view, &surface.vertices);
        let model = match self.method {
            Method::Joint => Model::Joint,
            _ => Model::Motion,
        };
        let solved = Solved {
            scene: &scene,
            vertices: &surface.vertices,
            visible,
            matches: &surface.matches,
            photo: photo.as_ref(),
            refine: &self.options.reconstruct.refine,
        };
        Some(expected_errors(&solved, model))
    }
}
