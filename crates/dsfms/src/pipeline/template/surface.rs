//! The surface that stereo saw, as the template's mesh.

use super::{Exploration, FoundOrgan, TemplateError, TemplateOptions, click, named, outline};
use crate::camera::{Camera, CameraModel};
use crate::dense::{
    DenseOptions, DenseSurface, DepthMap, PosedFrame, depth_maps, labelling, outlines,
    surface as fused, worthwhile,
};
use crate::geometry::{Isometry, Point2, Point3};
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
    /// See [`super::BuiltTemplate::organ`].
    pub organ: Option<FoundOrgan>,
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
    let named = named(exploration.frames, poses);
    let open = !told(&posed, options);
    let stereo = |posed: &[PosedFrame]| depth_maps(posed, points, &dense, &report);
    let mut seen = None;
    if open && options.click.is_some() {
        seen = Some(fused(&posed, &stereo(&posed)?, &dense)?);
    }
    let alone = seen.as_ref().is_some_and(|seen| piece_alone(&seen.mesh, camera, &named, options));
    let mut found = None;
    if open && !alone {
        let coarse = coarser(&posed, &dense);
        let report = |done, total| progress.step("coarse stereo", done, total);
        let maps = depth_maps(&posed, points, &coarse, &report)?;
        found = organ(&posed, &maps, &named, options, progress)?;
        seen = None;
    }
    if let Some(found) = found.as_ref().filter(|found| found.taken) {
        posed.retain_mut(|view| {
            let own = found.masks.iter().find(|(name, _)| *name == view.frame.name);
            view.organ = own.map(|(_, organ)| organ);
            view.organ.is_some()
        });
    }
    let seen = match seen {
        Some(seen) => seen,
        None => {
            let maps = stereo(&posed)?;
            progress.step("surface", 0, 2);
            fused(&posed, &maps, &dense)?
        }
    };
    progress.step("surface", 1, 2);
    let fine = outline::trim(seen.mesh.clone(), camera, &named, &options.outlines)?;
    let fine = click::pick(fine, camera, &named, options.click.as_ref())?;
    let mut mesh = remesh(&fine, options.vertices, &options.remesh)?;
    if options.fit_diagonals {
        mesh = fit_diagonals(&mesh, &fine);
    }
    let sigma = expected_errors(&seen, &mesh);
    progress.step("surface", 2, 2);
    Ok(Surface { mesh, sigma, organ: found })
}

/// Stereo on a quarter of the frames' width and height (a surface is seen on half), or less of large frames:
/// enough to tell the organ from what lies behind.
fn coarser(posed: &[PosedFrame], options: &DenseOptions) -> DenseOptions {
    let few = |view: &PosedFrame| (view.frame.rgb.len() / 16).min(COARSE);
    let pixels = posed.iter().map(few).sum::<usize>().max(1000);
    DenseOptions { max_pixels: pixels.min(options.max_pixels), ..options.clone() }
}

/// Depth pixels of a frame, at most: about as many as the labelling looks at.
const COARSE: usize = 20_000;

/// Whether the user says in every frame where the organ ends, or wants everything.
fn told(posed: &[PosedFrame], options: &TemplateOptions) -> bool {
    let masks = posed.iter().all(|view| view.organ.is_some());
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

/// Where the organ ends before something else (the wall of a cavity). It is what was clicked, what masks of some
/// frames show, or else what the frames look at; and then it is taken only if depth steps where it ends.
fn organ(
    posed: &[PosedFrame],
    maps: &[DepthMap],
    named: &[(&str, Isometry)],
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Result<Option<FoundOrgan>, TemplateError> {
    let Some(first) = posed.first() else { return Ok(None) };
    let clicked = match &options.click {
        Some(click) => {
            let (name, pose) = click.frame_of(named)?;
            let beside = || {
                let frame = name.to_string();
                TemplateError::ClickBeside { frame, pixel: click.pixel }
            };
            Some(shown_at(maps, first.camera, &pose, &click.pixel).ok_or_else(beside)?)
        }
        None => None,
    };
    progress.step("organ", 0, 1);
    let found = labelling(posed, maps, clicked.as_ref());
    let said = clicked.is_some() || posed.iter().any(|view| view.organ.is_some());
    if !said && found.stepping < STEPPING {
        return Ok(None);
    }
    let outlines = outlines(&found.masks, posed, maps);
    progress.step("organ", 1, 1);
    let shown = posed.iter().zip(outlines).filter(|(_, mask)| mask.data.contains(&true));
    let masks: Vec<_> = shown.map(|(view, mask)| (view.frame.name.clone(), mask)).collect();
    let taken = masks.len() >= 2 && (said || found.marked >= MARKED);
    if !said {
        let percent = 100.0 * found.marked;
        progress.warn(&match taken {
            true => format!(
                "no mask says where the organ is: it is what the frames look at ({percent:.0} % of its outline is \
                 marked by depth, a fold or the image); --organ-click, --organ-masks or --organ-polygon tell \
                 otherwise, --whole keeps all"
            ),
            false => format!(
                "whether the organ ends within the frames is open: only {percent:.0} % of what may be its outline is \
                 marked by depth, a fold or the image, so that all is kept; look at the outlines found, and say \
                 --organ-click or --organ-masks if they are right, --whole if all is the organ"
            ),
        });
    }
    Ok(Some(FoundOrgan { masks, stepping: found.stepping, marked: found.marked, taken }))
}

/// Shares of the outline found: where depth steps along less, all is one surface; where more is marked, it is the
/// organ's. On nine generated scenes they are 0.5 to 0.8 and 0.97 to 0.99; where one smooth surface fills the
/// frames nothing is found.
const STEPPING: f64 = 0.2;
const MARKED: f64 = 0.8;
/// A point is shown at a pixel where it projects as near, px.
const NEAR_PX: f64 = 3.0;

/// The point (world axes) that a frame shows at a pixel, by the depth maps: the nearest quarter of what
/// projects there.
fn shown_at(
    maps: &[DepthMap],
    camera: &CameraModel,
    pose: &Isometry,
    pixel: &Point2,
) -> Option<Point3> {
    let there = |point: Point3| -> Option<(f64, Point3)> {
        let p = pose * point;
        let off = camera.project(&p)?.pixel - pixel;
        (off.norm() < NEAR_PX).then_some((p.z, point))
    };
    let mut shown: Vec<(f64, Point3)> =
        maps.par_iter().flat_map_iter(DepthMap::points).filter_map(there).collect();
    shown.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    shown.get(shown.len() / 4).map(|s| s.1)
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
