//! The surface that stereo saw, as the template's mesh.

use super::{Exploration, TemplateError, TemplateOptions, click, named, outline};
use crate::camera::CameraModel;
use crate::dense::{
    DenseOptions, DenseSurface, DepthMap, PosedFrame, depth_maps, outlines, parts,
    surface as fused, worthwhile,
};
use crate::geometry::{Isometry, Point3};
use crate::image::Mask;
use crate::mesh::Mesh;
use crate::mesh::remesh::{fit_diagonals, remesh};
use crate::mesh::surface_points::ClosestPoints;
use crate::pipeline::Progress;
use rayon::prelude::*;

/// The mesh of a template and how well its place is known.
pub(super) struct Surface {
    pub mesh: Mesh,
    /// See [`crate::template::Template::sigma`].
    pub sigma: Vec<f64>,
}

/// Stereo on the registered frames, the organ of what it saw, remeshed. `points` are those of
/// structure from motion, `poses` one a frame.
pub(super) fn dense_mesh(
    exploration: &Exploration,
    camera: &CameraModel,
    poses: &[Option<Isometry>],
    points: &[Point3],
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Result<Surface, TemplateError> {
    let posed = posed(exploration, camera, poses);
    let report = |done, total| progress.step("stereo", done, total);
    let dense = DenseOptions {
        // Which piece is the organ the user says, if anybody: it need not be the largest.
        largest_only: options.dense.largest_only
            && options.outlines.is_empty()
            && options.click.is_none(),
        ..options.dense.clone()
    };
    let mut posed = worthwhile(&posed, points, &dense);
    let mut maps = depth_maps(&posed, points, &dense, &report)?;
    let named = named(exploration.frames, poses);
    progress.step("surface", 0, 2);
    let open = !told(exploration, options);
    let clicked = (open && options.click.is_some()).then(|| fused(&posed, &maps, &dense));
    let mut seen = clicked.transpose()?;
    let alone = seen.as_ref().is_some_and(|seen| piece_alone(&seen.mesh, camera, &named, options));
    let outlines = match open && !alone {
        true => organ(&posed, &maps, &named, options, progress)?,
        false => Vec::new(),
    };
    if !outlines.is_empty() {
        let within = |(i, organ)| PosedFrame { organ: Some(organ), ..posed[i] };
        posed = outlines.iter().map(|(i, organ)| within((*i, organ))).collect();
        maps = depth_maps(&posed, points, &dense, &report)?;
        seen = None;
        progress.step("surface", 0, 2);
    }
    let seen = seen.map_or_else(|| fused(&posed, &maps, &dense), Ok)?;
    progress.step("surface", 1, 2);
    let fine = outline::trim(seen.mesh.clone(), camera, &named, &options.outlines)?;
    let fine = click::pick(fine, camera, &named, options.click.as_ref())?;
    let mut mesh = remesh(&fine, options.vertices, &options.remesh)?;
    if options.fit_diagonals {
        mesh = fit_diagonals(&mesh, &fine);
    }
    let sigma = expected_errors(&seen, &mesh);
    progress.step("surface", 2, 2);
    Ok(Surface { mesh, sigma })
}

/// Whether the user says where the organ ends, or wants everything.
fn told(exploration: &Exploration, options: &TemplateOptions) -> bool {
    let masks = exploration.organ.iter().any(Option::is_some);
    masks || !options.outlines.is_empty() || (options.whole && options.click.is_none())
}

/// Whether the piece clicked is the smaller part of what was seen and hangs on nothing else: its own rim is
/// then nearer the truth than an outline found in images.
fn piece_alone(
    seen: &Mesh,
    camera: &CameraModel,
    named: &[(&str, Isometry)],
    options: &TemplateOptions,
) -> bool {
    let smaller = |piece: Mesh| 2 * piece.topology.faces.len() < seen.topology.faces.len();
    click::pick(seen.clone(), camera, named, options.click.as_ref()).is_ok_and(smaller)
}

/// Where what was seen parts (an organ before the wall of a cavity), the frames that show the organ, by their
/// number, and its outline in each: stereo then knows no other surface, and the rim is held by the outlines.
/// The organ is the part clicked, else the one in the middle of the frames. Empty where all is one.
fn organ(
    posed: &[PosedFrame],
    maps: &[DepthMap],
    named: &[(&str, Isometry)],
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Result<Vec<(usize, Mask)>, TemplateError> {
    let found = parts(posed, maps, &options.dense)?;
    let (Some(first), true) = (posed.first(), found.count() > 1) else { return Ok(Vec::new()) };
    let part = match &options.click {
        Some(click) => found.at(first.camera, &click.frame_of(named)?.1, &click.pixel),
        None => {
            let count = found.count();
            progress.warn(&format!(
                "the surface falls into {count} parts where depth steps; the one in the middle of the \
                 frames is the organ (--organ-click names another, --organ-masks or --organ-polygon \
                 its outline, --whole keeps all)"
            ));
            Some(found.central(posed))
        }
    };
    let Some(part) = part else { return Ok(Vec::new()) };
    let masks = outlines(&found, part, posed, maps).into_iter().enumerate();
    let shown: Vec<_> = masks.filter(|(_, mask)| mask.data.contains(&true)).collect();
    Ok(if shown.len() < 2 { Vec::new() } else { shown })
}

fn posed<'a>(
    exploration: &'a Exploration,
    camera: &'a CameraModel,
    poses: &[Option<Isometry>],
) -> Vec<PosedFrame<'a>> {
    let one = |(i, pose): (usize, &Option<Isometry>)| {
        Some(PosedFrame {
            frame: &exploration.frames[i],
            camera,
            pose: (*pose)?,
            valid: exploration.valid.get(i).and_then(Option::as_ref),
            organ: exploration.organ.get(i).and_then(Option::as_ref),
        })
    };
    poses.iter().enumerate().filter_map(one).collect()
}

