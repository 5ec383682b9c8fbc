//! Exchanges: recordings of each other's cameras, images mirrored or turned, colours of each other's markers.

use super::{Alternative, ClockEvidence, Evidence};
use crate::{Cause, Finding, PipelineError};
use mavsight_geometry::{Vector2, Vector3};
use mavsight_pose::{CameraClock, CameraStream, ClockPrior, MarkerObservation, Rig, fitting_clocks, median};

/// Markers up to which every permutation of them is tried; of more, every exchange of two.
const MOST_PERMUTED: usize = 5;

/// Cameras up to which every subset of them is tried as mirrored or turned; of more, one and all.
const MOST_SUBSETS: usize = 4;

/// Instants from which a permutation is tried; those that fit are tried with all.
const FEW: usize = 7;

/// Cosine of the angle between the body's z and down above which a body is upright: it leans by less than 60°, which few
/// aircraft exceed for all of a flight.
const UPRIGHT: f64 = 0.5;

/// What may have been done to recordings or to the file of the vehicle.
#[derive(Debug, Clone, PartialEq)]
enum Exchange {
    Cameras(usize, usize),
    Mirrored(Vec<usize>),
    UpsideDown(Vec<usize>),
    /// The ball that the file calls marker k is marker `[k]`.
    Markers(Vec<usize>),
}

impl Exchange {
    /// Those that a rig allows: only cameras of one image size can have been exchanged.
    fn of_cameras(rig: &Rig) -> Vec<Self> {
        let size = |k: usize| rig.cameras[k].camera.size;
        let n = rig.cameras.len();
        let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
        let exchanged = pairs.filter(|(a, b)| size(*a) == size(*b)).map(|(a, b)| Self::Cameras(a, b));
        let turned = subsets(n).into_iter().flat_map(|of| [Self::Mirrored(of.clone()), Self::UpsideDown(of)]);
        exchanged.chain(turned).collect()
    }

    fn cause(&self) -> Cause {
        match self {
            Self::Cameras(..) => Cause::CamerasExchanged,
            Self::Mirrored(_) | Self::UpsideDown(_) => Cause::ImageTurned,
            Self::Markers(_) => Cause::ColorsExchanged,
        }
    }

    /// Markers that are not where the file says.
    fn displaced(&self) -> usize {
        let Self::Markers(of) = self else { return 0 };
        of.iter().enumerate().filter(|(k, of)| k != *of).count()
    }

    fn camera(&self) -> Option<usize> {
        match self {
            Self::Mirrored(of) | Self::UpsideDown(of) => <[usize; 1]>::try_from(&of[..]).ok().map(|[k]| k),
            _ => None,
        }
    }

    /// The observation as it would have been without.
    fn undone(&self, mut seen: MarkerObservation, rig: &Rig) -> MarkerObservation {
        let size = rig.cameras[seen.camera].camera.size;
        let (right, bottom) = (f64::from(size.width_px) - 1.0, f64::from(size.height_px) - 1.0);
        match self {
            Self::Cameras(a, b) if seen.camera == *a => seen.camera = *b,
            Self::Cameras(a, b) if seen.camera == *b => seen.camera = *a,
            Self::Mirrored(of) if of.contains(&seen.camera) => {
                seen.pixel.x = right - seen.pixel.x;
                for at in [(0, 1), (1, 0)] {
                    seen.covariance_px2[at] = -seen.covariance_px2[at];
                }
            }
            Self::UpsideDown(of) if of.contains(&seen.camera) => {
                seen.pixel = Vector2::new(right, bottom) - seen.pixel;
            }
            Self::Markers(of) => seen.marker = of[seen.marker],
            _ => {}
        }
        seen
    }

