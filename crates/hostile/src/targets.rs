//! The list of targets.

mod estimators;
pub(crate) mod film;
mod fits;
mod foreign;
mod logs;
mod packets;
mod tables;
mod texts;

use crate::Kind::{Film, Format, Numbers, Packet, Table, Text};
use crate::{Target, files::example};

/// Every target.
pub const TARGETS: &[Target] = &[
    Target::new("session", Text, || vec![example("session.toml"), texts::small_session()], texts::session),
    Target::new("vehicle", Text, || vec![example("vehicle.toml"), texts::old_vehicle()], texts::vehicle),
    Target::new("model", Text, texts::models, texts::model),
    Target::new("equations", Text, || vec![example("model.toml")], texts::equations),
    Target::new("scenario", Text, || vec![example("scenario.toml")], texts::scenario),
    Target::new("staging", Text, || vec![example("staging.toml")], texts::staging),
    Target::new("room", Text, || vec![example("room.toml"), texts::room_file()], texts::room),
    Target::new("campaign", Text, || vec![example("campaign.toml")], texts::campaign),
    Target::new("rig", Text, || vec![example("rig.toml")], texts::rig),
    Target::new("summary", Text, texts::summaries, texts::summary),
    Target::new("inputs", Table, tables::input_tables, tables::inputs),
    Target::new("sensors", Table, tables::sensor_tables, tables::sensors),
    Target::new("control-points", Table, tables::control_point_tables, tables::control_points),
    Target::new("control-pixels", Table, tables::control_pixel_tables, tables::control_pixels),
    Target::new("markers", Table, tables::marker_tables, tables::markers),
    Target::new("poses", Table, tables::pose_tables, tables::poses),
    Target::new("motion", Table, tables::motion_tables, tables::motion),
    Target::new("body", Table, tables::body_tables, tables::body),
    Target::new("distances", Table, tables::distance_tables, tables::distances),
    Target::new("truth", Table, tables::truth_tables, tables::truth),
    Target::new("log-table", Table, tables::input_tables, tables::log_table),
    Target::new("parquet", Format, tables::parquet_tables, tables::parquet),
    Target::new("ulog", Format, || vec![logs::small_logs::ulog::small()], logs::log),
    Target::new("dataflash", Format, || vec![logs::small_logs::dataflash::small()], logs::log),
    Target::new("crazyflie", Format, || vec![logs::small_logs::crazyflie::small()], logs::log)
        .repaired_by(logs::repair_crazyflie),
    Target::new("argus", Table, foreign::argus_files, foreign::argus_cameras),
    Target::new("dltdv", Table, foreign::dltdv_files, foreign::dltdv_cameras),
    Target::new("kalibr", Text, foreign::kalibr_files, foreign::kalibr_cameras),
    Target::new("opencv", Text, foreign::opencv_files, foreign::opencv_cameras),
    Target::new("ros", Text, foreign::ros_files, foreign::ros_cameras),
    Target::new("dltdv-points", Table, foreign::point_files, foreign::points),
    Target::new("dltdv-sparse", Table, foreign::sparse_files, foreign::sparse_points),
    Target::new("dltdv-object", Table, foreign::control_objects, foreign::control_object),
    Target::new("c3d", Format, foreign::c3d_files, foreign::c3d_paths),
    Target::new("trc", Table, foreign::trc_files, foreign::trc_paths),
    Target::new("positions", Table, foreign::position_tables, foreign::positions),
    Target::new("tum", Table, foreign::tum_files, foreign::tum),
    Target::new("euroc", Table, foreign::euroc_files, foreign::euroc),
    Target::new("pose-table", Table, tables::pose_tables, foreign::pose_table),
    Target::new("mp4", Film, film::films, film::mp4),
    Target::new("y4m", Format, film::y4m_films, film::y4m),
    Target::new("png", Format, film::png_images, film::image).repaired_by(film::repair_png),
    Target::new("jpeg", Format, film::jpeg_images, film::image),
    Target::new("natnet", Packet, packets::natnet_packets, packets::natnet),
    Target::new("vrpn", Packet, packets::vrpn_packets, packets::vrpn),
    Target::new("mavlink", Packet, packets::mavlink_packets, packets::mavlink)
        .repaired_by(packets::repair_mavlink),
    Target::new("page", Packet, packets::page_requests, packets::page),
    Target::new("triangulation", Numbers, Vec::new, estimators::triangulation),
    Target::new("pose", Numbers, Vec::new, estimators::pose_of_markers),
    Target::new("bundle-adjustment", Numbers, Vec::new, estimators::bundle),
    Target::new("smoother", Numbers, Vec::new, estimators::smoother),
    Target::new("causal-filter", Numbers, Vec::new, estimators::causal_filter),
    Target::new("equation-error", Numbers, Vec::new, fits::equation_error),
];