/// Standard deviation of what was seen where each vertex lies on it, length units; infinity where no
/// depth map agrees with a corner there.
fn expected_errors(seen: &DenseSurface, mesh: &Mesh) -> Vec<f64> {
    let surface = ClosestPoints::new(&seen.mesh);
    let at = |p: &Point3| {
        let Some(place) = surface.closest(p) else { return f64::INFINITY };
        let corners = seen.mesh.topology.faces[place.face as usize];
        let weighed = corners.iter().zip(place.barycentric).filter(|(_, w)| *w > 0.0);
        weighed.map(|(&v, w)| w * seen.support[v as usize].sigma).sum()
    };
    mesh.positions.par_iter().map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::VertexSupport;
    use crate::mesh::shapes;

    #[test]
    fn errors_are_read_between_the_vertices_of_what_was_seen() {
        let seen = shapes::mesh(
            [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
                .map(|[x, y]| Point3::new(x, y, 0.0))
                .to_vec(),
            vec![[0, 1, 2], [1, 3, 2]],
        );
        let sigmas = [0.1, 0.3, 0.5, f64::INFINITY];
        let support = sigmas.map(|sigma| VertexSupport { frames: 1, sigma }).to_vec();
        let seen = DenseSurface { mesh: seen, support };
        let at = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let corners = vec![at(0.0, 0.0), at(0.5, 0.0), at(0.25, 0.5), at(0.9, 0.9)];
        let mesh = shapes::mesh(corners, vec![[0, 1, 2], [1, 3, 2]]);
        let found = expected_errors(&seen, &mesh);
        for (found, wanted) in found.iter().zip([0.1, 0.2, 0.35]) {
            assert!((found - wanted).abs() < 1e-12, "{found} {wanted}");
        }
        assert_eq!(found[3], f64::INFINITY);
    }
}
