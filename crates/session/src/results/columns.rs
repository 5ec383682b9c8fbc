//! Names of columns: a quantity, and its unit after it; `_std` stands between the two.

use crate::SessionError;
use crate::table::{Row, Table};

pub(crate) type Quantity = (&'static str, &'static str);

/// Position and attitude, in `pose.csv` and `motion.csv`.
pub(crate) const POSE: [Quantity; 6] =
    [("x", "m"), ("y", "m"), ("z", "m"), ("phi", "rad"), ("theta", "rad"), ("psi", "rad")];

/// Coordinates of a pose's covariance: position in world axes, then a small turn about body axes.
const ERROR: [Quantity; 6] =
    [("x", "m"), ("y", "m"), ("z", "m"), ("turn_x", "rad"), ("turn_y", "rad"), ("turn_z", "rad")];

/// Places in the upper triangle of a pose's covariance, row by row.
pub(super) fn upper_triangle() -> impl Iterator<Item = (usize, usize)> {
    (0..6).flat_map(|i| (i..6).map(move |j| (i, j)))
}

/// Name of a covariance of the part of a pose's error that is new in each frame.
pub(super) fn new_covariance((i, j): (usize, usize)) -> String {
    let ((a, first), (b, second)) = (ERROR[i], ERROR[j]);
    let unit = if first == second { format!("{first}2") } else { format!("{first}_{second}") };
    format!("new_{a}_{b}_{unit}")
}

/// What `motion.csv` has after the pose: a is the specific force, `pdot` the angular acceleration.
pub(super) const RATES: [Quantity; 12] = [
    ("u", "m_s"),
    ("v", "m_s"),
    ("w", "m_s"),
    ("p", "rad_s"),
    ("q", "rad_s"),
    ("r", "rad_s"),
    ("ax", "m_s2"),
    ("ay", "m_s2"),
    ("az", "m_s2"),
    ("pdot", "rad_s2"),
    ("qdot", "rad_s2"),
    ("rdot", "rad_s2"),
];

/// What `motion.csv` has behind that: standard deviations of velocity and rates as errors of poses and the jerk of the whole flight
/// have them.
pub(super) fn noise() -> impl Iterator<Item = Quantity> {
    const OWN: [&str; 6] = ["u_noise", "v_noise", "w_noise", "p_noise", "q_noise", "r_noise"];
    OWN.into_iter().zip(RATES).map(|(name, (_, unit))| (name, unit))
}

/// Times by the clock of the aircraft's log, in `pose.csv` and `motion.csv`.
pub(super) const LOG_TIME: &str = "log_t_s";

pub(super) fn motion() -> impl Iterator<Item = Quantity> {
    POSE.into_iter().chain(RATES)
}

pub(super) const MARKERS: [&str; 7] = ["t_s", "camera", "marker", "u_px", "v_px", "u_std_px", "v_std_px"];

pub(super) const BODY: [&str; 9] =
    ["marker", "x_m", "y_m", "z_m", "x_std_m", "y_std_m", "z_std_m", "diameter_m", "diameter_std_m"];

pub(super) const PARAMETERS: [&str; 8] =
    ["estimator", "output", "parameter", "value", "std", "ci_low", "ci_high", "identifiable"];

pub(super) const POOLED: [&str; 11] = [
    "estimator",
    "output",
    "parameter",
    "flights",
    "mean",
    "std",
    "ci_low",
    "ci_high",
    "between_flights_std",
    "chi_square",
    "p_value",
];

pub(crate) fn value((quantity, unit): Quantity) -> String {
    format!("{quantity}_{unit}")
}

pub(super) fn std((quantity, unit): Quantity) -> String {
    format!("{quantity}_std_{unit}")
}

/// The columns of a table over time: `N` quantities, and their standard deviations where it has them.
pub(super) struct Series<const N: usize> {
    t: usize,
    values: [usize; N],
    stds: [Option<usize>; N],
}

pub(super) struct Instant<'a, const N: usize> {
    pub(super) row: Row<'a>,
    pub(super) t_ns: i64,
    /// None where nothing was measured.
    pub(super) values: Option<[f64; N]>,
}

impl<const N: usize> Series<N> {
    pub(super) fn of(
        table: &Table,
        quantities: impl Iterator<Item = Quantity>,
    ) -> Result<Self, SessionError> {
        let mut series = Self { t: table.column("t_s")?, values: [0; N], stds: [None; N] };
        for (k, quantity) in quantities.enumerate() {
            series.values[k] = table.column(&value(quantity))?;
            series.stds[k] = table.column(&std(quantity)).ok();
        }
        Ok(series)
    }

    /// The rows, whose times must increase.
    pub(super) fn rows<'a>(&self, table: &'a Table) -> Result<Vec<Instant<'a, N>>, SessionError> {
        let mut rows: Vec<Instant<'a, N>> = Vec::new();
        for row in table.rows()? {
            let t_ns = row.time_ns(self.t)?;
            if rows.last().is_some_and(|before| before.t_ns >= t_ns) {
                let detail =
                    "the time does not come after that of the row before: sort the rows and remove repeats";
                return Err(row.refuse(self.t, detail));
            }
            let is_empty = self.values.iter().all(|column| row.text(*column).is_empty());
            let values = (!is_empty).then(|| row.numbers(self.values)).transpose()?;
            rows.push(Instant { row, t_ns, values });
        }
        Ok(rows)
    }

    /// The standard deviations of a row, `unknown` where it does not say; `passes` says which are possible.
    pub(super) fn stds(
        &self,
        row: Row<'_>,
        unknown: f64,
        passes: impl Fn(f64) -> bool,
    ) -> Result<[f64; N], SessionError> {
        let mut stds = [unknown; N];
        for (std, column) in stds.iter_mut().zip(self.stds) {
            let Some(column) = column else { continue };
            let Some(value) = row.number_if_any(column)? else { continue };
            if !passes(value) {
                let detail = format!("{value} must be above zero: leave the cell empty if unknown");
                return Err(row.refuse(column, detail));
            }
            *std = value;
        }
        Ok(stds)
    }
}
