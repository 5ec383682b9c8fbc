//! Clocks and frame rates that are not what the session says of them.

use super::{Alternative, Evidence};
use crate::{Cause, PipelineError};
use mavsight_pose::{
    BodyMarker, CameraClock, CameraStream, ClockPrior, ClockVerdict, MarkerObservation, PixelPath, Rig,
    estimate_clocks,
};

/// Rates at which cameras film, frames a second; those of NTSC are a thousandth below.
const RATES_HZ: [f64; 9] = [15.0, 20.0, 24.0, 25.0, 30.0, 50.0, 60.0, 120.0, 240.0];

/// Part of the observations of each camera that clocks have to leave at instants that two cameras see: by clocks
/// that are far off a camera shares none with others, and those fit by themselves.
const LEAST_SHARED: f64 = 0.7;

/// How well cameras whose clocks are given were started together, where a rate is wrong.
const STARTED_STD_S: f64 = 0.1;

/// What each camera saw by its own clock.
#[derive(Debug)]
pub(crate) struct ClockEvidence {
    pub(crate) streams: Vec<CameraStream>,
}

impl ClockEvidence {
    /// Whether the session leaves a clock to the flight.
    pub(super) fn is_open(&self) -> bool {
        self.streams.iter().skip(1).any(|s| s.prior.offset_std_s > 0.0)
    }

    /// What the cameras see at some times if their clocks are these.
    pub(super) fn instants(
        &self,
        rig: &Rig,
        markers: usize,
        times_ns: &[i64],
        clocks: &[CameraClock],
    ) -> Vec<Vec<MarkerObservation>> {
        let of_camera = |(k, (stream, clock)): (usize, (&CameraStream, &CameraClock))| -> Vec<PixelPath> {
            stream.paths(rig.cameras[k].camera.size, markers, clock)
        };
        let paths: Vec<Vec<PixelPath>> = self.streams.iter().zip(clocks).enumerate().map(of_camera).collect();
        let at = |t_ns: &i64| -> Vec<MarkerObservation> {
            let of = |camera: usize, marker: usize| {
                let seen = paths[camera][marker].at(*t_ns as f64 * 1e-9)?;
                let (pixel, covariance_px2) = (seen.pixel, seen.covariance_px2);
                Some(MarkerObservation { t_ns: *t_ns, camera, marker, pixel, covariance_px2 })
            };
            (0..paths.len()).flat_map(|c| (0..markers).filter_map(move |m| of(c, m))).collect()
        };
        times_ns.iter().map(at).collect()
    }
}