    /// The recordings as they would have been without. A recording keeps its clock, but not what was known of its offset
    /// from the others'.
    fn undone_in(&self, mut streams: Vec<CameraStream>, rig: &Rig) -> Vec<CameraStream> {
        for (k, stream) in streams.iter_mut().enumerate() {
            stream.observations.iter_mut().for_each(|o| *o = self.undone(*o, rig));
            match self {
                Self::Mirrored(of) if of.contains(&k) => stream.readout.x = -stream.readout.x,
                Self::UpsideDown(of) if of.contains(&k) => stream.readout = -stream.readout,
                _ => {}
            }
        }
        if let Self::Cameras(a, b) = self {
            streams.swap(*a, *b);
            for stream in &mut streams {
                let line_time_s = stream.prior.clock.line_time_s;
                let clock = CameraClock { line_time_s, ..CameraClock::default() };
                stream.prior = ClockPrior { clock, ..ClockPrior::unknown() };
            }
        }
        streams
    }

    fn words(&self, evidence: &Evidence<'_>) -> String {
        let name = |k: usize| &evidence.rig.cameras[k].name;
        let all = |of: &[usize]| names(&of.iter().map(|k| name(*k).as_str()).collect::<Vec<_>>());
        let its =
            |of: &[usize], one: &'static str, more: &'static str| if of.len() == 1 { one } else { more };
        match self {
            Self::Cameras(a, b) => format!(
                "with the recordings of {} and {} exchanged: exchange them in the session file",
                name(*a),
                name(*b)
            ),
            Self::Mirrored(of) => format!(
                "with {} mirrored left to right: turn mirroring off where the camera or its program offers it, or mirror {} too",
                all(of),
                its(of, "its still", "their stills")
            ),
            Self::UpsideDown(of) => format!(
                "with {} turned upside down: {} have to be the same way up",
                all(of),
                its(of, "its recording and its still", "the recording and the still of each")
            ),
            Self::Markers(of) => format!(
                "with the colours of {} exchanged: exchange them in the vehicle file",
                names(&evidence.displaced(of))
            ),
        }
    }
}

fn names(all: &[&str]) -> String {
    match all {
        [rest @ .., last] if !rest.is_empty() => format!("{} and {last}", rest.join(", ")),
        _ => all.join(", "),
    }
}

/// All subsets of so many that are not empty, or of many those of one and of all.
fn subsets(count: usize) -> Vec<Vec<usize>> {
    if count > MOST_SUBSETS {
        return (0..count).map(|k| vec![k]).chain([(0..count).collect()]).collect();
    }
    let of = |bits: usize| (0..count).filter(|k| bits >> k & 1 == 1).collect();
    (1..1 << count).map(of).collect()
}

/// All permutations of so many.
fn permutations(count: usize) -> Vec<Vec<usize>> {
    if count > MOST_PERMUTED {
        let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
        let swap = |(a, b)| {
            let mut all: Vec<usize> = (0..count).collect();
            all.swap(a, b);
            all
        };
        return pairs.map(swap).collect();
    }
    let mut out: Vec<Vec<usize>> = vec![vec![]];
    for next in 0..count {
        let longer = |p: &Vec<usize>| -> Vec<Vec<usize>> {
            (0..=p.len())
                .map(|at| p[..at].iter().copied().chain([next]).chain(p[at..].iter().copied()).collect())
                .collect()
        };
        out = out.iter().flat_map(longer).collect();
    }
    out.retain(|p| p.iter().enumerate().any(|(k, of)| k != *of));
    out
}

/// An exchange that fits.
struct Fitting {
    is_upright: bool,
    displaced: usize,
    alternative: Alternative,
}

/// Of exchanges that leave the least, those in which the body is upright, and of these those of the fewest markers. Of a
/// flat body the mirror image is one more pose: cameras that face each other and are all turned upside down see what they
/// would see exchanged, of a body that is upside down.
fn likeliest(mut fitting: Vec<Fitting>) -> Vec<Alternative> {
    let least = fitting.iter().map(|f| f.alternative.fit.ratio).fold(f64::INFINITY, f64::min);
    fitting.retain(|f| f.alternative.fit.ratio <= super::ALIKE * least);
    let rank = |f: &Fitting| (!f.is_upright, f.displaced);
    let Some(first) = fitting.iter().map(rank).min() else { return vec![] };
    fitting.retain(|f| rank(f) == first);
    fitting.into_iter().map(|f| f.alternative).collect()
}

