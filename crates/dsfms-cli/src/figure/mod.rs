//! Plates for a paper: surfaces read, put in order, laid out, drawn.

pub mod layout;
pub mod panel;
pub mod plate;
pub mod surfaces;
