//! The options that every series of cases has.

use crate::exit::Usage;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use dsfms::experiment::SeriesOrgan;
use dsfms::synth::{ExtensionOf, LightKind, Protocol};
use std::path::Path;

#[derive(Debug, Args)]
pub struct SeriesArgs {
    /// `uterus`, `liver` (a part of it for every case, scaled to 2000 mm2), `patch` (a bulging
    /// patch of 50 x 40 mm), or a mesh file.
    #[arg(long, value_name = "ORGAN", default_value = "patch")]
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
    /// Light along the optical axis, near and 3 mm above the camera, or a ring of 4 mm around the
    /// lens.
    #[arg(long, value_name = "LIGHT", default_value = LightKind::Distant.name(), value_parser = light())]
    light: LightKind,
    /// Vertices of the template; default 334, for a clip 1000.
    #[arg(long, value_name = "N", value_parser = vertices)]
    vertices: Option<usize>,
    /// What an extension states: the largest relative edge-length change in the deformed zone, or
    /// the mean one.
    #[arg(long, value_enum, default_value_t = ExtensionName::Largest)]
    extension_of: ExtensionName,
    /// Attraction points of a case, all pulling or all pushing.
    #[arg(long, value_name = "N", default_value_t = Protocol::default().attractions,
        value_parser = attractions)]
    attractions: usize,
    /// Radius of the surface that one attraction point moves, mm.
    #[arg(long, value_name = "MM", default_value_t = Protocol::default().reach, value_parser = length)]
    reach: f64,
    /// Distance of the attraction points from the surface, mm.
    #[arg(long, value_name = "LEAST,MOST", num_args = 1..=2, value_delimiter = ',',
        default_values_t = Protocol::default().height, value_parser = length)]
    height: Vec<f64>,
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
enum ExtensionName {
    Largest,
    Mean,
}

impl SeriesArgs {
    /// What all cases share.
    pub fn protocol(&self, seed: u64) -> Protocol {
        let (matches, everywhere) = match self.matches {
            Matches::Sparse => (25, false),
            Matches::Dense => (500, true),
        };
        let extension_of = match self.extension_of {
            ExtensionName::Largest => ExtensionOf::Largest,
            ExtensionName::Mean => ExtensionOf::Mean,
        };
        let ends = |pick: fn(f64, f64) -> f64| self.height.iter().copied().reduce(pick);
        let height = [ends(f64::min), ends(f64::max)].map(|h| h.unwrap_or(1.0));
        let (attractions, reach) = (self.attractions, self.reach);
        let vertices = self.vertices_or(Protocol::default().vertices);
        Protocol {
            vertices,
            light: self.light,
            matches,
            everywhere,
            extension_of,
            attractions,
            reach,
            height,
            seed,
        }
    }

    /// Vertices, where they are not given.
    pub fn vertices_or(&self, default: usize) -> usize {
        self.vertices.unwrap_or(default)
    }

    /// The organ.
    pub fn organ(&self) -> anyhow::Result<SeriesOrgan> {
        SeriesOrgan::named(&self.organ).map_err(|error| match Path::new(&self.organ).exists() {
            true => error.into(),
            false => Usage(format!("--organ: {error}")).into(),
        })
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

/// A light by its name.
fn light() -> impl TypedValueParser<Value = LightKind> {
    let names = PossibleValuesParser::new(LightKind::ALL.map(LightKind::name));
    names.try_map(|name| LightKind::named(&name).ok_or("no such light"))
}

/// A length above zero.
fn length(text: &str) -> Result<f64, String> {
    let valid = |v: &f64| (0.5..=100.0).contains(v);
    text.parse().ok().filter(valid).ok_or_else(|| "expected 0.5 to 100 mm".to_owned())
}

fn attractions(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n @ 1..=20) => Ok(n),
        _ => Err("expected a whole number from 1 to 20".into()),
    }
}

fn vertices(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n @ 60..=20_000) => Ok(n),
        _ => Err("expected a whole number from 60 to 20000".into()),
    }
}
