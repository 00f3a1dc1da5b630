//! How the exploration frames look beside the template made from them: the measure for later
//! frames.

use super::views::{RegisteredFrame, Views};
use crate::geometry::{Point3, median};
use crate::image::{Mask, Picture};
use crate::light::lit;
use crate::mesh::normals::vertex_normals;
use crate::template::Template;
use crate::template::usual::{Appearance, Usual};
use crate::verdict::{Compared, Thresholds, look};
use rayon::prelude::*;

/// Frames that are looked at, at most: a median of so many is steady.
const FRAMES: usize = 12;

impl Views<'_> {
    /// Look at some of the frames; `None` where nothing can be compared.
    pub(super) fn usual(
        &self,
        template: &Template,
        registered: &[RegisteredFrame],
    ) -> Option<Usual> {
        let every = registered.len().div_ceil(FRAMES).max(1);
        let some: Vec<&RegisteredFrame> = registered.iter().step_by(every).collect();
        let found: Vec<Appearance> =
            some.into_par_iter().filter_map(|r| self.appearance(template, r)).collect();
        let of = |value: &dyn Fn(&Appearance) -> Option<f64>| {
            median(&mut found.iter().filter_map(value).collect::<Vec<f64>>())
        };
        let depths: Vec<f64> = registered.iter().filter_map(|r| self.depth(template, r)).collect();
        let least = depths.iter().copied().fold(f64::INFINITY, f64::min);
        let most = depths.iter().copied().fold(0.0, f64::max);
        let usual = Usual {
            frames: found.len(),
            appearance: Appearance {
                correlation: of(&|a| a.correlation),
                contrast: of(&|a| a.contrast),
                residual: of(&|a| Some(a.residual))?,
                shown: of(&|a| Some(a.shown))?,
                compared: of(&|a| Some(a.compared))?,
            },
            depth: [least, most],
        };
        usual.is_plausible().then_some(usual)
    }

    fn appearance(&self, template: &Template, r: &RegisteredFrame) -> Option<Appearance> {
        let camera = self.exploration.camera;
        let picture = Picture::of(&self.exploration.frames[r.frame], self.exploration.tone);
        let whole = || Mask::filled(camera.size, true);
        let compared = Compared {
            camera,
            picture: &picture,
            usable: &self.usable[r.frame].clone().unwrap_or_else(whole),
            albedo: template.albedo.as_ref()?,
            // The light's own, which the tissue reflects, is in the template's.
            ambient: 0.0,
        };
        let shape: Vec<Point3> = template.mesh.positions.iter().map(|p| r.pose * p).collect();
        let limits = Thresholds::default().tile();
        let normals = vertex_normals(&template.mesh.topology, &shape);
        let lit = lit(&template.lighting(), &shape, &normals);
        let looked = look(&compared, &template.mesh, &shape, &lit, &limits);
        looked.map(|l| l.appearance)
    }

    /// Median depth of what a frame sees.
    fn depth(&self, template: &Template, r: &RegisteredFrame) -> Option<f64> {
        let seen = self.visible(r, &template.mesh);
        let depths = seen.iter().zip(&template.mesh.positions).filter(|(seen, _)| **seen);
        median(&mut depths.map(|(_, p)| (r.pose * p).z).collect::<Vec<f64>>())
    }
}
