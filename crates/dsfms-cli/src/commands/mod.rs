//! One file per subcommand.

pub mod calibrate;
pub mod completions;
pub mod demo;
pub mod evaluate;
pub mod experiment;
pub mod export;
pub mod figure;
pub mod inspect;
pub mod options;
pub mod reconstruct;
pub mod register_ct;
pub mod replay;
mod scale;
pub mod synth;
pub mod template;
pub mod track;
pub mod view;

use anyhow::Context;

/// The worker threads; `apart`: each on a core of its own where there are enough, since a live
/// source cannot wait for a scheduler that packs threads together.
pub fn start_threads(threads: Option<usize>, apart: bool) -> anyhow::Result<()> {
    let cores = if apart { core_affinity::get_core_ids().unwrap_or_default() } else { Vec::new() };
    let count = threads.unwrap_or(cores.len());
    let mut builder = rayon::ThreadPoolBuilder::new().num_threads(count);
    if count <= cores.len() {
        builder = builder.start_handler(move |thread| {
            // Where that is refused, threads run as they would have.
            cores.get(thread).map(|core| core_affinity::set_for_current(*core));
        });
    }
    if threads.is_some() || apart {
        builder.build_global().context("cannot start the worker threads")?;
    }
    Ok(())
}
