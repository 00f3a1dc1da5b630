//! The template on disk: a directory whose files the field's own tools open.
//!
//! `template.toml` (manifest), `template.ply` (surface, double precision), `albedo.npz`,
//! `flattening.npz`, `features.npz`, `seen.npz`, `sigma.npz` (NumPy), `usual.toml` (what the
//! exploration frames look like beside it), `template.glb` (viewers), `sparse/` (COLMAP text).
//! Reading uses the manifest, the PLY, `usual.toml`, the npz files and the points of `sparse/`; the
//! rest is for other programs.

use super::atomic::{WriteError, Writing, old_prefix, parent, partial_prefix, share, write_atomic};
use super::mesh::read_mesh;
use super::ply::{PlyExtras, Precision, write_ply};
pub use super::template_error::TemplateFileError;
use super::template_error::expect;
pub use super::template_glb::{texture, vertex_colours};
use super::template_manifest::{
    Counts, FileNote, MANIFEST, MOST_MANIFEST_BYTES, Manifest, VERSION, VersionOnly,
};
use super::{template_arrays as arrays, template_glb, template_sparse};
use crate::guard;
use crate::mesh::normals::vertex_normals;
use crate::template::usual::Usual;
use crate::template::{Features, Surroundings, Template};
use std::fs;
use std::path::Path;

pub(super) const SURFACE: &str = "template.ply";
pub(super) const ALBEDO: &str = "albedo.npz";
pub(super) const FLATTENING: &str = "flattening.npz";
pub(super) const FEATURES: &str = "features.npz";
/// Cameras, poses and sparse points of the exploration.
const SPARSE: &str = "sparse";
const SEEN: &str = "seen.npz";
/// Optional: older templates have none, older programs do not look for it.
const SIGMA: &str = "sigma.npz";
/// Optional likewise.
const USUAL: &str = "usual.toml";
/// Optional likewise, and what it holds of descriptors too.
const SURROUNDINGS: &str = "surroundings.ply";
const SURROUNDING_FEATURES: &str = "surrounding_features.npz";
const VIEWER: &str = "template.glb";
/// All that is in a template: its files, and what programs add about them.
const CONTENT: [&str; 21] = [
    MANIFEST,
    SURFACE,
    ALBEDO,
    FLATTENING,
    FEATURES,
    SPARSE,
    SEEN,
    SIGMA,
    USUAL,
    SURROUNDINGS,
    SURROUNDING_FEATURES,
    VIEWER,
    "report.html",
    "pictures",
    "organ_masks",
    "organ_masks_a",
    "organ_masks_b",
    "organ_masks_c",
    "organ.scene",
    "organ_scribbles.json",
    "precision.json",
];

/// Check, before any work, that a template can take this name: nothing is there, or a template and
/// nothing but what [`write_template`] and the pages about it leave in one.
///
/// # Errors
/// [`NotATemplate`](TemplateFileError::NotATemplate), [`Foreign`](TemplateFileError::Foreign).
pub fn check_target(path: &Path) -> Result<(), TemplateFileError> {
    if !path.exists() {
        return Ok(());
    }
    let owned = || path.to_path_buf();
    if !path.join(MANIFEST).is_file() {
        return Err(TemplateFileError::NotATemplate { path: owned() });
    }
    let entries = fs::read_dir(path).map_err(|source| WriteError::new(path, source))?;
    let names = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    match names.into_iter().find(|name| !CONTENT.contains(&name.as_str())) {
        Some(name) => Err(TemplateFileError::Foreign { path: owned(), name }),
        None => Ok(()),
    }
}

/// Write a template directory. All files are written to a temporary directory beside `path`, which
/// then takes its name; an older template there is replaced, anything else is refused.
///
/// ```
/// use dsfms::{read_template, synth::Case, write_template};
///
/// let template = Case::example(1).template;
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("organ.template");
/// write_template(&path, &template)?;
/// assert_eq!(read_template(&path)?.mesh.positions, template.mesh.positions);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A folder of anything else at `path`, or one that cannot be written.
pub fn write_template(path: &Path, template: &Template) -> Result<(), TemplateFileError> {
    check_target(path)?;
    let _writing = Writing::begin();
    let replaces = path.exists();
    let fail = |source| WriteError::new(path, source);
    let folder = parent(path);
    fs::create_dir_all(folder).map_err(fail)?;
    let temporary = |prefix: String| tempfile::Builder::new().prefix(&prefix).tempdir_in(folder);
    let fresh = temporary(partial_prefix("template-")).map_err(fail)?;
    write_files(fresh.path(), template)?;
    read_template(fresh.path())
        .map_err(|e| TemplateFileError::Unreadable { path: path.into(), source: Box::new(e) })?;
    share(fresh.path()).map_err(fail)?;
    // The old directory steps aside first: a directory cannot be renamed over another.
    let old = temporary(old_prefix()).map_err(fail)?;
    // Under its own name, by which it is found again if this run is killed here.
    let aside = old.path().join(path.file_name().unwrap_or_default());
    if replaces {
        fs::rename(path, &aside).map_err(fail)?;
    }
    if let Err(error) = fs::rename(fresh.path(), path) {
        if replaces {
            fs::rename(&aside, path).map_err(fail)?;
        }
        return Err(fail(error).into());
    }
    // Its content now lies under the final name; there is nothing left to remove.
    let _moved = fresh.keep();
    Ok(())
}

