//! Hot loops compiled for the vector units of the machine that they run on.
//!
//! The crate is built for the oldest processor of its architecture. A [`Kernel`] is compiled a
//! second time with AVX2 and related features, and that version runs if the processor has them.
//! Nothing else differs: no operation is fused or reordered, so the results are the same bits.

/// A piece of work whose loops are worth compiling twice.
pub trait Kernel {
    /// The result of the work.
    type Output;

    /// Does the work. Mark it, and what it calls in its loops, `#[inline(always)]`: only code that
    /// is inlined is compiled for the newer processor.
    fn run(self) -> Self::Output;
}

/// Runs a kernel with the widest vectors that it is compiled for and the processor has.
#[inline]
pub fn run<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if *HAS_AVX2 {
        // SAFETY: the processor has all of the features that `with_avx2` is compiled for.
        #[expect(unsafe_code, reason = "the one call into code compiled for a newer processor")]
        return unsafe { with_avx2(kernel) };
    }
    kernel.run()
}

/// True if the processor has AVX2. Tested once: small kernels run very often.
#[cfg(target_arch = "x86_64")]
static HAS_AVX2: std::sync::LazyLock<bool> = std::sync::LazyLock::new(|| {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
});

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [i32]);

    impl Kernel for Sum<'_> {
        type Output = i32;

        #[inline(always)]
        fn run(self) -> i32 {
            self.0.iter().sum()
        }
    }

    #[test]
    fn both_ways_give_the_same() {
        let numbers: Vec<i32> = (0..1000).collect();
        assert_eq!(run(Sum(&numbers)), Sum(&numbers).run());
    }
}
