//! The page of what is on disk: an output folder, a template, a mesh file.

use super::Page;
use super::data::{PageData, ShownFrame, ShownSurface};
use super::embed::{self, Cloud, Numbers};
use super::template::{chosen, definition_list, still, template_page};
use anyhow::Context;
use dsfms::io::images::read_frame;
use dsfms::io::mesh::{MeshFile, MeshUnit, read_mesh};
use dsfms::io::names::natural_order;
use dsfms::io::template::read_template;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// What a path holds.
#[derive(Debug, PartialEq, Eq)]
pub enum Source {
    /// A page that a command left.
    Report(PathBuf),
    Template(PathBuf),
    /// Reconstructed frames.
    Meshes(Vec<PathBuf>),
}

impl Source {
    /// Look at the path. A page that is older than the frames beside it is not taken.
    pub fn of(path: &Path) -> anyhow::Result<Self> {
        let is = |name: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(name));
        if path.is_file() {
            return Ok(match is("html") {
                true => Self::Report(path.into()),
                false => Self::Meshes(vec![path.into()]),
            });
        }
        let report = path.join("report.html");
        if path.join("template.toml").is_file() && !report.is_file() {
            return Ok(Self::Template(path.into()));
        }
        let meshes = frames(path)?;
        let changed = |p: &PathBuf| p.metadata().and_then(|m| m.modified()).ok();
        let newest = meshes.iter().filter_map(changed).max();
        match changed(&report) {
            Some(written) if newest.is_none_or(|newest| newest <= written) => {
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
        let of = |p: &PathBuf| p.metadata().and_then(|m| m.modified()).ok();
        match self {
            Self::Report(path) => of(path),
            Self::Template(path) => of(&path.join("template.toml")),
            Self::Meshes(paths) => paths.iter().filter_map(of).max(),
        }
    }

    /// The page.
    pub fn html(&self) -> anyhow::Result<String> {
        match self {
            Self::Report(path) => std::fs::read_to_string(path)
                .with_context(|| format!("cannot read {}", path.display())),
            Self::Template(path) => {
                template_page(&name(path), &read_template(path)?, &[], &[])?.html()
            }
            Self::Meshes(paths) => meshes_page(paths)?.html(),
        }
    }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
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

fn meshes_page(paths: &[PathBuf]) -> anyhow::Result<Page> {
    let first = read_mesh(&paths[0])?;
    let unit = match first.unit {
        Some(MeshUnit::Millimetre) => "mm",
        Some(MeshUnit::Centimetre) => "cm",
        Some(MeshUnit::Metre) => "m",
        Some(MeshUnit::TemplateUnit) | None => "units",
    };
    let mut data = PageData::of_mesh(&first.mesh, unit);
    data.methods = vec!["surface".into()];
    if let [path] = paths {
        data.frames = vec![still(&name(path))];
        data.moving_camera = true;
    } else {
        data.reference = "the first frame";
        for i in chosen(paths.len()) {
            data.frames.push(frame(&paths[i], &first)?);
        }
    }
    let facts = [
        ("Surface", format!("{} vertices", first.mesh.positions.len())),
        ("Faces", first.mesh.topology.faces.len().to_string()),
        ("Unit", unit.to_string()),
    ];
    Ok(Page {
        title: match paths {
            [path] => name(path),
            _ => name(paths[0].parent().unwrap_or(Path::new(""))),
        },
        summary: definition_list(&facts),
        sections: String::new(),
        data,
    })
}

/// A reconstructed frame with its overlay as the image.
fn frame(path: &Path, first: &MeshFile) -> anyhow::Result<ShownFrame> {
    let file = read_mesh(path)?;
    if file.mesh.topology.faces != first.mesh.topology.faces {
        anyhow::bail!("{} has other faces than the first frame beside it", path.display());
    }
    let stem = name(&path.with_extension(""));
    let overlay = path.with_file_name(format!("{stem}_overlay.png"));
    let picture = overlay.is_file().then(|| read_frame(&overlay)).transpose()?;
    let mut shown = match picture {
        Some(picture) => ShownFrame::new(&stem, &picture)?,
        None => ShownFrame::with(&stem, None, [640, 480]),
    };
    let flags = |v: &Vec<f64>| embed::flags(&v.iter().map(|&v| v != 0.0).collect::<Vec<_>>());
    shown.surfaces.push(Some(ShownSurface {
        positions: Some(Cloud::of(&file.mesh.positions)),
        visible: file.attributes.get("visible").map(flags),
        confidence: file.attributes.get("confidence").map(|v| Numbers::of(v)),
        ..Default::default()
    }));
    shown.status.push("ok");
    Ok(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_older_than_its_frames_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        assert!(Source::of(folder.path()).is_err());
        std::fs::write(at("report.html"), "old").unwrap();
        assert_eq!(Source::of(folder.path()).unwrap(), Source::Report(at("report.html")));
        std::fs::write(at("frame_010.ply"), "").unwrap();
        std::fs::write(at("frame_9.ply"), "").unwrap();
        let later = SystemTime::now() + std::time::Duration::from_secs(5);
        std::fs::File::open(at("frame_9.ply")).unwrap().set_modified(later).unwrap();
        let source = Source::of(folder.path()).unwrap();
        assert_eq!(source, Source::Meshes(vec![at("frame_9.ply"), at("frame_010.ply")]));
        assert_eq!(source.changed(), Some(later));
    }
}
