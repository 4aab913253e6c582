//! Mathematics for C programs: functions with the same last bit on every machine, and the integrator.

use std::ffi::{c_int, c_void};
use std::ptr;

use plant_process::integrate::integrate;
use shared_types::time;

use super::interface::{Interval, OK, Rates};
use super::reason::hil_failed;
use crate::float_modes;

macro_rules! same_everywhere {
    ($($name:ident($($x:ident),+) = $function:path;)*) => {
        $(
            #[doc = concat!("`", stringify!($name), "` of the header.")]
            #[unsafe(no_mangle)]
            pub extern "C" fn $name($($x: f64),+) -> f64 {
                $function($($x),+)
            }
        )*
    };
}

same_everywhere! {
    hil_sin(x) = libm::sin;
    hil_cos(x) = libm::cos;
    hil_tan(x) = libm::tan;
    hil_asin(x) = libm::asin;
    hil_acos(x) = libm::acos;
    hil_atan(x) = libm::atan;
    hil_atan2(y, x) = libm::atan2;
    hil_sinh(x) = libm::sinh;
    hil_cosh(x) = libm::cosh;
    hil_tanh(x) = libm::tanh;
    hil_exp(x) = libm::exp;
    hil_expm1(x) = libm::expm1;
    hil_log(x) = libm::log;
    hil_log10(x) = libm::log10;
    hil_pow(x, y) = libm::pow;
}

/// `hil_integrate` of the header: [`integrate`] with rates in C.
///
/// # Safety
/// `state` points to `count` numbers, `interval` to an interval, and `rates` reads and writes `count` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn hil_integrate(
    state: *mut f64,
    count: usize,
    interval: *const Interval,
    rates: Option<Rates>,
    context: *const c_void,
) -> c_int {
    let Some(rates) = rates.filter(|_| !state.is_null() && !interval.is_null()) else {
        // SAFETY: a literal.
        return unsafe { hil_failed(c"hil_integrate got a null pointer".as_ptr()) };
    };
    // SAFETY: it is not null, so it points to an interval.
    let interval = unsafe { &*interval };
    let interval = time::Interval {
        start_s: interval.start_s,
        length_s: interval.length_s,
        substeps: interval.substeps,
    };
    let padded = match count {
        0 => return OK,
        1 => padded::<1>,
        2 => padded::<2>,
        3..=4 => padded::<4>,
        5..=8 => padded::<8>,
        9..=16 => padded::<16>,
        17..=32 => padded::<32>,
        33..=64 => padded::<64>,
        // SAFETY: a literal.
        _ => return unsafe { hil_failed(c"hil_integrate takes up to 64 numbers".as_ptr()) },
    };
    // SAFETY: every arm has space for at least `count` numbers; `state` is not null, so it points to `count` numbers,
    // and the caller guarantees the rates.
    unsafe { padded(state, count, &interval, rates, context) };
    OK
}

/// Integrates a state padded with zeros; the method treats every component separately. The state is written only at the
/// end, so the rates may read it.
///
/// # Safety
/// `state` points to `count` numbers, at most `N`, and the rates read and write `count` numbers.
unsafe fn padded<const N: usize>(
    state: *mut f64,
    count: usize,
    interval: &time::Interval,
    rates: Rates,
    context: *const c_void,
) {
    // A copy of a length known to the compiler needs no function call.
    let is_whole = count == N;
    let mut whole = [0.0; N];
    // SAFETY: the caller guarantees `state`.
    unsafe {
        match is_whole {
            true => whole = state.cast::<[f64; N]>().read(),
            false => ptr::copy_nonoverlapping(state, whole.as_mut_ptr(), count),
        }
    }
    integrate(&mut whole, interval, |time_s, x| {
        let mut dx = [0.0; N];
        // SAFETY: both arrays have at least as many elements as the state.
        unsafe { rates(context, time_s, x.as_ptr(), dx.as_mut_ptr()) };
        float_modes::settle("rates");
        // Read one by one, as they were written: a wider load would wait until all have left the store buffer.
        let dx = dx.each_ref();
        // SAFETY: a reference is valid for reads.
        dx.map(|rate| unsafe { ptr::read_volatile(rate) })
    });
    // SAFETY: as above.
    unsafe {
        match is_whole {
            true => state.cast::<[f64; N]>().write(whole),
            false => ptr::copy_nonoverlapping(whole.as_ptr(), state, count),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::slice;

    use super::*;

    unsafe extern "C" fn decay(count: *const c_void, time_s: f64, x: *const f64, dx: *mut f64) {
        // SAFETY: the test passes the number of states, and arrays of that length.
        let (x, dx) = unsafe {
            let count = *count.cast::<usize>();
            (
                slice::from_raw_parts(x, count),
                slice::from_raw_parts_mut(dx, count),
            )
        };
        for (i, (x, dx)) in x.iter().zip(dx).enumerate() {
            *dx = time_s - (1.0 + i as f64) * x;
        }
    }

    fn integrated(state: &mut [f64], interval: &Interval) -> c_int {
        let count = state.len();
        let context = (&raw const count).cast();
        // SAFETY: `decay` expects the number of states as its context.
        unsafe { hil_integrate(state.as_mut_ptr(), count, interval, Some(decay), context) }
    }

    #[test]
    fn results_are_bit_identical_to_the_rust_integrator_for_any_number_of_states() {
        let interval = Interval {
            start_s: 0.5,
            length_s: 0.1,
            substeps: 3,
        };
        let rust = time::Interval {
            start_s: 0.5,
            length_s: 0.1,
            substeps: 3,
        };
        for count in 1..=64 {
            let mut state: Vec<f64> = (0..count).map(|i| 1.0 / (1.0 + i as f64)).collect();
            let expected: Vec<u64> = (0..count)
                .map(|i| {
                    let mut x = [state[i]];
                    integrate(&mut x, &rust, |t, [x]| [t - (1.0 + i as f64) * x]);
                    x[0].to_bits()
                })
                .collect();
            assert_eq!(integrated(&mut state, &interval), OK);
            let actual: Vec<u64> = state.iter().map(|x| x.to_bits()).collect();
            assert_eq!(actual, expected, "{count}");
        }
        assert_ne!(integrated(&mut [0.0; 65], &interval), OK);
    }

    #[test]
    fn null_pointers_are_refused() {
        // SAFETY: null is refused before it is used.
        let status = unsafe {
            hil_integrate(
                std::ptr::null_mut(),
                1,
                std::ptr::null(),
                None,
                std::ptr::null(),
            )
        };
        assert_ne!(status, OK);
    }
}
