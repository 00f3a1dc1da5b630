//! The text form: `#` starts a comment line.

use super::super::atomic::{WriteError, write_atomic};
use super::super::error::{InputError, read_text};
use super::camera;
use super::model::{ColmapCamera, ColmapImage, ColmapModel, ColmapPoint};
use crate::geometry::{Isometry, Point2, Point3};
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use std::path::Path;
use std::str::FromStr;

const CAMERA: &str = "COLMAP's CAMERA_ID MODEL WIDTH HEIGHT PARAMS";
const IMAGE: &str = "COLMAP's IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME";
const POINT: &str = "COLMAP's POINT3D_ID X Y Z R G B ERROR and a track of IMAGE_ID POINT2D_IDX";

pub(super) fn read_cameras(path: &Path) -> Result<Vec<ColmapCamera>, InputError> {
    each_line(path, |line| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [id, model, width, height, parameters @ ..] = words.as_slice() else {
            return Err(format!("expected {CAMERA}"));
        };
        let size = [number(width, "WIDTH")?, number(height, "HEIGHT")?];
        let parameters: Result<Vec<f64>, _> = parameters.iter().map(|w| finite(w)).collect();
        let camera = camera::from_colmap(model, size, &parameters?)?;
        Ok(ColmapCamera { id: number(id, "CAMERA_ID")?, camera })
    })
}

pub(super) fn read_points(path: &Path) -> Result<Vec<ColmapPoint>, InputError> {
    each_line(path, |line| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [id, x, y, z, r, g, b, error, track @ ..] = words.as_slice() else {
            return Err(format!("expected {POINT}"));
        };
        let pair = |p: &[&str]| match p {
            [image, index] => Ok((number(image, "IMAGE_ID")?, number(index, "POINT2D_IDX")?)),
            _ => Err("the track has an odd number of entries".to_string()),
        };
        Ok(ColmapPoint {
            id: number(id, "POINT3D_ID")?,
            position: Point3::new(finite(x)?, finite(y)?, finite(z)?),
            rgb: [number(r, "R")?, number(g, "G")?, number(b, "B")?],
            error_px: finite(error)?,
            track: track.chunks(2).map(pair).collect::<Result<_, String>>()?,
        })
    })
}

/// Lines with content that are no comments, in order.
fn each_line<T>(
    path: &Path,
    parse: impl Fn(&str) -> Result<T, String>,
) -> Result<Vec<T>, InputError> {
    let text = read_text(path)?;
    let content = text.lines().enumerate().filter(|(_, line)| {
        let line = line.trim();
        !line.is_empty() && !line.starts_with('#')
    });
    content
        .map(|(i, line)| parse(line).map_err(|problem| InputError::line(path, i + 1, problem)))
        .collect()
}

/// Every image takes a line, and one of its points, which may be empty or missing.
pub(super) fn read_images(path: &Path) -> Result<Vec<ColmapImage>, InputError> {
    let text = read_text(path)?;
    let mut images: Vec<ColmapImage> = Vec::new();
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim_start().starts_with('#')) {
        let wrong = |problem: String| InputError::line(path, i + 1, problem);
        let words: Vec<&str> = line.split_whitespace().collect();
        // Lines of points are triples of numbers; an image's name is none.
        let numbers =
            words.len().is_multiple_of(3) && words.iter().all(|w| w.parse::<f64>().is_ok());
        match images.last_mut().filter(|_| numbers) {
            Some(image) if !words.is_empty() => image.points = points(&words).map_err(wrong)?,
            _ if words.is_empty() => {}
            _ => images.push(image(&words).map_err(wrong)?),
        }
    }
    Ok(images)
}

