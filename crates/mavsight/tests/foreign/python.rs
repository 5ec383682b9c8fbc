//! Written by us and read by the programs themselves, and the other way round.

use crate::lab::{Lab, apart, poses_apart};
use mavsight::geometry::BrownConrady;
use mavsight::session::foreign::poses::{TimedPose, read_pose_table};
use mavsight::session::read_rig;
use serde_json::{Value, json};
use std::process::Command;

const LENS: BrownConrady = BrownConrady { k1: -0.25, k2: 0.08, p1: 1e-3, p2: -2e-3, k3: 0.0 };

/// Runs a case of the script; false where a package is missing.
pub(crate) fn check(case: &str, lab: &Lab, expected: &Value) -> bool {
    lab.write("expected.json", expected.to_string());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/foreign/check.py");
    let python = std::env::var("MAVSIGHT_PYTHON").unwrap_or_else(|_| "python3".into());
    let Ok(output) = Command::new(&python).args([script, case]).arg(lab.path("")).output() else {
        println!("skipped: {python} does not start; name one by MAVSIGHT_PYTHON");
        return false;
    };
    let said =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    if output.status.code() == Some(77) {
        println!("skipped: {python}: {said}");
        return false;
    }
    assert!(output.status.success(), "{said}");
    println!("{said}");
    true
}

fn measured(poses: &[TimedPose]) -> Vec<TimedPose> {
    poses.iter().copied().filter(|p| p.world_from_body.is_some()).collect()
}

#[test]
fn opencv_projects_what_we_project_and_its_files_come_back() {
    let lab = Lab::new(BrownConrady { k3: 0.01, ..LENS });
    lab.convert("rig.toml calib.yml");
    lab.convert("calib.yml own.toml");
    let own = apart(&lab.rig, &read_rig(&lab.path("own.toml")).expect("a rig"));
    assert!(own.0 == 0.0 && own.1 < 1e-14, "{own:?}");
    if !check(
        "opencv",
        &lab,
        &json!({"points": lab.points().iter().map(|p| [p.x, p.y, p.z]).collect::<Vec<_>>(), "pixels": lab.pixels()}),
    ) {
        return;
    }
    lab.convert("theirs.yml theirs.toml");
    let theirs = apart(&lab.rig, &read_rig(&lab.path("theirs.toml")).expect("a rig"));
    assert!(theirs.0 < 1e-12 && theirs.1 < 1e-14, "{theirs:?}");
    // The stereo sample's names: the world is camera 1, the distance between the cameras is kept.
    let notes = lab.convert("stereo.yml stereo.toml --size 640x480");
    assert!(notes.contains("the world is camera 1"), "{notes}");
    let stereo = read_rig(&lab.path("stereo.toml")).expect("a rig");
    let base = |rig: &mavsight::pose::Rig| {
        (rig.cameras[0].camera.centre_in_world() - rig.cameras[1].camera.centre_in_world()).norm()
    };
    assert!((base(&stereo) - base(&lab.rig)).abs() < 1e-12);
}

#[test]
fn ros_and_kalibr_files_are_yaml_that_others_read() {
    let lab = Lab::new(LENS);
    lab.convert("rig.toml {camera}-camera_info.yaml");
    lab.convert("rig.toml camchain.yaml");
    let cameras: Vec<Value> = lab
        .rig
        .cameras
        .iter()
        .map(|c| {
            let (k, d, m) = (&c.camera.intrinsics, &c.camera.distortion, c.camera.cam_from_world.to_homogeneous());
            let rows: Vec<f64> = (0..3).flat_map(|i| (0..4).map(move |j| m[(i, j)])).collect();
            json!({"intrinsics": [k.fx_px, k.fy_px, k.cx_px, k.cy_px], "distortion": [d.k1, d.k2, d.p1, d.p2, d.k3], "cam_from_world": rows})
        })
        .collect();
    let mut names = vec![("cam2-camera_info.yaml", "camchain.yaml")];
    if check("yaml_files", &lab, &json!({"cameras": cameras})) {
        names.push(("theirs-camera_info.yaml", "theirs-camchain.yaml"));
    }
    for (info, chain) in names {
        lab.convert(&format!("{info} info.toml"));
        lab.convert(&format!("{chain} chain.toml --cameras cam1,cam2"));
        let info = read_rig(&lab.path("info.toml")).expect("a rig");
        assert_eq!(info.cameras[0].camera.intrinsics, lab.rig.cameras[1].camera.intrinsics);
        assert_eq!(info.cameras[0].camera.distortion, lab.rig.cameras[1].camera.distortion);
        let mut want = lab.rig.clone();
        let first = want.cameras[0].camera.cam_from_world.inverse();
        want.cameras.iter_mut().for_each(|c| c.camera.cam_from_world *= first);
        let chain = apart(&want, &read_rig(&lab.path("chain.toml")).expect("a rig"));
        assert!(chain.0 == 0.0 && chain.1 < 1e-13, "{chain:?}");
    }
}

