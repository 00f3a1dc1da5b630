//! The organ that the cases of a series are made on.

use super::ExperimentError;
use crate::synth::{Case, Cell, Protocol};

/// The organ that the cases of a series are made on.
#[derive(Clone, Debug)]
pub enum Organ {
    /// A bulging patch of 50 × 40 mm, another one for every case.
    Patch,
}

impl Organ {
    /// Its name, as `--organ` takes it.
    pub fn name(&self) -> &str {
        match self {
            Self::Patch => "patch",
        }
    }

    /// Case `index` of a cell.
    ///
    /// # Errors
    /// No part of the organ can be used.
    pub fn case(
        &self,
        protocol: &Protocol,
        cell: Cell,
        index: usize,
    ) -> Result<Case, ExperimentError> {
        match self {
            Self::Patch => Ok(protocol.case(cell, index)),
        }
    }
}
