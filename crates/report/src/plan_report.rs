//! The report of a plan: drawing, map, tables.

use crate::drawing::{BoxRole, DrawnBox, DrawnCamera, RoomDrawing, draw_room};
use crate::heatmap::{HeatMap, draw_heat_maps};
use crate::{Figure, Report, ReportError, Table, render};
use mavsight_geometry::{Camera, Vector2};
use mavsight_plan::{Placed, Planner, Ranked, Solid, StudyRow};
use mavsight_pose::{MapPlane, Volume};
use mavsight_session::write_whole;
use rayon::prelude::*;
use std::path::Path;

const MAP_CELLS: usize = 20;

/// The result of a search for camera places.
pub struct CameraPlan<'a> {
    /// The room and its cameras.
    pub planner: &'a Planner,
    /// Placements, best first; at least one.
    pub ranked: &'a [Ranked],
    /// Predicted errors of two cameras against their angle, and against their distance; empty where not asked
    /// for.
    pub study: [Vec<StudyRow>; 2],
}

/// Angle between the optical axes of the first two cameras.
pub fn angle_deg(ranked: &Ranked) -> f64 {
    let axis = |k: usize| ranked.placed[k].aim_m - ranked.placed[k].centre_m;
    axis(0).angle(&axis(1)).to_degrees()
}

/// The row of least error among those that meet all limits.
pub fn least(rows: &[StudyRow]) -> Option<&StudyRow> {
    let feasible = rows.iter().filter(|r| r.prediction.is_feasible());
    feasible.min_by(|a, b| a.prediction.figure.total_cmp(&b.prediction.figure))
}

/// Writes `plan.html`: placements, a drawing of the room, maps of the predicted error, and the study.
///
/// # Errors
/// A plot that cannot be drawn, a placement that gives no rig, or what the file system refuses.
pub fn write_plan_report(plan: &CameraPlan<'_>, out: &Path) -> Result<(), ReportError> {
    let (planner, best) = (plan.planner, &plan.ranked[0]);
    let drawing = draw_room(&drawing(planner, best))?;
    let prediction = &best.prediction;
    let mut report = Report {
        title: format!("mavsight plan: {}", planner.room().name),
        lead: vec![format!(
            "{} cameras; standard deviations of the body's pose are predicted, over all three axes together, \
             with calibration, markers and centres as the room file says.",
            best.placed.len()
        )],
        headline: vec![
            ("Position, mean".into(), format!("{:.2} mm", prediction.mean.position_std_mm)),
            ("Position, worst".into(), format!("{:.2} mm", prediction.worst.position_std_mm)),
            ("Attitude, mean".into(), format!("{:.3}°", prediction.mean.attitude_std_deg)),
            ("Smallest marker".into(), format!("{:.1} px", prediction.least_diameter_px)),
        ],
        ..Report::default()
    };
    let room = Figure::new("The best placement. Lines bound what a camera sees.", drawing);
    report.add("Where the cameras go", vec![placements(plan)], vec![room]);
    report.add("Millimetres through the volume", vec![], vec![maps(planner, best)?]);
    if let [angles, distances] = &plan.study
        && !angles.is_empty()
    {
        let tables = vec![
            study("Error against the angle between two cameras", angles),
            study("Error against distance, at a right angle", distances),
        ];
        report.add("Two cameras", tables, vec![]);
    }
    Ok(write_whole(&out.join("plan.html"), render(&report)?.as_bytes())?)
}

fn placements(plan: &CameraPlan<'_>) -> Table {
    let header = [
        "Rank",
        "Cameras at X, Y, Z (m)",
        "Angle of the first two (°)",
        "Position, mean (mm)",
        "worst (mm)",
        "new in each frame (mm)",
        "Attitude, mean (°)",
        "Smallest marker (px)",
    ];
    let rows = plan.ranked.iter().enumerate().map(|(k, r)| {
        let place = |c: &Placed| format!("{:.2}, {:.2}, {:.2}", c.centre_m.x, c.centre_m.y, c.centre_m.z);
        let p = &r.prediction;
        vec![
            (k + 1).to_string(),
            r.placed.iter().map(place).collect::<Vec<_>>().join("; "),
            format!("{:.1}", angle_deg(r)),
            format!("{:.3}", p.mean.position_std_mm),
            format!("{:.3}", p.worst.position_std_mm),
            format!("{:.3}", p.mean.new_position_std_mm),
            format!("{:.4}", p.mean.attitude_std_deg),
            format!("{:.1}", p.least_diameter_px),
        ]
    });
    Table::new("Placements, best first", header, rows.collect())
}

