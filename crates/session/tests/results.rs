//! Results: what is written reads back, and what cannot be written leaves nothing.

#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use approx::assert_relative_eq;
use common::Folder;
use mavsight_geometry::{
    Camera, ControlPoint, EulerAngles, ImageSize, Intrinsics, Matrix2, Matrix6, Vector2, Vector3,
    world_from_body,
};
use mavsight_pose::{
    CameraControl, MarkerObservation, Motion, MotionCovariance, MotionSample, PoseError, PoseEstimate,
    PoseSample, Rig, calibrate, euler_std,
};
use mavsight_session::{
    FlightTable, MarkerAsBuilt, RunResults, read_body, read_flight_table, read_markers, read_motion,
    read_poses, read_rig, read_summary, write_markers_early, write_results, write_rig,
};
use nalgebra::SMatrix;

fn names(all: &[&str]) -> Vec<String> {
    all.iter().map(|n| (*n).to_owned()).collect()
}

fn rig() -> Rig {
    let size = ImageSize { width_px: 640, height_px: 480 };
    let camera = Camera::looking_at(
        Vector3::new(4.5, -4.5, 1.5),
        Vector3::new(0.0, 0.0, 1.5),
        Intrinsics::from_horizontal_fov(size, 0.925),
        size,
    );
    let points = (0..8).map(|k| {
        let point =
            Vector3::new(f64::from(k & 1) * 3.0 - 1.5, f64::from(k & 2) * 1.5 - 1.5, f64::from(k & 4) * 0.75);
        let shift = Vector2::new(0.05 * f64::from(k % 3), -0.03 * f64::from(k % 2));
        ControlPoint {
            name: format!("p{k}"),
            point_in_world_m: point,
            pixel: camera.project(&point).unwrap().pixel + shift,
            pixel_cov_px2: Matrix2::identity() * 0.01,
        }
    });
    let points: Vec<_> = points.collect();
    calibrate(&[CameraControl::exact("cam1".into(), size, points, vec![0.03; 8])]).unwrap()
}

fn pose_sample(t_ns: i64) -> PoseSample {
    let attitude = EulerAngles { phi_rad: 0.3, theta_rad: -0.4, psi_rad: 2.0 };
    let mut covariance = Matrix6::from_diagonal(&[1e-6, 4e-6, 9e-6, 1e-4, 2e-4, 3e-4].into());
    (covariance[(0, 4)], covariance[(4, 0)]) = (-3e-6, -3e-6);
    let mut systematic = nalgebra::Matrix6xX::zeros(2);
    (systematic[(0, 0)], systematic[(4, 1)]) = (2e-3, 5e-3);
    let place = world_from_body(Vector3::new(0.1, -0.2, 1.5), attitude);
    let estimate = PoseEstimate::new(place, &covariance)
        .with_systematic(&systematic.map(|v: f64| v as f32))
        .by_markers([0, 2].into_iter().collect(), Default::default(), Some(0.125));
    PoseSample { t_ns, estimate: Ok(estimate) }
}

fn motion() -> Motion {
    let pose = pose_sample(0).estimate.unwrap();
    let mut covariance = SMatrix::<f64, 18, 18>::from_diagonal_element(1e-4);
    covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(&pose.covariance());
    let sample = MotionSample {
        t_ns: 33_333_333,
        world_from_body: pose.world_from_body,
        velocity_in_body_m_s: Vector3::new(1.0, 2.0, 3.0),
        rates_rad_s: Vector3::new(4.0, 5.0, 6.0),
        specific_force_m_s2: Vector3::new(7.0, 8.0, -9.8),
        angular_acceleration_rad_s2: Vector3::new(10.0, 11.0, 1e-9),
        covariance: MotionCovariance::of(&covariance).with_noise([1e-5, 2e-5, 3e-5, 4e-5, 5e-5, 6e-5]),
    };
    Motion {
        samples: vec![sample],
        unknown_ns: vec![7_000_000_000],
        doubts: mavsight_pose::Doubts::default(),
        translation_bandwidth_hz: 3.5,
        rotation_bandwidth_hz: 4.5,
        sample_interval_s: 1.0 / 30.0,
    }
}

fn as_built(name: &str, diameter_std_m: Option<f64>) -> MarkerAsBuilt {
    MarkerAsBuilt {
        name: name.into(),
        position_m: Vector3::new(0.225, -1.0 / 3.0, 0.1),
        position_std_m: Vector3::new(1e-4, 2e-4, 1.0 / 7e3),
        diameter_m: 0.05,
        diameter_std_m,
    }
}

