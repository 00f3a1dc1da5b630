//! A rim that can be trusted: what few of the frames that look there confirm, or none sees but at a
//! grazing angle, is peeled off the surface from outside, along a smooth line.

use super::clean::grown;
use super::depth_map::{DepthMap, GRAZING, SAME_SURFACE, Said};
use super::tetrahedra::Triangles;
use crate::camera::PosedFrame;
use crate::geometry::{Point3, Vector3};
use crate::mesh::Topology;
use crate::mesh::faces::{boundary_edges, edge_list};
use crate::mesh::normals::normals_of;
use crate::raster::{rasterize, visible_vertices};
use rayon::prelude::*;

/// Share of the frames that look at a place whose depth agrees with it, for full trust.
const AGREEING: f64 = 0.2;
/// Cosine to the sightline of the agreeing frame that faces a place most, for full trust.
const FACING: f64 = 0.05;
/// Steps of diffusion: trust is averaged over about half their root in edges.
const STEPS: usize = 100;
/// Trust that stays, averaged, none beyond the rim.
const LEAST: f64 = 0.15;
/// Share of the neighbourhood whose front a frame must look at.
const SEEN: f64 = 0.5;
/// What a straight rim of full trust loses by that, in edges: it is given back.
const LOST: usize = 4;
/// What lies behind the surface by more than this fraction of the depth is hidden: both may be off
/// by what depths of one surface differ by at a grazing angle.
const BEHIND: f64 = 2.0 * SAME_SURFACE / GRAZING;
/// Bays of the rim narrower than twice this, in edges, stay filled.
const BAY: usize = 6;

/// Peel the rim. Expects one fan a vertex; leaves teeth. `hides`: a frame does not look at what
/// faces away from it or the surface itself hides from it.
pub(super) fn peel(
    triangles: &mut Triangles,
    views: &[PosedFrame],
    maps: &[DepthMap],
    hides: bool,
) {
    let normals = normals_of(&triangles.faces, &triangles.positions);
    let open = hides.then(|| unhidden(triangles, &normals, maps));
    let (trust, seen): (Vec<f64>, Vec<f64>) = (0..normals.len())
        .into_par_iter()
        .map(|v| {
            let looks = |i: &usize| open.as_ref().is_none_or(|open| open[*i][v]);
            let frames = (0..maps.len()).filter(looks).map(|i| (&views[i], &maps[i]));
            trust(frames, &triangles.positions[v], &normals[v])
        })
        .unzip();
    let trust = diffused(triangles, trust);
    let front: Vec<bool> = seen.iter().map(|&s| s > 0.0).collect();
    let seen = diffused(triangles, seen);
    let doubtful: Vec<bool> =
        trust.iter().zip(&seen).map(|(&t, &s)| t < LEAST || s < SEEN).collect();
    remove_from_rim(triangles, &doubtful, &front);
}

/// For every frame, whether a vertex faces it and nothing of the surface itself hides the vertex
/// from it: an empty depth map, or a wrong one, tells nothing of what the surface lies before.
fn unhidden(triangles: &Triangles, normals: &[Vector3], maps: &[DepthMap]) -> Vec<Vec<bool>> {
    let topology = Topology::from_checked(triangles.positions.len(), triangles.faces.clone());
    let one = |map: &DepthMap| {
        let positions: Vec<Point3> = triangles.positions.iter().map(|p| map.pose * p).collect();
        let raster = rasterize(&map.camera, &topology, &positions);
        let nearest = raster.depth.iter().copied().fold(f64::INFINITY, f64::min);
        let tolerance = BEHIND * nearest;
        let mut open = visible_vertices(&map.camera, &topology, &positions, &raster, tolerance);
        for ((open, p), normal) in open.iter_mut().zip(&positions).zip(normals) {
            *open &= (map.pose.rotation * normal).dot(&p.coords) < 0.0;
        }
        open
    };
    // One after the other: a z-buffer is large, and drawn by all threads.
    maps.iter().map(one).collect()
}

/// Trust in a vertex, in `[0, 1]`, and 1 where one of the frames looks at its front, else 0.
fn trust<'a>(
    frames: impl Iterator<Item = (&'a PosedFrame<'a>, &'a DepthMap)>,
    point: &Point3,
    normal: &Vector3,
) -> (f64, f64) {
    let (mut looking, mut agreeing, mut facing, mut seen) = (0, 0, 0.0f64, false);
    for (view, map) in frames {
        let Some(agrees) = says(view, map, point) else { continue };
        let cosine = normal.dot(&(view.centre() - point).normalize());
        looking += 1;
        seen |= cosine > 0.0;
        if agrees {
            facing = facing.max(cosine);
            agreeing += 1;
        }
    }
    let share = agreeing as f64 / (AGREEING * looking.max(1) as f64);
    let trust = share.min(1.0) * (facing / FACING).clamp(0.0, 1.0);
    (trust, f64::from(u8::from(seen)))
}