/// Write the surface of a template as one `.glb` for viewers: normals, UV, baked albedo.
///
/// # Errors
/// A file that cannot be written.
pub fn write_viewer(path: &Path, template: &Template) -> Result<(), WriteError> {
    template_glb::write(path, template)
}

fn write_files(folder: &Path, template: &Template) -> Result<(), TemplateFileError> {
    let mut files = Vec::new();
    let mut note = |name: &str, content: &str| {
        files.push(FileNote { name: name.into(), content: content.into() });
        folder.join(name)
    };
    let mesh = &template.mesh;
    let (colours, normals) =
        (vertex_colours(template), vertex_normals(&mesh.topology, &mesh.positions));
    let extras = PlyExtras {
        precision: Precision::Double,
        normals: Some(&normals),
        color: colours.as_deref(),
        ..PlyExtras::default()
    };
    let surface =
        note(SURFACE, "rest surface, double precision, with normals and albedo as colour");
    write_ply(&surface, &mesh.topology, &mesh.positions, template.unit, &extras)?;
    if !template.seen.is_empty() {
        arrays::write_seen(&note(SEEN, "exploration frames that saw each vertex"), &template.seen)?;
    }
    if !template.sigma.is_empty() {
        let file = note(SIGMA, "standard deviation expected of each vertex, length units");
        arrays::write_sigma(&file, &template.sigma)?;
    }
    if let Some(usual) = &template.usual {
        let file = note(USUAL, "how the exploration frames look beside this template");
        let text = toml::to_string(usual).map_err(|e| damaged(&file, &e))?;
        write_atomic(&file, |w| w.write_all(text.as_bytes()))?;
    }
    if let Some(Surroundings { mesh, features }) = &template.surroundings {
        let file = note(SURROUNDINGS, "what lies around the organ, a coarse surface");
        let double = PlyExtras { precision: Precision::Double, ..PlyExtras::default() };
        write_ply(&file, &mesh.topology, &mesh.positions, template.unit, &double)?;
        let file = note(SURROUNDING_FEATURES, "descriptors on what lies around the organ");
        arrays::write_features(&file, features)?;
    }
    if let Some(albedo) = &template.albedo {
        arrays::write_albedo(&note(ALBEDO, "albedo on the surface, linear RGB"), albedo)?;
    }
    if let Some(map) = &template.flattening {
        arrays::write_flattening(&note(FLATTENING, "UV per face corner and distortion"), map)?;
    }
    if let Some(features) = &template.features {
        arrays::write_features(&note(FEATURES, "descriptors on the surface"), features)?;
    }
    template_glb::write(&note(VIEWER, "for viewers: UV, baked albedo, normals"), template)?;
    if !template.views.is_empty() {
        template_sparse::write(&note(SPARSE, "COLMAP text model of the exploration"), template)?;
    }
    write_manifest(folder, template, files)
}

fn write_manifest(
    folder: &Path,
    template: &Template,
    files: Vec<FileNote>,
) -> Result<(), TemplateFileError> {
    let manifest = Manifest {
        version: VERSION,
        unit: template.unit,
        generator: concat!("dsfms ", env!("CARGO_PKG_VERSION")).into(),
        counts: counts(template),
        tone: template.tone.clone(),
        camera: template.camera.clone(),
        light: template.light.clone(),
        coat: template.coat,
        files,
        views: template.views.clone(),
    };
    let path = folder.join(MANIFEST);
    let text = toml::to_string(&manifest)
        .map_err(|e| TemplateFileError::Manifest { path: path.clone(), reason: e.to_string() })?;
    Ok(write_atomic(&path, |w| w.write_all(text.as_bytes()))?)
}

fn counts(template: &Template) -> Counts {
    Counts {
        vertices: template.mesh.positions.len(),
        faces: template.mesh.topology.faces.len(),
        texels: template.albedo.as_ref().map_or(0, |a| a.value.len()),
        features: template.features.as_ref().map_or(0, |f| f.descriptors.len()),
        flattened: template.flattening.is_some(),
        seen: !template.seen.is_empty(),
    }
}

