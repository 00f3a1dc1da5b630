//! The output folder: apart from the input, and without files of an older run.

pub mod mark;

use crate::exit::{Usage, describe};
use crate::outputs::{check_folder, prepare_folder};
use dsfms::image::names;
use mark::{MARK, check_names, foreign};
use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};

/// Commands that renew each other's folders.
const COMMANDS: [&str; 2] = ["reconstruct", "track"];

/// What a run writes besides `frame_NNN…`.
const FILES: [&str; 11] = [
    "summary.csv",
    "camera_poses.json",
    "report.html",
    "vertices.npz",
    "run.json",
    "frames.pvd",
    "frames.glb",
    "frames.mtl",
    "frames.png",
    "overlay.mp4",
    MARK,
];
/// What it writes of every frame.
const ENDINGS: [&str; 7] =
    [".ply", ".json", "_overlay.png", "_structures.png", ".vtp", ".obj", ".stl"];
/// Folders of a file or more a frame.
const FOLDERS: [&str; 4] = ["overlay", "structures", "view", "volume"];

/// Refuse, before any work, an output folder that is or lies in a folder of the input, that holds
/// an image of the input, that cannot be written, or that holds files of our names which no run of
/// ours left.
pub fn check(output: &Path, inputs: &[&Path]) -> anyhow::Result<()> {
    check_apart(output, inputs)?;
    check_names(output, &COMMANDS, "-o", is_our_name)?;
    for folder in FOLDERS.iter().filter(|_| !mark::is_marked(output, &COMMANDS)) {
        if let Some(name) =
            mark::names(&output.join(folder))?.iter().find(|n| n.starts_with("frame_"))
        {
            return Err(foreign(output, &format!("{folder}/{name}"), "-o"));
        }
    }
    check_folder(output)
}

/// Refuse an output folder that is, or lies in, a folder of the input, or that holds an image of
/// it.
pub fn check_apart(output: &Path, inputs: &[&Path]) -> anyhow::Result<()> {
    let out = real(output);
    for input in inputs {
        let within = input.is_dir() && out.starts_with(real(input));
        let is_ours = || input.file_name().is_some_and(|n| is_our_name(&n.to_string_lossy()));
        let is_image = names::EXTENSIONS.iter().any(|e| input.extension() == Some(OsStr::new(e)));
        let beside =
            input.is_file() && real(input).parent() == Some(&out) && (is_image || is_ours());
        if within || beside {
            let text = format!(
                "the output folder {} lies in the input ({}), where a next run would take results for input; \
                 choose another with -o",
                output.display(),
                input.display()
            );
            return Err(Usage(text).into());
        }
    }
    Ok(())
}

/// Refuse to write a file over one of the input.
pub fn keep_inputs<'a>(
    output: &Path,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> anyhow::Result<()> {
    match inputs.into_iter().any(|input| input.is_file() && same(input, output)) {
        true => {
            let text = format!(
                "{} is an input, and would be overwritten; choose another name",
                output.display()
            );
            Err(Usage(text).into())
        }
        false => Ok(()),
    }
}

/// Refuse an output folder that holds a file or folder of the input: it is replaced as a whole.
pub fn keep_outside(output: &Path, inputs: &[&Path]) -> anyhow::Result<()> {
    match inputs.iter().find(|input| within(input, output)) {
        Some(input) => {
            let text = format!(
                "the input {} lies in the output folder {}, and would be lost; choose another with -o",
                input.display(),
                output.display()
            );
            Err(Usage(text).into())
        }
        None => Ok(()),
    }
}

/// Whether a path is a folder or lies in it.
pub fn within(path: &Path, folder: &Path) -> bool {
    real(path).starts_with(real(folder))
}

/// Whether two paths are of one place.
pub fn same(a: &Path, b: &Path) -> bool {
    real(a) == real(b)
}

