//! Names of columns: a quantity, and its unit after it; `_std` stands between the two.

/// Position and attitude, in `pose.csv` and `motion.csv`.
pub(crate) const POSE: [(&str, &str); 6] =
    [("x", "m"), ("y", "m"), ("z", "m"), ("phi", "rad"), ("theta", "rad"), ("psi", "rad")];

/// Coordinates of a pose's covariance: position in world axes, then a small turn about body axes, each with
/// its unit.
const ERROR: [(&str, &str); 6] =
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
pub(super) const RATES: [(&str, &str); 12] = [
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

/// Columns of `markers.csv`.
pub(super) const MARKERS: [&str; 7] = ["t_s", "camera", "marker", "u_px", "v_px", "u_std_px", "v_std_px"];

/// Columns of `body.csv`.
pub(super) const BODY: [&str; 9] =
    ["marker", "x_m", "y_m", "z_m", "x_std_m", "y_std_m", "z_std_m", "diameter_m", "diameter_std_m"];

/// Columns of `parameters.csv`.
pub(super) const PARAMETERS: [&str; 8] =
    ["estimator", "output", "parameter", "value", "std", "ci_low", "ci_high", "identifiable"];

pub(crate) fn value((quantity, unit): (&str, &str)) -> String {
    format!("{quantity}_{unit}")
}

pub(super) fn std((quantity, unit): (&str, &str)) -> String {
    format!("{quantity}_std_{unit}")
}
