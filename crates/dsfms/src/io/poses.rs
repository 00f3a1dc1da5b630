//! Camera poses: our JSON, and COLMAP's `images.txt` or `images.bin`.
//!
//! The JSON is a list of `{"image": "frame_000.png", "R": [[…]×3], "t": [x, y, z]}` (also `name`,
//! or a number `frame`), with `X_camera = R X_world + t`, alone or in an object under
//! `exploration` or `deformed`. nerfstudio's `transforms.json` (`frames` with `file_path` and
//! `transform_matrix`) is read too.

use super::colmap::{ColmapImage, file_in, is_binary, read_images};
use super::error::{InputError, parse_json, read_text};
use super::names::frame_number;
use crate::geometry::{Isometry, Vector3};
use crate::image::names::stem;
use nalgebra::{Matrix3, Matrix4, Rotation3, Translation3, UnitQuaternion};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// The pose of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedPose {
    /// Image name as the file writes it, folders included.
    pub name: String,
    /// `camera_from_world`.
    pub camera_from_world: Isometry,
}

impl From<ColmapImage> for NamedPose {
    fn from(image: ColmapImage) -> Self {
        Self { name: image.name, camera_from_world: image.pose }
    }
}

/// Which list of a JSON file that holds several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoseList {
    /// The frames of the organ at rest.
    #[default]
    Exploration,
    /// The frames of the deformed organ.
    Deformed,
}

impl PoseList {
    fn key(self) -> &'static str {
        match self {
            Self::Exploration => "exploration",
            Self::Deformed => "deformed",
        }
    }
}

/// No camera is a kilometre away from what it looks at, mm.
const FARTHEST: f64 = 1e6;

/// Read the poses of a file; the format is told from its content. A folder is taken for a COLMAP
/// model.
///
/// # Errors
/// A file that is missing, of no known format, without a pose, or with a translation of more than
/// 1e6.
pub fn read_poses(path: &Path, list: PoseList) -> Result<Vec<NamedPose>, InputError> {
    if path.is_dir() {
        return read_poses(&file_in(path, "images")?, list);
    }
    let json = |text: &String| text.trim_start().starts_with(['{', '[']);
    let text = if is_binary(path) { None } else { Some(read_text(path)?) };
    let poses = match text.filter(json) {
        Some(text) => from_json(path, &parse_json(path, &text)?, list)?,
        None => read_images(path)?.into_iter().map(NamedPose::from).collect(),
    };
    if poses.is_empty() {
        return Err(InputError::format(path, "holds no pose; expected one per frame"));
    }
    let far = |v: &&f64| !(-FARTHEST..=FARTHEST).contains(*v);
    for pose in &poses {
        if let Some(value) = pose.camera_from_world.translation.vector.iter().find(far) {
            let name = &pose.name;
            let reason = format!(
                "the translation of {name:?} holds {value:e}; expected at most {FARTHEST:e}, a kilometre in mm"
            );
            return Err(InputError::format(path, reason));
        }
    }
    // The same pose told twice is one.
    let first: BTreeMap<&str, &Isometry> =
        poses.iter().rev().map(|p| (p.name.as_str(), &p.camera_from_world)).collect();
    if let Some(other) = poses.iter().find(|p| *first[p.name.as_str()] != p.camera_from_world) {
        let reason = format!("holds two different poses of {}; expected one", other.name);
        return Err(InputError::format(path, reason));
    }
    Ok(poses)
}

/// The pose of every frame name (stems or file names), `None` where the file has none. A pose
/// belongs to a frame of the same file name, else of the same stem, else, where only one pose has
/// it, of the same last number.
pub fn match_poses(poses: &[NamedPose], frames: &[&str]) -> Vec<Option<Isometry>> {
    frames.iter().map(|frame| pose_of(poses, frame)).collect()
}

fn pose_of(poses: &[NamedPose], frame: &str) -> Option<Isometry> {
    let names: Vec<&str> = poses.iter().map(|pose| pose.name.as_str()).collect();
    position_of(&names, frame).map(|i| poses[i].camera_from_world)
}

/// Index of the name that belongs to a frame, as in [`match_poses`].
pub(super) fn position_of(names: &[&str], frame: &str) -> Option<usize> {
    let stem_of = |name| stem(file_name(name));
    let (file, stem) = (file_name(frame), stem_of(frame));
    let exact = names.iter().position(|name| file_name(name) == file);
    let same_stem = || names.iter().position(|name| stem_of(name) == stem);
    let same_number = || {
        let number = frame_number(stem)?;
        let mut with =
            (0..names.len()).filter(|&i| frame_number(stem_of(names[i])) == Some(number));
        with.next().filter(|_| with.next().is_none())
    };
    exact.or_else(same_stem).or_else(same_number)
}

