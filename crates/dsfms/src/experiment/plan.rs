//! What is run: cells, cases and methods.

use crate::pipeline::{Method, ReconstructOptions};
use crate::synth::{Cell, Protocol};
use serde::Serialize;

/// A method with its options, under the name that tables show.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Arm {
    /// Name, unique in a plan, without commas.
    pub name: String,
    /// Method.
    pub method: Method,
    /// Its options.
    pub options: ReconstructOptions,
}

/// An experiment. Its JSON is the key that results on disk are kept under.
#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    /// Name of the organ.
    pub organ: String,
    /// What all cases share.
    pub protocol: Protocol,
    /// Extensions, percent.
    pub extensions: Vec<f64>,
    /// Noise of the matches, px.
    pub noises: Vec<f64>,
    /// Cases of a cell.
    pub count: usize,
    /// Methods.
    pub arms: Vec<Arm>,
    /// Tells program versions apart, so that results of different ones are never mixed.
    pub build: String,
}

impl Plan {
    /// All cells, noise by noise.
    pub fn cells(&self) -> Vec<Cell> {
        let cell =
            |&noise: &f64| self.extensions.iter().map(move |&extension| Cell { extension, noise });
        self.noises.iter().flat_map(cell).collect()
    }
}

/// Methods with the same options, under the names that `--method` takes.
pub fn arms_of(methods: &[Method], options: &ReconstructOptions) -> Vec<Arm> {
    let arm = |&method: &Method| Arm {
        name: format!("{method:?}").to_lowercase(),
        method,
        options: options.clone(),
    };
    methods.iter().map(arm).collect()
}