impl Evidence<'_> {
    /// What remains with clocks that the session gives set right by the flight, and with other frame rates.
    /// Rates are tried where offsets do not explain it.
    pub(super) fn other_clocks(
        &self,
        explains: impl Fn(&Alternative) -> bool,
    ) -> Result<Vec<Alternative>, PipelineError> {
        let Some(clocks) = &self.clocks else { return Ok(vec![]) };
        let mut out: Vec<Alternative> = self.offset(clocks)?.into_iter().filter(explains).collect();
        if !out.is_empty() {
            return Ok(out);
        }
        for (camera, rate_hz, drift) in rates(&clocks.streams) {
            out.extend(self.rate(clocks, (camera, rate_hz), drift)?);
        }
        Ok(out)
    }

    fn offset(&self, evidence: &ClockEvidence) -> Result<Option<Alternative>, PipelineError> {
        let is_given = |(k, s): &(usize, &CameraStream)| *k > 0 && s.prior.offset_std_s == 0.0;
        let given: Vec<usize> =
            evidence.streams.iter().enumerate().filter(is_given).map(|(k, _)| k).collect();
        let mut streams = evidence.streams.clone();
        for k in &given {
            let clock = streams[*k].prior.clock;
            streams[*k].prior = ClockPrior { clock, ..ClockPrior::unknown() };
        }
        let shown = estimate_clocks(self.rig, self.markers(), &streams);
        let wrong: Vec<usize> =
            given.into_iter().filter(|k| shown[*k].verdict == ClockVerdict::SetRight).collect();
        if wrong.is_empty() {
            return Ok(None);
        }
        let clocks: Vec<CameraClock> = shown.iter().map(|s| s.clock).collect();
        let Some(fit) = self.fit_with(evidence, &clocks)? else { return Ok(None) };
        let said = wrong.iter().map(|k| {
            let (name, late_ms) = (&self.rig.cameras[*k].name, 1e3 * clocks[*k].offset_s);
            let given_ms = 1e3 * evidence.streams[*k].prior.clock.offset_s;
            format!(
                "the clock of {name} {late_ms:.1} ± {:.1} ms late against that of {}, not {given_ms:.1} ms",
                1e3 * shown[*k].offset_std_s,
                self.rig.cameras[0].name
            )
        });
        let words = format!(
            "with {}: leave time_offset_s out, and the flight sets it right",
            said.collect::<Vec<_>>().join(" and ")
        );
        let camera = if let [one] = wrong[..] { Some(one) } else { None };
        Ok(Some(Alternative { cause: Cause::ClockOffset, camera, fit, words }))
    }

    fn rate(
        &self,
        evidence: &ClockEvidence,
        (camera, rate_hz): (usize, f64),
        drift: f64,
    ) -> Result<Option<Alternative>, PipelineError> {
        let mut streams = evidence.streams.clone();
        for (k, stream) in streams.iter_mut().enumerate().skip(1) {
            if k == camera || camera == 0 {
                let clock = CameraClock { drift, ..stream.prior.clock };
                let offset_std_s = stream.prior.offset_std_s.max(STARTED_STD_S);
                stream.prior = ClockPrior { clock, offset_std_s, ..ClockPrior::unknown() };
                stream.interval_s /= 1.0 + drift;
            }
        }
        let shown = estimate_clocks(self.rig, self.markers(), &streams);
        let clocks: Vec<CameraClock> = shown.iter().map(|s| s.clock).collect();
        let Some(fit) = self.fit_with(&ClockEvidence { streams }, &clocks)? else { return Ok(None) };
        let words = format!(
            "with {} at {rate_hz} frames a second, not {:.2} as its time stamps say: correct the rate of the recording, or give \
             frame_rate_hz",
            self.rig.cameras[camera].name,
            1.0 / evidence.streams[camera].interval_s
        );
        Ok(Some(Alternative { cause: Cause::FrameRate, camera: Some(camera), fit, words }))
    }

    fn markers(&self) -> &[BodyMarker] {
        self.estimator.markers()
    }

    fn fit_with(
        &self,
        evidence: &ClockEvidence,
        clocks: &[CameraClock],
    ) -> Result<Option<super::ReprojectionFit>, PipelineError> {
        let Some(instants) = self.instants_by(evidence, clocks) else { return Ok(None) };
        self.median_fit(&instants)
    }

    /// What two cameras see by these clocks at the instants of the evidence; `None` where that is too little.
    pub(super) fn instants_by(
        &self,
        evidence: &ClockEvidence,
        clocks: &[CameraClock],
    ) -> Option<Vec<Vec<MarkerObservation>>> {
        let times_ns: Vec<i64> = self.instants.iter().filter_map(|seen| Some(seen.first()?.t_ns)).collect();
        let mut instants = evidence.instants(self.rig, self.markers().len(), &times_ns, clocks);
        instants.retain(|seen| super::is_by_two(seen));
        let of = |all: &[Vec<MarkerObservation>], camera: usize| {
            all.iter().flatten().filter(|o| o.camera == camera).count() as f64
        };
        let keeps = |camera| of(&instants, camera) >= LEAST_SHARED * of(&self.instants, camera);
        (0..self.rig.cameras.len()).all(keeps).then_some(instants)
    }
}

/// Cameras with the rates that each may have instead of that of its time stamps, and the drift that this is of
/// the others' clocks against the first's.
fn rates(streams: &[CameraStream]) -> Vec<(usize, f64, f64)> {
    let mut out = Vec::new();
    for (camera, stream) in streams.iter().enumerate() {
        let said_hz = 1.0 / stream.interval_s;
        for rate_hz in RATES_HZ {
            // Stamps run faster than time where the camera is faster than they say.
            let faster = rate_hz / said_hz;
            if (faster - 1.0).abs() < 0.005 || !(0.2..=5.0).contains(&faster) {
                continue;
            }
            let of_others = if camera == 0 { 1.0 / faster } else { faster };
            out.push((camera, rate_hz, of_others - 1.0));
        }
    }
    out
}
