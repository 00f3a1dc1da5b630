//! What this CPU can run: the program compiled for any x86-64 CPU hands over to the one compiled
//! for AVX2 and FMA beside it, where there is one and the CPU has them; that one says so on a CPU
//! that has not.

use std::path::{Path, PathBuf};

/// Set in the environment, the program for any CPU stays.
const STAY: &str = "DSFMS_PORTABLE";

/// Whether this CPU has what the program was compiled for; without the question it would die of an
/// illegal instruction. The standard library's own test is no question where the compiler may use
/// AVX2 everywhere: it is true at compile time.
pub fn suits() -> bool {
    !FAST || std::fs::read_to_string("/proc/cpuinfo").map_or(true, |text| has_avx2(&text))
}

/// Whether this program is compiled for AVX2.
pub const FAST: bool = cfg!(all(target_arch = "x86_64", target_feature = "avx2"));

/// Whether the first CPU of `/proc/cpuinfo` lists AVX2, FMA and BMI2; true where it lists nothing.
fn has_avx2(cpuinfo: &str) -> bool {
    let Some(flags) = cpuinfo.lines().find(|line| line.starts_with("flags")) else { return true };
    ["avx2", "fma", "bmi2"].iter().all(|name| flags.split_whitespace().any(|flag| flag == *name))
}

/// The faster program of an installation, beside this one or in `lib/dsfms` of the same root.
fn faster(own: &Path) -> Option<PathBuf> {
    const NAME: &str = "dsfms-x86-64-v3";
    let folder = own.parent()?;
    [folder.join(NAME), folder.join("../lib/dsfms").join(NAME)].into_iter().find(|p| p.is_file())
}

/// Go on as the faster program, where there is one that this CPU can run. Returns where there is
/// none.
#[cfg(all(target_arch = "x86_64", unix))]
pub fn hand_over() {
    use std::os::unix::process::CommandExt;
    // What x86-64-v3 means.
    let able = std::is_x86_feature_detected!("avx2")
        && std::is_x86_feature_detected!("fma")
        && std::is_x86_feature_detected!("bmi1")
        && std::is_x86_feature_detected!("bmi2")
        && std::is_x86_feature_detected!("f16c")
        && std::is_x86_feature_detected!("lzcnt")
        && std::is_x86_feature_detected!("movbe");
    if FAST || !able || std::env::var_os(STAY).is_some() {
        return;
    }
    let own = std::env::current_exe().and_then(|path| path.canonicalize());
    if let Some(faster) = own.ok().as_deref().and_then(faster) {
        // One that cannot be started is no reason not to work.
        let _ = std::process::Command::new(faster).args(std::env::args_os().skip(1)).exec();
    }
}

/// Elsewhere one program is all there is.
#[cfg(not(all(target_arch = "x86_64", unix)))]
pub fn hand_over() {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_old_cpu_is_told_before_it_stumbles() {
        assert!(has_avx2("processor : 0\nflags : fpu fma avx avx2 bmi1 bmi2\n"));
        assert!(!has_avx2("processor : 0\nflags : fpu avx bmi2 fma4\n"));
        assert!(has_avx2("model name : of no flags\n"));
    }

    #[test]
    fn the_faster_program_is_found_beside_and_in_lib() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        std::fs::create_dir_all(at("bin")).unwrap();
        std::fs::create_dir_all(at("lib/dsfms")).unwrap();
        assert_eq!(faster(&at("bin/dsfms")), None);
        std::fs::write(at("lib/dsfms/dsfms-x86-64-v3"), "").unwrap();
        let found = faster(&at("bin/dsfms")).unwrap().canonicalize().unwrap();
        assert_eq!(found, at("lib/dsfms/dsfms-x86-64-v3").canonicalize().unwrap());
        std::fs::write(at("bin/dsfms-x86-64-v3"), "").unwrap();
        assert_eq!(faster(&at("bin/dsfms")), Some(at("bin/dsfms-x86-64-v3")));
    }
}
