//! The metric scale of a reconstruction from frames: distances that the user knows.

use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point2, Point3, Vector3};
use crate::image::names::position_named;
use crate::mesh::Mesh;
use serde::{Deserialize, Serialize};

/// Something of known length.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ScaleReference {
    /// Two points of the surface and their straight distance, mm.
    Points {
        /// One end.
        from: PickedPoint,
        /// The other end.
        to: PickedPoint,
        /// Their distance, mm.
        millimetres: f64,
    },
    /// How far the camera moved between two frames, mm.
    CameraStep {
        /// Names of the two frames.
        frames: [String; 2],
        /// Distance of the two camera centres, mm.
        millimetres: f64,
    },
}

/// A point of the surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PickedPoint {
    /// What a pixel of a frame shows.
    Pixel {
        /// Name of the frame.
        frame: String,
        /// Pixel, centres at integers.
        pixel: Point2,
    },
    /// A vertex of the mesh, from 0.
    Vertex(usize),
}

/// The scale found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scale {
    /// Millimetres per unit of the reconstruction: geometric mean over the references.
    pub factor: f64,
    /// The factor that each reference alone asks for.
    pub each: Vec<f64>,
}

/// Why a reference gives no scale.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ScaleError {
    /// A distance that is none.
    #[error("a reference distance is {0} mm; expected a positive number")]
    Distance(f64),
    /// A frame that was not given or not registered.
    #[error("frame {0:?} of the scale reference is not among the registered frames: {1}")]
    NoFrame(String, String),
    /// A pixel beside the surface.
    #[error(
        "pixel {:.1},{:.1} of frame {frame:?} does not show the reconstructed surface; pick a point on it", pixel.x, pixel.y
    )]
    Beside {
        /// Name of the frame.
        frame: String,
        /// The pixel.
        pixel: Point2,
    },
    /// A vertex that the mesh does not have.
    #[error("vertex {vertex} of the scale reference does not exist; the mesh has {count}")]
    NoVertex {
        /// The vertex asked for.
        vertex: usize,
        /// Vertices of the mesh.
        count: usize,
    },
    /// The metric surface fits nowhere.
    #[error(
        "the reconstructed surface fits the metric mesh nowhere: the best placement is off by {:.0} % of its size; is it the same organ?", 100.0 * misfit
    )]
    NoFit {
        /// Root mean square distance over the size of the reconstruction.
        misfit: f64,
    },
    /// The metric surface fits at scales that differ.
    #[error(
        "the reconstructed surface fits the metric mesh as well at {ratio:.2} times the scale: its shape tells no one place; give a known distance (points or a camera step)"
    )]
    TwoScales {
        /// The other scale over that of the best placement.
        ratio: f64,
    },
    /// The two ends coincide in the reconstruction.
    #[error(
        "the two ends of a scale reference coincide in the reconstruction; take points, or frames, further apart"
    )]
    Coincide,
}

/// What was reconstructed, in its own unit.
#[derive(Clone, Copy, Debug)]
pub struct ScaleScene<'a> {
    /// The surface, world axes.
    pub mesh: &'a Mesh,
    /// Camera of all frames.
    pub camera: &'a CameraModel,
    /// Name and `camera_from_world` of every registered frame.
    pub poses: &'a [(&'a str, Isometry)],
}

/// Millimetres per unit; `None` without references.
///
/// # Errors
/// A reference that cannot be found in the scene, or whose length makes no sense.
#[doc(alias = "metric scale")]
pub(crate) fn find_scale(
    scene: &ScaleScene,
    references: &[ScaleReference],
) -> Result<Option<Scale>, ScaleError> {
    let each = references.iter().map(|r| scene.factor(r)).collect::<Result<Vec<f64>, _>>()?;
    if each.is_empty() {
        return Ok(None);
    }
    let logarithm = each.iter().map(|f| f.ln()).sum::<f64>() / each.len() as f64;
    Ok(Some(Scale { factor: logarithm.exp(), each }))
}

