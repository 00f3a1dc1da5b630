//! Texel resolution, texels nobody saw, and the albedo seen by a camera.

use super::SurfaceTexels;
use super::albedo_options::AlbedoOptions;
use super::photometric::PreparedView;
use crate::geometry::{Point3, point_at};
use crate::image::{ColorImage, Mask};
use crate::mesh::Mesh;
use crate::raster::Raster;
use rayon::prelude::*;

/// Rounds of averaging over vertices that nobody saw.
const SMOOTHING_ROUNDS: usize = 30;

/// About one texel per pixel of the closest view that shows the face; 1 for faces nobody sees.
pub(super) fn choose_resolution(
    mesh: &Mesh,
    views: &[PreparedView],
    options: &AlbedoOptions,
) -> Vec<u16> {
    let finest = |face: usize| views.iter().fold(f64::INFINITY, |m, v| m.min(v.footprint[face]));
    let wanted: Vec<f64> = mesh
        .face_areas()
        .iter()
        .enumerate()
        .map(|(face, area)| (area.sqrt() / finest(face) * options.texels_per_px).max(1.0))
        .collect();
    let limit = f64::from(options.max_resolution.max(1));
    let total: f64 = wanted.iter().map(|r| r.min(limit).powi(2)).sum();
    let shrink = (options.max_texels as f64 / total).sqrt().min(1.0);
    wanted.iter().map(|r| (r.min(limit) * shrink).round().max(1.0) as u16).collect()
}

/// Give every texel without any observation (spread NaN) the value its neighbourhood suggests:
/// vertex means of observed texels, carried over the unseen part of the surface, interpolated on
/// the face.
pub(super) fn fill_unseen(mesh: &Mesh, texels: &mut SurfaceTexels) {
    let vertices = vertex_values(mesh, texels);
    for (face, corners) in mesh.topology.faces.iter().enumerate() {
        let corners = corners.map(|v| Point3::from(vertices[v as usize]));
        let [a, b, c] = &corners;
        for (k, w) in texels.centres(face).enumerate() {
            let i = texels.offset[face] as usize + k;
            if texels.spread[i].is_nan() {
                let value = point_at([a, b, c], w);
                texels.value[i] = [value.x as f32, value.y as f32, value.z as f32];
            }
        }
    }
}

/// RGB per vertex: the barycentric-weighted mean of the observed texels around it, or else
/// carried over from the nearest vertices that have one.
fn vertex_values(mesh: &Mesh, texels: &SurfaceTexels) -> Vec<[f64; 3]> {
    let n = mesh.positions.len();
    let (mut sum, mut total) = (vec![[0.0; 3]; n], vec![0.0; n]);
    for (face, corners) in mesh.topology.faces.iter().enumerate() {
        for (k, w) in texels.centres(face).enumerate() {
            let i = texels.offset[face] as usize + k;
            if texels.views[i] == 0 {
                continue;
            }
            for (&v, w) in corners.iter().zip(w) {
                total[v as usize] += w;
                (0..3).for_each(|c| sum[v as usize][c] += w * f64::from(texels.value[i][c]));
            }
        }
    }
    let known: Vec<_> =
        sum.iter().zip(&total).map(|(s, &t)| (t > 0.0).then(|| s.map(|x| x / t))).collect();
    spread_over_rings(&mesh.topology.one_ring, known)
}

fn spread_over_rings(rings: &[Vec<u32>], known: Vec<Option<[f64; 3]>>) -> Vec<[f64; 3]> {
    let mean = |values: &mut dyn Iterator<Item = [f64; 3]>| {
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for value in values {
            (0..3).for_each(|c| sum[c] += value[c]);
            count += 1.0;
        }
        (count > 0.0).then(|| sum.map(|s| s / count))
    };
    let mut values = known.clone();
    loop {
        let next: Vec<_> = (0..values.len())
            .map(|v| {
                let mut near = rings[v].iter().filter_map(|&j| values[j as usize]);
                values[v].or_else(|| mean(&mut near))
            })
            .collect();
        if next == values {
            break;
        }
        values = next;
    }
    // Parts of the surface without any observation take the mean of all that were observed.
    let overall = mean(&mut known.iter().filter_map(|v| *v)).unwrap_or_default();
    let mut values: Vec<_> = values.into_iter().map(|v| v.unwrap_or(overall)).collect();
    for _ in 0..SMOOTHING_ROUNDS {
        values = (0..values.len())
            .map(|v| {
                let mut near = rings[v].iter().map(|&j| values[j as usize]);
                known[v].or_else(|| mean(&mut near)).unwrap_or(values[v])
            })
            .collect();
    }
    values
}

/// The albedo as a camera sees it, and `true` where it was observed (not filled in); black where
/// there is no surface. `raster` must be of the template's topology.
pub(crate) fn render_albedo(raster: &Raster, texels: &SurfaceTexels) -> (ColorImage, Mask) {
    let seen = raster.render(([0.0; 3], false), |face, w| {
        let i = texels.index(face, w);
        (texels.value[i], texels.views[i] > 0)
    });
    let (data, observed) = seen.into_par_iter().unzip();
    (ColorImage { size: raster.size, data }, Mask { size: raster.size, data: observed })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;
    use std::sync::Arc;

    #[test]
    fn unseen_texels_take_their_neighbours_value() {
        let topology = Arc::new(Topology::new(4, vec![[0, 1, 2], [2, 1, 3]]).unwrap());
        let positions =
            [[0., 0.], [1., 0.], [0., 1.], [1., 1.]].map(|p| Point3::new(p[0], p[1], 9.)).to_vec();
        let mesh = Mesh { topology, positions };
        let mut texels = SurfaceTexels::new(vec![3, 2]);
        for i in 0..9 {
            texels.value[i] = [0.5, 0.25, 0.125];
            texels.views[i] = 2;
            texels.spread[i] = 0.0;
        }
        fill_unseen(&mesh, &mut texels);
        for value in &texels.value {
            for (found, expected) in value.iter().zip([0.5, 0.25, 0.125]) {
                assert!((found - expected).abs() < 1e-6);
            }
        }
        assert_eq!(texels.views[9..], [0; 4]);
    }
}
