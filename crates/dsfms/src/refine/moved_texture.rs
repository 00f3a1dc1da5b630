//! Matches of tissue that moved farther than descriptors and blurs reach.
//!
//! Patches of the rendered shape are found in the frame: first where the shape shows them, then,
//! ring by ring, from where a neighbour was found, turned and stretched as that one is (affine
//! match propagation; Ferrari et al. 2006). Each step is short, so that a pulled tip
//! is reached along the tissue that leads to it.

use super::Photograph;
use super::look::shading;
use crate::geometry::{Neighbours, Point2, Point3, Vector2};
use crate::image::affine::{PlacedPatch, TexturePatch};
use crate::image::corners::{CornerGrid, corners};
use crate::image::filter::halve;
use crate::image::{Mask, Plane, diagonal};
use crate::mesh::Mesh;
use crate::mesh::normals::vertex_normals;
use crate::raster::{Raster, rasterize};
use crate::register::Match;
use crate::register::find::agreeing;
use nalgebra::Matrix2;
use rayon::prelude::*;

/// `DOUBT` is measured on scenes, `ALIKE`, `REACH` and `NEAR` on six frames, the others are not
/// (`docs/results/choices.md`). The picture is halved until its diagonal is no longer, px: patches
/// are of one size in it.
const DIAGONAL: f64 = 1000.0;
/// Places: one in every square of this side, px.
const GRID: CornerGrid = CornerGrid { cell: 5, stride: 2, most: 4000 };
/// Least correlation of a patch where the shape shows it, and of one that a neighbour leads to.
const ALIKE: [f64; 2] = [0.85, 0.8];
/// A patch is found no farther from where it is expected, px.
const REACH: f64 = 4.0;
/// Largest standard deviation of a place, px: along an edge it is not known.
const DOUBT: f64 = 0.5;
/// Neighbours that lead to a place lie within this, px, and how many of the nearest are looked at.
const NEAR: f64 = 12.0;
const NEIGHBOURS: usize = 24;
/// Of those found, the nearest that are tried.
const TRIED: usize = 4;
/// Starts that differ by less, px and norm of the map, lead to the same place.
const SAME_PX: f64 = 1.0;
const SAME_MAP: f64 = 0.1;
/// Rounds at most: a place is at most so many neighbours from one that did not move.
const ROUNDS: usize = 60;
/// What is off by more from the median of its neighbours, and a third of that, is strayed, px.
const STRAY: f64 = 2.0;
/// What lies nearer to where the shape shows it the blurs reach, px.
const MOVED: f64 = 3.0;

/// Matches of places that the frame shows more than a blur away from where `shape` (camera axes)
/// has them.
#[doc(alias("match propagation", "dense matching"))]
pub(crate) fn moved_texture(rest: &Mesh, shape: &[Point3], photo: &Photograph) -> Vec<Match> {
    let working = WorkingImages::new(rest, shape, photo);
    let found: Vec<Option<PlacedPatch>> = working.found();
    let offsets: Vec<Option<Vector2>> = (working.places.iter().zip(&found))
        .map(|(place, found)| Some(found.as_ref()?.at - place.pixel))
        .collect();
    let rendered: Vec<Point2> = working.places.iter().map(|p| p.pixel).collect();
    let kept = agreeing(&rendered, &offsets, f64::INFINITY, STRAY);
    let scale = f64::from(1u32 << working.halvings);
    let moved = kept.into_iter().filter_map(|i| {
        let (place, found) = (&working.places[i], found[i]?);
        ((found.at - place.pixel).norm() > MOVED).then(|| Match {
            face: place.face,
            barycentric: place.barycentric,
            pixel: found.at.map(|c| (c + 0.5) * scale - 0.5),
        })
    });
    moved.collect()
}

/// A place of the template.
struct RenderedPlace {
    face: u32,
    barycentric: [f64; 3],
    /// Where the shape shows it, px.
    pixel: Point2,
}

/// The rendered shape and the frame: square roots of brightness, whose noise is even; NaN where
/// they do not count.
struct WorkingImages {
    halvings: u32,
    render: Plane,
    frame: Plane,
    places: Vec<RenderedPlace>,
}