fn image(words: &[&str]) -> Result<ColmapImage, String> {
    let [id, values @ .., camera] = words.get(..9).ok_or(format!("expected {IMAGE}"))? else {
        return Err(format!("expected {IMAGE}"));
    };
    let values: Vec<f64> = values.iter().map(|w| finite(w)).collect::<Result<_, _>>()?;
    let name = words[9..].join(" ");
    if name.is_empty() {
        return Err(format!("no image name; expected {IMAGE}"));
    }
    let pose = pose(&values, &name)?;
    Ok(ColmapImage {
        id: number(id, "IMAGE_ID")?,
        camera: number(camera, "CAMERA_ID")?,
        name,
        pose,
        points: Vec::new(),
    })
}

/// The motion of QW QX QY QZ TX TY TZ.
pub(super) fn pose(values: &[f64], name: &str) -> Result<Isometry, String> {
    let [qw, qx, qy, qz, tx, ty, tz] = *values else {
        return Err(format!("expected {IMAGE}"));
    };
    let quaternion = Quaternion::new(qw, qx, qy, qz);
    let norm = quaternion.norm();
    if norm.is_nan() || (norm - 1.0).abs() > 1e-2 {
        return Err(format!("the quaternion of {name:?} has norm {norm}, expected 1"));
    }
    let rotation = UnitQuaternion::from_quaternion(quaternion);
    Ok(Isometry::from_parts(Translation3::new(tx, ty, tz), rotation))
}

fn points(words: &[&str]) -> Result<Vec<(Point2, Option<u64>)>, String> {
    let triple = |w: &[&str]| match w {
        [x, y, id] => {
            let id = if *id == "-1" { None } else { Some(number(id, "POINT3D_ID")?) };
            Ok((Point2::new(finite(x)? - 0.5, finite(y)? - 0.5), id))
        }
        _ => Err("expected the image's points as triples X Y POINT3D_ID".to_string()),
    };
    words.chunks(3).map(triple).collect()
}

fn number<T: FromStr>(word: &str, name: &str) -> Result<T, String> {
    word.parse().map_err(|_| format!("{name} is {word:?}; expected a whole number in range"))
}

fn finite(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("{word:?} is no finite number")),
    }
}

pub(super) fn write(folder: &Path, model: &ColmapModel) -> Result<(), WriteError> {
    write_atomic(&folder.join("cameras.txt"), |w| {
        writeln!(w, "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]")?;
        for ColmapCamera { id, camera } in &model.cameras {
            let (_, name, parameters) = camera::to_colmap(camera);
            write!(w, "{id} {name} {} {}", camera.size[0], camera.size[1])?;
            parameters.iter().try_for_each(|p| write!(w, " {p}"))?;
            writeln!(w)?;
        }
        Ok(())
    })?;
    write_atomic(&folder.join("images.txt"), |w| {
        writeln!(w, "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME")?;
        writeln!(w, "# POINTS2D[] as (X, Y, POINT3D_ID)")?;
        for image in &model.images {
            let (q, t) = (image.pose.rotation.quaternion(), image.pose.translation.vector);
            write!(w, "{} {} {} {} {} ", image.id, q.w, q.i, q.j, q.k)?;
            writeln!(w, "{} {} {} {} {}", t.x, t.y, t.z, image.camera, image.name)?;
            for (i, (p, id)) in image.points.iter().enumerate() {
                let space = if i > 0 { " " } else { "" };
                write!(w, "{space}{} {} ", p.x + 0.5, p.y + 0.5)?;
                match id {
                    Some(id) => write!(w, "{id}")?,
                    None => write!(w, "-1")?,
                }
            }
            writeln!(w)?;
        }
        Ok(())
    })?;
    write_atomic(&folder.join("points3D.txt"), |w| {
        writeln!(w, "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)")?;
        for p in &model.points {
            let ([x, y, z], [r, g, b]) = (<[f64; 3]>::from(p.position.coords), p.rgb);
            write!(w, "{} {x} {y} {z} {r} {g} {b} {}", p.id, p.error_px)?;
            p.track.iter().try_for_each(|(image, index)| write!(w, " {image} {index}"))?;
            writeln!(w)?;
        }
        Ok(())
    })
}
