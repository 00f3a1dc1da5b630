//! The options that every series of cases has.

use anyhow::Context;
use clap::{Args, ValueEnum};
use dsfms::experiment::Organ;
use dsfms::pipeline::ReconstructOptions;
use dsfms::synth::{LightKind, Protocol};
use std::path::PathBuf;

#[derive(Debug, Args)]
pub struct SeriesArgs {
    /// `patch` (a bulging patch of 50 x 40 mm).
    #[arg(long, default_value = "patch")]
    organ: String,
    /// Cases of every extension and noise.
    #[arg(long, value_name = "N", default_value = "100", value_parser = count)]
    pub count: usize,
    /// Noise of the matches, px.
    #[arg(long, value_delimiter = ',', default_value = "1", value_parser = noise)]
    pub noise: Vec<f64>,
    /// 25 matches outside the deformed zone, or 500 over the whole surface.
    #[arg(long, value_enum, default_value_t = Matches::Sparse)]
    matches: Matches,
    /// Light along the optical axis, or near and 3 mm above the camera.
    #[arg(long, value_enum, default_value_t = LightName::Distant)]
    light: LightName,
    /// Vertices of the template.
    #[arg(long, value_name = "N", default_value_t = 334, value_parser = vertices)]
    vertices: usize,
    /// Weights and thresholds of the methods, as `dsfms reconstruct --options` takes them.
    #[arg(long, value_name = "FILE")]
    options: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Matches {
    /// 25 outside the zone.
    #[value(name = "25")]
    Sparse,
    /// 500 anywhere.
    #[value(name = "500")]
    Dense,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum LightName {
    Distant,
    Near,
}

impl SeriesArgs {
    /// What all cases share.
    pub fn protocol(&self, seed: u64) -> Protocol {
        let (matches, everywhere) = match self.matches {
            Matches::Sparse => (25, false),
            Matches::Dense => (500, true),
        };
        let light = match self.light {
            LightName::Distant => LightKind::Distant,
            LightName::Near => LightKind::Near,
        };
        Protocol { vertices: self.vertices, light, matches, everywhere, seed, ..Default::default() }
    }

    /// The organ.
    pub fn organ(&self) -> anyhow::Result<Organ> {
        match self.organ.as_str() {
            "patch" => Ok(Organ::Patch),
            other => Err(anyhow::anyhow!("--organ {other}: not known")),
        }
    }

    /// The options of the methods.
    pub fn options(&self) -> anyhow::Result<ReconstructOptions> {
        let Some(path) = &self.options else { return Ok(ReconstructOptions::default()) };
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("--options {}", path.display()))?;
        ReconstructOptions::from_toml(&text)
            .with_context(|| format!("--options {}", path.display()))
    }
}

/// A number of cases.
pub fn count(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n @ 1..=100_000) => Ok(n),
        _ => Err("expected a whole number from 1 to 100000".into()),
    }
}

/// An extension.
pub fn percent(text: &str) -> Result<f64, String> {
    within(text, 40.0, "expected a percentage from 0 to 40")
}

fn noise(text: &str) -> Result<f64, String> {
    within(text, 50.0, "expected a noise from 0 to 50 px")
}

fn within(text: &str, most: f64, expected: &str) -> Result<f64, String> {
    text.parse().ok().filter(|v| (0.0..=most).contains(v)).ok_or_else(|| expected.to_owned())
}

fn vertices(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n @ 60..=20_000) => Ok(n),
        _ => Err("expected a whole number from 60 to 20000".into()),
    }
}
