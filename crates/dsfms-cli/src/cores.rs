//! Worker threads, each on a core of its own where the system can do that.

/// The worker threads of this process; `apart`: each on a core of its own where there are enough,
/// since a live source cannot wait for a scheduler that packs threads together.
pub fn start_threads(
    threads: Option<usize>,
    apart: bool,
) -> Result<(), rayon::ThreadPoolBuildError> {
    let cores = if apart { cores() } else { Vec::new() };
    let count = threads.unwrap_or(cores.len());
    let mut builder = rayon::ThreadPoolBuilder::new().num_threads(count);
    if count <= cores.len() {
        // Where that is refused, threads run as they would have.
        builder = builder.start_handler(move |thread| _ = cores.get(thread).map(keep_to));
    }
    if threads.is_some() || apart {
        builder.build_global()?;
    }
    Ok(())
}

#[cfg(target_os = "linux")]
use rustix::thread::CpuSet as Core;

/// The cores that this process may use.
#[cfg(target_os = "linux")]
fn cores() -> Vec<Core> {
    let Ok(all) = rustix::thread::sched_getaffinity(None) else { return Vec::new() };
    let alone = |k: usize| {
        let mut core = Core::new();
        core.set(k);
        core
    };
    (0..Core::MAX_CPU).filter(|&k| all.is_set(k)).map(alone).collect()
}

#[cfg(target_os = "linux")]
fn keep_to(core: &Core) {
    _ = rustix::thread::sched_setaffinity(None, core);
}

#[cfg(not(target_os = "linux"))]
type Core = ();

/// Other schedulers keep threads apart by themselves, and not all take advice.
#[cfg(not(target_os = "linux"))]
fn cores() -> Vec<Core> {
    Vec::new()
}

#[cfg(not(target_os = "linux"))]
fn keep_to((): &Core) {}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_thread_keeps_to_its_core() {
        for core in cores() {
            let kept = std::thread::spawn(move || {
                keep_to(&core);
                cores()
            });
            assert_eq!(kept.join().unwrap(), [core]);
        }
        assert!(!cores().is_empty());
    }
}
