//! The page of what is on disk: an output folder, a template, a mesh file.

use super::Page;
use super::clip;
use super::data::{PageData, ShownFrame, ShownSurface};
use super::embed::{self, Cloud, Numbers};
use super::template::{MOST_FRAMES, definition_list, still, template_page};
use anyhow::Context;
use dsfms::guard;
use dsfms::io::images::read_frame;
use dsfms::io::mesh::{MeshFile, MeshUnit, read_mesh};
use dsfms::io::names::natural_order;
use dsfms::io::template::read_template;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Frames that are newer than the page by less than this belong to it: `dsfms track` writes them
/// one by one and the page every few seconds.
const GRACE: Duration = Duration::from_secs(20);

/// What a path holds.
#[derive(Debug, PartialEq, Eq)]
pub enum PathContent {
    /// A page that a command left.
    Report(PathBuf),
    Template(PathBuf),
    /// Reconstructed frames of one or several methods.
    Meshes(Vec<Column>),
}

/// A folder of frames.
#[derive(Debug, PartialEq, Eq)]
pub struct Column {
    pub name: String,
    pub paths: Vec<PathBuf>,
}

impl PathContent {
    /// Look at the path. A page that is older than the frames beside it is not taken.
    pub fn of(path: &Path) -> anyhow::Result<Self> {
        let is = |name: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(name));
        if path.is_file() {
            return Ok(match is("html") {
                true => Self::Report(path.into()),
                false => Self::Meshes(vec![Column { name: name(path), paths: vec![path.into()] }]),
            });
        }
        let report = path.join("report.html");
        if path.join("template.toml").is_file() && !report.is_file() {
            return Ok(Self::Template(path.into()));
        }
        let meshes = columns(path)?;
        let newest = meshes.iter().flat_map(|c| &c.paths).filter_map(changed).max();
        match changed(&report) {
            Some(written) if newest.is_none_or(|newest| newest <= written + GRACE) => {
                Ok(Self::Report(report))
            }
            _ if !meshes.is_empty() => Ok(Self::Meshes(meshes)),
            _ => anyhow::bail!(
                "{} holds no report.html, no template and no frame_NNN.ply; give an output folder, a \
                 template or a mesh file",
                path.display()
            ),
        }
    }

    /// The newest change of what is shown: the page is made again when it moves.
    pub fn changed(&self) -> Option<SystemTime> {
        match self {
            Self::Report(path) => changed(path),
            Self::Template(path) => changed(path.join("template.toml")),
            Self::Meshes(all) => all.iter().flat_map(|c| &c.paths).filter_map(changed).max(),
        }
    }

    /// The page; of a long clip with some of its frames, the others by [`PathContent::frame`].
    pub fn html(&self) -> anyhow::Result<String> {
        match self {
            Self::Report(path) => {
                let html = guard::read_text(path)
                    .with_context(|| format!("cannot read {}", path.display()))?;
                Ok(clip::streamed(html, &clip::names(path)))
            }
            Self::Template(path) => template_page(&name(path), &read_template(path)?, &[])?.html(),
            Self::Meshes(columns) => meshes_page(columns)?.html(),
        }
    }
}

impl PathContent {
    /// A frame of a long clip by its name; `None` where there is none of that name.
    pub fn frame(&self, wanted: &str) -> anyhow::Result<Option<String>> {
        match self {
            Self::Report(path) => clip::read(path, wanted),
            Self::Template(_) => Ok(None),
            Self::Meshes(columns) => {
                let file = format!("{wanted}.ply");
                let all = &columns[0].paths;
                if all.len() <= MOST_FRAMES || !all.iter().any(|p| name(p) == file) {
                    return Ok(None);
                }
                let shown = frame(columns, &file, &read_mesh(&all[0])?)?;
                Ok(Some(serde_json::to_string(&shown)?))
            }
        }
    }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn changed(path: impl AsRef<Path>) -> Option<SystemTime> {
    path.as_ref().metadata().and_then(|m| m.modified()).ok()
}

/// The frames of a folder, or of each folder in it.
pub fn columns(folder: &Path) -> anyhow::Result<Vec<Column>> {
    let own = frames(folder)?;
    if !own.is_empty() {
        return Ok(vec![Column { name: name(folder), paths: own }]);
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)?.flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.push(Column { name: name(&path), paths: frames(&path)? });
        }
    }
    found.retain(|c| !c.paths.is_empty());
    found.sort_by(|a, b| natural_order(&a.name, &b.name));
    Ok(found)
}

