//! The room file: what there is, what may stand where, and what counts.

use crate::{CentreNoise, CentreStd, PlanError, Solid};
use mavsight_geometry::{
    BrownConrady, EulerAngles, ImageSize, Intrinsics, Isometry3, Vector3, world_from_body,
};
use mavsight_pose::{CameraModel, Lens, Pixels};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Version of the room file.
pub const ROOM_SCHEMA: u32 = 1;

/// The paper's room as files to start from: name and content of each.
pub const EXAMPLE: [(&str, &str); 2] = [
    ("room.toml", include_str!("../example/room.toml")),
    ("control_points.csv", include_str!("../example/control_points.csv")),
];

/// A room with all that matters for where its cameras go; the content of `ROOM.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Room {
    /// Version of this file, [`ROOM_SCHEMA`].
    pub schema: u32,
    /// Name.
    pub name: String,
    /// Vehicle file, for its markers; the paper's where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vehicle: Option<PathBuf>,
    /// How well the markers' places on the body are known, each coordinate.
    #[serde(default)]
    pub markers_std_m: f64,
    /// Standard deviation of a centre's systematic error, each coordinate.
    #[serde(default)]
    pub centre_bias_px: f64,
    /// Walls, floor and ceiling.
    pub room: Solid,
    /// Where the aircraft flies.
    pub volume: VolumeSection,
    /// What counts.
    #[serde(default)]
    pub weights: Weights,
    /// Calibration; without it the cameras count as exact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub control: Option<ControlSection>,
    /// Cameras by type.
    pub camera: Vec<CameraType>,
    /// Where cameras may stand; everywhere in the room where left out.
    #[serde(default)]
    pub stand: Vec<Solid>,
    /// Where none may stand, though it may be looked through.
    #[serde(default)]
    pub keep_out: Vec<Solid>,
    /// What blocks the view; no camera stands in it either.
    #[serde(default)]
    pub block: Vec<Solid>,
}

/// Where the aircraft flies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VolumeSection {
    /// Corner of the least coordinates that the body's origin reaches.
    pub low_m: [f64; 3],
    /// Corner of the largest.
    pub high_m: [f64; 3],
    /// Where the nose points, from +X towards +Y; each place is looked at with all of them.
    #[serde(default = "four_headings")]
    pub headings_deg: Vec<f64>,
}

fn four_headings() -> Vec<f64> {
    vec![22.5, 112.5, 202.5, 292.5]
}

/// What counts: the root of the sum of squares of both standard deviations, each times its weight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// Of a millimetre of position (root of the trace of its covariance).
    #[serde(default = "one")]
    pub per_mm: f64,
    /// Of a degree of attitude.
    #[serde(default)]
    pub per_deg: f64,
    /// Over the volume.
    #[serde(default)]
    pub criterion: Criterion,
}

fn one() -> f64 {
    1.0
}

impl Default for Weights {
    fn default() -> Self {
        Self { per_mm: 1.0, per_deg: 0.0, criterion: Criterion::Mean }
    }
}

/// How the figures of all places become one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Criterion {
    /// Their mean.
    #[default]
    Mean,
    /// The largest.
    Worst,
}

/// Calibration by control points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlSection {
    /// Table of control points, as of a session.
    pub points: PathBuf,
    /// Standard deviation of one coordinate of the centre of a ball in the stills; predicted from its size
    /// where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub std_px: Option<f64>,
}

/// A type of camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraType {
    /// Name.
    pub name: String,
    /// How many there are.
    pub count: usize,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Angle across the width.
    pub horizontal_fov_deg: f64,
    /// Radial distortion, r².
    #[serde(default)]
    pub k1: f64,
    /// Radial distortion, r⁴.
    #[serde(default)]
    pub k2: f64,
    /// Standard deviation of one coordinate of a ball's centre, one for all or a list of equally likely ones;
    /// predicted from `image` where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre_std_px: Option<CentreStd>,
    /// What its pictures look like.
    #[serde(default)]
    pub image: CentreNoise,
    /// A marker's image must be at least so large.
    #[serde(default = "three")]
    pub least_diameter_px: f64,
    /// Nearest and farthest distance that is sharp; everything where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focus_m: Option<[f64; 2]>,
    /// Frames a second, for the session file.
    #[serde(default = "thirty")]
    pub frame_rate_hz: f64,
}

