//! Reading what a user points at, with the options of the command line.

use crate::args::Global;
use anyhow::Context;
use dsfms::camera::CameraModel;
use dsfms::image::ToneCurve;
use dsfms::io::InputError;
use dsfms::pipeline::inputs::frames_camera;
pub use dsfms::pipeline::inputs::{
    CameraInput, Purpose, Source, check_size, mask_of, predicted_from, rest_lost, sources,
};
use dsfms::template::Template;
use std::path::Path;

/// Read `--camera`; `--tone` counts more than what the file says.
pub fn camera(path: &Path, global: &Global) -> anyhow::Result<CameraInput> {
    CameraInput::read(path, global.tone.map(Into::into)).context("camera file")
}

/// Read an options file.
pub fn options<T, E>(path: &Path, parse: impl FnOnce(&str) -> Result<T, E>) -> anyhow::Result<T>
where
    E: std::error::Error + Send + Sync + 'static,
{
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("cannot read the options file {}", path.display()))?;
    parse(&text).with_context(|| format!("{} is not a valid options file", path.display()))
}

/// Camera and tone curve of frames of the deformed organ: of `--camera`, or else of the template. The
/// file's lens and, where the template knows none, its light become the template's.
pub fn frame_camera(
    path: Option<&Path>,
    global: &Global,
    template: &mut Template,
) -> anyhow::Result<(CameraModel, ToneCurve)> {
    let given = path.map(|path| camera(path, global)).transpose()?;
    frames_camera(template, given, global.tone.map(Into::into))
        .context("the template holds no camera; give the frames' camera with --camera")
}

/// A path that must be there before any work begins.
pub fn must_exist(path: &Path, option: &str) -> anyhow::Result<()> {
    match path.exists() {
        true => Ok(()),
        false => Err(InputError::Missing(path.into())).context(option.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::camera::Lens;
    use dsfms::io::camera::{CameraFile, write_camera};
    use dsfms::light::{LightModel, PointLight, Spot};
    use dsfms::pipeline::{Silent, TemplateOptions, template_from_mesh};
    use dsfms::template::LengthUnit;

    /// Both `reconstruct` and `track` take camera, lens and light from here.
    #[test]
    fn a_template_without_light_takes_that_of_the_camera_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.json");
        let light = LightModel::Point(PointLight {
            positions: vec![dsfms::geometry::Point3::new(0.0, -3.0, 0.0)],
            reference_distance: 50.0,
            spot: Spot::Isotropic,
        });
        let camera = CameraModel {
            size: [64, 48],
            focal: [60.0; 2],
            centre: [31.5, 23.5],
            lens: Lens::Pinhole,
        };
        let (light, vignetting) = (Some(light), Some(-0.2));
        write_camera(&path, &CameraFile { camera, tone: None, light, vignetting }).unwrap();
        let mesh = dsfms::synth::patch(60, 1).mesh;
        let options = TemplateOptions::default();
        let mut template =
            template_from_mesh(mesh, LengthUnit::Millimetre, None, &options, &Silent);
        let global = Global { threads: None, seed: 0, quiet: true, tone: None };
        assert!(frame_camera(None, &global, &mut template).is_err());
        frame_camera(Some(&path), &global, &mut template).unwrap();
        assert!(matches!(template.light, Some(LightModel::Point(_))));
        assert_eq!(template.coat.vignetting, -0.2);
        // One that was measured stays.
        template.light = Some(LightModel::Collinear);
        frame_camera(Some(&path), &global, &mut template).unwrap();
        assert_eq!(template.light, Some(LightModel::Collinear));
    }
}
