//! Other programs' formats: what is read is also written again, in this program's form and in theirs.

use crate::Outcome;
use crate::files::{path, with_file, written};
use crate::target::ends;
use mavsight_geometry::{Camera, ImageSize, Intrinsics, Vector3};
use mavsight_pose::{CameraModel, Lens, Pixels, Rig, RigCamera};
use mavsight_session::foreign::dltdv_points::{PointOptions, read_offsets, read_xypts, read_xyzpts};
use mavsight_session::foreign::frames::AxesOf;
use mavsight_session::foreign::marker_paths::{MarkerPaths, poses_of_body, read_table, write_table};
use mavsight_session::foreign::pixels::PixelOrigin;
use mavsight_session::foreign::poses::{
    TimedPose, Trajectory, read_pose_table, read_trajectory, write_pose_table, write_trajectory,
};
use mavsight_session::foreign::{CameraOptions, Noted, argus, c3d, dltdv, kalibr, opencv, ros, trc};
use mavsight_session::{SessionError, write_rig};
use std::path::Path;

const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

fn rig(cameras: usize) -> Rig {
    let lens = Intrinsics::from_horizontal_fov(SIZE, 0.9);
    let camera = |k: usize| {
        let centre_m = Vector3::new(k as f64 * 4.0 - 2.0, -4.0, 1.0);
        let mut camera = Camera::looking_at(centre_m, Vector3::new(0.0, 0.0, 1.0), lens, SIZE);
        (camera.distortion.k1, camera.distortion.p2) = (-0.05, 1e-3);
        RigCamera::exact(
            format!("cam{}", k + 1),
            camera,
            CameraModel { pixels: Pixels::Square, lens: Lens::Straight },
        )
    };
    Rig::exact((0..cameras).map(camera).collect())
}

fn options() -> CameraOptions {
    CameraOptions { sizes: vec![SIZE], drop_skew: true, ..CameraOptions::default() }
}

type ReadRig = fn(&Path, &CameraOptions) -> Result<Noted<Rig>, SessionError>;
type WriteRig = fn(&Path, &Rig, &CameraOptions) -> Result<Vec<String>, SessionError>;

const RIG_WRITERS: [WriteRig; 5] = [argus::write, dltdv::write, kalibr::write, opencv::write, ros::write];

/// A rig in a format.
fn rig_file(write: WriteRig, cameras: usize) -> Vec<u8> {
    written("rig", |path| write(path, &rig(cameras), &options()).map(drop))
}

/// Reads cameras; what is read is finite, and every writer takes or refuses it.
fn cameras(bytes: &[u8], read: ReadRig) -> Outcome {
    let rig = with_file("attacked-cameras", bytes, |path| {
        // Without a size where the file has its own.
        read(path, &CameraOptions::default()).or_else(|_| read(path, &options()))
    });
    if let Ok(rig) = &rig {
        for camera in &rig.value.cameras {
            let k = &camera.camera.intrinsics;
            assert!(k.fx_px.is_finite() && k.fx_px > 0.0 && k.fy_px > 0.0, "focal lengths {k:?}");
            assert!(
                camera.camera.centre_in_world().iter().all(|x| x.is_finite()),
                "centre of {}",
                camera.name
            );
        }
        for write in RIG_WRITERS {
            ends(write(&path("again"), &rig.value, &options()));
        }
        ends(write_rig(&path("rig-again.toml"), &rig.value));
    }
    rig.into()
}

pub(super) fn argus_files() -> Vec<Vec<u8>> {
    vec![rig_file(argus::write, 2)]
}

pub(super) fn argus_cameras(bytes: &[u8]) -> Outcome {
    cameras(bytes, argus::read)
}

pub(super) fn dltdv_files() -> Vec<Vec<u8>> {
    vec![rig_file(dltdv::write, 2), rig_file(dltdv::write, 1)]
}

pub(super) fn dltdv_cameras(bytes: &[u8]) -> Outcome {
    cameras(bytes, dltdv::read)
}

pub(super) fn kalibr_files() -> Vec<Vec<u8>> {
    let mut plain = rig(2);
    plain.cameras.iter_mut().for_each(|c| c.camera.distortion.k3 = 0.0);
    vec![written("chain.yaml", |path| kalibr::write(path, &plain, &options()).map(drop))]
}

pub(super) fn kalibr_cameras(bytes: &[u8]) -> Outcome {
    cameras(bytes, kalibr::read)
}

pub(super) fn opencv_files() -> Vec<Vec<u8>> {
    vec![rig_file(opencv::write, 2), rig_file(opencv::write, 1), rig_file(opencv::write, 3)]
}

pub(super) fn opencv_cameras(bytes: &[u8]) -> Outcome {
    cameras(bytes, opencv::read)
}

pub(super) fn ros_files() -> Vec<Vec<u8>> {
    vec![rig_file(ros::write, 1)]
}

pub(super) fn ros_cameras(bytes: &[u8]) -> Outcome {
    cameras(bytes, ros::read)
}

fn names(all: &[&str]) -> Vec<String> {
    all.iter().map(|name| (*name).to_owned()).collect()
}

fn point_options() -> PointOptions {
    PointOptions {
        rate_hz: 30.0,
        origin: PixelOrigin::Dltdv5,
        sizes: vec![SIZE],
        cameras: names(&["cam1", "cam2"]),
        points: Vec::new(),
        std_px: 0.5,
    }
}

pub(super) fn point_files() -> Vec<Vec<u8>> {
    let text = "pt1_cam1_X,pt1_cam1_Y,pt1_cam2_X,pt1_cam2_Y\n1,2,3,4\nNaN,NaN,3,4\n1.5,2.5,NaN,NaN\n";
    vec![text.into(), b"1,2,3\n1,2,3\n".to_vec(), b"2,2\n2,2\n0,0\n".to_vec()]
}

