//! Recordings that are not those of the cameras that they are given for, recognised by what the cameras saw.

use crate::PipelineError;
use mavsight_geometry::Vector2;
use mavsight_pose::{
    MarkerObservation, Observations, PoseError, PoseEstimator, ReprojectionFit, Rig, TrackedDetection,
};

/// Instants that are looked at, spread over the flight: half of them outvote those of a false match.
const SAMPLED: usize = 60;

/// Observations that lie so many standard deviations from where any pose has them do not fit: the stated
/// covariance explains 4 % of their variance.
const FITS: f64 = 5.0;

/// What is taken for a mistake has to bring the residuals down to this part: over hundreds of degrees of
/// freedom no chance does.
const EXPLAINS: f64 = 1.0 / 3.0;

/// What may have been done to recordings.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mistake {
    Exchanged(usize, usize),
    Mirrored(usize),
    UpsideDown(usize),
}

impl Mistake {
    /// Those that a rig allows: only cameras of one image size can have been exchanged.
    fn all(rig: &Rig) -> Vec<Self> {
        let size = |k: usize| rig.cameras[k].camera.size;
        let n = rig.cameras.len();
        let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
        let exchanged = pairs.filter(|(a, b)| size(*a) == size(*b)).map(|(a, b)| Self::Exchanged(a, b));
        let turned = (0..n).flat_map(|k| [Self::Mirrored(k), Self::UpsideDown(k)]);
        exchanged.chain(turned).collect()
    }

    /// The observation as it would have been without.
    fn undone(self, mut seen: MarkerObservation, rig: &Rig) -> MarkerObservation {
        let size = rig.cameras[seen.camera].camera.size;
        let (right, bottom) = (f64::from(size.width_px) - 1.0, f64::from(size.height_px) - 1.0);
        match self {
            Self::Exchanged(a, b) if seen.camera == a => seen.camera = b,
            Self::Exchanged(a, b) if seen.camera == b => seen.camera = a,
            Self::Mirrored(k) if seen.camera == k => {
                seen.pixel.x = right - seen.pixel.x;
                for at in [(0, 1), (1, 0)] {
                    seen.covariance_px2[at] = -seen.covariance_px2[at];
                }
            }
            Self::UpsideDown(k) if seen.camera == k => {
                seen.pixel = Vector2::new(right, bottom) - seen.pixel;
            }
            _ => {}
        }
        seen
    }

    fn words(self, rig: &Rig) -> String {
        let name = |k: usize| &rig.cameras[k].name;
        match self {
            Self::Exchanged(a, b) => format!(
                "with the recordings of {} and {} exchanged: exchange them in the session file",
                name(a),
                name(b)
            ),
            Self::Mirrored(k) => format!(
                "with {} mirrored left to right: turn mirroring off where the camera or its program offers it, or mirror its still too",
                name(k)
            ),
            Self::UpsideDown(k) => format!(
                "with {} turned upside down: its recording and its still have to be the same way up",
                name(k)
            ),
        }
    }
}

/// A note on observations that do not fit, if they do not; an error where recordings exchanged, mirrored or
/// turned upside down explain it.
pub(crate) fn note(
    estimator: &PoseEstimator,
    rig: &Rig,
    observations: &Observations,
) -> Result<Option<String>, PipelineError> {
    let failed = |source| PipelineError::Pose { place: "centres".into(), source };
    let instants = sampled(observations);
    let fit = |mistake| median_fit(estimator, rig, &instants, mistake).map_err(failed);
    let Some(given) = fit(None)?.filter(|f| f.ratio > FITS) else { return Ok(None) };
    for mistake in Mistake::all(rig) {
        let Some(instead) = fit(Some(mistake))? else { continue };
        if instead.ratio < FITS && instead.ratio < EXPLAINS * given.ratio {
            let (given_px, instead_px) = (given.residual_px, instead.residual_px);
            let given = if given_px.is_finite() {
                format!("lies {given_px:.2} px from")
            } else {
                "is not".to_owned()
            };
            return Err(PipelineError::MixedUp { given, instead_px, mistake: mistake.words(rig) });
        }
    }
    let ReprojectionFit { residual_px, ratio } = given;
    Ok(ratio.is_finite().then(|| {
        format!(
            "What the cameras saw lies {residual_px:.2} px from where any pose of the body has it, {ratio:.0} times what their noise \
             explains: a camera may have been moved since its calibration, its frame rate or clock may be another, or the marker \
             positions of the vehicle file are off ([refine] finds those of a ruler)."
        )
    }))
}

/// Observations of some instants, of markers that are identified by their colours alone.
#[derive(Debug, Default)]
pub(crate) struct ObservationSample {
    observations: Observations,
    taken: usize,
    /// Instants from one that is taken to the next, and those until then.
    every: usize,
    until_next: usize,
}

impl ObservationSample {
    pub(crate) fn spread_over(&mut self, instants: usize) {
        self.every = instants / SAMPLED;
    }

    pub(crate) fn is_full(&self) -> bool {
        self.taken >= SAMPLED
    }

    pub(crate) fn observations(&self) -> &Observations {
        &self.observations
    }

