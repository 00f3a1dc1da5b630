//! The exploration as a COLMAP text model (pixel centres at half integers there, hence + 0.5).

use super::atomic::{WriteError, write_atomic};
use crate::camera::{CameraModel, Lens};
use crate::template::Template;
use std::path::Path;

pub(super) fn write(folder: &Path, template: &Template) -> Result<(), WriteError> {
    if let Some(camera) = &template.camera {
        write_atomic(&folder.join("cameras.txt"), |w| {
            writeln!(w, "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]")?;
            writeln!(w, "1 {}", camera_line(camera))
        })?;
    }
    write_atomic(&folder.join("images.txt"), |w| {
        writeln!(w, "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME")?;
        writeln!(w, "# POINTS2D[] as (X, Y, POINT3D_ID)")?;
        for (k, view) in template.views.iter().enumerate() {
            let (q, t) = (
                view.camera_from_template.rotation.quaternion(),
                view.camera_from_template.translation.vector,
            );
            write!(w, "{} {} {} {} {} ", k + 1, q.w, q.i, q.j, q.k)?;
            writeln!(w, "{} {} {} 1 {}\n", t.x, t.y, t.z, view.name)?;
        }
        Ok(())
    })?;
    write_atomic(&folder.join("points3D.txt"), |w| {
        writeln!(w, "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)")
    })
}

fn camera_line(camera: &CameraModel) -> String {
    let [w, h] = camera.size;
    let ([fx, fy], [cx, cy]) = (camera.focal, camera.centre.map(|c| c + 0.5));
    let pinhole = format!("{w} {h} {fx} {fy} {cx} {cy}");
    match camera.lens {
        Lens::Pinhole => format!("PINHOLE {pinhole}"),
        Lens::BrownConrady { k: [k1, k2, 0.0], p: [p1, p2] } => {
            format!("OPENCV {pinhole} {k1} {k2} {p1} {p2}")
        }
        Lens::BrownConrady { k: [k1, k2, k3], p: [p1, p2] } => {
            format!("FULL_OPENCV {pinhole} {k1} {k2} {p1} {p2} {k3} 0 0 0")
        }
        Lens::KannalaBrandt { k: [k1, k2, k3, k4] } => {
            format!("OPENCV_FISHEYE {pinhole} {k1} {k2} {k3} {k4}")
        }
    }
}
