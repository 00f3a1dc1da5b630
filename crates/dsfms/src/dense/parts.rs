//! Where what the depth maps show parts: an organ before the wall of a cavity.
//!
//! A field of signed distances has a zero level between what is free and what is hidden too, so its surface
//! goes on by a membrane from the rim of an organ to the wall behind it. No frame shows that membrane: from
//! every frame it is either hidden or looked through. Without it the surface falls into its parts.

use super::tetrahedra::{Triangles, extract};
use super::volume::Volume;
use super::{DenseError, DenseOptions, DepthMap, PosedFrame, clean, contour, fit, rim, tolerance};
use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point2, Point3, Vector3};
use crate::mesh::Topology;
use crate::raster::{Raster, rasterize};
use rayon::prelude::*;

/// Share of the frames that look at a place: what fewer find there, they find by accident.
const CHANCE: f64 = 0.1;
/// Half the width, in edges, of the necks at which parts are told apart.
const NECK: usize = 5;
/// Share of what all frames show from which on a piece is a part and no crumb.
const CONSIDERABLE: f64 = 0.05;
/// Share of a border in the depth maps without a step from which on two parts touch.
const TOUCHING: f64 = 0.5;

/// What the depth maps show, in parts that do not touch where frames look.
#[derive(Clone, Debug)]
pub struct Parts {
    topology: Topology,
    positions: Vec<Point3>,
    /// Part of every face; [`CRUMB`] where it belongs to none.
    of_face: Vec<u32>,
    count: usize,
}

/// Of no part.
pub(super) const CRUMB: u32 = u32::MAX;

/// The parts of what the depth maps show, those that the frames show most of first; `maps` are those of
/// [`super::depth_maps`] for the same `views`, in the same order.
///
/// # Errors
/// Bad options, or depth maps that hold no surface.
pub fn parts(
    views: &[PosedFrame],
    maps: &[DepthMap],
    options: &DenseOptions,
) -> Result<Parts, DenseError> {
    options.validate()?;
    let least = (options.min_support * maps.len() as f64) as f32;
    let mut volume = Volume::fuse(views, maps, options);
    fit::run(&mut volume, options.smoothness as f32);
    let triangles = extract(&volume, least);
    drop(volume);
    let doubtful = membranes(&triangles, maps);
    let of_face = pieces(&triangles.faces, &doubtful);
    let none = |_| DenseError::NoSurface { frames: maps.len() };
    let topology = Topology::new(triangles.positions.len(), triangles.faces).map_err(none)?;
    let mut parts = Parts { topology, positions: triangles.positions, of_face, count: 0 };
    parts.drop_crumbs(views);
    parts.join_touching(maps);
    Ok(parts)
}

/// The vertices that too few frames find, or more look through than find.
fn membranes(triangles: &Triangles, maps: &[DepthMap]) -> Vec<bool> {
    let vertices = triangles.positions.par_iter().zip(rim::normals(triangles));
    vertices.map(|(p, n)| !Sight::of(maps, p, &n).stays()).collect()
}

/// Label of the piece of each face, pieces told apart where they are joined by necks; [`CRUMB`] for what is
/// doubtful or hangs on no piece.
fn pieces(faces: &[[u32; 3]], doubtful: &[bool]) -> Vec<u32> {
    let stays = |f: &usize| faces[*f].iter().all(|&v| !doubtful[v as usize]);
    let staying: Vec<usize> = (0..faces.len()).filter(stays).collect();
    let own: Vec<[u32; 3]> = staying.iter().map(|&f| faces[f]).collect();
    let mut rim = vec![false; doubtful.len()];
    clean::boundary_edges(&own).iter().flatten().for_each(|&v| rim[v as usize] = true);
    let neck = clean::grown(&own, rim, NECK - 1);
    let inner = |f: &usize| own[*f].iter().all(|&v| !neck[v as usize]);
    let core: Vec<usize> = (0..own.len()).filter(inner).collect();
    let labels = clean::components(&core.iter().map(|&f| own[f]).collect::<Vec<_>>());
    let mut label = vec![CRUMB; own.len()];
    core.iter().zip(labels).for_each(|(&f, l)| label[f] = l);
    let label = grown(&own, label);
    let mut all = vec![CRUMB; faces.len()];
    staying.iter().zip(label).for_each(|(&f, l)| all[f] = l);
    all
}

