//! Errors and warnings as Python sees them.

use dsfms::calibrate::CalibrateError;
use dsfms::eval::EvaluateError;
use dsfms::experiment::ExperimentError;
use dsfms::io::InputError;
use dsfms::io::template::TemplateFileError;
use dsfms::pipeline::sources::SourceError;
use dsfms::pipeline::{ReconstructError, TemplateError};
use dsfms::track::TrackError;
use dsfms::video::VideoError;
use pyo3::exceptions::{PyException, PyUserWarning, PyValueError};
use pyo3::prelude::*;
use std::error::Error;
use std::fmt::Display;

pyo3::create_exception!(dsfms, DsfmsError, PyException, "Base of every error of this package.");
pyo3::create_exception!(
    dsfms,
    FileError,
    DsfmsError,
    "A file or folder is missing, damaged or of another kind."
);
pyo3::create_exception!(dsfms, BuildError, DsfmsError, "No template came of the frames.");
pyo3::create_exception!(dsfms, ReconstructionError, DsfmsError, "A frame gave no surface.");
pyo3::create_exception!(dsfms, TrackingError, DsfmsError, "A template or frame cannot be tracked.");
pyo3::create_exception!(dsfms, CalibrationError, DsfmsError, "No intrinsics came of the images.");
pyo3::create_exception!(dsfms, EvaluationError, DsfmsError, "Two surfaces cannot be compared.");
pyo3::create_exception!(
    dsfms,
    DsfmsWarning,
    PyUserWarning,
    "Something that the caller should know and that stops nothing."
);

/// An error with its causes; a cause that the text already quotes is not repeated.
fn text(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let own = error.to_string();
        if !text.contains(&own) {
            text += &format!(": {own}");
        }
        cause = error.source();
    }
    text
}

/// The Python exception of a library error.
pub trait IntoPython {
    /// Convert.
    fn into_python(self) -> PyErr;
}

macro_rules! raised_as {
    ($($error:ty => $exception:ident),* $(,)?) => {
        $(impl IntoPython for $error {
            fn into_python(self) -> PyErr {
                $exception::new_err(text(&self))
            }
        })*
    };
}

raised_as! {
    InputError => FileError,
    TemplateFileError => FileError,
    VideoError => FileError,
    SourceError => FileError,
    TemplateError => BuildError,
    ReconstructError => ReconstructionError,
    TrackError => TrackingError,
    CalibrateError => CalibrationError,
    EvaluateError => EvaluationError,
    ExperimentError => PyValueError,
}

/// A `ValueError` that names argument, expectation and what was found.
pub fn wrong(argument: &str, expected: impl AsRef<str>, found: impl AsRef<str>) -> PyErr {
    PyValueError::new_err(format!(
        "{argument}: expected {}, found {}",
        expected.as_ref(),
        found.as_ref()
    ))
}

/// Options as their TOML gives them.
pub fn options<T, E: Display>(read: Result<T, E>) -> PyResult<T> {
    read.map_err(|error| wrong("options", "TOML of known fields", error.to_string()))
}

/// Add the exceptions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("DsfmsError", py.get_type::<DsfmsError>())?;
    module.add("FileError", py.get_type::<FileError>())?;
    module.add("BuildError", py.get_type::<BuildError>())?;
    module.add("ReconstructionError", py.get_type::<ReconstructionError>())?;
    module.add("TrackingError", py.get_type::<TrackingError>())?;
    module.add("CalibrationError", py.get_type::<CalibrationError>())?;
    module.add("EvaluationError", py.get_type::<EvaluationError>())?;
    module.add("DsfmsWarning", py.get_type::<DsfmsWarning>())
}
