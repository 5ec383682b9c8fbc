//! Responses of first order to a signal, such as a disc's to a rate or a rotor's to a command.

use crate::FlightError;

/// The response of x' = -x/τ + f(t) from x(0) = `start`, exact for an f that is a straight line between its
/// samples ([`Between::Line`]) or holds until the next ([`Between::Hold`]).
///
/// `times_s` must increase; the answer has one value a time.
pub fn first_order_response(
    times_s: &[f64],
    forcing: &[f64],
    between: Between,
    time_constant_s: f64,
    start: f64,
) -> Vec<f64> {
    let mut out = Vec::with_capacity(times_s.len());
    let mut x = start;
    for (k, t_s) in times_s.iter().enumerate() {
        if k > 0 {
            let h = t_s - times_s[k - 1];
            let slope = match between {
                Between::Line => (forcing[k] - forcing[k - 1]) / h,
                Between::Hold => 0.0,
            };
            let tau = time_constant_s;
            let decay = (-h / tau).exp();
            x = x * decay + tau * forcing[k - 1] * (1.0 - decay) + slope * tau * (h - tau * (1.0 - decay));
        }
        out.push(x);
    }
    out
}

/// How a sampled signal goes from one sample to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Between {
    /// A straight line.
    Line,
    /// The earlier value, until the later.
    Hold,
}

/// The response of a rotor's disc to a body rate, from rest: x' = -x/τ - rate, exact for a rate that is the
/// cubic between samples that its values and accelerations determine.
///
/// Straight lines between frames of 1/30 s would miss h²/12 of the acceleration, which biases the
/// coefficients that the same acceleration is fitted by. All three series must have one value a time, and
/// times must increase.
pub fn from_rate(
    times_s: &[f64],
    rate_rad_s: &[f64],
    acceleration_rad_s2: &[f64],
    time_constant_s: f64,
) -> Vec<f64> {
    let tau = time_constant_s;
    let mut out = Vec::with_capacity(times_s.len());
    let mut x = 0.0;
    for k in 0..times_s.len().min(rate_rad_s.len()).min(acceleration_rad_s2.len()) {
        if k > 0 {
            let h = times_s[k] - times_s[k - 1];
            let (f0, f1) = (-rate_rad_s[k - 1], -rate_rad_s[k]);
            let (d0, d1) = (-acceleration_rad_s2[k - 1], -acceleration_rad_s2[k]);
            let c2 = (3.0 * (f1 - f0) / h - 2.0 * d0 - d1) / h;
            let c3 = (2.0 * (f0 - f1) / h + d0 + d1) / (h * h);
            // x' = -x/τ + f is solved by τ f - τ² df + τ³ d²f - τ⁴ d³f for a cubic f, up to a decaying part.
            let particular = |f: f64, d: f64, dd: f64| tau * (f - tau * (d - tau * (dd - tau * 6.0 * c3)));
            let start = particular(f0, d0, 2.0 * c2);
            let end = particular(f1, d1, 2.0 * c2 + 6.0 * c3 * h);
            x = (x - start) * (-h / tau).exp() + end;
        }
        out.push(x);
    }
    out
}

/// Linear interpolation of a series at a time.
///
/// # Errors
/// [`FlightError::InputsDoNotCover`] outside the series.
pub fn interpolate(times_s: &[f64], values: &[f64], t_s: f64) -> Result<f64, FlightError> {
    let (Some(&start_s), Some(&end_s)) = (times_s.first(), times_s.last()) else {
        return Err(FlightError::TooFewInputs(0));
    };
    if times_s.len() < 2 || values.len() != times_s.len() {
        return Err(FlightError::TooFewInputs(values.len().min(times_s.len())));
    }
    if !(t_s >= start_s - 1e-6 && t_s <= end_s + 1e-6) {
        return Err(FlightError::InputsDoNotCover { t_s, start_s, end_s });
    }
    let after = times_s.partition_point(|t| *t <= t_s).clamp(1, times_s.len() - 1);
    let w = ((t_s - times_s[after - 1]) / (times_s[after] - times_s[after - 1])).clamp(0.0, 1.0);
    Ok(values[after - 1] + w * (values[after] - values[after - 1]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_ramp_is_answered_by_the_closed_form(tau in 0.01..5.0, slope in -3.0..3.0, offset in -1.0..1.0, start in -1.0..1.0) {
            let times: Vec<f64> = (0..60).map(|k| 0.03 * f64::from(k) + 0.004 * f64::from(k % 3)).collect();
            let forcing: Vec<f64> = times.iter().map(|t| offset + slope * t).collect();
            let got = first_order_response(&times, &forcing, Between::Line, tau, start);
            for (t, x) in times.iter().zip(got) {
                let particular = |t: f64| -> f64 { tau * (offset + slope * (t - tau)) };
                let closed: f64 = particular(*t) + (start - particular(0.0)) * (-t / tau).exp();
                prop_assert!((x - closed).abs() < 1e-11 * (1.0 + closed.abs() + tau * tau));
            }
        }
    }

    #[test]
    fn a_sine_of_rate_is_answered_by_the_closed_form() {
        let (w, times) = (9.0, (0..200).map(|k| f64::from(k) / 30.0).collect::<Vec<f64>>());
        let rate: Vec<f64> = times.iter().map(|t| (w * t).sin()).collect();
        let acceleration: Vec<f64> = times.iter().map(|t| w * (w * t).cos()).collect();
        for tau in [0.05, 3.0] {
            let got = from_rate(&times, &rate, &acceleration, tau);
            for (t, x) in times.iter().zip(got) {
                let gain = tau / (1.0 + (w * tau).powi(2));
                let closed = -gain * ((w * t).sin() - w * tau * (w * t).cos() + w * tau * (-t / tau).exp());
                assert!((x - closed).abs() < 2e-5, "{tau} {t}: {x} is not {closed}");
            }
        }
    }
}
