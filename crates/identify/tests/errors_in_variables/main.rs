//! Monte Carlo of total least squares; the example `errors_in_variables` runs five times as many.

mod monte_carlo;

use mavsight_identify::Correlation;
use monte_carlo::{correlated_errors, independent_errors, ratios};

/// 400 runs leave the achieved standard deviation known to 3.5 %: bounds of ± 12 % are more than three of
/// that.
#[test]
fn total_least_squares_knows_its_spread() {
    for (errors, rho, how) in [
        (correlated_errors(), 0.0, Correlation::White),
        (correlated_errors(), 0.8, Correlation::Rows(60)),
        (independent_errors(), 0.8, Correlation::Rows(60)),
    ] {
        let (ratio, bias) = ratios(400, rho, &errors, how);
        println!("rho {rho} {how:?}: {:.3?} {:.2?}", ratio.as_slice(), bias.as_slice());
        assert!(ratio.iter().all(|r| (0.88..1.12).contains(r)), "{rho} {ratio}");
        assert!(bias.iter().all(|b| b.abs() < 4.0), "{rho} {bias}");
    }
}
