//! Work compiled twice: for any processor, and for those with AVX2.
//!
//! One choice a page, outside of all loops. Both ways give the same bits: integers are integers, and no feature that
//! is switched on fuses a multiplication with an addition.

/// Work whose `run`, and all that it calls in its loops, is `#[inline(always)]`, so that it can be compiled for other
/// processors than its caller.
pub(super) trait Work {
    type Output;
    /// Does it, with whatever the caller is compiled for.
    fn run(self) -> Self::Output;
}

/// Runs `work` with the best that this processor has.
pub(super) fn run<W: Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2")
        && std::arch::is_x86_feature_detected!("bmi1")
        && std::arch::is_x86_feature_detected!("bmi2")
        && std::arch::is_x86_feature_detected!("f16c")
    {
        // SAFETY: the processor has all that the function is compiled for.
        return unsafe { run_avx2(work) };
    }
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,f16c")]
fn run_avx2<W: Work>(work: W) -> W::Output {
    work.run()
}