/// `frame_*.ply` of a folder, by number.
fn frames(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder)
        .with_context(|| format!("{} does not exist or cannot be read", folder.display()))?;
    let is_frame = |p: &PathBuf| {
        let name = name(p);
        name.starts_with("frame_") && name.ends_with(".ply")
    };
    let mut found: Vec<PathBuf> =
        entries.filter_map(|e| e.ok().map(|e| e.path())).filter(is_frame).collect();
    found.sort_by(|a, b| natural_order(&name(a), &name(b)));
    Ok(found)
}

fn meshes_page(columns: &[Column]) -> anyhow::Result<Page> {
    let all = &columns[0].paths;
    let first = read_mesh(&all[0])?;
    let unit = match first.unit {
        Some(MeshUnit::Millimetre) => "mm",
        Some(MeshUnit::Centimetre) => "cm",
        Some(MeshUnit::Metre) => "m",
        Some(MeshUnit::TemplateUnit) | None => "units",
    };
    let mut data = PageData::of_mesh(&first.mesh, unit);
    data.methods = columns.iter().map(|c| c.name.clone()).collect();
    if let ([_], [path]) = (columns, all.as_slice()) {
        data.frames = vec![still(&name(path))];
        data.moving_camera = true;
    } else {
        data.reference = "the first frame";
        data.stream = all.len() > MOST_FRAMES;
        let here = clip::here(all.len());
        for (i, path) in all.iter().enumerate() {
            let whole = !data.stream || here.contains(&i);
            data.frames.push(match whole {
                true => frame(columns, &name(path), &first)?,
                false => ShownFrame::named(stem(&name(path))),
            });
        }
    }
    let (vertices, faces) = (first.mesh.positions.len(), first.mesh.topology.faces.len());
    let facts =
        [("Surface", format!("{vertices} vertices, {faces} faces")), ("Unit", unit.to_string())];
    Ok(Page {
        title: data.methods.join(", "),
        summary: definition_list(&facts),
        sections: String::new(),
        data,
        curves: String::new(),
    })
}

fn stem(file: &str) -> &str {
    file.strip_suffix(".ply").unwrap_or(file)
}

/// A reconstructed frame; the overlay of the first method is its image.
fn frame(columns: &[Column], file: &str, first: &MeshFile) -> anyhow::Result<ShownFrame> {
    let stem = stem(file);
    // As `reconstruct` and as `track` leave them.
    let overlay = [format!("{stem}_overlay.png"), format!("overlay/{stem}.png")]
        .map(|name| columns[0].paths[0].with_file_name(name))
        .into_iter()
        .find(|path| path.is_file());
    let mut shown = match overlay {
        Some(path) => ShownFrame::new(stem, &read_frame(&path)?)?,
        None => ShownFrame::with(stem, None, [640, 480]),
    };
    for column in columns {
        let path = column.paths.iter().find(|p| name(p) == file);
        shown.surfaces.push(path.map(|p| surface(p, first)).transpose()?);
        shown.status.push(if path.is_some() { "ok" } else { "failed" });
    }
    Ok(shown)
}

fn surface(path: &Path, first: &MeshFile) -> anyhow::Result<ShownSurface> {
    let file = read_mesh(path)?;
    let file = match first.unit {
        Some(unit) => file
            .in_unit(unit)
            .with_context(|| format!("{}: its unit and that of the first frame", path.display()))?,
        None => file,
    };
    if file.mesh.topology.faces != first.mesh.topology.faces {
        anyhow::bail!("{} has other faces than the first frame beside it", path.display());
    }
    let flags = |v: &Vec<f64>| embed::flags(&v.iter().map(|&v| v != 0.0).collect::<Vec<_>>());
    Ok(ShownSurface {
        positions: Some(Cloud::of(&file.mesh.positions)),
        visible: file.attributes.get("visible").map(flags),
        expected_error: file.attributes.get("expected_error").map(|v| Numbers::of(v)),
        ..Default::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_older_than_its_frames_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        assert!(PathContent::of(folder.path()).is_err());
        std::fs::write(at("report.html"), "old").unwrap();
        assert_eq!(PathContent::of(folder.path()).unwrap(), PathContent::Report(at("report.html")));
        std::fs::write(at("frame_010.ply"), "").unwrap();
        std::fs::write(at("frame_9.ply"), "").unwrap();
        let later = SystemTime::now() + Duration::from_secs(60);
        std::fs::File::open(at("frame_9.ply")).unwrap().set_modified(later).unwrap();
        let source = PathContent::of(folder.path()).unwrap();
        let PathContent::Meshes(columns) = &source else { panic!("{source:?}") };
        assert_eq!(columns[0].paths, [at("frame_9.ply"), at("frame_010.ply")]);
        assert_eq!(source.changed(), Some(later));
    }
}