/// Whether a frame agrees with a surface at a point; `None` where it does not look or something
/// lies before it.
fn says(view: &PosedFrame, map: &DepthMap, point: &Point3) -> Option<bool> {
    let p = map.pose * point;
    view.usable_pixel(&p)?;
    match map.compare(&p)?.1 {
        Said::Agrees => Some(true),
        Said::Before | Said::Nothing => Some(false),
        Said::Behind => None,
    }
}

/// Values averaged over the neighbourhood, with zero held on the rim: low at the rim and in what
/// sticks out of it.
fn diffused(triangles: &Triangles, mut value: Vec<f64>) -> Vec<f64> {
    let mut ring: Vec<Vec<u32>> = vec![Vec::new(); value.len()];
    for sides in edge_list(&triangles.faces).chunk_by(|a, b| a.0 == b.0) {
        let [a, b] = sides[0].0;
        ring[a as usize].push(b);
        ring[b as usize].push(a);
    }
    for v in boundary_edges(&triangles.faces).into_iter().flatten() {
        ring[v as usize].clear();
        value[v as usize] = 0.0;
    }
    for _ in 0..STEPS {
        let mean = |(v, ring): (usize, &Vec<u32>)| {
            if ring.is_empty() {
                return value[v];
            }
            let sum: f64 = ring.iter().map(|&n| value[n as usize]).sum();
            0.5 * (value[v] + sum / ring.len() as f64)
        };
        value = ring.par_iter().enumerate().map(mean).collect();
    }
    value
}

/// Take away the faces at doubtful vertices that connect over such vertices to the rim: doubt amid
/// the surface makes no hole. What is given back is only what a frame looks at from the front.
fn remove_from_rim(triangles: &mut Triangles, doubtful: &[bool], front: &[bool]) {
    let mut gone = vec![false; doubtful.len()];
    let rim = boundary_edges(&triangles.faces);
    rim.iter().flatten().for_each(|&v| gone[v as usize] = doubtful[v as usize]);
    loop {
        let mut grew = false;
        for face in &triangles.faces {
            if face.iter().any(|&v| gone[v as usize]) {
                for &v in face.iter().filter(|&&v| doubtful[v as usize]) {
                    grew |= !std::mem::replace(&mut gone[v as usize], true);
                }
            }
        }
        if !grew {
            break;
        }
    }
    let mut kept = vec![false; gone.len()];
    for face in triangles.faces.iter().filter(|face| !face.iter().any(|&v| gone[v as usize])) {
        face.iter().for_each(|&v| kept[v as usize] = true);
    }
    let given_back = grown(&triangles.faces, kept.clone(), LOST);
    let all = kept.iter().zip(&given_back).zip(front);
    let kept: Vec<bool> = all.map(|((&kept, &back), &front)| kept || back && front).collect();
    let kept = without_bays(&triangles.faces, kept, &rim);
    triangles.faces.retain(|face| face.iter().all(|&v| kept[v as usize]));
}

