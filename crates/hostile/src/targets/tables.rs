//! Tables, as CSV and as Parquet.

use crate::Outcome;
use crate::files::{path, with_file, written};
use mavsight_flight::Vehicle;
use mavsight_model::Model;
use mavsight_score::read_truth;
use mavsight_session::foreign::parquet::{from_csv, to_csv};
use mavsight_session::logs::{TableTime, read_log};
use mavsight_session::tables::{read_control_pixels, read_control_points, read_inputs, read_sensors};
use mavsight_session::{
    DistanceTable, SessionError, read_body, read_flight_table, read_markers, read_motion, read_poses,
};
use std::path::Path;
use std::sync::LazyLock;

fn all(tables: &[&str]) -> Vec<Vec<u8>> {
    tables.iter().map(|table| table.as_bytes().to_vec()).collect()
}

fn names(all: &[&str]) -> Vec<String> {
    all.iter().map(|name| (*name).to_owned()).collect()
}

pub(super) fn input_tables() -> Vec<Vec<u8>> {
    all(&[
        "t_s,omega_u_rad_s,omega_l_rad_s,delta_lon_rad,delta_lat_rad\n0.00,182.1,196.2,0.0,0.0\n0.01,182.2,196.1,0.01,-0.02\n0.02,181,195,0,0\n",
        "# a comment\nt_s, current_a, note\n1690000000.000000001,2.5,\"a, b\"\n1690000000.01,2.25,c\n",
    ])
}

pub(super) fn inputs(bytes: &[u8]) -> Outcome {
    with_file("attacked-inputs.csv", bytes, |path| read_inputs(path, &Vehicle::paper())).into()
}

/// A model that has sensors.
static SENSED: LazyLock<Model> = LazyLock::new(|| {
    mavsight_model::SHELF
        .iter()
        .filter_map(|(name, _)| Model::shelf(name))
        .max_by_key(|model| model.sensors.len())
        .unwrap()
});

pub(super) fn sensor_tables() -> Vec<Vec<u8>> {
    let columns: Vec<String> = SENSED.sensors.iter().map(|s| s.column.clone()).collect();
    let row = |t_s: &str| format!("{t_s},{}\n", vec!["0.25"; columns.len()].join(","));
    vec![format!("t_s,{}\n{}{}", columns.join(","), row("0"), row("0.01")).into()]
}

pub(super) fn sensors(bytes: &[u8]) -> Outcome {
    with_file("attacked-sensors.csv", bytes, |path| read_sensors(path, &SENSED)).into()
}

pub(super) fn control_point_tables() -> Vec<Vec<u8>> {
    all(&[
        include_str!("../../../plan/example/control_points.csv"),
        "name,x_m,y_m,z_m,diameter_m,color,std_m\na,0,0,0,0.04,#db1212,0.001\nb,1,0,2e-1,0.04,#12a02e,\n",
    ])
}

pub(super) fn control_points(bytes: &[u8]) -> Outcome {
    with_file("attacked-points.csv", bytes, read_control_points).into()
}

pub(super) fn control_pixel_tables() -> Vec<Vec<u8>> {
    all(&["camera,name,u_px,v_px\ncam1,a,312.5,240.25\ncam2,a,100,200\ncam1,b,1e2,3\n"])
}

pub(super) fn control_pixels(bytes: &[u8]) -> Outcome {
    let read = |path: &Path| read_control_pixels(path, &["cam1", "cam2"], &["a", "b"]);
    with_file("attacked-pixels.csv", bytes, read).into()
}

pub(super) fn marker_tables() -> Vec<Vec<u8>> {
    all(&[
        "t_s,camera,marker,u_px,v_px,u_std_px,v_std_px\n0.0,cam1,red,312.5,240.25,0.05,0.05\n0.0333,cam2,blue,1,2,0.1,0.2\n",
    ])
}

pub(super) fn markers(bytes: &[u8]) -> Outcome {
    let (cameras, markers) = (names(&["cam1", "cam2"]), names(&["red", "green", "blue"]));
    with_file("markers.csv", bytes, |path| read_markers(path, &cameras, &markers)).into()
}

/// Columns of the covariance that is new in each frame, and whether each is a variance.
fn new_columns() -> Vec<(String, bool)> {
    let error = ["x", "y", "z", "turn_x", "turn_y", "turn_z"];
    let unit = |i: usize, j: usize| match (i < 3, j < 3) {
        (true, true) => "m2",
        (true, false) => "m_rad",
        _ => "rad2",
    };
    let upper = (0..6).flat_map(|i| (i..6).map(move |j| (i, j)));
    upper.map(|(i, j)| (format!("new_{}_{}_{}", error[i], error[j], unit(i, j)), i == j)).collect()
}

