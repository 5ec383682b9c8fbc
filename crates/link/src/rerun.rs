//! A recording that Rerun opens (`.rrd`), written as the flight goes.
//!
//! | entity | what |
//! |---|---|
//! | `world` | Z up |
//! | `world/aircraft` | `Transform3D`, world_from_body, of each pose that was measured, and no other |
//! | `world/aircraft/markers`, `world/cameras` | `Points3D` |
//! | `position_m`, `position_std_m`, `euler_deg` | `Scalars`; none where nothing was measured |
//! | `rates_deg_s`, `residual_px`, `latency_ms` | `Scalars` likewise |
//! | `notes`, `tracking` | `TextLog` |
//!
//! Timelines: `t`, since the flight began, and `captured`, by this machine's clock. Poses are in Rerun's
//! single precision, scalars in double. Rows go to the file once a second of flight; a kill loses what has come
//! since.

mod columns;
mod file;

use crate::{Event, LinkError, Outlet, PoseEvent, Scene, Tracking};
use arrow_array::{Float64Array, StringArray, UInt8Array, UInt32Array};
use columns::{captured, component, fixed, flight_time, floats, lists};
use file::RrdFile;
use std::io;
use std::path::{Path, PathBuf};

/// Time of which rows wait before they are written: they share a head of two kilobytes.
const KEPT_S: f64 = 1.0;

/// Writes what happens into a file.
pub struct Rerun {
    path: PathBuf,
    file: RrdFile,
    poses: Vec<PoseEvent>,
    tracking: Option<Tracking>,
}

impl Rerun {
    /// Begins a file, in place of one that is there.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn create(path: &Path) -> Result<Self, LinkError> {
        let refused = |source| LinkError::File { path: path.display().to_string(), source };
        let mut file = RrdFile::create(path, "mavsight", crate::outlet::now_ns()).map_err(refused)?;
        // Right, forward, up.
        let axes = lists([1], fixed::<3>(UInt8Array::from(vec![3, 5, 1])));
        let column = component("ViewCoordinates", "xyz", "ViewCoordinates", axes);
        file.chunk("/world", 1, vec![column]).map_err(refused)?;
        Ok(Self { path: path.to_owned(), file, poses: Vec::new(), tracking: None })
    }

    fn scene(&mut self, scene: &Scene) -> io::Result<()> {
        let points = |places: Vec<[f64; 3]>, names: Vec<&str>| {
            let places = lists([places.len()], fixed::<3>(floats(places.as_flattened())));
            let labels = lists([names.len()], StringArray::from(names));
            vec![
                component("Points3D", "positions", "Position3D", places),
                component("Points3D", "labels", "Text", labels),
            ]
        };
        let (cameras, markers) = (&scene.cameras, &scene.markers);
        let names = cameras.iter().map(|c| c.name.as_str()).collect();
        self.file.chunk("/world/cameras", 1, points(cameras.iter().map(|c| c.centre_m).collect(), names))?;
        let names = markers.iter().map(|m| m.name.as_str()).collect();
        let mut columns = points(markers.iter().map(|m| m.in_body_m).collect(), names);
        // Red, green, blue and opacity from the highest byte on.
        let color = |[r, g, b]: [u8; 3]| u32::from_be_bytes([r, g, b, 255]);
        let colors: UInt32Array = markers.iter().map(|m| Some(color(m.rgb))).collect();
        let radii: Vec<f64> = markers.iter().map(|m| 0.5 * m.diameter_m).collect();
        columns.push(component("Points3D", "colors", "Color", lists([markers.len()], colors)));
        columns.push(component("Points3D", "radii", "Radius", lists([markers.len()], floats(&radii))));
        self.file.chunk("/world/aircraft/markers", 1, columns)
    }

    fn text(&mut self, entity: &str, t_s: f64, text: &str) -> io::Result<()> {
        let body = component("TextLog", "text", "Text", lists([1], StringArray::from(vec![text])));
        self.file.chunk(entity, 1, vec![flight_time([t_s]), body])
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.poses.is_empty() {
            return Ok(());
        }
        let poses = std::mem::take(&mut self.poses);
        let times = |of: &[&PoseEvent]| {
            vec![captured(of.iter().map(|p| p.captured_ns)), flight_time(of.iter().map(|p| p.t_s))]
        };
        let measured: Vec<&PoseEvent> = poses.iter().filter(|p| p.position_m.is_some()).collect();
        if !measured.is_empty() {
            let places: Vec<f64> = measured.iter().filter_map(|p| p.position_m).flatten().collect();
            // Rerun has w last.
            let turns = measured.iter().filter_map(|p| p.attitude).flat_map(|[w, x, y, z]| [x, y, z, w]);
            let turns: Vec<f64> = turns.collect();
            let ones = || measured.iter().map(|_| 1);
            let mut columns = times(&measured);
            let turns = lists(ones(), fixed::<4>(floats(&turns)));
            columns.push(component("Transform3D", "quaternion", "RotationQuat", turns));
            let places = lists(ones(), fixed::<3>(floats(&places)));
            columns.push(component("Transform3D", "translation", "Translation3D", places));
            self.file.chunk("/world/aircraft", measured.len(), columns)?;
        }
        let all: Vec<&PoseEvent> = poses.iter().collect();
        for (entity, of) in SCALARS {
            let values: Vec<Vec<f64>> = all.iter().map(|p| of(p)).collect();
            let rows = lists(values.iter().map(Vec::len), Float64Array::from(values.concat()));
            let mut columns = times(&all);
            columns.push(component("Scalars", "scalars", "Scalar", rows));
            self.file.chunk(entity, all.len(), columns)?;
        }
        Ok(())
    }

    fn take(&mut self, event: &Event) -> io::Result<()> {
        match event {
            Event::Scene(scene) => self.scene(scene),
            Event::Pose(pose) => {
                self.poses.push((**pose).clone());
                if self.tracking.replace(pose.tracking) != Some(pose.tracking) {
                    self.text("/tracking", pose.t_s, &format!("{:?}", pose.tracking).to_lowercase())?;
                }
                let is_due = self.poses.first().is_some_and(|first| pose.t_s - first.t_s >= KEPT_S);
                if is_due { self.flush() } else { Ok(()) }
            }
            Event::Note { t_s, text, .. } => self.text("/notes", *t_s, text),
            _ => Ok(()),
        }
    }
}