pub(super) fn sparse_files() -> Vec<Vec<u8>> {
    vec![b"Sparse format\n3\t4\t5\n1\t1\t10\n2\t1\t11\n1\t2\t10\n2\t2\t11\n3\t3\t1.5\n".to_vec()]
}

fn digitised(name: &str, bytes: &[u8]) -> Outcome {
    let read = |path: &Path| {
        let in_images = read_xypts(path, &point_options()).map(drop);
        let in_space = read_xyzpts(path, 30.0, &[]);
        if let Ok(paths) = &in_space {
            write_paths(paths);
        }
        in_images.or(in_space.map(drop)).or(read_offsets(path, 30.0).map(drop))
    };
    with_file(name, bytes, read).into()
}

pub(super) fn points(bytes: &[u8]) -> Outcome {
    digitised("points.csv", bytes)
}

pub(super) fn sparse_points(bytes: &[u8]) -> Outcome {
    digitised("points.tsv", bytes)
}

pub(super) fn control_objects() -> Vec<Vec<u8>> {
    vec![b"x,y,z\n0,0,0\n1,0.5,2\n".to_vec()]
}

pub(super) fn control_object(bytes: &[u8]) -> Outcome {
    with_file("object.csv", bytes, dltdv::read_control_object).into()
}

/// Every writer of paths takes or refuses them.
fn write_paths(paths: &MarkerPaths) {
    assert!(paths.points_m.iter().flatten().flatten().all(|p| p.iter().all(|x| x.is_finite())));
    ends(c3d::write(&path("again.c3d"), paths));
    ends(trc::write(&path("again.trc"), paths));
    ends(write_table(&path("again.csv"), paths));
    let place = |k: usize| Vector3::new(0.1 * k as f64, 0.2 * (k % 2) as f64, 0.1 * (k % 3) as f64);
    let body: Vec<_> =
        paths.names.iter().take(6).enumerate().map(|(k, name)| (name.clone(), place(k))).collect();
    ends(poses_of_body(&path("again.csv"), paths, &body));
}

fn paths() -> MarkerPaths {
    let place = |k: usize, m: usize| (k + m != 3).then(|| Vector3::new(k as f64, m as f64, 0.5));
    MarkerPaths {
        names: names(&["red", "green"]),
        t_ns: (0..5).map(|k| 10_000_000 * k).collect(),
        points_m: (0..5).map(|k| (0..2).map(|m| place(k, m)).collect()).collect(),
    }
}

pub(super) fn c3d_files() -> Vec<Vec<u8>> {
    vec![written("a.c3d", |path| c3d::write(path, &paths()).map(drop))]
}

pub(super) fn c3d_paths(bytes: &[u8]) -> Outcome {
    let read = with_file("attacked.c3d", bytes, c3d::read);
    if let Ok(paths) = &read {
        write_paths(&paths.value);
    }
    read.into()
}

pub(super) fn trc_files() -> Vec<Vec<u8>> {
    vec![written("a.trc", |path| trc::write(path, &paths()))]
}

pub(super) fn trc_paths(bytes: &[u8]) -> Outcome {
    let read = with_file("attacked.trc", bytes, trc::read);
    if let Ok(paths) = &read {
        write_paths(paths);
    }
    read.into()
}

pub(super) fn position_tables() -> Vec<Vec<u8>> {
    let mut third = paths();
    third.names.push("blue".to_owned());
    third.points_m.iter_mut().for_each(|places| places.push(Some(Vector3::new(0.3, 0.1, 0.2))));
    vec![written("a.csv", |path| write_table(path, &third))]
}

pub(super) fn positions(bytes: &[u8]) -> Outcome {
    let read = with_file("positions.csv", bytes, read_table);
    if let Ok(paths) = &read {
        write_paths(paths);
    }
    read.into()
}

const TRAJECTORIES: [Trajectory; 2] = [Trajectory::Tum, Trajectory::Euroc];

fn poses() -> Vec<TimedPose> {
    let pose = |k: i64| {
        let camera = rig(1).cameras[0].camera.cam_from_world;
        TimedPose { t_ns: 33_333_333 * k, world_from_body: Some(camera) }
    };
    (0..3).map(pose).collect()
}

fn write_poses(poses: &[TimedPose]) {
    for format in TRAJECTORIES {
        ends(write_trajectory(&path("again.txt"), format, poses, AxesOf::Enu));
    }
    ends(write_pose_table(&path("poses-again.csv"), poses));
}

fn trajectory(bytes: &[u8], format: Trajectory) -> Outcome {
    let read = with_file("trajectory.txt", bytes, |path| read_trajectory(path, format, AxesOf::Ned));
    if let Ok(poses) = &read {
        write_poses(poses);
    }
    read.into()
}

pub(super) fn tum_files() -> Vec<Vec<u8>> {
    vec![written("a.txt", |path| write_trajectory(path, Trajectory::Tum, &poses(), AxesOf::World).map(drop))]
}

pub(super) fn tum(bytes: &[u8]) -> Outcome {
    trajectory(bytes, Trajectory::Tum)
}

pub(super) fn euroc_files() -> Vec<Vec<u8>> {
    vec![written("a.txt", |path| {
        write_trajectory(path, Trajectory::Euroc, &poses(), AxesOf::World).map(drop)
    })]
}

pub(super) fn euroc(bytes: &[u8]) -> Outcome {
    trajectory(bytes, Trajectory::Euroc)
}

pub(super) fn pose_table(bytes: &[u8]) -> Outcome {
    let read = with_file("pose-table.csv", bytes, read_pose_table);
    if let Ok(poses) = &read {
        write_poses(poses);
    }
    read.into()
}