#[test]
fn an_independent_dlt_reconstructs_with_our_coefficients_and_its_own_come_back() {
    let lab = Lab::new(BrownConrady::default());
    lab.convert("rig.toml cal-DLTcoefs.csv");
    lab.convert("rig.toml cal-dlt-coefficients.csv");
    lab.convert("rig.toml five-DLTcoefs.csv --origin dltdv5");
    for name in ["cal-DLTcoefs.csv", "cal-dlt-coefficients.csv", "five-DLTcoefs.csv"] {
        lab.convert(&format!("{name} back.toml --size 640x480"));
        let back = apart(&lab.rig, &read_rig(&lab.path("back.toml")).expect("a rig"));
        assert!(back.0 < 1e-8 && back.1 < 1e-10, "{name}: {back:?}");
    }
    // Each point at an instant of its own.
    let mut markers = String::from("t_s,camera,marker,u_px,v_px,u_std_px,v_std_px\n");
    for k in 0..lab.points().len() {
        for (camera, pixels) in lab.pixels().iter().enumerate() {
            let [u, v] = pixels[k];
            markers += &format!("{:.9},cam{},red,{u:?},{v:?},0.1,0.1\n", k as f64 * 0.02, camera + 1);
        }
    }
    lab.write("markers.csv", markers).convert("markers.csv flight-xypts.csv");
    lab.convert("flight-xypts.csv back-markers.csv --rate 50 --points red --std 0.1");
    for (a, b) in lab.read("markers.csv").lines().zip(lab.read("back-markers.csv").lines()).skip(1) {
        let (a, b): (Vec<&str>, Vec<&str>) = (a.split(',').collect(), b.split(',').collect());
        assert_eq!(a[..3], b[..3]);
        for k in 3..5 {
            let apart_px = a[k].parse::<f64>().expect("u") - b[k].parse::<f64>().expect("u");
            assert!(apart_px.abs() < 5.1e-7, "{a:?}\n{b:?}");
        }
    }
    let points: Vec<[f64; 3]> = lab.points().iter().map(|p| (*p).into()).collect();
    if check("dlt", &lab, &json!({"points": points, "pixels": lab.pixels()})) {
        lab.convert("theirs-DLTcoefs.csv theirs.toml --size 640x480");
        let theirs = apart(&lab.rig, &read_rig(&lab.path("theirs.toml")).expect("a rig"));
        assert!(theirs.0 < 1e-5 && theirs.1 < 1e-7, "{theirs:?}");
    }
}

#[test]
fn evo_reads_our_trajectories_and_we_read_its_own() {
    let lab = Lab::new(LENS);
    for frame in ["world", "world-flu", "ned", "enu"] {
        for name in ["flight.tum", "flight-euroc.csv"] {
            let notes = lab.convert(&format!("pose.csv {name} --frame {frame}"));
            assert!(notes.contains("1 of 25 instants were not measured"), "{notes}");
            lab.convert(&format!("{name} back.csv --to pose --frame {frame}"));
            let back = read_pose_table(&lab.path("back.csv")).expect("poses");
            assert!(poses_apart(&measured(&lab.poses), &back) < 1e-14);
        }
    }
    let (mut t_s, mut xyz, mut wxyz) = (Vec::new(), Vec::new(), Vec::new());
    for line in lab.read("flight-euroc.csv").lines().skip(1) {
        let n: Vec<f64> = line.split(',').map(|c| c.parse().expect("a number")).collect();
        t_s.push(n[0] * 1e-9);
        xyz.push(n[1..4].to_vec());
        wxyz.push(n[4..8].to_vec());
    }
    if check("evo", &lab, &json!({"trajectory": {"t_s": t_s, "xyz": xyz, "wxyz": wxyz}})) {
        lab.convert("theirs.tum theirs.csv --to pose --frame enu");
        let theirs = read_pose_table(&lab.path("theirs.csv")).expect("poses");
        assert!(poses_apart(&measured(&lab.poses), &theirs) < 1e-14);
    }
}