fn study(caption: &str, rows: &[StudyRow]) -> Table {
    let header = [
        "Angle (°)",
        "Distance (m)",
        "Position, mean (mm)",
        "worst (mm)",
        "Attitude, mean (°)",
        "Seen (%)",
        "",
    ];
    let best = least(rows);
    let cells = rows.iter().map(|r| {
        let p = &r.prediction;
        let note = match (best == Some(r), &p.refused, p.limit) {
            (true, _, _) => "least",
            (_, Some(_), _) => "cannot be calibrated",
            (_, None, Some(limit)) => limit.text(),
            _ => "",
        };
        let unless_refused = |text: String| if p.refused.is_some() { String::new() } else { text };
        vec![
            format!("{:.0}", r.pair.angle_deg),
            format!("{:.2}", r.pair.distance_m),
            unless_refused(format!("{:.3}", p.mean.position_std_mm)),
            unless_refused(format!("{:.3}", p.worst.position_std_mm)),
            unless_refused(format!("{:.4}", p.mean.attitude_std_deg)),
            format!("{:.0}", 100.0 * p.share_seen),
            note.to_owned(),
        ]
    });
    Table::new(caption, header, cells.collect())
}

/// Predicted position over the horizontal and the upright plane through the middle of the volume.
fn maps(planner: &Planner, best: &Ranked) -> Result<Figure, ReportError> {
    let rig = planner.rig(&best.placed)?;
    let section = &planner.room().volume;
    let volume = Volume { low_m: section.low_m.into(), high_m: section.high_m.into() };
    let values = |plane: MapPlane| {
        let middle = |k: usize| (k as f64 + 0.5) / MAP_CELLS as f64;
        let value = |cell: usize| {
            let place = plane.corner_in_world_m
                + plane.first_side_m * middle(cell % MAP_CELLS)
                + plane.second_side_m * middle(cell / MAP_CELLS);
            planner.position_std_mm(&best.placed, &rig, &place)
        };
        (0..MAP_CELLS * MAP_CELLS).into_par_iter().map(value).collect()
    };
    let maps = HeatMap::through(&volume, MAP_CELLS, values);
    let caption = "Predicted standard deviation of the body's position, mean over the headings; crossed where some marker is not seen by two cameras.";
    Ok(Figure::new(caption, draw_heat_maps(&maps, "mm")?))
}

fn drawing(planner: &Planner, best: &Ranked) -> RoomDrawing {
    let room = planner.room();
    let drawn = |role, solid: &Solid| DrawnBox { role, low_m: solid.low_m, high_m: solid.high_m };
    let mut boxes = vec![drawn(BoxRole::Room, &room.room)];
    boxes.extend(room.stand.iter().map(|s| drawn(BoxRole::Stand, s)));
    boxes.extend(room.keep_out.iter().map(|s| drawn(BoxRole::KeepOut, s)));
    boxes.extend(room.block.iter().map(|s| drawn(BoxRole::Block, s)));
    let (low_m, high_m) = (room.volume.low_m, room.volume.high_m);
    boxes.push(DrawnBox { role: BoxRole::Volume, low_m, high_m });
    let cameras = best.placed.iter().enumerate().map(|(k, p)| {
        let camera = planner.camera(p);
        let (width, height) = (f64::from(camera.size.width_px), f64::from(camera.size.height_px));
        let (middle_u, middle_v) = ((width - 1.0) / 2.0, (height - 1.0) / 2.0);
        let end = |u, v| far_end(&camera, Vector2::new(u, v), &room.room);
        DrawnCamera {
            name: planner.name(k),
            centre_m: p.centre_m.into(),
            across_m: [end(0.0, middle_v), end(width - 1.0, middle_v)],
            upright_m: [end(middle_u, 0.0), end(middle_u, height - 1.0)],
        }
    });
    RoomDrawing {
        cameras: cameras.collect(),
        points_m: planner.control().iter().map(|c| c.position_m).collect(),
        boxes,
    }
}

/// Where the ray of a pixel leaves the room; the camera itself where it has no ray.
fn far_end(camera: &Camera, pixel: Vector2<f64>, room: &Solid) -> [f64; 3] {
    let centre = camera.centre_in_world();
    let Ok(ray) = camera.ray(&pixel) else { return centre.into() };
    let to_wall = |k: usize| {
        let wall = if ray[k] > 0.0 { room.high_m[k] } else { room.low_m[k] };
        if ray[k].abs() < 1e-12 { f64::INFINITY } else { (wall - centre[k]) / ray[k] }
    };
    let length = (0..3).map(to_wall).fold(f64::INFINITY, f64::min).max(0.0);
    (centre + ray * if length.is_finite() { length } else { 0.0 }).into()
}