fn results() -> RunResults {
    let observation = MarkerObservation {
        t_ns: 33_333_333,
        camera: 1,
        marker: 2,
        pixel: Vector2::new(12.25, 480.0 / 7.0),
        covariance_px2: Matrix2::new(0.04, 0.0, 0.0, 0.09),
    };
    RunResults {
        session: "test".into(),
        camera_names: names(&["cam1", "cam2"]),
        marker_names: names(&["red", "green", "blue"]),
        rig: Some(rig()),
        markers: vec![observation],
        body: vec![as_built("red", Some(1e-4)), as_built("green", None)],
        poses: vec![
            pose_sample(0),
            PoseSample { t_ns: 33_333_333, estimate: Err(PoseError::NotMeasured) },
            pose_sample(66_666_667),
        ],
        motion: Some(motion()),
        summary: serde_json::json!({"frames": 3}),
        ..RunResults::default()
    }
}

#[test]
fn a_rig_survives() {
    let (folder, rig) = (Folder::new(), rig());
    write_rig(&folder.path("rig.toml"), &rig).unwrap();
    let back = read_rig(&folder.path("rig.toml")).unwrap();
    let (a, b) = (&rig.cameras[0], &back.cameras[0]);
    assert_eq!(
        (&a.name, a.camera.size, a.model, a.camera.intrinsics, a.camera.distortion),
        (&b.name, b.camera.size, b.model, b.camera.intrinsics, b.camera.distortion)
    );
    assert_eq!((&a.points, a.residual_rms_px, a.sigma_px), (&b.points, b.residual_rms_px, b.sigma_px));
    assert_eq!((a.centre_std_m, a.centre_cov_m2), (b.centre_std_m, b.centre_cov_m2));
    assert!(rig.uncertainty.ncols() >= 9);
    assert_eq!((&rig.uncertainty, &rig.left_out), (&back.uncertainty, &back.left_out));
    let point = Vector3::new(0.3, 0.4, 1.1);
    assert_relative_eq!(
        a.camera.project(&point).unwrap().pixel,
        b.camera.project(&point).unwrap().pixel,
        epsilon = 1e-9
    );
    let text = std::fs::read_to_string(folder.path("rig.toml")).unwrap();
    let error =
        read_rig(&folder.write("bad.toml", text.replace("sigma_px", "sigma"))).unwrap_err().to_string();
    assert!(error.contains("bad.toml") && error.contains("sigma") && error.contains("line"), "{error}");
}

#[test]
fn all_tables_survive() {
    let (folder, results) = (Folder::new(), results());
    let out = folder.path("out");
    write_results(&out, &results).unwrap();
    let markers =
        read_markers(&out.join("markers.csv"), &results.camera_names, &results.marker_names).unwrap();
    assert_eq!(markers[0].t_ns, 33_333_333);
    assert_eq!((markers[0].camera, markers[0].marker, markers[0].pixel), (1, 2, results.markers[0].pixel));
    assert_relative_eq!(markers[0].covariance_px2, results.markers[0].covariance_px2, epsilon = 1e-15);

    let poses = read_poses(&out.join("pose.csv"), &results.marker_names).unwrap();
    assert_eq!(poses.iter().map(|p| p.t_ns).collect::<Vec<_>>(), [0, 33_333_333, 66_666_667]);
    assert!(poses[1].estimate.is_err());
    let (a, b) = (results.poses[2].estimate.as_ref().unwrap(), poses[2].estimate.as_ref().unwrap());
    assert_relative_eq!(a.world_from_body, b.world_from_body, epsilon = 1e-14);
    assert_eq!((&a.markers_used, a.residual_px), (&b.markers_used, b.residual_px));
    let turn = |p: &PoseEstimate| {
        euler_std(&p.world_from_body, &p.covariance().fixed_view::<3, 3>(3, 3).into_owned())
    };
    // Systematic errors are kept to seven digits.
    assert_relative_eq!(turn(a), turn(b), max_relative = 2e-7);
    assert_relative_eq!(a.own_covariance(), b.own_covariance(), epsilon = 1e-16);
    assert_relative_eq!(a.covariance().diagonal(), b.covariance().diagonal(), max_relative = 0.3);

    let motion = read_motion(&out.join("motion.csv")).unwrap();
    let wanted = results.motion.as_ref().unwrap();
    assert_eq!((motion.translation_bandwidth_hz, motion.rotation_bandwidth_hz), (3.5, 4.5));
    assert_eq!((motion.samples.len(), &motion.unknown_ns), (1, &wanted.unknown_ns));
    let noise = |m: &Motion| [0, 3, 5].map(|k| m.samples[0].covariance.noise_variance(k));
    assert_eq!(noise(&motion), noise(wanted));
    assert_eq!(motion.samples[0].specific_force_m_s2, wanted.samples[0].specific_force_m_s2);
    assert_eq!(motion.samples[0].angular_acceleration_rad_s2, wanted.samples[0].angular_acceleration_rad_s2);
    assert_relative_eq!(motion.samples[0].covariance.variance(17), 1e-4, max_relative = 2e-7);
    assert_eq!(read_body(&out.join("body.csv")).unwrap(), results.body);
    let summary = read_summary(&out.join("summary.json")).unwrap();
    assert_eq!((summary["schema"].as_u64(), summary["frames"].as_u64()), (Some(1), Some(3)));
}

