//! A surface looked at in its frame, and judged.

use super::candidate::Candidate;
use super::clock::Clock;
use super::look::{Look, edge_px};
use super::prepare::View;
use super::tracker::{Draft, Tracker};
use super::verdict::{Known, evidence};
use super::{Origin, Surface};
use crate::geometry::Point3;
use crate::light::lit;
use crate::mesh::normals::vertex_normals;
use crate::verdict::{Compared, ImageAgreement, TileVerdict, judge, look, regions};
use std::sync::Arc;

impl Tracker<'_> {
    /// Look at a surface and judge it.
    pub(super) fn judged(
        &self,
        view: &View,
        draft: Draft,
        origin: Origin,
        clock: &mut Clock,
    ) -> Candidate {
        let rest = &self.template.mesh;
        let ((look, [agreeing, places]), looked) = clock.time("look", || self.looks(view, &draft));
        let Draft { ambient, shown, jumped, .. } = draft;
        let camera = &self.working.compared;
        let says = |p: &Point3| looked.as_ref().map_or(TileVerdict::Nothing, |l| l.at(camera, p));
        let (regions, folds) = regions(rest, &draft.vertices, &look.visible, says, None);
        let surface = Surface {
            regions,
            visible: look.visible.clone(),
            vertices: draft.vertices,
            pose: draft.pose,
            matches: draft.matches,
            residual_px: draft.residual_px,
            reprojection_px: draft.reprojection_px,
            photometric: draft.photometric,
            depth_uncertainty: draft.depth_uncertainty,
            agreement: agreeing as f64 / places.max(1) as f64,
            places,
            origin,
        };
        let last =
            self.last.as_ref().filter(|l| origin == Origin::Followed && l.frame + 1 == self.count);
        let before = last.map(|l| l.vertices.as_slice());
        let verdict = clock.time("verdict", || {
            let appearance = looked.as_ref().map(|l| l.appearance);
            let (residual, camera) = (self.usual.median(), self.other_camera);
            let usual = self.template.usual.map(|u| u.appearance);
            let known = Known { before, residual, camera, appearance, usual, folds };
            judge(&evidence(rest, self.camera, &surface, &known), self.limits())
        });
        let (look, places) = (Arc::new(look), Vec::new());
        Candidate { verdict, surface, look, ambient, shown, jumped, places }
    }

    /// What a surface looks like, in how many of its places its frame agrees, and the frame beside
    /// the prediction.
    fn looks(&self, view: &View, draft: &Draft) -> ((Look, [usize; 2]), Option<ImageAgreement>) {
        let lit = self.lit(&draft.vertices);
        let look = || {
            let rest = &self.template.mesh;
            let look = Look::new(&self.working, rest, &draft.vertices, &lit, &self.albedo);
            let agreement = look.agreement(&view.seen, self.limits().correlation);
            (look, agreement)
        };
        // Each has parts that one thread alone works on: beside each other they leave none idle.
        rayon::join(look, || self.compared(view, draft, &lit))
    }

    /// Diffuse shading of the vertices of a shape.
    pub(super) fn lit(&self, shape: &[Point3]) -> Vec<f64> {
        lit(&self.light, shape, &vertex_normals(&self.template.mesh.topology, shape))
    }

    /// Image beside prediction, as single frames are looked at.
    fn compared(&self, view: &View, draft: &Draft, lit: &[f64]) -> Option<ImageAgreement> {
        let (camera, rest) = (&self.working.compared, &self.template.mesh);
        let shot = view.compared();
        let edge = edge_px(camera, rest.mean_edge_length(), &draft.vertices);
        let compared = Compared {
            camera,
            picture: &shot.picture,
            usable: &shot.usable,
            albedo: &self.albedo.for_edge(edge).texels,
            // What veils the frame must not pass for light that the camera adds.
            ambient: 0.0,
        };
        look(&compared, rest, &draft.vertices, lit, &self.limits().tile())
    }
}
