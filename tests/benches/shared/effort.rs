//! Effort of a bench: all of it, or with `HIL_BENCH_QUICK=1` so little that it shows only
//! whether the bench works.

fn is_quick() -> bool {
    std::env::var_os("HIL_BENCH_QUICK").is_some()
}

/// Rounds; the results are medians over them.
pub(crate) fn rounds() -> usize {
    if is_quick() { 1 } else { 5 }
}

/// Returns the number of repetitions in a round, or a fiftieth of it with `HIL_BENCH_QUICK=1`.
pub(crate) fn shortened(count: u64) -> u64 {
    if is_quick() { count / 50 } else { count }
}
