//! How well the cameras saw the markers.

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

/// How well one camera saw one marker; all but the share are its colour's, and 0 where no ball of it was
/// ever seen.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MarkerHealth {
    /// Share of the frames in which the marker was identified.
    pub seen: f64,
    /// Share of the ball's pixels with a full channel.
    pub saturated: f64,
    /// Contrast of the ball's light to that around it (Michelson).
    pub contrast: f64,
    /// Apparent diameter.
    pub diameter_px: f64,
    /// Other objects of its colour in the image.
    pub others: f64,
    /// Smallest angle of hue to coloured background next to the ball; 180 where there is none.
    pub hue_apart_deg: f64,
}
