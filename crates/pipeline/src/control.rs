//! Control points: where they are, and where they were seen.

use mavsight_flight::Color;

/// A ball of the control frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlPointRow {
    /// Name, unique.
    pub name: String,
    /// Centre, world axes.
    pub position_m: [f64; 3],
    /// Diameter; 0 for a point.
    pub diameter_m: f64,
    /// Nominal colour.
    pub color: Color,
    /// Standard deviation of each coordinate of the surveyed centre; 0 for exact.
    pub std_m: f64,
}

/// Standard deviation of a point clicked by hand: a person hits the centre of a small ball to about half a
/// pixel.
pub const CLICKED_STD_PX: f64 = 0.5;

/// A control point as clicked or found elsewhere.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlPixel {
    /// Camera name.
    pub camera: String,
    /// Name of the control point.
    pub name: String,
    /// Column; the centre of the top-left pixel is 0.
    pub u_px: f64,
    /// Row.
    pub v_px: f64,
    /// Standard deviation of each.
    pub std_px: f64,
}
