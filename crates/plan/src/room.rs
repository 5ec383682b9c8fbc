//! The room file: room, cameras, their places, and the weights of the plan.

use crate::{CentreNoise, CentreStd, PlanError, Solid};
use mavsight_geometry::{EulerAngles, ImageSize, Isometry3, Vector3, world_from_body};
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

/// A room with all data for the placement of cameras; the content of `ROOM.toml`.
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
    /// Standard deviation of a marker's place on the body, each coordinate.
    #[serde(default)]
    pub markers_std_m: f64,
    /// Standard deviation of a centre's systematic error, each coordinate.
    #[serde(default)]
    pub centre_bias_px: f64,
    /// Walls, floor and ceiling.
    pub room: Solid,
    /// Flight volume.
    pub volume: VolumeSection,
    /// Weights of position and attitude.
    #[serde(default)]
    pub weights: Weights,
    /// Calibration; without it the cameras count as exact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub control: Option<ControlSection>,
    /// Cameras by type.
    pub camera: Vec<CameraType>,
    /// Boxes in which cameras may stand; the whole room where left out.
    #[serde(default)]
    pub stand: Vec<Solid>,
    /// Boxes in which no camera may stand; they do not block the view.
    #[serde(default)]
    pub keep_out: Vec<Solid>,
    /// Boxes that block the view; no camera may stand in them either.
    #[serde(default)]
    pub block: Vec<Solid>,
}

/// Flight volume.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VolumeSection {
    /// Corner of the least coordinates that the body's origin reaches.
    pub low_m: [f64; 3],
    /// Corner of the largest.
    pub high_m: [f64; 3],
    /// Headings of the nose, from +X towards +Y; each place is predicted with all of them.
    #[serde(default = "four_headings")]
    pub headings_deg: Vec<f64>,
}

fn four_headings() -> Vec<f64> {
    vec![22.5, 112.5, 202.5, 292.5]
}

/// Weights of the figure: the root of the sum of squares of both standard deviations, each times its weight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// Of a millimetre of position (root of the trace of its covariance).
    pub per_mm: f64,
    /// Of a degree of attitude.
    pub per_deg: f64,
    /// Over the volume.
    pub criterion: Criterion,
}

impl Default for Weights {
    fn default() -> Self {
        Self { per_mm: 1.0, per_deg: 0.0, criterion: Criterion::Mean }
    }
}

/// Combination of the figures of all places.
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
    /// Standard deviation of one coordinate of the centre of a ball in the stills. Left out: the camera's `centre_std_px` where
    /// that is given, else predicted from its size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub std_px: Option<f64>,
}

/// A type of camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraType {
    /// Name.
    pub name: String,
    /// Number of cameras of this type.
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
    /// Appearance of a ball in its images.
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
    /// Image size.
    pub fn size(&self) -> ImageSize {
        ImageSize { width_px: self.width_px, height_px: self.height_px }
    }

    /// The camera model that a calibration will choose.
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

    /// Standard deviation of a coordinate of the centre of a marker at a place in view of a camera of the
    /// rig: if the room file lists several, one of them, the same in each call.
    pub fn centre_std_px_at(
        &self,
        diameter_px: f64,
        place_m: &Vector3<f64>,
        camera: usize,
        marker: usize,
    ) -> f64 {
        let given = self.centre_std_px.as_ref();
        given.map_or_else(|| self.image.std_px(diameter_px), |std| std.at_px(place_m, camera, marker))
    }

    fn validate(&self) -> Result<(), PlanError> {
        let check = |is_right: bool, key: &str, detail: &dyn Fn() -> String| {
            PlanError::unless(is_right, format!("camera {:?}: {key}", self.name), detail)
        };
        let (width, height, fov) = (self.width_px, self.height_px, self.horizontal_fov_deg);
        let sizes = 16..=65_536;
        let is_image = sizes.contains(&width) && sizes.contains(&height);
        check(is_image, "width_px", &|| format!("{width} × {height} is no image"))?;
        check(fov > 1.0 && fov < 170.0, "horizontal_fov_deg", &|| {
            format!("{fov} is outside 1 to 170: give the angle across the width")
        })?;
        let centres = self.centre_std_px.as_ref().map_or(&[1.0][..], CentreStd::values_px);
        check(!centres.is_empty(), "centre_std_px", &|| {
            "is an empty list: give one or more, or leave it out".into()
        })?;
        let positive = [
            ("least_diameter_px", self.least_diameter_px),
            ("frame_rate_hz", self.frame_rate_hz),
            ("image.grey_noise", self.image.grey_noise),
            ("image.contrast", self.image.contrast),
            ("image.excess", self.image.excess),
        ];
        let centres = centres.iter().map(|std| ("centre_std_px", *std));
        for (key, value) in positive.into_iter().chain(centres) {
            check(value.is_finite() && value > 0.0, key, &|| format!("{value} is not above zero"))?;
        }
        let is_lens =
            self.k1.is_finite() && self.k2.is_finite() && (0.0..100.0).contains(&self.image.blur_px);
        check(is_lens, "k1, k2, image.blur_px", &|| "are not finite numbers of a lens".into())?;
        let [near, far] = self.focus_m.unwrap_or([0.0, 1.0]);
        check(near >= 0.0 && far > near, "focus_m", &|| {
            format!("{near} to {far} is no range: give nearest and farthest")
        })
    }
}

