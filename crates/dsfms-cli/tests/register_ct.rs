//! `register-ct` through the binary.
#[test]
fn compiles() {}
