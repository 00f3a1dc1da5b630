//! The surface that stereo saw, as the template's mesh.

use super::error::TemplateError;
use super::exploration::Exploration;
use super::found_organ::{FoundOrgan, ToldOrgan};
use super::options::TemplateOptions;
use super::registered::{RegisteredFrames, named, posed};
use super::{kept, outline};
use crate::checkpoint::Keep;
use crate::dense::{DenseOptions, DenseSurface, DepthMap, PosedFrame, surface, worthwhile};
use crate::geometry::Point3;
use crate::mesh::Mesh;
use crate::mesh::remesh::{fit_diagonals, remesh};
use crate::mesh::surface_points::ClosestPoints;
use crate::pipeline::{Progress, logging};
use crate::sfm::SparseReconstruction;
use rayon::prelude::*;

/// The mesh of a template and how well its place is known.
pub(super) struct StereoSurface {
    pub mesh: Mesh,
    /// See [`crate::template::Template::sigma`].
    pub sigma: Vec<f64>,
    /// What the frames tell of the organ, and what is around it.
    pub told: ToldOrgan,
}

/// Stereo on the registered frames, the organ of what it saw, remeshed. `points` are those of
/// structure from motion.
pub(super) fn dense_mesh(
    exploration: &Exploration,
    sparse: &SparseReconstruction,
    points: &[Point3],
    options: &TemplateOptions,
    progress: &dyn Progress,
    keep: Keep,
) -> Result<StereoSurface, TemplateError> {
    let dense = DenseOptions {
        largest_only: options.dense.largest_only && !options.organ.names_a_piece(),
        ..options.dense.for_template(options.vertices)
    };
    let (camera, poses) = (&sparse.camera, &sparse.poses);
    let scene = RegisteredFrames {
        exploration,
        sparse,
        camera,
        views: worthwhile(&posed(exploration, camera, poses), points, &dense),
        points,
        named: named(exploration.frames, poses),
        options,
        progress,
    };
    logging::views(&scene.views, scene.named.len(), dense.max_frames);
    let told = scene.organ(&dense)?;
    let views = match told.organ.as_ref().filter(|organ| organ.taken) {
        Some(organ) => shown(&scene.views, organ),
        None => scene.views.clone(),
    };
    let whole = |maps: &Vec<DepthMap>| kept::whole_maps(maps, views.len());
    let maps = keep.stage("depth", Vec::len, whole, || scene.stereo(&views, &dense, "stereo"))?;
    logging::maps(&views, &maps, progress);
    progress.step("surface", 0, 2);
    let seen = surface(&views, &maps, &dense)?;
    progress.step("surface", 1, 2);
    let fine = outline::trim(seen.mesh.clone(), camera, &scene.named, options.organ.outlines())?;
    let fine = scene.piece(fine)?;
    let mut mesh = remesh(&fine, options.vertices, &options.remesh)?;
    if options.fit_diagonals {
        mesh = fit_diagonals(&mesh, &fine);
    }
    let sigma = expected_errors(&seen, &mesh);
    tracing::info!(
        seen_faces = seen.mesh.topology.faces.len(),
        kept_faces = fine.topology.faces.len(),
        vertices = mesh.positions.len(),
        edge = mesh.mean_edge_length(),
        "surface"
    );
    progress.step("surface", 2, 2);
    Ok(StereoSurface { mesh, sigma, told })
}

/// The views that show the organ, with the outlines found.
fn shown<'a>(views: &[PosedFrame<'a>], organ: &'a FoundOrgan) -> Vec<PosedFrame<'a>> {
    let own = |view: &PosedFrame<'a>| {
        let (_, mask) = organ.guess.masks.iter().find(|(name, _)| *name == view.frame.name)?;
        Some(PosedFrame { organ: Some(mask), ..*view })
    };
    views.iter().filter_map(own).collect()
}

/// Standard deviation of what was seen where each vertex lies on it, length units; infinity where
/// no depth map agrees with a corner there.
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
