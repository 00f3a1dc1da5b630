//! Loops compiled a second time for the wide registers of newer processors.

use std::sync::LazyLock;

/// Run `work` as compiled for AVX2 where the processor has it. Products and sums are never contracted,
/// so the bits are the same with and without; what `work` calls has to be inlined to gain.
#[inline(always)]
pub(crate) fn wide<R>(work: impl FnOnce() -> R) -> R {
    static ARCH: LazyLock<pulp::Arch> = LazyLock::new(pulp::Arch::new);
    ARCH.dispatch(work)
}
