//! A preoperative surface (of CT or MRI) is brought onto the template of the exploration.
//!
//! Four steps, each a function: [`fit_landmarks`] (pairs picked by hand: a closed-form similarity
//! that survives wrong pairs), [`align`] (the template's surface, a part of the organ, onto the
//! preoperative one, with scale), [`Uncertainty`] (what that leaves open, and at a target inside),
//! [`deform`] (the preoperative surface bends, within bounds, until it meets the template).
//! [`register_preoperative`] strings them together, refuses what is ambiguous and says why it
//! doubts the rest.
//!
//! The similarity is `ct_from_template`: template units or mm to mm of the preoperative surface.

mod align;
mod ambiguity;
mod deform;
mod landmarks;
mod options;
mod register;
mod scale;
mod starts;
mod target;
mod uncertainty;
mod verdict;

pub use align::{Aligned, Residual, align};
pub use deform::{Deformed, deform};
pub use landmarks::{LandmarkFit, LandmarkPair, fit_landmarks};
pub use options::{PreoperativeOptions, ScaleRule};
pub use register::{Preoperative, register_preoperative};
pub(crate) use scale::scale_on_surface;
pub use target::{SurfaceSample, Target, samples};
pub use uncertainty::{Uncertainty, expected_target_error};
pub use verdict::{Alternative, Doubt, PreoperativeError};