/// Labels gone on over edges to the faces without one, from all sides at once.
fn grown(faces: &[[u32; 3]], mut label: Vec<u32>) -> Vec<u32> {
    let mut beside = vec![Vec::new(); faces.len()];
    for pair in clean::edge_list(faces).windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        beside[pair[0].1 as usize].push(pair[1].1 as usize);
        beside[pair[1].1 as usize].push(pair[0].1 as usize);
    }
    let mut queue: Vec<usize> = (0..faces.len()).filter(|&f| label[f] != CRUMB).collect();
    let mut next = 0;
    while next < queue.len() {
        let f = queue[next];
        next += 1;
        for &n in &beside[f] {
            if label[n] == CRUMB {
                label[n] = label[f];
                queue.push(n);
            }
        }
    }
    label
}

/// Frames that look towards a point.
#[derive(Default)]
struct Sight {
    /// All of them.
    looking: usize,
    /// Those that find a surface there and look at its front.
    finding: usize,
    /// Those that see something behind it.
    through: usize,
}

impl Sight {
    fn of(maps: &[DepthMap], point: &Point3, normal: &Vector3) -> Self {
        let mut sight = Self::default();
        for map in maps {
            let p = map.pose * point;
            let Some(i) = map.pixel(&p) else { continue };
            let (z, facing) = map.seen(i);
            let agrees = (z - p.z).abs() < tolerance(p.z, facing);
            sight.looking += 1;
            let front = (map.pose.rotation * normal).dot(&p.coords) < 0.0;
            sight.finding += usize::from(agrees && front);
            sight.through += usize::from(z > p.z && !agrees);
        }
        sight
    }

    fn stays(&self) -> bool {
        let chance = (CHANCE * self.looking as f64).round().max(1.0) as usize;
        self.finding >= chance && self.finding >= self.through
    }
}

impl Parts {
    /// Number the parts by the pixels that show them, and forget the crumbs.
    fn drop_crumbs(&mut self, views: &[PosedFrame]) {
        let mut shown = vec![0usize; self.of_face.len()];
        let mut all = 0;
        for view in views {
            for &face in &self.drawn(view.camera, &view.pose).face {
                if let Some(n) = shown.get_mut(self.of(face) as usize) {
                    *n += 1;
                    all += 1;
                }
            }
        }
        let least = (CONSIDERABLE * all as f64) as usize;
        let mut labels: Vec<usize> = (0..shown.len()).filter(|&l| shown[l] > least).collect();
        labels.sort_by_key(|&l| std::cmp::Reverse(shown[l]));
        let number = |l: &u32| labels.iter().position(|k| *k == *l as usize);
        self.of_face.iter_mut().for_each(|l| *l = number(l).map_or(CRUMB, |n| n as u32));
        self.count = labels.len();
    }

    /// Make one of parts that touch: along their border depth makes no step.
    fn join_touching(&mut self, maps: &[DepthMap]) {
        let border = contour::borders(self, maps);
        let mut one: Vec<usize> = (0..self.count).collect();
        for (i, [joined, all]) in border.into_iter().enumerate() {
            if joined as f64 > TOUCHING * all as f64 {
                let (from, to) = (one[i % self.count], one[i / self.count]);
                one.iter_mut().filter(|part| **part == from).for_each(|part| *part = to);
            }
        }
        let mut left = one.clone();
        left.sort_unstable();
        left.dedup();
        let number = |part: usize| left.iter().position(|l| *l == one[part]);
        let renamed = |l: u32| one.get(l as usize).and_then(|_| number(l as usize));
        self.of_face.iter_mut().for_each(|l| *l = renamed(*l).map_or(CRUMB, |n| n as u32));
        self.count = left.len();
    }

