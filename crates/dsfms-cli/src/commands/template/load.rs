//! Frames and masks of an exploration.

use super::args::TemplateArgs;
use crate::args::Global;
use crate::exit::Usage;
use crate::inputs::{self, CameraInput, Source};
use crate::progress::Reporter;
use anyhow::Context;
use dsfms::camera::CameraModel;
use dsfms::camera::resample::{resampled, resampled_mask};
use dsfms::image::names::stem;
use dsfms::image::{Frame, Mask};
use dsfms::io::InputError;
use dsfms::io::camera::{CameraFile, ImageCameras, read_image_cameras};
use dsfms::io::masks::MaskKind;
use dsfms::pipeline::{OrganOutline, Progress};
use dsfms::video::SelectOptions;
use std::path::{Path, PathBuf};

/// The organ as outlined on a frame, which is taken from the list.
fn outline(outlines: &mut Vec<OrganOutline>, frame: &Frame) -> Option<Mask> {
    let own = |o: &OrganOutline| o.frame == frame.name || stem(&o.frame) == frame.name;
    let found = outlines.iter().position(own)?;
    Some(Mask::polygon(frame.size, &outlines.remove(found).corners))
}

/// Frames and their masks; a list of masks is empty where none were given.
pub struct Loaded {
    pub frames: Vec<Frame>,
    pub valid: Vec<Option<Mask>>,
    pub organ: Vec<Option<Mask>>,
    /// No frame had to be left out.
    pub complete: bool,
}

/// The camera that all frames are brought to, and those of single frames where they differ.
pub struct Cameras {
    pub common: CameraInput,
    own: Option<ImageCameras>,
}

impl Cameras {
    /// Pixels named on the command line are of frames as they are on disk.
    pub fn open(path: &Path, args: &TemplateArgs, global: &Global) -> anyhow::Result<Self> {
        let Some(own) = read_image_cameras(path).context("cameras of the model")? else {
            return Ok(Self { common: inputs::camera(path, global)?, own: None });
        };
        let organ = &args.organ;
        let pixels = organ.organ_click.is_some()
            || !organ.not_organ_click.is_empty()
            || organ.organ_scribbles.is_some()
            || !organ.organ_polygon.is_empty()
            || args.scale.names_pixels();
        if pixels {
            let problem = format!(
                "the cameras of {} differ, and frames are brought to one of them: --organ-polygon, --organ-click, --not-organ-click, --organ-scribbles and --scale-reference cannot be used, --organ-masks and --camera-step can",
                path.display()
            );
            return Err(Usage(problem).into());
        }
        let file =
            CameraFile { camera: own.common.clone(), tone: None, light: None, vignetting: None };
        let common = CameraInput::new(file, global.tone.map(Into::into));
        Ok(Self { common, own: Some(own) })
    }
}

/// A frame with its valid and its organ mask.
type Masked = (Frame, Option<Mask>, Option<Mask>);

/// The frame and its masks as another camera would have them.
fn brought((frame, valid, organ): Masked, from: &CameraModel, to: &CameraModel) -> Masked {
    if from == to {
        return (frame, valid, organ);
    }
    let (frame, shown) = resampled(&frame, from, to);
    let mask = |m: &Mask| resampled_mask(m, from, to);
    let valid = valid.as_ref().map(mask).map_or(shown.clone(), |valid| valid.and(&shown));
    (frame, Some(valid), organ.as_ref().map(mask))
}

/// Decode frames and masks. A frame that cannot be read or has another size than the camera is left
/// out with a warning; it is an error if that leaves fewer than two.
pub fn load(
    args: &TemplateArgs,
    video: &SelectOptions,
    cameras: &Cameras,
    camera_path: &Path,
    reporter: &Reporter,
) -> anyhow::Result<Loaded> {
    let options = [(&args.masks, "--masks"), (&args.organ.organ_masks, "--organ-masks")];
    for (path, option) in options.iter().filter_map(|(p, o)| Some((p.as_ref()?, o))) {
        inputs::must_exist(path, option)?;
    }
    let sources = inputs::sources(&args.frames, inputs::Purpose::Template(video), reporter)?;
    if cameras.own.is_none() {
        inputs::check_sizes(&sources, &cameras.common.file.camera, camera_path)?;
    }
    let mut loaded =
        Loaded { frames: Vec::new(), valid: Vec::new(), organ: Vec::new(), complete: true };
    let mut outlines = args.organ.organ_polygon.clone();
    let mut first_error = None;
    for source in &sources {
        let common = &cameras.common.file.camera;
        let name = source.path().and_then(|p| p.file_name()).map(|n| n.to_string_lossy());
        let name = name.map_or_else(|| source.name(), |n| n.into_owned());
        let own = cameras.own.as_ref().map_or(common, |own| own.of(&name));
        match load_frame(source, own, camera_path) {
            Ok(frame) => {
                let (valid, organ) = masks(args, source, &frame, reporter)?;
                let organ = organ.or(outline(&mut outlines, &frame));
                let (frame, valid, organ) = brought((frame, valid, organ), own, common);
                loaded.valid.push(valid);
                loaded.organ.push(organ);
                loaded.frames.push(frame);
            }
            Err(error) => {
                reporter.warn(&format!("{error}; the frame is left out"));
                loaded.complete = false;
                first_error.get_or_insert(error);
            }
        }
    }
    if let Some(left) = outlines.first() {
        let problem = format!("--organ-polygon: no frame is called {:?}", left.frame);
        return Err(Usage(problem).into());
    }
    check_outlined(args, &loaded, reporter)?;
    match first_error {
        Some(error) if loaded.frames.len() < 2 => Err(error).with_context(|| {
            format!("{} of {} frames can be used", loaded.frames.len(), sources.len())
        }),
        _ => Ok(loaded),
    }
}

