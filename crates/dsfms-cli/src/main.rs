//! dsfms command line
fn main() {}