/// A disc of less than three pixels has no pixel that is wholly inside.
fn three() -> f64 {
    3.0
}

fn thirty() -> f64 {
    30.0
}

impl CameraType {
    /// Size of its images.
    pub fn size(&self) -> ImageSize {
        ImageSize { width_px: self.width_px, height_px: self.height_px }
    }

    /// Its lens.
    pub fn lens(&self) -> (Intrinsics, BrownConrady) {
        let intrinsics = Intrinsics::from_horizontal_fov(self.size(), self.horizontal_fov_deg.to_radians());
        (intrinsics, BrownConrady { k1: self.k1, k2: self.k2, ..Default::default() })
    }

    /// The model that a calibration of it will choose.
    pub fn model(&self) -> CameraModel {
        let lens = match (self.k1 != 0.0, self.k2 != 0.0) {
            (false, false) => Lens::Straight,
            (true, false) => Lens::K1,
            (_, true) => Lens::K1K2,
        };
        CameraModel { pixels: Pixels::Square, lens }
    }

    /// Standard deviation of a coordinate of the centre of a typical ball's image.
    pub fn centre_std_px(&self, diameter_px: f64) -> f64 {
        self.centre_std_px.as_ref().map_or_else(|| self.image.std_px(diameter_px), CentreStd::typical_px)
    }

    /// The same of a marker at a place before a camera of the rig, which says what lies behind it: where
    /// these differ, one of them, the same whenever it is asked for.
    pub fn centre_std_px_at(
        &self,
        diameter_px: f64,
        place_m: &Vector3<f64>,
        (camera, marker): (usize, usize),
    ) -> f64 {
        let given = self.centre_std_px.as_ref();
        given.map_or_else(|| self.image.std_px(diameter_px), |std| std.at_px(place_m, camera, marker))
    }

    fn validate(&self) -> Result<(), PlanError> {
        let refuse = |key: &str, detail: String| {
            Err(PlanError::value(format!("camera {:?}: {key}", self.name), detail))
        };
        if self.width_px < 16 || self.height_px < 16 || self.width_px > 65_536 || self.height_px > 65_536 {
            return refuse("width_px", format!("{} × {} is no image", self.width_px, self.height_px));
        }
        if !(self.horizontal_fov_deg > 1.0 && self.horizontal_fov_deg < 170.0) {
            let detail =
                format!("{} is outside 1 to 170: give the angle across the width", self.horizontal_fov_deg);
            return refuse("horizontal_fov_deg", detail);
        }
        let positive = [
            ("least_diameter_px", self.least_diameter_px),
            ("frame_rate_hz", self.frame_rate_hz),
            ("image.grey_noise", self.image.grey_noise),
            ("image.contrast", self.image.contrast),
            ("image.excess", self.image.excess),
        ];
        let centres = self.centre_std_px.as_ref().map_or(&[1.0][..], CentreStd::values_px);
        if centres.is_empty() {
            return refuse("centre_std_px", "is an empty list: give one or more, or leave it out".into());
        }
        let centres = centres.iter().map(|std| ("centre_std_px", *std));
        for (key, value) in positive.into_iter().chain(centres) {
            if !(value.is_finite() && value > 0.0) {
                return refuse(key, format!("{value} is not above zero"));
            }
        }
        if !(self.k1.is_finite()
            && self.k2.is_finite()
            && self.image.blur_px >= 0.0
            && self.image.blur_px < 100.0)
        {
            return refuse("k1, k2, image.blur_px", "are not finite numbers of a lens".into());
        }
        match self.focus_m {
            Some([near, far]) if !(near >= 0.0 && far > near) => {
                refuse("focus_m", format!("{near} to {far} is no range: give nearest and farthest"))
            }
            _ => Ok(()),
        }
    }
}

