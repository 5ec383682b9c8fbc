//! How well the cameras saw the markers.

use mavsight_vision::BallHealth;

/// How well one camera saw the markers over a flight.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CameraHealth {
    /// Camera name.
    pub camera: String,
    /// Frames it delivered.
    pub frames: usize,
    /// Frames that were dark all over.
    pub dark: usize,
    /// Standard deviation of the blur of edges, pixel included.
    pub edge_px: f64,
    /// By marker.
    pub markers: Vec<MarkerHealth>,
}

/// Stated precision of the centres of a flight's markers, all cameras and markers together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CentreQuality {
    /// Standard deviations of a coordinate: of ten equal parts of the centres, in order, the middle one
    /// each. They differ with the background.
    pub tenths_px: [f64; 10],
    /// Standard deviation of the systematic error of a coordinate.
    pub bias_std_px: f64,
}

/// How well one camera saw one marker.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MarkerHealth {
    /// Share of the frames in which the marker was identified.
    pub seen: f64,
    /// What the balls of its colour looked like; zeros where none was ever seen.
    pub ball: BallHealth,
}
