//! How well the cameras saw the markers.

use crate::{Cause, Finding};
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
    /// The same of the room's edges; none where they are few.
    pub room_edge_px: Option<f64>,
    /// By marker.
    pub markers: Vec<MarkerHealth>,
}

/// Blur beyond which an edge is spread over the whole of a small ball.
const BLURRED_PX: f64 = 1.5;
/// What stands out from the others by this factor is this camera's own: lenses and exposures of one kind differ
/// by less.
const STANDS_OUT: f64 = 2.0;
/// Share of the frames from which on a marker's ball is measured and not met by chance.
const SEEN_AT_ALL: f64 = 0.1;
/// Objects of a marker's colour beside it, on average, from which there is one.
const DECOYS: f64 = 0.5;

impl CameraHealth {
    /// Whether any ball was seen more than now and then.
    fn sees_balls(&self) -> bool {
        self.markers.iter().any(|m| m.seen > SEEN_AT_ALL)
    }

    /// Markers beside which the camera sees others of their colour.
    fn beside_decoys(&self) -> impl Iterator<Item = usize> {
        self.markers.iter().enumerate().filter(|(_, m)| m.ball.others > DECOYS).map(|(k, _)| k)
    }
}

/// Cameras out of focus, and objects of a marker's colour, as the balls' images show them.
pub(crate) fn findings(health: &[CameraHealth], names: &[String]) -> Vec<Finding> {
    let mut out = Vec::new();
    for (camera, own) in health.iter().enumerate() {
        let beside: Vec<&str> =
            own.beside_decoys().filter_map(|k| names.get(k)).map(String::as_str).collect();
        if !beside.is_empty() {
            let (name, markers) = (&own.camera, beside.join(", "));
            let note = if beside.len() == 1 {
                format!("{name}: {markers} is not the only object of its colour in view: cover the other.")
            } else {
                format!(
                    "{name}: {markers} are not the only objects of their colours in view: cover the others."
                )
            };
            out.push(Finding { causes: vec![], camera: Some(camera), note });
        }
        // A camera far out of focus sees no ball: then the room's edges show it.
        let edge_px = |h: &CameraHealth| if own.sees_balls() { Some(h.edge_px) } else { h.room_edge_px };
        let Some(own_px) = edge_px(own).filter(|px| *px > BLURRED_PX) else { continue };
        let others = health.iter().enumerate().filter(|(k, _)| *k != camera).filter_map(|(_, h)| edge_px(h));
        let sharpest_px = others.fold(f64::INFINITY, f64::min);
        let (name, edge_px) = (&own.camera, own_px);
        // Motion blurs the images of all cameras about alike.
        out.push(if STANDS_OUT * sharpest_px < edge_px {
            let note = format!(
                "{name} is out of focus: edges are blurred by {edge_px:.1} px there and by {sharpest_px:.1} px in another \
                 camera. Focus it, and calibrate again."
            );
            Finding::of(Cause::OutOfFocus, Some(camera), note)
        } else {
            let note = format!("{name} is blurred by {edge_px:.1} px: focus it, or shorten the exposure.");
            Finding { causes: vec![], camera: Some(camera), note }
        });
    }
    out
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