type Curve = fn(&PoseEvent) -> Vec<f64>;

const SCALARS: [(&str, Curve); 6] = [
    ("/position_m", |p| p.position_m.map_or_else(Vec::new, Vec::from)),
    ("/position_std_m", |p| {
        p.covariance.map_or_else(Vec::new, |c| [0, 6, 11].map(|k| c[k].max(0.0).sqrt()).into())
    }),
    ("/euler_deg", |p| p.euler_rad.map_or_else(Vec::new, |a| a.map(f64::to_degrees).into())),
    ("/rates_deg_s", |p| p.rates_rad_s.map_or_else(Vec::new, |a| a.map(f64::to_degrees).into())),
    ("/residual_px", |p| p.residual_px.into_iter().collect()),
    ("/latency_ms", |p| vec![p.latency_ms]),
];

impl Outlet for Rerun {
    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        self.take(event).map_err(|source| LinkError::File { path: self.path.display().to_string(), source })
    }
}

impl Drop for Rerun {
    fn drop(&mut self) {
        // Nobody is left to report a fault to.
        let _ = self.flush();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(position_m: Option<[f64; 3]>) -> Event {
        Event::Pose(Box::new(PoseEvent {
            t_s: 0.5,
            sequence: 1,
            captured_ns: 1_795_000_000_000_000_000,
            valid: position_m.is_some(),
            tracking: Tracking::Tracking,
            position_m,
            attitude: position_m.map(|_| [1.0, 0.0, 0.0, 0.0]),
            euler_rad: None,
            covariance: None,
            velocity_in_body_m_s: None,
            velocity_std_m_s: None,
            rates_rad_s: None,
            rates_std_rad_s: None,
            residual_px: None,
            latency_ms: 1.0,
            reason: None,
        }))
    }

    /// The file's header and messages follow each other to its end; an instant without a pose is no
    /// transform.
    #[test]
    fn what_was_not_measured_is_no_transform() {
        let path = std::env::temp_dir().join(format!("mavsight-rerun-{}.rrd", std::process::id()));
        let transforms = |events: &[Event]| {
            let mut outlet = Rerun::create(&path).expect("a file");
            events.iter().for_each(|e| outlet.event(e).expect("written"));
            drop(outlet);
            let bytes = std::fs::read(&path).expect("the file");
            assert_eq!(&bytes[..4], b"RRF2");
            let (mut at, mut found) = (12, 0);
            while at < bytes.len() {
                let length = u64::from_le_bytes(bytes[at + 8..at + 16].try_into().expect("eight")) as usize;
                let message = &bytes[at + 16..at + 16 + length];
                found += usize::from(message.windows(12).any(|w| w == b":translation"));
                at += 16 + length;
            }
            assert_eq!(at, bytes.len());
            found
        };
        assert_eq!(transforms(&[pose(None), pose(None)]), 0);
        assert_eq!(transforms(&[pose(None), pose(Some([1.0, 2.0, 3.0]))]), 1);
        std::fs::remove_file(&path).expect("removed");
    }

    #[test]
    fn rows_are_written_once_a_second_at_any_rate() {
        let path = std::env::temp_dir().join(format!("mavsight-rerun-slow-{}.rrd", std::process::id()));
        let mut outlet = Rerun::create(&path).expect("a file");
        for k in 0..12 {
            let Event::Pose(pose) = pose(Some([1.0, 2.0, 3.0])) else { panic!("a pose") };
            outlet
                .event(&Event::Pose(Box::new(PoseEvent { t_s: 0.1 * f64::from(k), ..*pose })))
                .expect("written");
        }
        let bytes = std::fs::read(&path).expect("the file");
        assert!(bytes.windows(12).any(|w| w == b":translation") && outlet.poses.len() == 1);
        std::fs::remove_file(&path).expect("removed");
    }

    #[test]
    fn a_file_that_cannot_be_written_is_reported() {
        let said = Rerun::create(Path::new("/no/such/folder/x.rrd")).err().map(|e| e.to_string());
        assert!(said.is_some_and(|s| s.contains("/no/such/folder/x.rrd cannot be written")));
    }
}