impl WorkingImages {
    fn new(rest: &Mesh, shape: &[Point3], photo: &Photograph) -> Self {
        let (mut camera, mut frame) = (photo.camera.clone(), photographed(photo));
        let mut halvings = 0;
        while diagonal(camera.size) > DIAGONAL {
            (camera, frame, halvings) = (camera.halved(), halve(&frame), halvings + 1);
        }
        let raster = rasterize(&camera, &rest.topology, shape);
        let render = rendered(rest, shape, photo, &raster);
        let known = render.data.iter().map(|v| !v.is_nan()).collect();
        let known = Mask { size: render.size, data: known };
        let places = corners(&render, &known, &GRID).into_iter().filter_map(|[x, y]| {
            let (face, barycentric) = raster.surface(x, y)?;
            Some(RenderedPlace { face, barycentric, pixel: Point2::new(x as f64, y as f64) })
        });
        let places = places.collect();
        Self { halvings, render, frame, places }
    }

    /// Where the frame shows the places.
    fn found(&self) -> Vec<Option<PlacedPatch>> {
        let near = Neighbours::of(self.places.iter().map(|p| p.pixel.coords.into()).collect());
        let nearest = |i: usize| -> Vec<usize> {
            let mut near = near.nearest(i, NEIGHBOURS);
            near.retain(|&j| (self.places[j].pixel - self.places[i].pixel).norm() < NEAR);
            near
        };
        let all = || (0..self.places.len()).into_par_iter();
        let nearest: Vec<Vec<usize>> = all().map(nearest).collect();
        let mut found: Vec<Option<PlacedPatch>> =
            all().map(|i| self.best(i, &[self.as_shown(i)], ALIKE[0])).collect();
        let mut tried: Vec<Vec<PlacedPatch>> = all().map(|i| vec![self.as_shown(i)]).collect();
        for _ in 0..ROUNDS {
            let starts: Vec<Vec<PlacedPatch>> = all()
                .map(|i| match found[i] {
                    None => self.starts(i, &nearest[i], &found, &tried[i]),
                    Some(_) => Vec::new(),
                })
                .collect();
            let new: Vec<Option<PlacedPatch>> =
                all().map(|i| self.best(i, &starts[i], ALIKE[1])).collect();
            if new.iter().all(Option::is_none) {
                break;
            }
            found.iter_mut().zip(new).for_each(|(found, new)| *found = found.or(new));
            tried.iter_mut().zip(starts).for_each(|(tried, starts)| tried.extend(starts));
        }
        found
    }

    /// Place `i` as the shape shows it.
    fn as_shown(&self, i: usize) -> PlacedPatch {
        let (at, affine) = (self.places[i].pixel, Matrix2::identity());
        PlacedPatch { at, affine, alike: 0.0, sigma: 0.0 }
    }

    /// Where the nearest neighbours that are found lead place `i`, but for what was tried.
    fn starts(
        &self,
        i: usize,
        nearest: &[usize],
        found: &[Option<PlacedPatch>],
        tried: &[PlacedPatch],
    ) -> Vec<PlacedPatch> {
        let led = |&j: &usize| {
            let neighbour = found[j]?;
            let along = self.places[i].pixel - self.places[j].pixel;
            Some(PlacedPatch { at: neighbour.at + neighbour.affine * along, ..neighbour })
        };
        let mut starts: Vec<PlacedPatch> = Vec::new();
        for start in nearest.iter().filter_map(led).take(TRIED) {
            if !tried.iter().chain(&starts).any(|other| alike(other, &start)) {
                starts.push(start);
            }
        }
        starts
    }

    /// Place `i` near where one of `starts` has it: where it is most alike, and that at least.
    fn best(&self, i: usize, starts: &[PlacedPatch], alike: f64) -> Option<PlacedPatch> {
        if starts.is_empty() {
            return None;
        }
        let patch = TexturePatch::of(&self.render, self.places[i].pixel)?;
        let found = starts.iter().filter_map(|start| {
            let found = patch.found(&self.frame, start)?;
            let near = (found.at - start.at).norm() < REACH;
            (near && found.alike >= alike && found.sigma < DOUBT).then_some(found)
        });
        found.max_by(|a, b| a.alike.total_cmp(&b.alike))
    }
}

