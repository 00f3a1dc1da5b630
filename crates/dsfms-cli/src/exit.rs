//! Exit codes, and errors as the user reads them.

use dsfms::experiment::ExperimentError;
use dsfms::io::InputError;
use dsfms::io::mesh::MeshFileError;
use dsfms::mesh::topology::TopologyError;
use dsfms::pipeline::{ReconstructError, TemplateError};
use dsfms::register::RegisterError;
use dsfms::voxels::VoxelError;
use std::error::Error;
use std::process::ExitCode;

/// How a command that produced something ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Every frame is ok.
    Ok,
    /// Some frames are degraded or failed.
    Degraded,
    /// Every frame failed; said already.
    Nothing,
}

/// A combination of arguments that makes no sense.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);

const NOTHING: u8 = 1;
const DEGRADED: u8 = 2;
const USAGE: u8 = 64;

/// The exit code of a command; prints its error and a hint.
pub fn code(result: anyhow::Result<Outcome>) -> ExitCode {
    match result {
        Ok(Outcome::Ok) => ExitCode::SUCCESS,
        Ok(Outcome::Degraded) => ExitCode::from(DEGRADED),
        Ok(Outcome::Nothing) => ExitCode::from(NOTHING),
        Err(error) => {
            eprintln!("error: {}", describe(&error));
            if let Some(hint) = hint(&error) {
                eprintln!("hint: {hint}");
            }
            ExitCode::from(if error.is::<Usage>() { USAGE } else { NOTHING })
        }
    }
}

/// An error with its causes; a cause that the message before it already quotes is not repeated.
pub fn describe(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text += &format!(": {cause}");
        }
    }
    text
}

/// [`describe`] with the option that helps, for one frame of many.
pub fn advised(error: &anyhow::Error) -> String {
    match error.chain().find_map(option) {
        Some(hint) => format!("{}; {hint}", describe(error)),
        None => describe(error),
    }
}

/// `--help` and `--version` are successes, everything else that clap refuses is wrong usage.
pub fn parse_error(error: &clap::Error) -> ExitCode {
    // The terminal may be gone; there is nothing better to do than to exit.
    let _ = error.print();
    if error.use_stderr() { ExitCode::from(USAGE) } else { ExitCode::SUCCESS }
}

/// What to try next, by the kind of the innermost error that has advice.
fn hint(error: &anyhow::Error) -> Option<&'static str> {
    if error.is::<Usage>() {
        return Some("`dsfms help COMMAND` shows every option with examples");
    }
    error.chain().find_map(advice)
}

fn advice(cause: &(dyn Error + 'static)) -> Option<&'static str> {
    if let Some(hint) = option(cause) {
        return Some(hint);
    }
    match cause.downcast_ref::<InputError>()? {
        InputError::Missing(_) => {
            Some("check the path; relative paths start at the current folder")
        }
        InputError::Image { .. } => Some("expected PNG, JPEG or TIFF; export the frame again"),
        InputError::Field { .. } | InputError::Camera { .. } => {
            Some("README.md lists the fields of camera.json and of the other files")
        }
        _ => None,
    }
}

/// The options of the command line that help against an error of the library, which knows none.
fn option(cause: &(dyn Error + 'static)) -> Option<&'static str> {
    match cause.downcast_ref::<InputError>() {
        Some(InputError::PosesForCamera(_)) => return Some("it belongs to --poses"),
        Some(InputError::CameraForPoses(_)) => return Some("it belongs to --camera"),
        _ => {}
    }
    match cause.downcast_ref::<MeshFileError>() {
        // Where there is no face, there is nothing to mend.
        Some(MeshFileError::Topology { source: TopologyError::NoFaces, .. }) => return None,
        Some(MeshFileError::Topology { .. } | MeshFileError::ZeroArea { .. }) => {
            return Some(
                "--repair (of `dsfms template` and `dsfms register-ct`) merges vertices, removes such faces and \
                 turns those that run against their neighbours, and says what it did",
            );
        }
        _ => {}
    }
    match cause.downcast_ref::<TemplateError>() {
        Some(TemplateError::NoPoints { .. }) => return Some("leave --poses out to estimate them"),
        Some(TemplateError::EmptyOutline { .. }) => {
            return Some("--organ-masks takes masks of all frames");
        }
        _ => {}
    }
    if let Some(ExperimentError::OtherParameters { .. } | ExperimentError::Results { .. }) =
        cause.downcast_ref::<ExperimentError>()
    {
        return Some("-o gives another folder, --restart drops the old results");
    }
    match cause.downcast_ref::<VoxelError>() {
        Some(VoxelError::Beside { others: 1.., .. }) => {
            return Some("--volume-axes says which axes the mesh has");
        }
        Some(VoxelError::Open { .. }) => {
            return Some("--volume-registration takes the folder of `dsfms register-ct`");
        }
        _ => {}
    }
    match cause.downcast_ref::<ReconstructError>()? {
        ReconstructError::NoDescriptors
        | ReconstructError::Register(RegisterError::TooFewMatches { .. }) => {
            Some("--matches gives matches, see `dsfms help reconstruct`")
        }
        ReconstructError::Register(RegisterError::NoView { .. }) => {
            Some("--camera-motion says where the camera is")
        }
        ReconstructError::NoAlbedo(_) => {
            Some("`dsfms template --mesh MESH --albedo FILE` gives a mesh its albedo")
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_said_once() {
        let inner = anyhow::anyhow!("disk full");
        let quoted = inner.context("cannot write a: disk full").context("output");
        assert_eq!(describe(&quoted), "output: cannot write a: disk full");
    }

    #[test]
    fn a_mesh_without_faces_has_nothing_to_repair() {
        let hint = |source| {
            let error = MeshFileError::Topology { path: "m.ply".into(), source };
            super::hint(&anyhow::Error::from(error))
        };
        assert_eq!(hint(TopologyError::NoFaces), None);
        let twice = TopologyError::DuplicateFace { first: 0, second: 1 };
        assert!(hint(twice).unwrap().contains("--repair"));
    }

    #[test]
    fn the_option_that_helps_is_named_behind_the_causes_of_the_library() {
        let few = ReconstructError::from(RegisterError::TooFewMatches { found: 2, needed: 4 });
        let text = advised(&anyhow::Error::from(few).context("frame_003"));
        assert!(
            text.starts_with("frame_003: 2 usable matches") && text.contains("--matches"),
            "{text}"
        );
    }
}