    /// Takes an instant if it is one's turn; one that says nothing leaves its turn to the next.
    pub(crate) fn take(&mut self, t_ns: i64, seen: &[TrackedDetection], color_of_marker: &[usize]) {
        if self.until_next > 0 || self.is_full() {
            self.until_next = self.until_next.saturating_sub(1);
            return;
        }
        let lone = lone(t_ns, seen, color_of_marker);
        // Four in two cameras, or in one of them, have more coordinates than a pose.
        if lone.len() >= 4 {
            lone.iter().for_each(|o| self.observations.push(o));
            self.taken += 1;
            self.until_next = self.every.saturating_sub(1);
        }
    }
}

/// Balls that are the only ones of their colour in their camera, as the only markers of it.
fn lone(t_ns: i64, seen: &[TrackedDetection], color_of_marker: &[usize]) -> Vec<MarkerObservation> {
    let is_lone = |c: &&TrackedDetection| {
        seen.iter().filter(|o| (o.camera, o.color) == (c.camera, c.color)).count() == 1
            && color_of_marker.iter().filter(|m| **m == c.color).count() == 1
    };
    let identified = |c: &TrackedDetection| {
        let marker = color_of_marker.iter().position(|m| *m == c.color)?;
        Some(MarkerObservation { t_ns, ..c.of_marker(marker) })
    };
    seen.iter().filter(is_lone).filter_map(identified).collect()
}

fn sampled(observations: &Observations) -> Vec<Vec<MarkerObservation>> {
    let times_ns: Vec<i64> = observations.times_ns().collect();
    let count = SAMPLED.min(times_ns.len());
    let at = |k: usize| {
        let mut seen = Vec::new();
        observations.at(times_ns[(2 * k + 1) * times_ns.len() / (2 * count)], &mut seen);
        seen
    };
    (0..count).map(at).collect()
}

/// That of the instant in the middle, by standard deviations; `None` where no instant has enough
/// observations.
fn median_fit(
    estimator: &PoseEstimator,
    rig: &Rig,
    instants: &[Vec<MarkerObservation>],
    mistake: Option<Mistake>,
) -> Result<Option<ReprojectionFit>, PoseError> {
    let mut fits = Vec::new();
    for seen in instants {
        let own = match mistake {
            Some(mistake) => seen.iter().map(|o| mistake.undone(*o, rig)).collect(),
            None => seen.clone(),
        };
        fits.extend(estimator.reprojection_fit(&own)?);
    }
    fits.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    Ok(fits.get(fits.len() / 2).copied())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body_markers;
    use crate::testing::{rig, seen_by};
    use mavsight_flight::Vehicle;

    fn noted(change: impl Fn(&mut MarkerObservation)) -> Result<Option<String>, PipelineError> {
        let (rig, vehicle) = (rig(), Vehicle::paper());
        let mut seen: Vec<MarkerObservation> = (0..3).flat_map(|camera| seen_by(camera, 0..90)).collect();
        seen.iter_mut().for_each(change);
        let (estimator, seen) = (PoseEstimator::new(&rig, &body_markers(&vehicle)), seen.iter().collect());
        note(&estimator, &rig, &seen)
    }

    #[test]
    fn recordings_in_the_place_of_others_are_refused_with_what_was_done_to_them() {
        assert_eq!(noted(|_| {}).unwrap(), None);
        for a in 0..3 {
            let b = (a + 1) % 3;
            let text = noted(|o| match o.camera {
                k if k == a => o.camera = b,
                k if k == b => o.camera = a,
                _ => {}
            });
            let text = text.unwrap_err().to_string();
            let named = format!("cam{} and cam{} exchanged", a.min(b) + 1, a.max(b) + 1);
            assert!(text.contains(&named), "{text}");
        }
        let text = noted(|o| o.pixel.x = if o.camera == 1 { 639.0 - o.pixel.x } else { o.pixel.x });
        let text = text.unwrap_err().to_string();
        assert!(text.contains("cam2 mirrored"), "{text}");
        let text = noted(|o| {
            if o.camera == 0 {
                o.pixel = Vector2::new(639.0, 479.0) - o.pixel;
            }
        });
        let text = text.unwrap_err().to_string();
        assert!(text.contains("cam1 turned upside down"), "{text}");
    }

    #[test]
    fn a_ball_counts_as_its_colours_marker_where_both_are_alone() {
        let ball = |camera, color| TrackedDetection {
            t_ns: 7,
            camera,
            track_id: 0,
            color,
            pixel: Vector2::new(color as f64, 2.0),
            covariance_px2: mavsight_geometry::Matrix2::identity(),
            diameter_px: 5.0,
            is_static: false,
            is_preferred: true,
        };
        // Colour 1 has two markers; camera 0 sees two balls of colour 0, camera 1 one.
        let seen = [ball(0, 0), ball(0, 0), ball(0, 1), ball(0, 2), ball(1, 0), ball(1, 1)];
        let got: Vec<_> =
            lone(7, &seen, &[0, 1, 1, 2]).iter().map(|o| (o.t_ns, o.camera, o.marker)).collect();
        assert_eq!(got, [(7, 0, 3), (7, 1, 0)]);
    }

    #[test]
    fn what_no_mistake_of_these_explains_is_noted_as_it_is() {
        // A camera that looks elsewhere by a hundredth of a radian.
        let text = noted(|o| o.pixel.x += if o.camera == 2 { 6.0 } else { 0.0 }).unwrap().unwrap();
        assert!(text.contains("times what their noise explains") && text.contains("moved since"), "{text}");
    }
}
