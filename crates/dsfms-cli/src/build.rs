//! Which build of the program this is.

use anyhow::Context;

/// A number that differs between builds of this program: results of two are never mixed.
pub fn number() -> anyhow::Result<String> {
    let bytes = std::env::current_exe()
        .and_then(std::fs::read)
        .context("cannot read the program's own file")?;
    let fnv = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325, fnv);
    Ok(format!("{} {hash:016x}", env!("CARGO_PKG_VERSION")))
}
