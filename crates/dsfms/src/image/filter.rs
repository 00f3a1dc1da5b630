//! Gaussian blur, with and without a mask.
