//! The organ as clicked on a frame.

use super::error::TemplateError;
use crate::camera::{Camera, CameraModel};
use crate::dense::DepthMap;
use crate::geometry::{Isometry, Point2, Point3};
use crate::image::names::position_named;
use crate::mesh::Mesh;
use crate::mesh::components::components;
use crate::raster::rasterize;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A pixel that shows the organ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OrganClick {
    /// Name of the frame; `None` = the first registered one.
    pub frame: Option<String>,
    /// Pixel, centres at integers.
    pub pixel: Point2,
}

/// Name and pose of a frame, of those registered; `None` = the first.
pub(super) fn frame_named<'a>(
    frame: Option<&str>,
    poses: &[(&'a str, Isometry)],
) -> Result<(&'a str, Isometry), TemplateError> {
    let at = frame.map_or(Some(0), |name| position_named(poses.iter().map(|p| p.0), name));
    let found = at.and_then(|at| poses.get(at)).copied();
    found.ok_or_else(|| TemplateError::OutlineFrame { frame: frame.unwrap_or_default().into() })
}

/// A point is shown at a pixel where it projects as near, px.
const NEAR_PX: f64 = 3.0;

/// The points (world axes) that a frame shows at some pixels, by the depth maps: of what projects
/// to each the one that a quarter lies before. Pixels that show nothing have none.
pub(super) fn shown_at(
    maps: &[DepthMap],
    camera: &CameraModel,
    pose: &Isometry,
    pixels: &[Point2],
) -> Vec<Point3> {
    let projected = |point: Point3| -> Option<(Point2, f64, Point3)> {
        let p = pose * point;
        Some((camera.project(&p)?.pixel, p.z, point))
    };
    let all: Vec<_> =
        maps.par_iter().flat_map_iter(DepthMap::points).filter_map(projected).collect();
    let shown = |pixel: &Point2| {
        let near = all.iter().filter(|(at, ..)| (at - pixel).norm() < NEAR_PX);
        let mut near: Vec<(f64, Point3)> = near.map(|&(_, z, point)| (z, point)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.get(near.len() / 4).map(|near| near.1)
    };
    pixels.par_iter().filter_map(shown).collect()
}

/// The connected piece of the surface that the pixel shows. Pieces part where depth jumps; where
/// the organ touches its neighbour only an outline tells them apart. `poses`: name and
/// `camera_from_world` of the registered frames.
pub(super) fn pick(
    mesh: Mesh,
    camera: &CameraModel,
    poses: &[(&str, Isometry)],
    click: Option<&OrganClick>,
) -> Result<Mesh, TemplateError> {
    let Some(click) = click else { return Ok(mesh) };
    let (name, pose) = frame_named(click.frame.as_deref(), poses)?;
    let positions: Vec<Point3> = mesh.positions.iter().map(|p| pose * p).collect();
    let raster = rasterize(camera, &mesh.topology, &positions);
    let Some((face, _)) = raster.surface_at(&click.pixel) else {
        let frame = name.to_string();
        return Err(TemplateError::ClickBeside { frame, pixel: click.pixel });
    };
    let pieces = components(&mesh.topology).of_face;
    let own = |f: &usize| pieces[*f] == pieces[face as usize];
    Ok(mesh.subset(&(0..pieces.len()).filter(own).collect::<Vec<_>>()).0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn the_clicked_piece_stays() {
        let camera = CameraModel::pinhole([101, 101], [100.0; 2], [50.0; 2]);
        // A small plate at depth 10 on the left, a larger one behind it.
        let p = Point3::new;
        let near = [p(-3., -1., 10.), p(-1., -1., 10.), p(-1., 1., 10.), p(-3., 1., 10.)];
        let far = [p(-8., -8., 20.), p(8., -8., 20.), p(8., 8., 20.), p(-8., 8., 20.)];
        let faces = vec![[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]];
        let mesh = shapes::mesh([near, far].concat(), faces);
        let poses = [("a", Isometry::identity())];
        let at = |x: f64, y: f64, frame: Option<&str>| {
            let click = OrganClick { frame: frame.map(str::to_string), pixel: Point2::new(x, y) };
            pick(mesh.clone(), &camera, &poses, Some(&click))
        };
        let depth = |found: Result<Mesh, TemplateError>| found.unwrap().positions[0].z;
        assert_eq!(depth(at(30.0, 50.0, None)), 10.0);
        assert_eq!(depth(at(60.0, 50.0, Some("a.png"))), 20.0);
        assert!(matches!(at(1.0, 1.0, None), Err(TemplateError::ClickBeside { .. })));
        assert!(at(1.0, 1.0, Some("b")).unwrap_err().to_string().contains("\"b\""));
    }
}
