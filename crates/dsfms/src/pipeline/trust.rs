//! Everything that is asked of a surface before it is handed out.

use super::sight::Sight;
use super::{Method, ReconstructOptions, Reconstruction};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Point3, median};
use crate::image::diagonal;
use crate::light::lit;
use crate::mesh::normals::vertex_normals;
use crate::refine::outline_distance;
use crate::register::{Match, Posed, Scene};
use crate::verdict::evidence::{EXPECTED, Evidence, MatchCount};
use crate::verdict::intrinsics::other_camera;
use crate::verdict::observability::{distinct, pose_uncertainty};
use crate::verdict::regions::{largest_part, regions, share};
use crate::verdict::strain::strain;
use crate::verdict::{Compared, ImageAgreement, Region, TileVerdict, judge, look};

/// Part of the image's diagonal (8 px at 640 x 480) within which a surface agrees with a given
/// match: on six clips nine of ten good ones are within 1.6 px, and noise of 4 px would leave nine
/// of ten within 9 px. Given matches that are all 10 px off stay in the solve, beside found ones
/// that are right.
const AGREES: f64 = 0.01;

/// A surface and what it was made from.
pub(super) struct Trusted<'a> {
    pub(super) sight: &'a Sight<'a>,
    pub(super) scene: &'a Scene<'a>,
    pub(super) posed: &'a Posed,
    pub(super) method: Method,
    pub(super) options: &'a ReconstructOptions,
}

/// Judge a surface; sets its verdict and its regions.
pub(super) fn trust(trusted: &Trusted, result: &mut Reconstruction) {
    let finite = result.vertices.iter().all(|v| v.iter().all(|c| c.is_finite()));
    if !finite {
        result.verdict =
            judge(&Evidence { finite, ..Evidence::default() }, &trusted.options.verdict);
        result.regions = vec![Region::Hidden; result.vertices.len()];
        return;
    }
    let looked = trusted.looked(result);
    let says =
        |p: &Point3| looked.as_ref().map_or(TileVerdict::Nothing, |l| l.at(trusted.camera(), p));
    let (shape, near_match) = (&result.vertices, result.observed.as_deref());
    let (regions, folds) = regions(trusted.scene.rest, shape, &result.visible, says, near_match);
    let evidence = trusted.evidence(result, looked.as_ref(), &regions, folds);
    result.verdict = judge(&evidence, &trusted.options.verdict);
    (result.evidence, result.regions) = (evidence, regions);
}

impl Trusted<'_> {
    fn camera(&self) -> &CameraModel {
        self.sight.observation.camera
    }

    fn looked(&self, result: &Reconstruction) -> Option<ImageAgreement> {
        let (picture, albedo) = self.sight.compared.as_ref()?;
        let compared = Compared {
            camera: self.camera(),
            picture,
            usable: &self.sight.usable,
            albedo,
            ambient: result.ambient / result.gain.max(f64::MIN_POSITIVE),
        };
        let limits = self.options.verdict.tile();
        let (rest, shape) = (self.scene.rest, &result.vertices);
        let lit = lit(&self.sight.light, shape, &vertex_normals(&rest.topology, shape));
        look(&compared, rest, shape, &lit, &limits)
    }

    fn evidence(
        &self,
        result: &Reconstruction,
        looked: Option<&ImageAgreement>,
        regions: &[Region],
        folds: usize,
    ) -> Evidence {
        let (rest, camera, shape) = (self.scene.rest, self.camera(), &result.vertices);
        let template = self.sight.template;
        let diagonal = diagonal(camera.size());
        let all: Vec<Match> = result.matches.iter().map(|m| m.0).collect();
        let kept: Vec<Match> = result.matches.iter().filter(|m| m.1).map(|m| m.0).collect();
        // Of the given matches, where found ones stand behind them.
        let given = self.sight.observation.matches.map_or(all.len(), |given| given.len());
        let near = |m: &Match| self.away(m, shape).is_some_and(|px| px <= AGREES * diagonal);
        let given_kept = result.matches[..given].iter().filter(|m| m.1 && near(&m.0)).count();
        let different: Vec<Match> = distinct(&kept, diagonal).iter().map(|&i| kept[i]).collect();
        let seen: Vec<Point3> =
            (0..shape.len()).filter(|&v| result.visible[v]).map(|v| shape[v]).collect();
        let residual_px = self.residual_px(&kept, shape);
        let pose = (!seen.is_empty()).then(|| {
            let noise = residual_px.unwrap_or(0.0);
            pose_uncertainty(camera, &rest.topology, shape, &different, noise, &seen)
        });
        let depth = median(&mut seen.iter().map(|p| p.z).collect::<Vec<f64>>());
        let radius = self.scene.radius();
        let part = |which| largest_part(rest, camera, shape, regions, which);
        Evidence {
            finite: true,
            visible: seen.len(),
            radius,
            matches: MatchCount {
                total: given,
                kept: given_kept,
                distinct: distinct(&all, diagonal).len(),
                distinct_kept: different.len(),
                given: self.sight.observation.matches.is_some(),
            },
            residual_px,
            outline_px: self.outline_px(result),
            rigid_px: Some([self.posed.median_px(), camera.size()[0] as f64]),
            pose,
            depth: depth.zip(template.usual.map(|u| u.depth)),
            extent_px: depth.map(|z| [radius * camera.focal[0] / z, diagonal]),
            camera: template.camera.as_ref().and_then(|own| {
                let (limit, register) = (self.options.verdict.camera, &self.options.register);
                other_camera([camera, own], limit, rest, &all, register, self.options.seed)
            }),
            appearance: looked.map(|l| l.appearance),
            usual: template.usual.map_or(EXPECTED, |u| u.appearance),
            uncompared: self.sight.compared.is_some() && looked.is_none(),
            no_shading: result.shaded == Some(0),
            gain: (self.method == Method::Dsfms && result.shaded != Some(0)).then_some(result.gain),
            contradicted: part(Region::Contradicted),
            unobserved: part(Region::Unobserved),
            folded: (folds > 0).then(|| (folds, share(rest, regions, Region::Folded))),
            strain: Some(strain(rest, shape)),
            ..Evidence::default()
        }
    }

    /// Distance of its contour from the organ's outline, px.
    fn outline_px(&self, result: &Reconstruction) -> Option<f64> {
        let outline = self.sight.outline.as_ref().or(result.outline.as_ref())?;
        outline_distance(self.camera(), &self.scene.rest.topology, &result.vertices, outline)
    }

    /// Distance of a match from the surface, px.
    fn away(&self, m: &Match, shape: &[Point3]) -> Option<f64> {
        Some((self.camera().project(&self.scene.point(m, shape))?.pixel - m.pixel).norm())
    }

    /// Its median over matches.
    fn residual_px(&self, matches: &[Match], shape: &[Point3]) -> Option<f64> {
        let away = |m: &Match| self.away(m, shape);
        median(&mut matches.iter().filter_map(away).collect::<Vec<f64>>())
    }
}