/// Read a template directory; what [`write_template`] wrote comes back bit for bit.
///
/// [`write_template`] has an example.
///
/// # Errors
/// A folder that is missing, no template, damaged, or of a later version.
pub fn read_template(path: &Path) -> Result<Template, TemplateFileError> {
    let manifest = read_manifest(path)?;
    let counts = manifest.counts;
    let surface = path.join(SURFACE);
    let mesh = read_mesh(&surface)?.mesh;
    expect(&surface, "vertices", counts.vertices, mesh.positions.len())?;
    let faces = mesh.topology.faces.len();
    expect(&surface, "faces", counts.faces, faces)?;
    let seen = if counts.seen { arrays::read_seen(&path.join(SEEN))? } else { Vec::new() };
    if counts.seen {
        expect(&path.join(SEEN), "vertices", counts.vertices, seen.len())?;
    }
    let file = path.join(SIGMA);
    let sigma =
        if file.exists() { arrays::read_sigma(&file, counts.vertices)? } else { Vec::new() };
    let usual = read_usual(&path.join(USUAL))?;
    let surroundings = read_surroundings(path)?;
    let optional = |name: &str, wanted: bool| wanted.then(|| path.join(name));
    let albedo = optional(ALBEDO, counts.texels > 0)
        .map(|file| arrays::read_albedo(&file, faces, counts.texels))
        .transpose()?;
    let flattening = optional(FLATTENING, counts.flattened)
        .map(|file| arrays::read_flattening(&file, &mesh.topology))
        .transpose()?;
    let features = optional(FEATURES, counts.features > 0 || path.join(FEATURES).exists())
        .map(|file| arrays::read_features(&file, faces))
        .transpose()?;
    if let Some(features) = &features {
        let found = features.descriptors.len();
        expect(&path.join(FEATURES), "descriptors", counts.features, found)?;
    }
    let points = match manifest.views.is_empty() {
        true => Vec::new(),
        false => template_sparse::read(&path.join(SPARSE), manifest.views.len())?,
    };
    Ok(Template {
        unit: manifest.unit,
        mesh,
        seen,
        sigma,
        flattening,
        albedo,
        features,
        views: manifest.views,
        points,
        camera: manifest.camera,
        tone: manifest.tone,
        light: manifest.light,
        coat: manifest.coat,
        usual,
        surroundings,
    })
}

/// What lies around the organ; `None` in templates of frames that do not part it from that.
fn read_surroundings(folder: &Path) -> Result<Option<Surroundings>, TemplateFileError> {
    let [surface, features] = [SURROUNDINGS, SURROUNDING_FEATURES].map(|name| folder.join(name));
    if !surface.exists() {
        return Ok(None);
    }
    let mesh = read_mesh(&surface)?.mesh;
    let features = match features.exists() {
        true => arrays::read_features(&features, mesh.topology.faces.len())?,
        false => Features::default(),
    };
    Ok(Some(Surroundings { mesh, features }))
}

fn read_usual(file: &Path) -> Result<Option<Usual>, TemplateFileError> {
    if !file.exists() {
        return Ok(None);
    }
    let text = guard::read_text_at_most(file, guard::MOST_OPTIONS_BYTES);
    let text = text.map_err(|e| damaged(file, &e))?;
    let usual: Usual = toml::from_str(&text).map_err(|e| damaged(file, &e))?;
    if !usual.is_plausible() {
        return Err(damaged(file, &"a figure is not finite or out of its bounds"));
    }
    Ok(Some(usual))
}

fn damaged(file: &Path, reason: &dyn std::fmt::Display) -> TemplateFileError {
    TemplateFileError::Damaged { path: file.to_path_buf(), reason: reason.to_string() }
}

fn read_manifest(folder: &Path) -> Result<Manifest, TemplateFileError> {
    let path = folder.join(MANIFEST);
    if !path.is_file() {
        return Err(TemplateFileError::Missing { path: folder.to_path_buf() });
    }
    let wrong = |reason: String| TemplateFileError::Manifest { path: path.clone(), reason };
    let text = guard::read_text_at_most(&path, MOST_MANIFEST_BYTES);
    let text = text.map_err(|e| wrong(e.to_string()))?;
    let version: VersionOnly = toml::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    if version.version != VERSION {
        let path = folder.to_path_buf();
        return Err(TemplateFileError::Version { path, found: version.version });
    }
    let manifest: Manifest = toml::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    manifest.check().map_err(wrong)?;
    Ok(manifest)
}

#[cfg(test)]
mod tests;