#[test]
fn headers_are_those_of_the_contract() {
    let folder = Folder::new();
    write_results(&folder.path(""), &results()).unwrap();
    let header = |file: &str| {
        std::fs::read_to_string(folder.path(file)).unwrap().lines().next().unwrap_or_default().to_owned()
    };
    assert_eq!(header("markers.csv"), "t_s,camera,marker,u_px,v_px,u_std_px,v_std_px");
    let pose = header("pose.csv");
    assert!(
        pose.starts_with(
            "t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad,x_std_m,y_std_m,z_std_m,phi_std_rad,theta_std_rad,psi_std_rad,\
             markers,residual_px,new_x_x_m2,new_x_y_m2,new_x_z_m2,new_x_turn_x_m_rad,"
        ) && pose.ends_with(",new_turn_z_turn_z_rad2"),
        "{pose}"
    );
    assert!(
        header("motion.csv").contains(",u_m_s,u_std_m_s,")
            && header("motion.csv").ends_with(
                ",rdot_rad_s2,rdot_std_rad_s2,u_noise_std_m_s,v_noise_std_m_s,w_noise_std_m_s,p_noise_std_rad_s,q_noise_std_rad_s,\
                 r_noise_std_rad_s"
            )
    );
    let text = std::fs::read_to_string(folder.path("pose.csv")).unwrap();
    assert_eq!(
        text.lines().nth(2).unwrap(),
        format!("0.033333333{}", ",".repeat(35)),
        "an unmeasured frame is an empty row"
    );
}

#[test]
fn a_pose_table_of_another_system_is_read() {
    let folder = Folder::new();
    let table =
        "t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad\n0.0,1,2,3,0,0,0.5\n0.1,,,,,,\n0.2,1,2,3,0,0,0.5\n";
    let poses = read_poses(&folder.write("pose.csv", table), &[]).unwrap();
    assert!(poses[1].estimate.is_err());
    let estimate = poses[2].estimate.as_ref().unwrap();
    assert_eq!(estimate.world_from_body.translation.vector, Vector3::new(1.0, 2.0, 3.0));
    assert_relative_eq!(estimate.covariance(), Matrix6::identity() * 1e-6, epsilon = 1e-18);
    for (bad, parts) in [
        (table.replace("0.2,1", "0.05,1"), ["row 3", "t_s"]),
        (table.replace("0.2,1,2,3", "0.2,1,,3"), ["row 3", "y_m"]),
        (table.replace("psi_rad", "yaw"), ["psi_rad", "yaw"]),
    ] {
        let error = read_poses(&folder.write("bad.csv", bad), &[]).unwrap_err().to_string();
        assert!(parts.iter().all(|p| error.contains(p)) && error.contains("bad.csv"), "{error}");
    }
}

/// Equal errors of the Euler angles were presumed: near a pitch of 90° good poses were left out, and intervals held 73 %.
#[test]
fn an_attitude_of_which_nothing_is_said_is_as_good_about_any_axis() {
    let folder = Folder::new();
    let table = "t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad\n0.0,1,2,3,0.4,1.5,0.5\n0.1,1,2,3,0.4,-1.56,0.5\n";
    for pose in read_poses(&folder.write("pose.csv", table), &[]).unwrap() {
        assert_relative_eq!(pose.estimate.unwrap().covariance(), Matrix6::identity() * 1e-6, epsilon = 1e-18);
    }
}