impl Room {
    /// Checks the numbers.
    ///
    /// # Errors
    /// [`PlanError::Value`] names the key.
    pub fn validate(&self) -> Result<(), PlanError> {
        if self.schema != ROOM_SCHEMA {
            let detail = format!("{} is not known: this version reads schema = {ROOM_SCHEMA}", self.schema);
            return Err(PlanError::value("schema", detail));
        }
        let volume = Solid { name: None, low_m: self.volume.low_m, high_m: self.volume.high_m };
        let boxes = [("room", &self.room), ("volume", &volume)].into_iter();
        let listed = [("stand", &self.stand), ("keep_out", &self.keep_out), ("block", &self.block)];
        for (key, solid) in
            boxes.chain(listed.into_iter().flat_map(|(k, all)| all.iter().map(move |s| (k, s))))
        {
            let sound = (0..3).all(|k| {
                solid.low_m[k].abs() < 1e6 && solid.high_m[k] < 1e6 && solid.high_m[k] >= solid.low_m[k]
            });
            if !sound {
                let detail = format!(
                    "{:?} to {:?} is no box: low_m is the corner of the least coordinates, in metres",
                    solid.low_m, solid.high_m
                );
                return Err(PlanError::value(key, detail));
            }
        }
        for corner in [volume.low_m, volume.high_m] {
            if !self.room.contains(&Vector3::from(corner)) {
                return Err(PlanError::value(
                    "volume",
                    format!("its corner {corner:?} lies outside the room: make it smaller"),
                ));
            }
        }
        let headings = &self.volume.headings_deg;
        if headings.is_empty() || headings.iter().any(|h| !h.is_finite()) {
            return Err(PlanError::value("volume.headings_deg", "must be one or more finite angles"));
        }
        let w = &self.weights;
        if !(w.per_mm >= 0.0
            && w.per_deg >= 0.0
            && w.per_mm + w.per_deg > 0.0
            && (w.per_mm + w.per_deg).is_finite())
        {
            return Err(PlanError::value(
                "weights",
                format!(
                    "{} per mm and {} per degree: neither may be below zero, nor both be zero",
                    w.per_mm, w.per_deg
                ),
            ));
        }
        for (key, value) in [("markers_std_m", self.markers_std_m), ("centre_bias_px", self.centre_bias_px)] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(PlanError::value(
                    key,
                    format!("{value} is no standard deviation: give 0 or more"),
                ));
            }
        }
        if let Some(std) =
            self.control.as_ref().and_then(|c| c.std_px).filter(|s| !(s.is_finite() && *s > 0.0))
        {
            return Err(PlanError::value("control.std_px", format!("{std} is not above zero")));
        }
        let cameras: usize = self.camera.iter().map(|c| c.count).sum();
        if !(2..=16).contains(&cameras) {
            return Err(PlanError::value(
                "camera",
                format!("{cameras} cameras in all: give 2 to 16 by `count`"),
            ));
        }
        self.camera.iter().try_for_each(CameraType::validate)
    }

    /// Middle of the flight volume.
    pub fn middle_m(&self) -> Vector3<f64> {
        (Vector3::from(self.volume.low_m) + Vector3::from(self.volume.high_m)) / 2.0
    }

    /// Poses on a grid of so many steps along each side of the volume, with all headings; level.
    pub fn poses(&self, steps: usize) -> Vec<Isometry3<f64>> {
        let steps = steps.max(1);
        let (low, high) = (Vector3::from(self.volume.low_m), Vector3::from(self.volume.high_m));
        let part = |k: usize| if steps == 1 { 0.5 } else { k as f64 / (steps - 1) as f64 };
        let mut out = Vec::with_capacity(steps.pow(3) * self.volume.headings_deg.len());
        for cell in 0..steps.pow(3) {
            let share =
                Vector3::new(part(cell % steps), part(cell / steps % steps), part(cell / steps / steps));
            let place = low + (high - low).component_mul(&share);
            out.extend(self.poses_at(&place));
        }
        out
    }

    /// A place with all headings.
    pub fn poses_at(&self, place_m: &Vector3<f64>) -> impl Iterator<Item = Isometry3<f64>> {
        let level = |heading_deg: &f64| {
            let attitude = EulerAngles { psi_rad: -heading_deg.to_radians(), ..Default::default() };
            world_from_body(*place_m, attitude)
        };
        self.volume.headings_deg.iter().map(level)
    }
}