/// Make the folder, mark it, and remove the files of an older run.
pub fn renew(output: &Path, command: &str) -> anyhow::Result<()> {
    prepare_folder(output)?;
    // First: where there is no room for it, what an older run left stays; and a removal that was
    // interrupted is taken up by the next run.
    mark::write(output, command)?;
    let of_frame = |name: &str| name.starts_with("frame_");
    for folder in FOLDERS.map(|name| output.join(name)) {
        if mark::names(&folder)?.iter().any(|name| of_frame(name)) {
            mark::remove(&folder, of_frame)?;
            // It stays where something else lies in it.
            let _ = std::fs::remove_dir(&folder);
        }
    }
    mark::remove(output, |name| name != MARK && is_our_name(name))
}

/// An error before anything is written, with the word that what an older run left is still there.
pub fn untouched(output: &Path, error: anyhow::Error) -> anyhow::Error {
    if !output.join(MARK).is_file() {
        return error;
    }
    let text = format!("{}; what {} holds is of an older run", describe(&error), output.display());
    error.context(text)
}

/// Whether runs give files this name.
fn is_our_name(name: &str) -> bool {
    let of_frame = || {
        let rest = name.strip_prefix("frame_")?;
        let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        (digits >= 3).then(|| ENDINGS.contains(&&rest[digits..]))
    };
    FILES.contains(&name) || of_frame().unwrap_or(false)
}

/// A path without links, `.` and `..`, as far as it exists.
pub fn real(path: &Path) -> PathBuf {
    let full = std::path::absolute(path).unwrap_or_else(|_| path.into());
    let mut real = PathBuf::new();
    for part in full.components() {
        match part {
            Component::ParentDir => drop(real.pop()),
            Component::CurDir => {}
            part => real.push(part),
        }
        real = real.canonicalize().unwrap_or(real);
    }
    real
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{create_dir_all, write};

    #[test]
    fn old_files_of_ours_go_and_the_user_s_stay() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        check(&out, &[]).unwrap();
        renew(&out, "track").unwrap();
        create_dir_all(out.join("overlay")).unwrap();
        let ours =
            ["frame_000.ply", "frame_012_overlay.png", "summary.csv", "overlay/frame_000.png"];
        let users = ["notes.txt", "frame_1.png", "frame_ply", "frames.txt", "overlay/mine.png"];
        ours.iter().chain(&users).for_each(|name| write(out.join(name), "x").unwrap());
        check(&out, &[]).unwrap();
        renew(&out, "track").unwrap();
        assert!(ours.iter().all(|name| !out.join(name).exists()));
        assert!(users.iter().all(|name| out.join(name).exists()));
        assert!(out.join(MARK).exists());
    }

    #[test]
    fn files_that_no_run_left_are_never_removed() {
        let folder = tempfile::tempdir().unwrap();
        let refused = |name: &str| {
            let error = check(folder.path(), &[]).unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        create_dir_all(folder.path().join("overlay")).unwrap();
        write(folder.path().join("overlay/frame_003.png"), "the user's picture").unwrap();
        refused("overlay/frame_003.png");
        write(folder.path().join("frame_003.ply"), "the user's truth").unwrap();
        refused("frame_003.ply");
    }

    #[test]
    fn output_within_the_input_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let frames = folder.path().join("frames");
        create_dir_all(&frames).unwrap();
        write(frames.join("a.png"), "x").unwrap();
        let bad = [
            frames.clone(),
            frames.join("deep/out"),
            frames.join("../frames"),
            folder.path().join("none/../frames/out"),
        ];
        for out in &bad {
            assert!(check_apart(out, &[&frames]).is_err(), "{}", out.display());
        }
        #[cfg(unix)]
        {
            let link = folder.path().join("link");
            std::os::unix::fs::symlink(&frames, &link).unwrap();
            assert!(check_apart(&link.join("out"), &[&frames]).is_err());
        }
        assert!(check_apart(&frames, &[&frames.join("a.png")]).is_err());
        assert!(check_apart(&frames.join("out"), &[&frames.join("a.png")]).is_ok());
        assert!(check_apart(folder.path(), &[&frames]).is_ok());
        assert!(check_apart(&folder.path().join("frames2"), &[&frames]).is_ok());
    }
}