/// Whether two starts lead to the same place.
fn alike(a: &PlacedPatch, b: &PlacedPatch) -> bool {
    (a.at - b.at).norm() < SAME_PX && (a.affine - b.affine).norm() < SAME_MAP
}

/// Square root of the mean of the channels.
fn brightness(channels: [f32; 3], light: f32) -> f32 {
    ((channels[0] + channels[1] + channels[2]) / 3.0 * light).sqrt()
}

/// Brightness of the frame; NaN where it does not count.
fn photographed(photo: &Photograph) -> Plane {
    let linear = &photo.picture.linear;
    let counts = |i: usize| photo.usable.data[i] && photo.picture.clipped[i] == [false; 3];
    let value = |i: usize| if counts(i) { brightness(linear.data[i], 1.0) } else { f32::NAN };
    Plane { size: linear.size, data: (0..linear.data.len()).into_par_iter().map(value).collect() }
}

/// Brightness of the shape; NaN where the albedo was not observed.
fn rendered(rest: &Mesh, shape: &[Point3], photo: &Photograph, raster: &Raster) -> Plane {
    let normals = vertex_normals(&rest.topology, shape);
    let shade = shading(photo.light, &rest.topology, shape, &normals, raster);
    let mean = |face, quarters| photo.picture.shown(photo.albedo.observed_mean(face, quarters));
    let albedo = raster.render_quarters([f32::NAN; 3], mean);
    let data = albedo.into_iter().zip(shade).map(|(a, s)| brightness(a, s as f32)).collect();
    Plane { size: raster.size, data }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::geometry::Vector3;
    use crate::image::Picture;
    use crate::synth::Case;

    /// Matches that are followed from a shape, with how far each lies from the truth and from where
    /// the shape has it, px.
    fn followed(case: &Case, shape: &[Point3]) -> Vec<[f64; 2]> {
        let frame = &case.frame;
        let photo = &Photograph {
            camera: &case.camera,
            picture: &Picture::of(frame, &case.template.tone),
            usable: &Mask::filled(frame.size, true),
            outline: None,
            light: &case.template.lighting(),
            albedo: case.template.albedo.as_ref().unwrap(),
            exposure: None,
        };
        let rest = &case.template.mesh;
        let away = |m: &Match, shape: &[Point3]| {
            let point = rest.topology.point(m.face, m.barycentric, shape);
            (case.camera.project(&point).unwrap().pixel - m.pixel).norm()
        };
        let found = moved_texture(rest, shape, photo);
        found.iter().map(|m| [away(m, &case.truth), away(m, shape)]).collect()
    }

    #[test]
    fn texture_is_followed_from_what_stays_to_what_moved_far() {
        let case = Case::example(1);
        // Of some thousand places on a sheet with a dozen thin vessels.
        assert!(followed(&case, &case.truth).len() < 10);
        // The shape lacks a pull of 20 px over a third of the picture.
        let middle = case.truth.iter().map(|p| p.coords).sum::<Vector3>() / case.truth.len() as f64;
        let px = middle.z / case.camera.focal[0];
        let [along, wide] = [20.0, case.camera.size[0] as f64 / 8.0].map(|c| c * px);
        let pull = |p: &Point3| {
            let away = (p.coords - middle).norm() / wide;
            p + Vector3::new(1.0, 0.5, 0.0).normalize() * (along * (-0.5 * away * away).exp())
        };
        let shape: Vec<Point3> = case.truth.iter().map(pull).collect();
        let found = followed(&case, &shape);
        let count = |of: &dyn Fn(&[f64; 2]) -> bool| found.iter().filter(|f| of(f)).count();
        let [far, nearer] = [count(&|f| f[1] > 12.0 && f[0] < 1.0), count(&|f| f[0] < f[1])];
        assert!(far > 20, "{far} of {} found far away to a pixel", found.len());
        // Bare tissue tells less, but mostly the right direction.
        assert!(nearer * 10 > found.len() * 7, "{nearer} of {} nearer to the truth", found.len());
    }
}
