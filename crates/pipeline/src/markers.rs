//! A vehicle's markers: their places and colours.

use mavsight_flight::Vehicle;
use mavsight_pose::BodyMarker;
use mavsight_vision::BallColor;

/// Half a millimetre: how well a ruler measures a coordinate of a marker where nothing else is said.
pub const MARKERS_STD_M: f64 = 5e-4;

/// The vehicle's markers as the pose estimator wants them.
pub fn body_markers(vehicle: &Vehicle) -> Vec<BodyMarker> {
    vehicle
        .marker
        .iter()
        .map(|m| BodyMarker {
            name: m.name.clone(),
            marker_in_body_m: m.position_m.into(),
            radius_m: m.diameter_m / 2.0,
        })
        .collect()
}

/// The colours of a vehicle's markers, each once, and which of them each marker has.
pub(crate) struct MarkerColors {
    pub(crate) balls: Vec<BallColor>,
    pub(crate) of_marker: Vec<usize>,
}

impl MarkerColors {
    pub(crate) fn of(vehicle: &Vehicle) -> Self {
        let mut out = Self { balls: Vec::new(), of_marker: Vec::new() };
        for marker in &vehicle.marker {
            let rgb = marker.color.rgb();
            let color = out.balls.iter().position(|b| b.rgb == rgb).unwrap_or_else(|| {
                out.balls.push(BallColor { name: marker.name.clone(), rgb });
                out.balls.len() - 1
            });
            out.of_marker.push(color);
        }
        out
    }

    /// How many markers each colour has.
    pub(crate) fn counts(&self) -> Vec<usize> {
        (0..self.balls.len()).map(|c| self.of_marker.iter().filter(|m| **m == c).count()).collect()
    }
}
