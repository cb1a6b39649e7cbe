//! [`with_best_registers`]: scalar code that the compiler may make for AVX2.
#![allow(unsafe_code)]

/// Returns whether this machine has AVX2.
#[cfg(target_arch = "x86_64")]
pub(crate) fn has_avx2() -> bool {
    std::arch::is_x86_feature_detected!("avx2")
}

/// Runs code with AVX2. The machine must have it.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
pub(crate) fn with_avx2<R>(f: impl FnOnce() -> R) -> R {
    f()
}

/// Runs code with AVX2 where the machine has it: as far as it is inlined into `f`, and `f` marked to be
/// inlined. Results are the same.
#[inline(always)]
pub(crate) fn with_best_registers<R>(f: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if has_avx2() {
        // SAFETY: the machine has AVX2.
        return unsafe { with_avx2(f) };
    }
    f()
}
