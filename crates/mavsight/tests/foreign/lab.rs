//! A rig, a flight and its tables, in a folder of their own, with what is true of them.

use mavsight::flight::Vehicle;
use mavsight::geometry::{
    BrownConrady, Camera, EulerAngles, ImageSize, Intrinsics, Vector3, world_from_body,
};
use mavsight::pose::{CameraModel, Rig, RigCamera};
use mavsight::session::foreign::poses::{TimedPose, write_pose_table};
use mavsight::session::{write_rig, write_toml};
use std::path::PathBuf;
use std::process::Output;

pub(crate) struct Lab {
    folder: tempfile::TempDir,
    pub(crate) rig: Rig,
    pub(crate) poses: Vec<TimedPose>,
}

pub(crate) const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

impl Lab {
    /// Two cameras with the given distortion, and 25 poses at 50 Hz of which the fourth was not measured.
    pub(crate) fn new(distortion: BrownConrady) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let camera = |name: &str, centre: Vector3<f64>, fov_deg: f64| {
            let mut k = Intrinsics::from_horizontal_fov(SIZE, f64::to_radians(fov_deg));
            (k.fy_px, k.cx_px, k.cy_px) = (k.fx_px * 1.01, k.cx_px + 3.25, k.cy_px - 5.5);
            let mut camera = Camera::looking_at(centre, Vector3::new(0.1, -0.1, 1.4), k, SIZE);
            camera.distortion = distortion;
            RigCamera::exact(name.into(), camera, CameraModel::DLT_16)
        };
        let rig = Rig::exact(vec![
            camera("cam1", Vector3::new(4.0, -3.0, 1.9), 50.0),
            camera("cam2", Vector3::new(-1.0, -4.5, 2.2), 55.0),
        ]);
        let pose = |k: i64| {
            let t = k as f64 * 0.02;
            let attitude =
                EulerAngles { phi_rad: 0.3 * t.sin(), theta_rad: -0.2 + 0.1 * t, psi_rad: 2.5 + 2.0 * t };
            let position = Vector3::new(0.3 * t, 0.2 - 0.1 * t, 1.0 + 0.5 * t * t);
            TimedPose {
                t_ns: 20_000_000 * k,
                world_from_body: (k != 3).then(|| world_from_body(position, attitude)),
            }
        };
        let lab = Self { folder, rig, poses: (0..25).map(pose).collect() };
        write_rig(&lab.path("rig.toml"), &lab.rig).expect("written");
        write_pose_table(&lab.path("pose.csv"), &lab.poses).expect("written");
        write_toml(&lab.path("vehicle.toml"), &Vehicle::paper()).expect("written");
        lab
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: impl AsRef<[u8]>) -> &Self {
        std::fs::write(self.path(name), text).expect("written");
        self
    }

    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).expect("there")
    }

    /// Points in view of all cameras, no four on a plane by design.
    pub(crate) fn points(&self) -> Vec<Vector3<f64>> {
        let place = |k: usize| {
            let k = k as f64;
            Vector3::new(0.5 * (1.7 * k).sin(), 0.5 * (2.9 * k).cos(), 1.3 + 0.4 * (4.3 * k).sin())
        };
        (0..12).map(place).collect()
    }

    pub(crate) fn pixels(&self) -> Vec<Vec<[f64; 2]>> {
        let seen = |c: &RigCamera, p: &Vector3<f64>| c.camera.project(p).expect("in view").pixel.into();
        self.rig.cameras.iter().map(|c| self.points().iter().map(|p| seen(c, p)).collect()).collect()
    }

    /// `mavsight convert` in the folder.
    pub(crate) fn run(&self, args: &str) -> Output {
        self.stage(&format!("convert {args}"))
    }

    /// A stage in the folder.
    pub(crate) fn stage(&self, args: &str) -> Output {
        let mut command = assert_cmd::Command::cargo_bin("mavsight").expect("the binary");
        command.current_dir(self.folder.path()).args(args.split(' ')).output().expect("it runs")
    }

    /// The same, which must succeed; its notes.
    pub(crate) fn convert(&self, args: &str) -> String {
        let output = self.run(args);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{args}: {said}");
        said
    }

    /// The same, which must be refused as a wrong call with every given word and leave nothing behind.
    pub(crate) fn refuses(&self, args: &str, words: &[&str]) {
        let output = self.run(args);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{args}: {said}");
        for word in words {
            assert!(said.contains(word), "{args}: the message lacks {word:?}: {said}");
        }
        let out = args.split(' ').nth(1).expect("OUT");
        assert!(!self.path(out).exists(), "{args}: {out} is left behind");
    }
}

/// Largest difference of two rigs: intrinsics and distortion; then rotation and centre.
pub(crate) fn apart(a: &Rig, b: &Rig) -> (f64, f64) {
    assert_eq!(a.cameras.len(), b.cameras.len());
    let (mut inner, mut outer) = (0f64, 0f64);
    for (a, b) in a.cameras.iter().zip(&b.cameras) {
        let (a, b) = (&a.camera, &b.camera);
        let list = |c: &Camera| {
            let (k, d) = (&c.intrinsics, &c.distortion);
            [k.fx_px, k.fy_px, k.cx_px, k.cy_px, k.skew_px, d.k1, d.k2, d.p1, d.p2, d.k3]
        };
        assert_eq!(a.size, b.size);
        inner = list(a).iter().zip(list(b)).fold(inner, |w, (x, y)| w.max((x - y).abs()));
        let step = a.cam_from_world.to_homogeneous() - b.cam_from_world.to_homogeneous();
        outer = outer.max(step.amax());
    }
    (inner, outer)
}

/// Largest difference of two flights in position and in elements of rotation; times and gaps must be the
/// same.
pub(crate) fn poses_apart(a: &[TimedPose], b: &[TimedPose]) -> f64 {
    assert_eq!(a.len(), b.len());
    let one = |(a, b): (&TimedPose, &TimedPose)| {
        assert_eq!(a.t_ns, b.t_ns);
        let (t_ns, a, b) = (a.t_ns, a.world_from_body, b.world_from_body);
        assert_eq!(a.is_some(), b.is_some(), "a gap at {t_ns} ns in one of them alone");
        a.zip(b).map_or(0.0, |(a, b)| (a.to_homogeneous() - b.to_homogeneous()).amax())
    };
    a.iter().zip(b).map(one).fold(0.0, f64::max)
}