/// The true places of the four balls, none where the pose was not measured.
fn paths(lab: &Lab) -> Value {
    let vehicle = mavsight::flight::Vehicle::paper();
    let place = |p: &TimedPose, m: [f64; 3]| match p.world_from_body {
        Some(w) => (w.rotation * mavsight::geometry::Vector3::from(m) + w.translation.vector)
            .iter()
            .copied()
            .map(Some)
            .collect(),
        None => vec![None; 3],
    };
    let frame = |p: &TimedPose| {
        vehicle.marker.iter().map(|m| place(p, m.position_m)).collect::<Vec<Vec<Option<f64>>>>()
    };
    let names: Vec<&str> = vehicle.marker.iter().map(|m| m.name.as_str()).collect();
    let times_s: Vec<f64> = lab.poses.iter().map(|p| p.t_ns as f64 * 1e-9).collect();
    json!({"names": names, "rate_hz": 50.0, "times_s": times_s, "paths_m": lab.poses.iter().map(frame).collect::<Vec<_>>()})
}

#[test]
fn motion_capture_files_become_the_poses_that_made_them() {
    let lab = Lab::new(LENS);
    let expected = paths(&lab);
    // Millimetres with six decimals (five, where the TRC package writes); 32-bit floats of at most 2 m:
    // half a unit in the last place is 0.06 µm.
    for (case, name, tolerance) in [("trc", "flight.trc", 5e-8), ("c3d", "flight.c3d", 1e-6)] {
        lab.convert(&format!("pose.csv {name} --vehicle vehicle.toml"));
        let mut files = vec![name.to_owned()];
        if check(case, &lab, &expected) {
            files.push(format!("theirs.{case}"));
        }
        for file in files {
            let notes = lab.convert(&format!("{file} back-pose.csv --vehicle vehicle.toml"));
            assert!(notes.contains("24 of 25 instants give a pose from 4 markers"), "{notes}");
            let back = read_pose_table(&lab.path("back-pose.csv")).expect("poses");
            let apart = poses_apart(&lab.poses, &back);
            println!("{file}: {apart:.1e}");
            assert!(apart < tolerance, "{file}: {apart}");
        }
        lab.convert(&format!("{name} positions.csv"));
        lab.convert("positions.csv again.c3d");
    }
}

#[cfg(feature = "parquet")]
#[test]
fn pandas_reads_our_parquet_and_we_read_its_own() {
    let lab = Lab::new(LENS);
    lab.write("mixed.csv", "name,n,x,flag,note\na,1,0.1,true,\n\"b, c\",-2,,false,é\n,3,1e300,,\"q\"\"q\"\n");
    for name in ["pose", "mixed"] {
        lab.convert(&format!("{name}.csv {name}.parquet"));
        lab.convert(&format!("{name}.parquet {name}-back.csv"));
    }
    assert_eq!(lab.read("mixed-back.csv"), lab.read("mixed.csv"));
    lab.convert("pose.parquet flight.tum");
    let back = read_pose_table(&lab.path("pose-back.csv")).expect("poses");
    let own = read_pose_table(&lab.path("pose.csv")).expect("poses");
    assert!(poses_apart(&own, &back) == 0.0);
    if check("parquet", &lab, &json!({"tables": ["pose", "mixed"]})) {
        lab.convert("theirs-pose.parquet theirs.csv --to csv");
        let theirs = read_pose_table(&lab.path("theirs.csv")).expect("poses");
        assert!(poses_apart(&own, &theirs) == 0.0);
    }
}