#[test]
fn a_folder_that_is_a_file_is_refused() {
    let folder = Folder::new();
    let place = folder.write("out", "mine");
    let error = write_results(&place, &results()).unwrap_err().to_string();
    assert!(error.contains("out") && error.contains("another folder"), "{error}");
    assert_eq!(std::fs::read_to_string(place).unwrap(), "mine");
}

#[test]
fn a_failed_write_leaves_no_results() {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path("motion.csv/in the way")).unwrap();
    let error = write_results(&folder.path(""), &results()).unwrap_err().to_string();
    assert!(error.contains("motion.csv"), "{error}");
    let left: Vec<_> = std::fs::read_dir(folder.path("")).unwrap().flatten().map(|e| e.file_name()).collect();
    assert_eq!(left, ["motion.csv"], "only what was in the way");
}

#[test]
fn markers_that_are_written_early_come_with_the_rest_or_not_at_all() {
    let folder = Folder::new();
    let mut results = results();
    let late = MarkerObservation { t_ns: 66_666_667, ..results.markers[0] };
    let all = [&results.markers[0], &late].into_iter().collect();
    let place = folder.path("markers.csv");
    write_markers_early(&folder.path(""), &mut results, &all, |o| o.t_ns > 50_000_000).unwrap();
    assert_eq!((results.markers.len(), results.markers[0].t_ns, place.exists()), (1, 66_666_667, false));
    write_results(&folder.path(""), &results).unwrap();
    let back = read_markers(&place, &results.camera_names, &results.marker_names).unwrap();
    assert_eq!(back.iter().map(|o| o.t_ns).collect::<Vec<_>>(), [33_333_333, 66_666_667]);
    let other = Folder::new();
    write_markers_early(&other.path(""), &mut results, &all, |_| true).unwrap();
    drop(results);
    assert_eq!(std::fs::read_dir(other.path("")).unwrap().count(), 0, "nobody asked for it");
}

#[test]
fn a_motion_of_another_system_needs_no_summary() {
    let folder = Folder::new();
    let names = "t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad,u_m_s,v_m_s,w_m_s,p_rad_s,q_rad_s,r_rad_s,ax_m_s2,ay_m_s2,\
                 az_m_s2,pdot_rad_s2,qdot_rad_s2,rdot_rad_s2";
    let row = |t: f64| format!("{t},{}", ["0.5"; 18].join(","));
    let rows = [row(0.0), row(0.01), format!("0.02{}", ",".repeat(18)), row(0.03)];
    let path = folder.write("motion.csv", format!("{names}\n{}\n", rows.join("\n")));
    let FlightTable::Motion(motion) = read_flight_table(&path, &[]).unwrap() else { panic!("a motion") };
    assert_eq!((motion.samples.len(), motion.samples[2].rates_rad_s.y), (3, 0.5));
    assert_eq!(motion.samples[0].covariance, MotionCovariance::default());
    assert_relative_eq!(motion.rotation_bandwidth_hz, 25.0, epsilon = 1e-9);
    let swapped = folder.write("motion.csv", format!("{names}\n{}\n{}\n", row(0.1), row(0.0)));
    assert!(read_flight_table(&swapped, &[]).unwrap_err().to_string().contains("sort"));
    let poses = folder.write("pose.csv", "t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad\n0,1,2,3,0,0,0\n");
    assert!(matches!(read_flight_table(&poses, &[]).unwrap(), FlightTable::Poses(p) if p.len() == 1));
    // A row that is missing was not measured.
    let rows: Vec<String> = [0.0, 0.1, 0.2, 0.4, 0.5].iter().map(|t| format!("{t},1,2,3,0,0,0")).collect();
    let text = format!("t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad\n{}\n", rows.join("\n"));
    let FlightTable::Poses(poses) = read_flight_table(&folder.write("pose.csv", text), &[]).unwrap() else {
        panic!("poses")
    };
    let times: Vec<i64> = poses.iter().map(|p| p.t_ns / 1_000_000).collect();
    assert_eq!(times, [0, 100, 200, 300, 400, 500]);
    assert!(poses[3].estimate.is_err() && poses[4].estimate.is_ok());
}