fn file_name(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

/// Whether a document is a list of poses, or has one.
pub(super) fn holds_poses(value: &Value) -> bool {
    let list = |value: &Value| {
        let posed = |entry: &Value| {
            (entry.get("R").is_some() && entry.get("t").is_some())
                || entry.get("transform_matrix").is_some()
        };
        value.as_array().and_then(|list| list.first()).is_some_and(posed)
    };
    list(value) || LISTS.iter().filter_map(|key| value.get(key)).any(list)
}

/// Names that a list of poses may have.
const LISTS: [&str; 5] = ["exploration", "deformed", "poses", "images", "frames"];

fn from_json(path: &Path, value: &Value, list: PoseList) -> Result<Vec<NamedPose>, InputError> {
    let entries = match value {
        Value::Array(entries) => entries,
        value => [list.key(), "poses", "images", "frames"]
            .iter()
            .find_map(|key| value.get(key)?.as_array())
            .ok_or_else(|| {
                if value.get("fx").is_some() || value.get("camera_matrix").is_some() {
                    return InputError::CameraForPoses(path.into());
                }
                let problem = "is missing; expected a list of {image, R, t}";
                InputError::field(path, list.key(), problem)
            })?,
    };
    entries.iter().enumerate().map(|(i, entry)| pose_from_json(path, i, entry)).collect()
}

fn pose_from_json(path: &Path, index: usize, entry: &Value) -> Result<NamedPose, InputError> {
    let name =
        ["image", "name", "file", "file_path"].iter().find_map(|key| entry.get(key)?.as_str());
    let numbered = || entry.get("frame")?.as_u64().map(|n| format!("frame_{n:03}"));
    let texted = || entry.get("frame")?.as_str().map(str::to_owned);
    let name = name.map(str::to_owned).or_else(numbered).or_else(texted);
    let name = name.ok_or_else(|| {
        InputError::field(
            path,
            format!("pose {index}"),
            "has no image name (\"image\" or \"name\")",
        )
    })?;
    let numbers = |key: &str, count: usize| {
        let error =
            |problem: String| InputError::field(path, format!("{key} of {name:?}"), problem);
        let value = entry.get(key).ok_or_else(|| error("is missing".into()))?;
        let list = flat_numbers(value).map_err(error)?;
        if list.len() != count {
            return Err(error(format!("holds {} numbers, expected {count}", list.len())));
        }
        Ok(list)
    };
    if entry.get("transform_matrix").is_some() {
        let list = numbers("transform_matrix", 16)?;
        let pose = from_opengl(&Matrix4::from_row_slice(&list)).map_err(|problem| {
            InputError::field(path, format!("transform_matrix of {name:?}"), problem)
        })?;
        return Ok(NamedPose { name, camera_from_world: pose });
    }
    let rotation = Matrix3::from_row_slice(&numbers("R", 9)?);
    let translation = Vector3::from_row_slice(&numbers("t", 3)?);
    let pose = isometry(&rotation, &translation)
        .map_err(|problem| InputError::field(path, format!("R of {name:?}"), problem))?;
    Ok(NamedPose { name, camera_from_world: pose })
}

/// nerfstudio's `transform_matrix`: `world_from_camera` with OpenGL's camera axes (y up, z
/// backwards).
fn from_opengl(matrix: &Matrix4<f64>) -> Result<Isometry, String> {
    let axes = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    let rotation = matrix.fixed_view::<3, 3>(0, 0) * axes;
    let translation = matrix.fixed_view::<3, 1>(0, 3).into_owned();
    Ok(isometry(&rotation, &translation)?.inverse())
}

fn flat_numbers(value: &Value) -> Result<Vec<f64>, String> {
    match value {
        Value::Array(items) => {
            Ok(items.iter().map(flat_numbers).collect::<Result<Vec<_>, _>>()?.concat())
        }
        value => match value.as_f64() {
            Some(number) if number.is_finite() => Ok(vec![number]),
            _ => Err(format!("holds {value}; expected finite numbers")),
        },
    }
}

/// The motion of a rotation matrix that is orthogonal to 1e-3, as files with few digits are; it
/// is replaced by the nearest rotation.
fn isometry(matrix: &Matrix3<f64>, translation: &Vector3) -> Result<Isometry, String> {
    let deviation = (matrix.transpose() * matrix - Matrix3::identity()).amax();
    let determinant = matrix.determinant();
    if !(deviation < 1e-3 && determinant > 0.0) {
        return Err(format!(
            "is not a rotation (RᵀR differs from the identity by {deviation:.1e}, determinant {determinant:.3}); expected X_camera = R X_world + t"
        ));
    }
    let svd = matrix.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Err("has no singular value decomposition".into());
    };
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * v_t));
    Ok(Isometry::from_parts(Translation3::from(*translation), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point3;

    fn read(text: &str, list: PoseList) -> Result<Vec<NamedPose>, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("poses.txt");
        std::fs::write(&path, text).unwrap();
        read_poses(&path, list).map_err(|error| error.to_string())
    }

    const QUARTER: &str = r#""R": [[0,-1,0],[1,0,0],[0,0,1]], "t": [1,2,3]"#;

    #[test]
    fn lists_of_a_scene() {
        let text = format!(
            r#"{{"K": 0, "exploration": [{{"frame": 0, "image": "exploration/frame_000.png", {QUARTER}}}],
                "deformed": [{{"frame": 7, {QUARTER}}}]}}"#
        );
        let poses = read(&text, PoseList::Exploration).unwrap();
        assert_eq!(poses[0].name, "exploration/frame_000.png");
        let point = poses[0].camera_from_world * Point3::new(5.0, 6.0, 7.0);
        assert!((point - Point3::new(-5.0, 7.0, 10.0)).norm() < 1e-12);
        assert_eq!(read(&text, PoseList::Deformed).unwrap()[0].name, "frame_007");
        let plain = format!("[{{\"name\": \"a.b.png\", {QUARTER}}}]");
        let poses = read(&plain, PoseList::Deformed).unwrap();
        assert!(match_poses(&poses, &["a.b"])[0].is_some());
    }

    /// A camera at (0, 0, 5) that looks down −z, as OpenGL has it: world y is up in the image.
    #[test]
    fn transforms_of_nerfstudio() {
        let text = r#"{"fl_x": 1, "frames": [{"file_path": "images/f_1.png",
            "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,5],[0,0,0,1]]}]}"#;
        let poses = read(text, PoseList::Exploration).unwrap();
        assert_eq!(poses[0].name, "images/f_1.png");
        let found = poses[0].camera_from_world * Point3::new(1.0, 2.0, 0.0);
        assert!((found - Point3::new(1.0, -2.0, 5.0)).norm() < 1e-12, "{found}");
    }

    #[test]
    fn intrinsics_are_no_poses() {
        let found = read(r#"{"fx": 1, "fy": 1}"#, PoseList::Exploration).unwrap_err();
        assert!(found.contains("intrinsics of a camera, no poses"), "{found}");
    }

    #[test]
    fn colmap_images() {
        let half = 0.5_f64.sqrt();
        let text = format!(
            "# Image list\n1 {half} 0 0 {half} 1 2 3 1 my frame_003.png\n10.5 20 -1 4 5 6\n2 1 0 0 0 0 0 0 1 frame_04.png\n\n"
        );
        let poses = read(&text, PoseList::Exploration).unwrap();
        assert_eq!(poses.len(), 2);
        assert_eq!(poses[0].name, "my frame_003.png");
        let point = poses[0].camera_from_world * Point3::new(5.0, 6.0, 7.0);
        assert!((point - Point3::new(-5.0, 7.0, 10.0)).norm() < 1e-12);
        let found = match_poses(&poses, &["organ_3", "frame_04", "frame_5"]);
        assert!(found[0].is_some() && found[1] == Some(Isometry::identity()) && found[2].is_none());
    }

    #[test]
    fn bad_poses_are_named() {
        let entry = |r: &str| format!(r#"[{{"image": "f_3.png", "R": {r}, "t": [0,0,1]}}]"#);
        for (text, words) in [
            (entry("[[1,0,0],[0,1,0],[0,0,-1]]"), "R of \"f_3.png\": is not a rotation"),
            (entry("[[2,0,0],[0,1,0],[0,0,1]]"), "is not a rotation"),
            (entry("[[1,0],[0,1]]"), "holds 4 numbers"),
            (entry("[[1,0,0],[0,1,0],[0,0,null]]"), "holds null"),
            (entry("[[1,0,0],[0,1,0],[0,0,NaN]]"), "NaN and Infinity"),
            ("{\"deformed\": []}".into(), "field exploration: is missing"),
            (
                r#"[{"image": "f_3.png", "R": [[1,0,0],[0,1,0],[0,0,1]], "t": [0,0,-1e300]}]"#
                    .into(),
                "poses.txt: the translation of \"f_3.png\" holds -1e300; expected",
            ),
            ("1 1 0 0 0 0 2e6 0 1 a.png\n\n".into(), "\"a.png\" holds 2e6"),
            ("[]".into(), "no pose"),
            ("[{\"R\": 1}]".into(), "pose 0"),
            ("1 2 0 0 0 0 0 0 1 a.png\n".into(), "line 1: the quaternion of \"a.png\""),
            ("1 1 0 0 nan 0 0 0 1 a.png\n".into(), "line 1"),
            ("hello world\n".into(), "line 1"),
        ] {
            let message = read(&text, PoseList::Exploration).unwrap_err();
            assert!(message.contains(words), "{message:?} lacks {words:?}");
        }
    }
}
