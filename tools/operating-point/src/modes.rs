//! Eigenvalues of the discrete state matrix, and their frequency and damping. Decides nothing about a point.

use nalgebra::linalg::Schur;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, DMatrix};
use serde::Serialize;

/// Iterations of the QR algorithm per eigenvalue, far beyond what it needs.
const ITERATIONS: usize = 1000;

/// Largest `|ln z|` of an integrator.
const INTEGRATES: f64 = 1e-12;

/// Eigenvalue z of the discrete state matrix.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Mode {
    /// Real part of z.
    pub(crate) re: f64,
    /// Imaginary part of z.
    pub(crate) im: f64,
    /// Size of z: below 1 the mode decays.
    pub(crate) magnitude: f64,
    /// Natural frequency `|ln z| / (2 pi T)`; none where z is 0.
    pub(crate) frequency_hz: Option<f64>,
    /// Damping ratio `-Re(ln z) / |ln z|`; none where z is 0 or 1.
    pub(crate) damping: Option<f64>,
}

impl Mode {
    /// Returns `true` if the mode decays, by more than the rounding of an integrator.
    pub(crate) fn decays(&self) -> bool {
        self.magnitude < 1.0 && !integrates(self.magnitude)
    }
}

/// Returns `true` if the magnitude of an eigenvalue is that of an integrator, apart from its rounding.
pub(crate) fn integrates(magnitude: f64) -> bool {
    (magnitude - 1.0).abs() < INTEGRATES
}

/// Returns the modes of a state matrix with this period, slowest decay first.
///
/// # Errors
/// If the eigenvalues cannot be computed.
pub(crate) fn of(a: &DMatrix<f64>, period_s: f64) -> Result<Vec<Mode>, String> {
    let mut modes: Vec<Mode> = (eigenvalues(a)?.into_iter())
        .map(|z| mode(z, period_s))
        .collect();
    modes.sort_by(|a, b| {
        b.magnitude
            .total_cmp(&a.magnitude)
            .then(a.im.total_cmp(&b.im))
    });
    Ok(modes)
}

/// Returns the eigenvalues of a matrix.
///
/// # Errors
/// If they cannot be computed.
pub(crate) fn eigenvalues(a: &DMatrix<f64>) -> Result<Vec<Complex<f64>>, String> {
    if a.nrows() == 0 {
        return Ok(Vec::new());
    }
    let mut balanced = a.clone();
    balance_parlett_reinsch(&mut balanced);
    let schur = Schur::try_new(balanced, f64::EPSILON, ITERATIONS * a.nrows());
    let schur = schur.ok_or("the eigenvalues of A cannot be computed")?;
    Ok(schur.complex_eigenvalues().iter().copied().collect())
}

fn mode(z: Complex<f64>, period_s: f64) -> Mode {
    let magnitude = libm::hypot(z.re, z.im);
    // ln z; of an integrator it is 0, apart from the rounding of z.
    let log = (magnitude > 0.0).then(|| [libm::log(magnitude), libm::atan2(z.im, z.re)]);
    let log = log.map(|log| match libm::hypot(log[0], log[1]) < INTEGRATES {
        true => [0.0; 2],
        false => log,
    });
    let size = log.map(|[re, im]| libm::hypot(re, im));
    Mode {
        re: z.re,
        im: z.im,
        magnitude,
        frequency_hz: size.map(|size| size / (2.0 * std::f64::consts::PI * period_s)),
        damping: (log.zip(size))
            .filter(|(_, size)| *size > 0.0)
            .map(|([re, _], size)| -re / size),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damped_oscillation_has_its_frequency_and_damping() {
        // 5 Hz, damping 0.2, at 1 kHz.
        let (w, t) = (2.0 * std::f64::consts::PI * 5.0, 1e-3);
        let decay = libm::exp(-0.2 * w * t);
        let angle = w * libm::sqrt(1.0 - 0.04) * t;
        let (c, s) = (decay * libm::cos(angle), decay * libm::sin(angle));
        let modes = of(&DMatrix::from_row_slice(2, 2, &[c, -s, s, c]), t).expect("modes");
        for mode in modes {
            assert!(
                (mode.frequency_hz.expect("not 0") - 5.0).abs() < 1e-9,
                "{mode:?}"
            );
            assert!(
                (mode.damping.expect("not 1") - 0.2).abs() < 1e-9,
                "{mode:?}"
            );
        }
    }

    #[test]
    fn an_integrator_has_neither_frequency_nor_damping() {
        let modes = of(&DMatrix::identity(1, 1), 0.1).expect("modes");
        assert_eq!((modes[0].frequency_hz, modes[0].damping), (Some(0.0), None));
    }
}