/// The kept vertices and the bays between them (a morphological closing).
fn without_bays(faces: &[[u32; 3]], kept: Vec<bool>, rim: &[[u32; 2]]) -> Vec<bool> {
    let mut open: Vec<bool> = grown(faces, kept.clone(), BAY).iter().map(|&k| !k).collect();
    rim.iter().flatten().for_each(|&v| open[v as usize] |= !kept[v as usize]);
    let open = grown(faces, open, BAY);
    kept.iter().zip(&open).map(|(&kept, &open)| kept || !open).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::geometry::Isometry;
    use crate::image::Frame;

    /// A sheet of 40 x 30 squares with a spike of width 3 at its right side.
    fn sheet() -> Triangles {
        let inside = |x: usize, y: usize| x < 40 || (14..17).contains(&y);
        let index = |x: usize, y: usize| (y * 61 + x) as u32;
        let mut faces = Vec::new();
        for (x, y) in (0..60).flat_map(|x| (0..30).map(move |y| (x, y))) {
            if inside(x, y) {
                let [a, b, c, d] =
                    [index(x, y), index(x + 1, y), index(x + 1, y + 1), index(x, y + 1)];
                faces.extend([[a, b, c], [a, c, d]]);
            }
        }
        let place = |i: usize| Point3::new((i % 61) as f64, (i / 61) as f64, 0.0);
        Triangles { positions: (0..61 * 31).map(place).collect(), faces }
    }

    #[test]
    fn a_spike_goes_and_the_sheet_loses_little() {
        let mut sheet = sheet();
        let trust = vec![1.0; sheet.positions.len()];
        let seen = vec![true; trust.len()];
        let doubtful: Vec<bool> = diffused(&sheet, trust).iter().map(|&t| t < LEAST).collect();
        remove_from_rim(&mut sheet, &doubtful, &seen);
        let reach = sheet.faces.iter().flatten().map(|v| v % 61).max();
        assert!(reach.is_some_and(|x| (36..44).contains(&x)), "{reach:?}");
        assert!(sheet.faces.len() > 2 * 34 * 24, "{}", sheet.faces.len());
    }

    /// Depth maps across the view at these depths, all from the origin along z; a pixel is one unit
    /// at 50.
    fn walls(depths: &[f32]) -> Vec<DepthMap> {
        let camera = CameraModel::pinhole([90, 70], [50.0; 2], [44.5, 34.5]);
        let wall = |&depth: &f32| DepthMap {
            camera: camera.clone(),
            pose: Isometry::identity(),
            depth: vec![depth; 90 * 70],
            normal: vec![[0.0, 0.0, -1.0]; 90 * 70],
            sigma: vec![0.1; 90 * 70],
            confidence: vec![1.0; 90 * 70],
        };
        depths.iter().map(wall).collect()
    }

    /// A strip of 30 squares' width whose section runs through these corners (x, z).
    fn strip(section: &[[i32; 2]]) -> Triangles {
        let mut line = vec![section[0]];
        for corners in section.windows(2) {
            let [from, to] = [corners[0], corners[1]];
            let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
            line.extend(
                (1..=steps).map(|k| [0, 1].map(|i| from[i] + k * (to[i] - from[i]) / steps)),
            );
        }
        let at = |i: usize, j: usize| (i * 31 + j) as u32;
        let mut faces = Vec::new();
        for (i, j) in (0..line.len() - 1).flat_map(|i| (0..30).map(move |j| (i, j))) {
            let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
            faces.extend([[a, b, c], [a, c, d]]);
        }
        let place = |[x, z]: [i32; 2]| {
            (0..31).map(move |j| Point3::new(f64::from(x), f64::from(j) - 15.0, f64::from(z)))
        };
        Triangles { positions: line.into_iter().flat_map(place).collect(), faces }
    }

    #[test]
    fn a_fold_that_the_surface_hides_goes_and_an_open_sheet_stays() {
        let maps = walls(&[50.0, 58.0]);
        let frame = Frame { name: "f".into(), size: [90, 70], rgb: vec![[90; 3]; 90 * 70] };
        let view = PosedFrame::new(&frame, &maps[0].camera, Isometry::identity());
        let left = |mut triangles: Triangles, hides: bool| {
            peel(&mut triangles, &[view, view], &maps, hides);
            let z = |f: &[u32; 3]| triangles.positions[f[0] as usize].z;
            [50.0, 58.0].map(|depth| triangles.faces.iter().filter(|f| z(f) == depth).count())
        };
        // Twice back behind itself: the last layer faces the camera, and the second map is of its
        // depth.
        let section = [[-20, 50], [20, 50], [20, 54], [-15, 54], [-15, 58], [15, 58]];
        assert!(left(strip(&section), false)[1] > 500);
        let fold = left(strip(&section), true);
        assert!(fold[0] > 2 * 34 * 24, "{fold:?}");
        assert_eq!(fold[1], 0);
        // Nothing lies before the same layer alone.
        let alone = left(strip(&[[-20, 58], [20, 58]]), true);
        assert!(alone[1] > 2 * 34 * 24, "{alone:?}");
    }

    #[test]
    fn doubt_amid_the_surface_makes_no_hole() {
        let mut sheet = sheet();
        let mut doubtful = vec![false; sheet.positions.len()];
        let seen = vec![true; doubtful.len()];
        for (x, y) in (10..14).flat_map(|x| (10..14).map(move |y| (x, y))) {
            doubtful[y * 61 + x] = true;
        }
        let before = sheet.faces.len();
        remove_from_rim(&mut sheet, &doubtful, &seen);
        assert_eq!(sheet.faces.len(), before);
        // A bay that is open to the rim is peeled.
        for (x, y) in (4..34).flat_map(|x| (0..24).map(move |y| (x, y))) {
            doubtful[y * 61 + x] = true;
        }
        remove_from_rim(&mut sheet, &doubtful, &seen);
        assert!(sheet.faces.len() < before);
    }
}