    /// Number of parts.
    pub fn count(&self) -> usize {
        self.count
    }

    /// All parts as a frame shows them.
    pub(super) fn drawn(&self, camera: &CameraModel, pose: &Isometry) -> Raster {
        let positions: Vec<Point3> = self.positions.iter().map(|p| pose * p).collect();
        rasterize(camera, &self.topology, &positions)
    }

    /// The part a face belongs to; [`CRUMB`] for none.
    pub(super) fn of(&self, face: u32) -> u32 {
        self.of_face.get(face as usize).copied().unwrap_or(CRUMB)
    }

    /// The part that a pixel of a frame shows.
    pub fn at(&self, camera: &CameraModel, pose: &Isometry, pixel: &Point2) -> Option<u32> {
        let (face, _) = self.drawn(camera, pose).surface_at(pixel)?;
        Some(self.of(face)).filter(|&part| part != CRUMB)
    }

    /// The part that shows most in the middle of the frames, half as wide and high as they are: who explores
    /// an organ looks at it. Of equal ones the first.
    pub fn central(&self, views: &[PosedFrame]) -> u32 {
        let mut shown = vec![0usize; self.count];
        for view in views {
            let raster = self.drawn(view.camera, &view.pose);
            let [w, h] = raster.size;
            for (x, y) in (h / 4..h - h / 4).flat_map(|y| (w / 4..w - w / 4).map(move |x| (x, y))) {
                if let Some(n) = shown.get_mut(self.of(raster.face[y * w + x]) as usize) {
                    *n += 1;
                }
            }
        }
        (0..shown.len()).max_by_key(|&p| (shown[p], std::cmp::Reverse(p))).unwrap_or(0) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squares of a grid of 40 x 12, each of two faces.
    fn sheet(inside: impl Fn(usize, usize) -> bool) -> Vec<[u32; 3]> {
        let index = |x: usize, y: usize| (y * 41 + x) as u32;
        let squares = (0..40).flat_map(|x| (0..12).map(move |y| (x, y)));
        let corners = |(x, y)| [index(x, y), index(x + 1, y), index(x + 1, y + 1), index(x, y + 1)];
        let kept = squares.filter(|&(x, y)| inside(x, y)).map(corners);
        kept.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
    }

    #[test]
    fn a_neck_parts_and_a_doubtful_strip_belongs_to_nothing() {
        let sides = |label: &[u32]| (label[0], label[label.len() - 1]);
        let whole = sheet(|_, _| true);
        let sure = vec![false; 41 * 13];
        let (left, right) = sides(&pieces(&whole, &sure));
        assert!(left == right && left != CRUMB);
        let neck = sheet(|x, y| !(18..22).contains(&x) || (4..7).contains(&y));
        let label = pieces(&neck, &sure);
        let (left, right) = sides(&label);
        assert!(left != right && !label.contains(&CRUMB), "{left} {right}");
        let strip: Vec<bool> = (0..41 * 13).map(|v| v % 41 == 20).collect();
        let label = pieces(&whole, &strip);
        let (left, right) = sides(&label);
        // 12 rows of 2 squares of 2 faces.
        assert!(left != right && label.iter().filter(|&&l| l == CRUMB).count() == 48);
    }

    #[test]
    fn what_frames_look_through_is_no_surface() {
        let sight = |finding, through| Sight { looking: 16, finding, through }.stays();
        assert!(sight(2, 0) && sight(5, 5));
        // One of sixteen finds it by accident; more look through than find.
        assert!(!sight(1, 0) && !sight(5, 6) && !sight(0, 0));
    }
}
