//! The embedded scene as files and as values.

use super::scene_files::FILES;
use crate::args::Global;
use crate::inputs::{self, CameraInput};
use anyhow::Context;
use dsfms::geometry::Isometry;
use dsfms::image::{Frame, Mask};
use dsfms::io::atomic::write_atomic;
use dsfms::io::images::{find_frames, read_frames};
use dsfms::io::masks::{MaskKind, read_masks};
use dsfms::io::matches::read_matches;
use dsfms::io::mesh::read_mesh;
use dsfms::io::poses::{PoseList, match_poses, read_poses};
use dsfms::io::vertex_truth::{VertexTruth, read_vertex_truth, vertex_truth_path};
use dsfms::mesh::Mesh;
use dsfms::register::Match;
use std::path::Path;

/// A deformed frame and what is known of it.
pub struct DeformedFrame {
    pub frame: Frame,
    pub instrument: Mask,
    pub organ: Mask,
    /// Matches onto the true rest mesh.
    pub matches: Vec<Match>,
    /// True mesh, camera axes, mm.
    pub mesh: Mesh,
    pub vertices: VertexTruth,
}

/// The scene; lengths in mm.
pub struct Scene {
    pub camera: CameraInput,
    pub exploration: Vec<Frame>,
    pub exploration_organ: Vec<Option<Mask>>,
    /// True `camera_from_world` of the exploration.
    pub poses: Vec<Isometry>,
    /// True mesh at rest, world.
    pub rest: Mesh,
    pub deformed: Vec<DeformedFrame>,
}

/// Write the scene's files, so that a user can run the other commands on them.
pub fn unpack(folder: &Path) -> anyhow::Result<()> {
    for (path, bytes) in FILES {
        write_atomic(&folder.join(path), |w| w.write_all(bytes))?;
    }
    Ok(())
}

/// The deformed frames, `frame_NNN`.
pub fn frame_names() -> impl Iterator<Item = &'static str> {
    let name = |file: &&'static str| file.strip_prefix("deformed/");
    FILES.iter().filter_map(move |(file, _)| name(file)?.strip_suffix(".jpg"))
}

impl Scene {
    /// Read an unpacked scene.
    pub fn read(folder: &Path, global: &Global) -> anyhow::Result<Self> {
        let camera = inputs::camera(&folder.join("camera.json"), global)?;
        let exploration = read_frames(&find_frames(&[folder.join("exploration")])?)?;
        let masks = folder.join("exploration_masks");
        let (organ, _) = read_masks(&exploration, &[], &masks, MaskKind::Organ)?;
        let poses = read_poses(&folder.join("truth/poses.json"), PoseList::Exploration)?;
        let names: Vec<&str> = exploration.iter().map(|f| f.name.as_str()).collect();
        let poses: Option<Vec<Isometry>> = match_poses(&poses, &names).into_iter().collect();
        Ok(Self {
            camera,
            exploration_organ: organ.into_iter().map(Some).collect(),
            exploration,
            poses: poses.context("the demo scene lacks a pose")?,
            rest: read_mesh(&folder.join("truth/rest_world.ply"))?.mesh,
            deformed: deformed(folder)?,
        })
    }
}

fn deformed(folder: &Path) -> anyhow::Result<Vec<DeformedFrame>> {
    let frames = read_frames(&find_frames(&[folder.join("deformed")])?)?;
    let read = |name: &str, kind| read_masks(&frames, &[], &folder.join(name), kind);
    let (organ, _) = read("deformed_masks", MaskKind::Organ)?;
    let (instrument, _) = read("instrument_masks", MaskKind::Instrument)?;
    let mut all = Vec::new();
    for ((frame, organ), instrument) in frames.into_iter().zip(organ).zip(instrument) {
        let path = folder.join(format!("truth/{}.ply", frame.name));
        let mesh = read_mesh(&path)?.mesh;
        let matches = read_matches(
            &folder.join(format!("matches/{}.csv", frame.name)),
            mesh.topology.faces.len(),
            frame.size,
        )?;
        let vertices = read_vertex_truth(&vertex_truth_path(&path))?;
        all.push(DeformedFrame { frame, instrument, organ, matches, mesh, vertices });
    }
    Ok(all)
}