impl Room {
    /// Checks the numbers.
    ///
    /// # Errors
    /// [`PlanError::Value`] names the key.
    pub fn validate(&self) -> Result<(), PlanError> {
        PlanError::unless(self.schema == ROOM_SCHEMA, "schema", || {
            format!("{} is not known: this version reads schema = {ROOM_SCHEMA}", self.schema)
        })?;
        let volume = Solid { name: None, low_m: self.volume.low_m, high_m: self.volume.high_m };
        let boxes = [("room", &self.room), ("volume", &volume)].into_iter();
        let listed = [("stand", &self.stand), ("keep_out", &self.keep_out), ("block", &self.block)];
        let listed = listed.into_iter().flat_map(|(k, all)| all.iter().map(move |s| (k, s)));
        for (key, Solid { low_m, high_m, .. }) in boxes.chain(listed) {
            let is_box = (0..3).all(|k| low_m[k].abs() < 1e6 && high_m[k] < 1e6 && high_m[k] >= low_m[k]);
            PlanError::unless(is_box, key, || {
                format!(
                    "{low_m:?} to {high_m:?} is no box: low_m is the corner of the least coordinates, in metres"
                )
            })?;
        }
        for corner in [volume.low_m, volume.high_m] {
            PlanError::unless(self.room.contains(&Vector3::from(corner)), "volume", || {
                format!("its corner {corner:?} lies outside the room: make it smaller")
            })?;
        }
        let headings = &self.volume.headings_deg;
        let has_headings = !headings.is_empty() && headings.iter().all(|h| h.is_finite());
        PlanError::unless(has_headings, "volume.headings_deg", || {
            "must be one or more finite angles".into()
        })?;
        let (mm, deg) = (self.weights.per_mm, self.weights.per_deg);
        let is_weight = mm >= 0.0 && deg >= 0.0 && mm + deg > 0.0 && (mm + deg).is_finite();
        PlanError::unless(is_weight, "weights", || {
            format!("{mm} per mm and {deg} per degree: neither may be below zero, nor both be zero")
        })?;
        for (key, value) in [("markers_std_m", self.markers_std_m), ("centre_bias_px", self.centre_bias_px)] {
            PlanError::unless(value.is_finite() && value >= 0.0, key, || {
                format!("{value} is no standard deviation: give 0 or more")
            })?;
        }
        let std = self.control.as_ref().and_then(|c| c.std_px).unwrap_or(1.0);
        let is_std = std.is_finite() && std > 0.0;
        PlanError::unless(is_std, "control.std_px", || format!("{std} is not above zero"))?;
        let cameras = self.camera.iter().fold(0_usize, |sum, camera| sum.saturating_add(camera.count));
        PlanError::unless((2..=16).contains(&cameras), "camera", || {
            format!("{cameras} cameras in all: give 2 to 16 by `count`")
        })?;
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
        let part = |k: usize| if steps == 1 { 0.5 } else { (k % steps) as f64 / (steps - 1) as f64 };
        let places = (0..steps.pow(3)).map(|cell| {
            let share = Vector3::new(part(cell), part(cell / steps), part(cell / steps / steps));
            low + (high - low).component_mul(&share)
        });
        places.flat_map(|place| self.poses_at(&place).collect::<Vec<_>>()).collect()
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