/// Few of these instants, spread over them.
fn few(instants: &[Vec<MarkerObservation>]) -> Vec<Vec<MarkerObservation>> {
    instants.iter().step_by((instants.len() / FEW).max(1)).cloned().collect()
}

impl Evidence<'_> {
    fn displaced(&self, of: &[usize]) -> Vec<&str> {
        let markers = self.estimator.markers().iter().zip(of).enumerate();
        markers.filter(|(k, (_, of))| k != *of).map(|(_, (m, _))| m.name.as_str()).collect()
    }

    fn instants_without(&self, exchange: &Exchange) -> Vec<Vec<MarkerObservation>> {
        let undone = |seen: &Vec<MarkerObservation>| {
            seen.iter().map(|o| exchange.undone(*o, self.rig)).collect::<Vec<_>>()
        };
        self.instants.iter().map(undone).collect()
    }

    /// The exchanges that are tried, in words that begin a sentence.
    pub(super) fn exchanges_tried(&self) -> String {
        let has_pair = Exchange::of_cameras(self.rig).iter().any(|e| matches!(e, Exchange::Cameras(..)));
        let recordings = if has_pair { "exchanged, mirrored" } else { "mirrored" };
        let colors = if self.estimator.markers().len() > MOST_PERMUTED { "two marker" } else { "marker" };
        format!("Recordings {recordings} or turned, every exchange of {colors} colours")
    }

    /// What exchanged or turned recordings leave at the given clocks.
    pub(super) fn exchanged_recordings(&self) -> Result<Vec<Alternative>, PipelineError> {
        let mut fitting = Vec::new();
        for exchange in Exchange::of_cameras(self.rig) {
            fitting.extend(self.fitting(&exchange, self.instants_without(&exchange))?);
        }
        Ok(likeliest(fitting))
    }

    /// What exchanged or turned recordings leave at the clocks that the flight then shows: those that it seems to show
    /// while they are exchanged are wrong as well.
    pub(super) fn exchanged_recordings_by_other_clocks(&self) -> Result<Vec<Alternative>, PipelineError> {
        let Some(evidence) = self.clocks.as_ref().filter(|c| c.is_open()) else { return Ok(vec![]) };
        let mut fitting = Vec::new();
        for exchange in Exchange::of_cameras(self.rig) {
            let streams = exchange.undone_in(evidence.streams.clone(), self.rig);
            let markers = self.estimator.markers();
            let Some(clocks) = fitting_clocks(self.rig, markers, &streams) else { continue };
            let Some(instants) = self.instants_by(&ClockEvidence { streams }, &clocks) else { continue };
            fitting.extend(self.fitting(&exchange, instants)?);
        }
        Ok(likeliest(fitting))
    }

    /// What an exchange leaves, where it fits.
    fn fitting(
        &self,
        exchange: &Exchange,
        without: Vec<Vec<MarkerObservation>>,
    ) -> Result<Option<Fitting>, PipelineError> {
        let fit = self.median_fit(&without)?.filter(|fit| fit.ratio <= super::FITS);
        Ok(fit.map(|fit| {
            let is_upright = self.upright(&few(&without)) >= 0.5;
            Fitting { is_upright, displaced: exchange.displaced(), alternative: self.by(exchange, fit) }
        }))
    }

    fn by(&self, exchange: &Exchange, fit: super::ReprojectionFit) -> Alternative {
        let (cause, camera) = (exchange.cause(), exchange.camera());
        Alternative { cause, camera, fit, words: exchange.words(self) }
    }

    /// What exchanged colours leave.
    pub(super) fn exchanged_colors(&self) -> Result<Vec<Alternative>, PipelineError> {
        let mut fitting = Vec::new();
        for of in permutations(self.estimator.markers().len()) {
            let exchange = Exchange::Markers(of);
            let without = self.instants_without(&exchange);
            if self.median_fit(&few(&without))?.is_some_and(|fit| fit.ratio <= super::FITS) {
                fitting.extend(self.fitting(&exchange, without)?);
            }
        }
        Ok(likeliest(fitting))
    }

    /// Cosines of the angle between the body's z and down, of the poses of these instants.
    fn tilts(&self, instants: &[Vec<MarkerObservation>]) -> Vec<f64> {
        let tilt = |seen: &Vec<MarkerObservation>| {
            let estimate = self.estimator.estimate(seen.first()?.t_ns, seen, None).ok()?;
            Some(-(estimate.world_from_body.rotation * Vector3::z()).z)
        };
        instants.iter().filter_map(tilt).collect()
    }

    /// Share of the poses of these instants in which the body's z points down; 1 where there are none.
    fn upright(&self, instants: &[Vec<MarkerObservation>]) -> f64 {
        let tilts = self.tilts(instants);
        if tilts.is_empty() {
            return 1.0;
        }
        tilts.iter().filter(|cosine| **cosine > 0.0).count() as f64 / tilts.len() as f64
    }

    /// That the body is upside down or on its side all the while.
    pub(super) fn not_upright(&self) -> Result<Option<Finding>, PipelineError> {
        let tilts = self.tilts(&few(&self.instants));
        if tilts.is_empty() || tilts.iter().any(|cosine| *cosine > UPRIGHT) {
            return Ok(None);
        }
        if tilts.iter().all(|cosine| *cosine <= 0.0) && tilts.iter().any(|cosine| *cosine < -UPRIGHT) {
            return self.upside_down().map(Some);
        }
        let tilt_deg = median(tilts).map_or(f64::NAN, |cosine| cosine.acos().to_degrees());
        let note = format!(
            "The body lies on its side in all that was looked at, its z {tilt_deg:.0}° from down (median): it was flown so, or the \
             control points' z does not point up, or the axes of the vehicle file are not forward, right and down. The images do not \
             show which: correct the file that is wrong, or every attitude and force is by the wrong axes."
        );
        Ok(Some(Finding { causes: vec![Cause::WorldAxes, Cause::BodyAxes], camera: None, note }))
    }

    /// That the body is upside down all the while, where other colours of its markers would turn it over: of a
    /// flat body the cameras see no more than that.
    fn upside_down(&self) -> Result<Finding, PipelineError> {
        let upright = self.exchanged_colors()?;
        let colors: Vec<&str> = upright.iter().map(|a| a.words.as_str()).collect();
        let (mut causes, mut other) = (vec![Cause::BodyAxes], String::new());
        if !upright.is_empty() {
            causes.insert(0, Cause::ColorsExchanged);
            other = format!("; or it is upright {}", colors.join("; or "));
        }
        let note = format!(
            "The body is upside down in all that was looked at: it was flown so, or the axes of the vehicle file are not forward, \
             right and down, or the control points' z does not point up{other}. The images do not show which, and no pose is given: correct the file; if it was flown so, film it \
             upright for a fifth of the time as well."
        );
        Ok(Finding { causes, camera: None, note })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_permutation_of_few_and_every_pair_of_many_is_tried() {
        let all = permutations(4);
        assert_eq!(all.len(), 23);
        let mut unlike = all.clone();
        unlike.sort();
        unlike.dedup();
        assert_eq!(unlike.len(), 23);
        assert_eq!(permutations(8).len(), 28);
    }

    #[test]
    fn every_subset_of_few_cameras_and_all_of_many_are_tried() {
        assert_eq!(subsets(2), [vec![0], vec![1], vec![0, 1]]);
        assert_eq!(subsets(4).len(), 15);
        assert_eq!(subsets(6).last(), Some(&(0..6).collect()));
    }
}
