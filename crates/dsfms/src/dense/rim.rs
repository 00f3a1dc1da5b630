//! A rim that can be trusted: what few of the frames that look there confirm, or none sees but at a
//! grazing angle, is peeled off the surface from outside, along a smooth line.

use super::clean::{boundary_edges, edge_list, grown};
use super::tetrahedra::Triangles;
use super::{DepthMap, PosedFrame};
use crate::camera::Camera;
use crate::geometry::{Point3, Vector3};
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
/// Bays of the rim narrower than twice this, in edges, stay filled.
const BAY: usize = 6;

/// Peel the rim. Expects one fan a vertex; leaves teeth.
pub(super) fn peel(triangles: &mut Triangles, views: &[PosedFrame], maps: &[DepthMap]) {
    let normals = normals(triangles);
    let (trust, seen): (Vec<f64>, Vec<f64>) =
        triangles.positions.par_iter().zip(&normals).map(|(p, n)| trust(views, maps, p, n)).unzip();
    let trust = diffused(triangles, trust);
    let front: Vec<bool> = seen.iter().map(|&s| s > 0.0).collect();
    let seen = diffused(triangles, seen);
    let doubtful: Vec<bool> =
        trust.iter().zip(&seen).map(|(&t, &s)| t < LEAST || s < SEEN).collect();
    remove_from_rim(triangles, &doubtful, &front);
}

/// Trust in a vertex, in `[0, 1]`, and 1 where a frame looks at its front, else 0.
fn trust(views: &[PosedFrame], maps: &[DepthMap], point: &Point3, normal: &Vector3) -> (f64, f64) {
    let (mut looking, mut agreeing, mut facing, mut seen) = (0, 0, 0.0f64, false);
    for (view, map) in views.iter().zip(maps) {
        let Some(agrees) = says(view, map, point) else { continue };
        let centre = view.pose.inverse_transform_point(&Point3::origin());
        let cosine = normal.dot(&(centre - point).normalize());
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

/// Whether a frame agrees with a surface at a point; `None` where it does not look or something lies
/// before it.
fn says(view: &PosedFrame, map: &DepthMap, point: &Point3) -> Option<bool> {
    let p = map.pose * point;
    let pixel = view.camera.project(&p)?.pixel;
    let [w, h] = view.camera.size.map(|n| n as f64 - 1.0);
    let inside = (0.0..=w).contains(&pixel.x) && (0.0..=h).contains(&pixel.y);
    if !inside || ![view.valid, view.organ].into_iter().flatten().all(|m| m.at_pixel(&pixel)) {
        return None;
    }
    let u = (map.camera.focal[0] * p.x / p.z + map.camera.centre[0]).round();
    let v = (map.camera.focal[1] * p.y / p.z + map.camera.centre[1]).round();
    let [w, h] = map.camera.size;
    if !(u >= 0.0 && v >= 0.0 && u < w as f64 && v < h as f64) {
        return None;
    }
    let i = v as usize * w + u as usize;
    let (z, facing) = (f64::from(map.depth[i]), -f64::from(map.normal[i][2]));
    let agrees = z > 0.0 && (z - p.z).abs() < super::surface::SAME_SURFACE * p.z / facing.max(0.25);
    let hidden = z > 0.0 && z < p.z;
    (agrees || !hidden).then_some(agrees)
}

/// Unit normals of the vertices, by area; zero where there is none.
fn normals(triangles: &Triangles) -> Vec<Vector3> {
    let mut normals = vec![Vector3::zeros(); triangles.positions.len()];
    for face in &triangles.faces {
        let [a, b, c] = face.map(|v| triangles.positions[v as usize]);
        let normal = (b - a).cross(&(c - a));
        face.iter().for_each(|&v| normals[v as usize] += normal);
    }
    normals.iter().map(|n| n.try_normalize(0.0).unwrap_or_default()).collect()
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

/// Take away the faces at doubtful vertices that connect over such vertices to the rim: doubt amid the
/// surface makes no hole. What is given back is only what a frame looks at from the front.
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