/// Deformed frames that are looked at, at most.
const ALSO: usize = 24;

/// Frames of the deformed organ; those that cannot be read are left out with a warning.
pub fn load_also(
    args: &TemplateArgs,
    cameras: &Cameras,
    camera_path: &Path,
    reporter: &Reporter,
) -> anyhow::Result<Vec<Frame>> {
    if args.organ.also.is_empty() {
        return Ok(Vec::new());
    }
    let sources = inputs::sources(&args.organ.also, inputs::Purpose::Reconstruct, reporter)?;
    let every = sources.len().div_ceil(ALSO).max(1);
    let some: Vec<Source> = sources.into_iter().step_by(every).collect();
    let mut frames = Vec::new();
    inputs::each_source(&some, &mut |_, source| {
        match load_frame(&source, &cameras.common.file.camera, camera_path) {
            Ok(frame) => frames.push(frame),
            Err(error) => reporter.warn(&format!("--also: {error}; the frame is left out")),
        }
        true
    });
    Ok(frames)
}

fn load_frame(source: &Source, camera: &CameraModel, path: &Path) -> Result<Frame, InputError> {
    let frame = source.frame()?;
    inputs::check_size(&frame, camera, path)?;
    Ok(frame)
}

fn masks(
    args: &TemplateArgs,
    source: &Source,
    frame: &Frame,
    reporter: &Reporter,
) -> Result<(Option<Mask>, Option<Mask>), InputError> {
    let read = |option: &Option<PathBuf>, kind| {
        option
            .as_deref()
            .map(|path| inputs::mask_of(frame, source.path(), path, kind, reporter))
            .transpose()
    };
    // The organ outlined in some of the frames tells it in the others.
    let organ = match read(&args.organ.organ_masks, MaskKind::Organ) {
        Err(InputError::NoPartner { .. }) => None,
        read => read?,
    };
    Ok((read(&args.masks, MaskKind::Valid)?, organ))
}

/// Say how many frames have an outline of the organ; masks that are of none of them are an error.
fn check_outlined(args: &TemplateArgs, loaded: &Loaded, reporter: &Reporter) -> anyhow::Result<()> {
    let (Some(path), Some(first)) = (&args.organ.organ_masks, loaded.frames.first()) else {
        return Ok(());
    };
    let (found, all) = (loaded.organ.iter().flatten().count(), loaded.frames.len());
    if found == 0 {
        anyhow::bail!(
            "{}: no organ mask (white = organ) for any of the {all} frames; expected {name}.png for {name}, or another \
             name with its number",
            path.display(),
            name = first.name
        );
    }
    if found < all {
        reporter
            .note(&format!("organ masks for {found} of {all} frames; the others follow from them"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::organ::parse_outline;
    use super::*;

    #[test]
    fn frames_of_other_cameras_are_brought_to_the_common_one() {
        let camera = |focal: f64| CameraModel::pinhole([8, 6], [focal; 2], [3.5, 2.5]);
        let frame = Frame { name: "f".into(), size: [8, 6], rgb: vec![[50; 3]; 48] };
        let organ = Some(Mask::filled([8, 6], true));
        let same = brought((frame.clone(), None, organ.clone()), &camera(10.0), &camera(10.0));
        assert_eq!(same, (frame.clone(), None, organ.clone()));
        let (found, valid, organ) = brought((frame, None, organ), &camera(20.0), &camera(10.0));
        let shown = valid.unwrap();
        assert!(shown.at(3, 2) && !shown.at(0, 0) && organ.unwrap().at(4, 3));
        assert_eq!((found.rgb[2 * 8 + 3], found.rgb[0]), ([50; 3], [0; 3]));
    }

    #[test]
    fn an_outline_belongs_to_its_frame() {
        let mut outlines =
            vec![parse_outline("a:b.png: -0.5,-0.5, 2.5,-0.5, 2.5,2.5,-0.5,2.5").unwrap()];
        let frame = |name: &str| Frame { name: name.into(), size: [4, 4], rgb: vec![[0; 3]; 16] };
        assert!(outline(&mut outlines, &frame("c")).is_none());
        assert_eq!(outline(&mut outlines, &frame("a:b")).unwrap().coverage(), 9.0 / 16.0);
        assert!(outlines.is_empty());
        for bad in ["frame", "f:1,2,3,4", "f:1,2,3,4,5", "f:1,2,3,4,5,x"] {
            assert!(parse_outline(bad).unwrap_err().contains("x,y"), "{bad}");
        }
    }
}