impl ScaleScene<'_> {
    fn factor(&self, reference: &ScaleReference) -> Result<f64, ScaleError> {
        let (a, b, millimetres) = match reference {
            ScaleReference::Points { from, to, millimetres } => {
                (self.picked(from)?, self.picked(to)?, *millimetres)
            }
            ScaleReference::CameraStep { frames: [a, b], millimetres } => {
                let centre =
                    |name: &str| Ok(self.pose(name)?.inverse_transform_point(&Point3::origin()));
                (centre(a)?, centre(b)?, *millimetres)
            }
        };
        if !(millimetres.is_finite() && millimetres > 0.0) {
            return Err(ScaleError::Distance(millimetres));
        }
        let factor = millimetres / (b - a).norm();
        if factor.is_finite() { Ok(factor) } else { Err(ScaleError::Coincide) }
    }

    /// The frame of that name, with or without the ending of an image file.
    fn pose(&self, name: &str) -> Result<Isometry, ScaleError> {
        let found = position_named(self.poses.iter().map(|p| p.0), name);
        found.map(|at| self.poses[at].1).ok_or_else(|| {
            let names: Vec<&str> = self.poses.iter().map(|p| p.0).collect();
            ScaleError::NoFrame(name.to_string(), names.join(", "))
        })
    }

    /// Place of a picked point in world axes.
    fn picked(&self, point: &PickedPoint) -> Result<Point3, ScaleError> {
        let positions = &self.mesh.positions;
        match point {
            PickedPoint::Vertex(vertex) => positions
                .get(*vertex)
                .copied()
                .ok_or(ScaleError::NoVertex { vertex: *vertex, count: positions.len() }),
            PickedPoint::Pixel { frame, pixel } => {
                let pose = self.pose(frame)?;
                let ray = self.camera.unproject(pixel).map(|ray| pose.rotation.inverse() * ray);
                let origin = pose.inverse_transform_point(&Point3::origin());
                ray.and_then(|ray| first_hit(self.mesh, &origin, &ray))
                    .ok_or(ScaleError::Beside { frame: frame.clone(), pixel: *pixel })
            }
        }
    }
}

/// The first point of the surface along a ray (Möller and Trumbore 1997).
fn first_hit(mesh: &Mesh, origin: &Point3, ray: &Vector3) -> Option<Point3> {
    let hit = |f: usize| -> Option<f64> {
        let [a, b, c] = mesh.corners(f);
        let (e1, e2, s) = (b - a, c - a, origin - a);
        let p = ray.cross(&e2);
        let inverse = 1.0 / e1.dot(&p);
        let u = s.dot(&p) * inverse;
        let q = s.cross(&e1);
        let v = ray.dot(&q) * inverse;
        let t = e2.dot(&q) * inverse;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t.is_finite()).then_some(t)
    };
    let nearest = (0..mesh.topology.faces.len()).filter_map(hit).min_by(f64::total_cmp)?;
    Some(origin + ray * nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    fn scene(check: impl Fn(&ScaleScene)) {
        let p = |x: f64, y: f64| Point3::new(x, y, 10.0);
        let mesh = shapes::mesh(
            vec![p(-5., -5.), p(5., -5.), p(5., 5.), p(-5., 5.)],
            vec![[0, 2, 1], [0, 3, 2]],
        );
        let camera = CameraModel::pinhole([101, 101], [100.0; 2], [50.0; 2]);
        let poses = [("a.b", Isometry::identity()), ("c", Isometry::translation(-3.0, 4.0, 0.0))];
        check(&ScaleScene { mesh: &mesh, camera: &camera, poses: &poses });
    }

    fn pixel(frame: &str, x: f64, y: f64) -> PickedPoint {
        PickedPoint::Pixel { frame: frame.into(), pixel: Point2::new(x, y) }
    }

    #[test]
    fn pixels_vertices_and_camera_steps() {
        scene(|scene| {
            // At depth 10 a pixel is 0.1 wide: 20 px are 2 units.
            let points = ScaleReference::Points {
                from: pixel("a.b.png", 40.0, 50.0),
                to: pixel("a.b", 60.0, 50.0),
                millimetres: 5.0,
            };
            let step = ScaleReference::CameraStep {
                frames: ["a.b".into(), "c".into()],
                millimetres: 50.0,
            };
            let side = ScaleReference::Points {
                from: PickedPoint::Vertex(0),
                to: PickedPoint::Vertex(1),
                millimetres: 10.0,
            };
            let found = find_scale(scene, &[points, step, side]).unwrap().unwrap();
            for (f, expected) in found.each.iter().zip([2.5, 10.0, 1.0]) {
                assert!((f - expected).abs() < 1e-12);
            }
            assert!((found.factor - 25f64.cbrt()).abs() < 1e-12);
            assert_eq!(find_scale(scene, &[]), Ok(None));
        });
    }

    #[test]
    fn what_cannot_be_measured_is_said() {
        scene(|scene| {
            let points = |from, to, millimetres| {
                let r = ScaleReference::Points { from, to, millimetres };
                find_scale(scene, &[r]).unwrap_err()
            };
            let (a, v) = (|| pixel("a.b", 50.0, 50.0), PickedPoint::Vertex);
            assert!(matches!(
                points(a(), pixel("a.b", 0.0, 110.0), 1.0),
                ScaleError::Beside { .. }
            ));
            assert!(points(a(), pixel("d", 0.0, 0.0), 1.0).to_string().contains("a.b, c"));
            assert_eq!(points(v(0), v(4), 1.0), ScaleError::NoVertex { vertex: 4, count: 4 });
            assert_eq!(points(v(0), v(0), 1.0), ScaleError::Coincide);
            assert_eq!(points(v(0), v(1), -1.0), ScaleError::Distance(-1.0));
        });
    }
}