pub(super) fn pose_tables() -> Vec<Vec<u8>> {
    let header = "t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad";
    let stds = "x_std_m,y_std_m,z_std_m,phi_std_rad,theta_std_rad,psi_std_rad";
    let row = "0.1,0.2,1.5,0.01,0.02,0.3,1e-3,1e-3,1e-3,2e-3,2e-3,2e-3,red green,0.1";
    let with_stds =
        format!("{header},{stds},markers,residual_px\n0,{row}\n0.0333{}\n0.0667,{row}\n", ",".repeat(14));
    let of_others = format!("{header}\n0,1,2,3,0.1,1.5707963,-3\n0.1,1,2,3,0.1,0.2,3\n0.5,1,2,3,0,0,0\n");
    let (columns, is_variance): (Vec<String>, Vec<bool>) = new_columns().into_iter().unzip();
    let cells: Vec<&str> = is_variance.iter().map(|is| if *is { "1e-6" } else { "0" }).collect();
    let new = format!("{header},{}\n0,1,2,3,0.1,0.2,0.3,{}\n", columns.join(","), cells.join(","));
    vec![with_stds.into(), of_others.into(), new.into()]
}

pub(super) fn poses(bytes: &[u8]) -> Outcome {
    let markers = names(&["red", "green", "blue"]);
    let read = |path: &Path| {
        read_poses(path, &markers)?;
        Ok::<_, SessionError>(read_flight_table(path, &markers)?.parts(3))
    };
    with_file("pose.csv", bytes, read).into()
}

pub(super) fn motion_tables() -> Vec<Vec<u8>> {
    let columns = "t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad,u_m_s,v_m_s,w_m_s,p_rad_s,q_rad_s,r_rad_s,\
        ax_m_s2,ay_m_s2,az_m_s2,pdot_rad_s2,qdot_rad_s2,rdot_rad_s2";
    let rest = "0.1,0.2,1.5,0.01,0.02,0.3,1,2,3,0.1,0.2,0.3,0,0,-9.8,1,2,3";
    vec![format!("{columns}\n0,{rest}\n0.0333,{}\n0.0667,{rest}\n0.1,{rest}\n", ",".repeat(17)).into()]
}

pub(super) fn motion(bytes: &[u8]) -> Outcome {
    let markers = names(&["red"]);
    let read = |path: &Path| {
        read_motion(path)?;
        Ok::<_, SessionError>(read_flight_table(path, &markers)?.parts(3))
    };
    with_file("motion.csv", bytes, read).into()
}

pub(super) fn body_tables() -> Vec<Vec<u8>> {
    all(&[
        "marker,x_m,y_m,z_m,x_std_m,y_std_m,z_std_m,diameter_m,diameter_std_m\nred,0.2,0.2,0.1,1e-4,1e-4,1e-4,0.05,1e-4\ngreen,0,0,0,0,0,0,0.05,\n",
    ])
}

pub(super) fn body(bytes: &[u8]) -> Outcome {
    with_file("body.csv", bytes, read_body).into()
}

pub(super) fn distance_tables() -> Vec<Vec<u8>> {
    all(&["from,to,distance_m,std_m\na,b,1.5,0.001\na,c,2,\nb,c,1.25,0.002\na,floor,0.5,\nb,c,plumb,\n"])
}

pub(super) fn distances(bytes: &[u8]) -> Outcome {
    with_file("distances.csv", bytes, |path| DistanceTable::read(path, 1e-3)).into()
}

pub(super) fn truth_tables() -> Vec<Vec<u8>> {
    let columns = "t_s,x_m,y_m,z_m,u_m_s,v_m_s,w_m_s,phi_rad,theta_rad,psi_rad,p_rad_s,q_rad_s,r_rad_s,\
        du_m_s2,dv_m_s2,dw_m_s2,dp_rad_s2,dq_rad_s2,dr_rad_s2";
    let rest = ",0.1".repeat(18);
    vec![format!("{columns}\n0{rest}\n0.0333{rest}\n").into()]
}

pub(super) fn truth(bytes: &[u8]) -> Outcome {
    with_file("attacked-truth.csv", bytes, |path| read_truth(path, &Vehicle::paper())).into()
}

pub(super) fn log_table(bytes: &[u8]) -> Outcome {
    with_file("log.csv", bytes, |path| read_log(path, TableTime::default(), &|_, _, _| true)).into()
}

pub(super) fn parquet_tables() -> Vec<Vec<u8>> {
    let of = |table: &Vec<u8>| {
        with_file("source.csv", table, |from| written("table.parquet", |to| from_csv(from, to)))
    };
    [input_tables(), control_point_tables(), pose_tables()].concat().iter().map(of).collect()
}

pub(super) fn parquet(bytes: &[u8]) -> Outcome {
    with_file("table.parquet", bytes, |from| to_csv(from, &path("from-parquet.csv"))).into()
}
