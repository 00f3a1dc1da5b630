//! A template from eight rendered frames, on few pixels: what is shown with it is not how good it
//! is.

use dsfms::checkpoint::Store;
use dsfms::pipeline::template_from_frames;
use dsfms::synth::Case;
use dsfms::{Exploration, Silent, Template, TemplateOptions};

pub fn options() -> TemplateOptions {
    let mut options = TemplateOptions { vertices: 150, ..Default::default() };
    options.dense.max_pixels = 20_000;
    options.albedo.max_resolution = 4;
    options.light.spots = 300;
    options
}

pub fn build(case: &Case, store: Option<&dyn Store>) -> Template {
    let (frames, _) = case.explore(8);
    let exploration = Exploration::new(&frames, &case.camera).light(case.template.light.as_ref());
    let exploration = match store {
        Some(store) => exploration.keep(store),
        None => exploration,
    };
    template_from_frames(&exploration, &options(), &Silent).unwrap().template
}

/// Names and bytes of the files of a template.
pub fn files(template: &Template) -> Vec<(String, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("organ.template");
    dsfms::write_template(&path, template).unwrap();
    let read = |entry: std::fs::DirEntry| {
        let name = entry.file_name().to_string_lossy().into_owned();
        (name, std::fs::read(entry.path()).unwrap())
    };
    let entries = std::fs::read_dir(&path).unwrap().map(|entry| entry.unwrap());
    let mut all: Vec<_> = entries.filter(|e| e.path().is_file()).map(read).collect();
    all.sort();
    all
}
