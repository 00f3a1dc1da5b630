//! The organ as outlined by hand on a frame.

use super::error::TemplateError;
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point2, Point3};
use crate::image::Mask;
use crate::image::names::position_named;
use crate::mesh::Mesh;
use crate::mesh::components::components;
use crate::raster::rasterize;
use serde::{Deserialize, Serialize};

/// A polygon around the organ in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OrganOutline {
    /// Name of the frame.
    pub frame: String,
    /// Corners, px, pixel centres at integers.
    pub corners: Vec<Point2>,
}

/// Least share of the outlines that the organ's surface fills.
const MIN_COVERED: f64 = 0.5;

/// Faces that project inside every outline, and of their connected pieces the one that the outlined
/// frames see most of: what lies behind the organ, or where no outlined frame looks, is left out.
/// `poses`: name and `camera_from_world` of the registered frames.
pub(super) fn trim(
    mesh: Mesh,
    camera: &CameraModel,
    poses: &[(&str, Isometry)],
    outlines: &[OrganOutline],
) -> Result<Mesh, TemplateError> {
    let faces = mesh.topology.faces.len();
    let (mut inside, mut seen, mut outlined) = (vec![true; faces], vec![0u32; faces], 0);
    for outline in outlines {
        let Some(at) = position_named(poses.iter().map(|p| p.0), &outline.frame) else {
            return Err(TemplateError::OutlineFrame { frame: outline.frame.clone() });
        };
        let pose = &poses[at].1;
        let polygon = Mask::polygon(camera.size, &outline.corners);
        outlined += polygon.data.iter().filter(|&&p| p).count();
        let positions: Vec<Point3> = mesh.positions.iter().map(|p| pose * p).collect();
        let within = |&v: &u32| {
            camera.project(&positions[v as usize]).is_some_and(|q| polygon.at_pixel(&q.pixel))
        };
        for (inside, face) in inside.iter_mut().zip(&mesh.topology.faces) {
            *inside &= face.iter().all(within);
        }
        for face in rasterize(camera, &mesh.topology, &positions).face {
            if let Some(seen) = seen.get_mut(face as usize) {
                *seen += 1;
            }
        }
    }
    if outlines.is_empty() {
        return Ok(mesh);
    }
    let kept: Vec<usize> = (0..faces).filter(|&f| inside[f]).collect();
    let (part, _) = mesh.subset(&kept);
    let pieces = components(&part.topology);
    let mut pixels = vec![0u32; pieces.count];
    for (&piece, &f) in pieces.of_face.iter().zip(&kept) {
        pixels[piece as usize] += seen[f];
    }
    // Of equal pieces the first.
    let most = (0..pieces.count).max_by_key(|&p| (pixels[p], std::cmp::Reverse(p)));
    // Another surface must not pass for the organ where that was not reconstructed.
    let covered = most.map_or(0.0, |p| f64::from(pixels[p]) / outlined.max(1) as f64);
    let Some(most) = most.filter(|_| covered >= MIN_COVERED) else {
        return Err(TemplateError::EmptyOutline { percent: 100.0 * covered });
    };
    let own = |f: &usize| pieces.of_face[*f] as usize == most;
    Ok(part.subset(&(0..kept.len()).filter(own).collect::<Vec<_>>()).0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// Two square plates that face the camera: a near one, and a wider one behind it.
    fn plates() -> Mesh {
        let plate = |half: f64, z: f64| {
            let p = |x: f64, y: f64| Point3::new(half * x, half * y, z);
            [p(-1., -1.), p(1., -1.), p(1., 1.), p(-1., 1.)]
        };
        let positions = [plate(2.0, 10.0), plate(2.5, 20.0), plate(1.0, 30.0)].concat();
        let faces = (0..3).flat_map(|k| [[0, 2, 1], [0, 3, 2]].map(|f| f.map(|v| v + 4 * k)));
        shapes::mesh(positions, faces.collect())
    }

    #[test]
    fn the_nearest_surface_inside_the_outline_stays() {
        let camera = CameraModel::pinhole([101, 101], [100.0; 2], [50.0; 2]);
        let poses = [("a", Isometry::identity())];
        let square = |low: f64, high: f64| OrganOutline {
            frame: "a.png".into(),
            corners: [[low, low], [high, low], [high, high], [low, high]]
                .map(Point2::from)
                .to_vec(),
        };
        let kept = trim(plates(), &camera, &poses, &[square(25.0, 75.0)]).unwrap();
        assert_eq!(kept.topology.faces.len(), 2);
        assert!(kept.positions.iter().all(|p| p.z == 10.0));
        assert_eq!(trim(plates(), &camera, &poses, &[]).unwrap().topology.faces.len(), 6);
        let nothing = trim(plates(), &camera, &poses, &[square(1.0, 5.0)]);
        assert!(matches!(nothing, Err(TemplateError::EmptyOutline { .. })));
        let other = OrganOutline { frame: "b".into(), ..square(25.0, 75.0) };
        let missing = trim(plates(), &camera, &poses, &[other]);
        assert!(missing.unwrap_err().to_string().contains("\"b\""));
    }
}
