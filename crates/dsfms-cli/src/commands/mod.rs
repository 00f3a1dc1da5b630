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
