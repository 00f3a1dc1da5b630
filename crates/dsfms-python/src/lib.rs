//! The Python module `dsfms._dsfms`: the library's front door with NumPy in and out. What needs no
//! Rust (bridges to other packages, batch runs, pages) lies beside it in `python/dsfms`.

mod build;
mod camera;
mod convert;
mod errors;
mod measure;
mod reconstruct;
mod surface;
mod template;
mod tracker;
mod video;
mod work;

use pyo3::prelude::*;

/// Native part of dsfms.
#[pymodule]
fn _dsfms(module: &Bound<'_, PyModule>) -> PyResult<()> {
    errors::register(module)?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<camera::Camera>()?;
    module.add_class::<template::Template>()?;
    module.add_class::<surface::Surface>()?;
    module.add_class::<tracker::Tracker>()?;
    module.add_class::<tracker::Tracking>()?;
    module.add_class::<video::Frames>()?;
    module.add_function(wrap_pyfunction!(video::frame_count, module)?)?;
    module.add_function(wrap_pyfunction!(camera::read_camera, module)?)?;
    module.add_function(wrap_pyfunction!(build::build_template, module)?)?;
    module.add_function(wrap_pyfunction!(reconstruct::reconstruct, module)?)?;
    module.add_function(wrap_pyfunction!(measure::_calibrate, module)?)?;
    module.add_function(wrap_pyfunction!(measure::_evaluate, module)?)?;
    module.add_function(wrap_pyfunction!(measure::_synthesize, module)?)
}
