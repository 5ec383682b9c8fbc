//! Files of other programs, both ways.

use super::convert_formats::{Kind, formats};
use super::named;
use crate::cli::{Convert, Format, Up, WrongCall};
use crate::out::outln;
use anyhow::Result;
use clap::ValueEnum;
use mavsight_flight::Vehicle;
use mavsight_geometry::Vector3;
use mavsight_identify::{EquationFile, OutputEquations};
use mavsight_pipeline::ControlPointRow;
use mavsight_pose::Rig;
use mavsight_session::foreign::dltdv_points::{self, PointOptions};
use mavsight_session::foreign::marker_paths::{self, MarkerPaths};
use mavsight_session::foreign::pixels::PixelOrigin;
use mavsight_session::foreign::poses::{
    TimedPose, Trajectory, read_pose_table, read_trajectory, write_pose_table, write_trajectory,
};
use mavsight_session::foreign::{CameraOptions, Noted, argus, c3d, dltdv, kalibr, opencv, ros, trc};
use mavsight_session::logs::{read_log_inputs, unit_by_model};
use mavsight_session::{
    RunResults, SessionError, cameras_of, load_equations, load_vehicle, read_rig, tables,
    write_control_points, write_markers, write_rig, write_vehicle, write_whole,
};
use std::path::{Path, PathBuf};

pub(crate) fn convert(args: &Convert) -> Result<()> {
    let place = |path: &Path| path.canonicalize().ok();
    match place(&args.input) {
        None => return Err(WrongCall(format!("{}: there is no such file", args.input.display())).into()),
        same if same == place(&args.output) => {
            let message =
                format!("{}: would be written over by itself: name another output", args.input.display());
            return Err(WrongCall(message).into());
        }
        Some(_) => {}
    }
    let (from, to) = formats(&args.input, &args.output, args.from, args.to, args.vehicle.is_some())?;
    if let Some(option) = args.log.given().filter(|_| from.kind() != Kind::Log) {
        let message = format!(
            "{option}: names fields of a log, and {} is read as {}: add --from log if it is one, or leave {option} out",
            args.input.display(),
            name_of(from)
        );
        return Err(WrongCall(message).into());
    }
    let call = Call { args, from, to, body: body(args)? };
    let notes = match (from.kind(), to.kind()) {
        (Kind::Log, Kind::Table) if to == Format::Csv => log_inputs(args)?,
        (_, Kind::Table) => call.table()?,
        (Kind::Poses | Kind::Paths, Kind::Poses | Kind::Paths) => call.content()?,
        (from, to) if from == to => call.content()?,
        _ => {
            return Err(WrongCall(format!(
                "{} ({}) does not turn into {} ({}): see mavsight help convert",
                args.input.display(),
                name_of(from),
                args.output.display(),
                name_of(to)
            ))
            .into());
        }
    };
    for note in notes {
        eprintln!("note: {note}");
    }
    outln!("{}", args.output.display());
    Ok(())
}

/// Writes the inputs of a log; notes of what was left out.
fn log_inputs(args: &Convert) -> Result<Vec<String>> {
    let section = args.log.section(&args.input);
    if !section.has_inputs() {
        let path = args.input.display();
        let message = format!(
            "{path}: which fields are inputs? Give --preset or --input; `mavsight log {path}` lists them"
        );
        return Err(WrongCall(message).into());
    }
    let vehicle = args.vehicle.as_deref().map(load_vehicle).transpose();
    let vehicle = named(vehicle)?;
    let unit_of = |column: &str| vehicle.as_ref().and_then(|v| unit_by_model(&v.model)(column));
    let Noted { value, notes } = named(read_log_inputs(&section, &unit_of))?;
    named(tables::write_inputs(&args.output, &value))?;
    Ok(notes)
}

fn name_of(format: Format) -> String {
    format.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

type Body = Vec<(String, Vector3<f64>)>;

fn body(args: &Convert) -> Result<Option<Body>> {
    let Some(path) = &args.vehicle else { return Ok(None) };
    let vehicle = named(load_vehicle(path))?;
    Ok(Some(vehicle.marker.into_iter().map(|m| (m.name, Vector3::from(m.position_m))).collect()))
}

const SECTIONS_NOTE: &str = "these sections belong into a flight model's file, which has what they name as inputs, states or definitions";

fn vehicle_notes() -> Vec<String> {
    let of_rotor = "the [rotor] is written as parameters of the model \"coaxial\"; for another aircraft name its model in their place";
    let of_assumption = "what was in [assumption] is in [simulation]; comments are not kept";
    [of_rotor, of_assumption].map(str::to_owned).into()
}

/// A vehicle file of schema 1.
fn earlier_vehicle(path: &Path) -> Result<Result<Box<Vehicle>, SessionError>, WrongCall> {
    match load_vehicle(path) {
        Ok(vehicle) if !vehicle.is_of_schema_1 => {
            Err(nothing_to_convert(path, "vehicle file without [rotor]"))
        }
        read => Ok(read.map(Box::new)),
    }
}

/// An equation file of schema 1.
fn earlier_equations(path: &Path) -> Result<Result<OutputEquations, SessionError>, WrongCall> {
    match load_equations(path) {
        Ok(EquationFile::Model(_)) => Err(nothing_to_convert(path, "flight model")),
        Ok(EquationFile::Outputs(equations)) => Ok(Ok(equations)),
        Err(wrong) => Ok(Err(wrong)),
    }
}

fn nothing_to_convert(path: &Path, what: &str) -> WrongCall {
    WrongCall(format!("{}: is a {what}, of schema 2 already: there is nothing to convert", path.display()))
}

/// The content of a file, in this program's conventions whatever its format.
enum Content {
    Cameras(Rig),
    Poses(Vec<TimedPose>),
    Paths(MarkerPaths),
    Pixels(Box<RunResults>),
    Control(Vec<ControlPointRow>),
    Offsets(Vec<f64>),
    Vehicle(Box<Vehicle>),
    Equations(OutputEquations),
}

type Read = Result<Noted<Content>, SessionError>;

fn noted<T>(read: Result<Noted<T>, SessionError>, content: fn(T) -> Content) -> Read {
    read.map(|Noted { value, notes }| Noted { value: content(value), notes })
}

fn plain<T>(read: Result<T, SessionError>, content: fn(T) -> Content) -> Read {
    noted(read.map(Noted::plain), content)
}

struct Call<'a> {
    args: &'a Convert,
    from: Format,
    to: Format,
    body: Option<Body>,
}

impl Call<'_> {
    /// Reads, turns poses into paths or back, and writes; the notes of all three.
    fn content(&self) -> Result<Vec<String>> {
        let Noted { value, mut notes } = self.read()?;
        let content = match (value, self.to.kind()) {
            (Content::Poses(poses), Kind::Paths) => {
                Content::Paths(marker_paths::paths_of_body(&poses, self.markers()?))
            }
            (Content::Paths(paths), Kind::Poses) => {
                let poses = marker_paths::poses_of_body(&self.args.input, &paths, self.markers()?);
                let Noted { value, notes: more } = named(poses)?;
                notes.extend(more);
                Content::Poses(value)
            }
            (content, _) => content,
        };
        notes.extend(self.write(content)?);
        Ok(notes)
    }

    fn read(&self) -> Result<Noted<Content>> {
        let Convert { input: path, cameras: names, points, size: sizes, frame: axes, std, .. } = self.args;
        let cameras = self.camera_options();
        let mut read = named(match self.from {
            Format::Pose => plain(read_pose_table(path), Content::Poses),
            Format::Tum => plain(read_trajectory(path, Trajectory::Tum, *axes), Content::Poses),
            Format::Euroc => plain(read_trajectory(path, Trajectory::Euroc, *axes), Content::Poses),
            Format::Paths => plain(marker_paths::read_table(path), Content::Paths),
            Format::Trc => plain(trc::read(path), Content::Paths),
            Format::C3d => noted(c3d::read(path), Content::Paths),
            Format::Xyzpts => plain(dltdv_points::read_xyzpts(path, self.rate_hz()?, points), Content::Paths),
            Format::Markers => plain(
                dltdv_points::read_marker_table(path, names, &self.point_names()).map(Box::new),
                Content::Pixels,
            ),
            Format::Xypts => {
                let options = PointOptions {
                    rate_hz: self.rate_hz()?,
                    origin: self.origin(),
                    sizes: sizes.clone(),
                    cameras: names.clone(),
                    points: self.point_names(),
                    std_px: *std,
                };
                plain(dltdv_points::read_xypts(path, &options).map(Box::new), Content::Pixels)
            }
            Format::Control => plain(tables::read_control_points(path), Content::Control),
            Format::Object => noted(dltdv::read_control_object(path), Content::Control),
            Format::Offsets => plain(dltdv_points::read_offsets(path, self.rate_hz()?), Content::Offsets),
            Format::Dlt => noted(dltdv::read(path, &cameras), Content::Cameras),
            Format::Argus => noted(argus::read(path, &cameras), Content::Cameras),
            Format::Opencv => noted(opencv::read(path, &cameras), Content::Cameras),
            Format::Ros => noted(ros::read(path, &cameras), Content::Cameras),
            Format::Kalibr => noted(kalibr::read(path, &cameras), Content::Cameras),
            Format::Vehicle => plain(earlier_vehicle(path)?, Content::Vehicle),
            Format::Equations => plain(earlier_equations(path)?, Content::Equations),
            Format::Rig | Format::Csv | Format::Parquet | Format::Log => {
                plain(read_rig(path), Content::Cameras)
            }
        })?;
        if let Content::Paths(paths) = &mut read.value
            && self.from != Format::Paths
            && self.args.up == Up::Y
        {
            turn(paths, |p| Vector3::new(p.x, -p.z, p.y));
        }
        Ok(read)
    }

    fn write(&self, content: Content) -> Result<Vec<String>> {
        let Convert { output: path, size: sizes, frame: axes, .. } = self.args;
        let none = |()| Vec::new();
        named(match (self.to, content) {
            (_, Content::Cameras(rig)) => return self.write_cameras(&rig),
            (Format::Tum, Content::Poses(poses)) => write_trajectory(path, Trajectory::Tum, &poses, *axes),
            (Format::Euroc, Content::Poses(poses)) => {
                write_trajectory(path, Trajectory::Euroc, &poses, *axes)
            }
            (_, Content::Poses(poses)) => write_pose_table(path, &poses).map(none),
            (to, Content::Paths(mut paths)) => {
                if to != Format::Paths && self.args.up == Up::Y {
                    turn(&mut paths, |p| Vector3::new(p.x, p.z, -p.y));
                }
                match to {
                    Format::Trc => trc::write(path, &paths).map(none),
                    Format::C3d => c3d::write(path, &paths),
                    Format::Xyzpts => dltdv_points::write_xyzpts(path, &paths),
                    _ => marker_paths::write_table(path, &paths).map(none),
                }
            }
            (Format::Xypts, Content::Pixels(tracks)) => {
                dltdv_points::write_xypts(path, &tracks, self.origin(), sizes)
            }
            (_, Content::Pixels(tracks)) => write_markers(path, &tracks).map(|()| {
                let (origin, std) = (self.origin().name(), self.args.std);
                vec![format!("pixels are taken as those of --origin {origin}, good to {std} px (--std)")]
            }),
            (Format::Object, Content::Control(points)) => dltdv::write_control_object(path, &points),
            (_, Content::Control(points)) => write_control_points(path, &points).map(none),
            (_, Content::Offsets(offsets)) => {
                let name = |k| self.args.cameras.get(k).cloned().unwrap_or_else(|| format!("cam{}", k + 1));
                let line = |(k, s)| format!("[[camera]]\nname = {:?}\ntime_offset_s = {s:?}\n", name(k));
                let lines: String = offsets.iter().enumerate().map(line).collect();
                let note = |()| vec!["these lines belong into the cameras of session.toml".to_owned()];
                write_whole(path, lines.as_bytes()).map(note)
            }
            (_, Content::Vehicle(vehicle)) => write_vehicle(path, &vehicle).map(|()| vehicle_notes()),
            (_, Content::Equations(equations)) => {
                let note = |()| vec![SECTIONS_NOTE.to_owned()];
                write_whole(path, equations.sections().as_bytes()).map(note)
            }
        })
    }

    /// Writes one file, or one a camera where the name asks for it.
    fn write_cameras(&self, rig: &Rig) -> Result<Vec<String>> {
        let out = self.args.output.to_string_lossy();
        if !out.contains("{camera}") {
            return self.write_rig(&self.args.output, rig, self.args.camera.as_deref());
        }
        let mut notes = Vec::new();
        for camera in &rig.cameras {
            let path = PathBuf::from(out.replace("{camera}", &camera.name));
            notes.extend(self.write_rig(&path, rig, Some(&camera.name))?);
        }
        Ok(notes)
    }

    fn write_rig(&self, path: &Path, rig: &Rig, camera: Option<&str>) -> Result<Vec<String>> {
        let chosen = camera.map(|name| named(cameras_of(rig, &[name], &self.args.input))).transpose()?;
        let rig = chosen.as_ref().unwrap_or(rig);
        let options = self.camera_options();
        named(match self.to {
            Format::Dlt => dltdv::write(path, rig, &options),
            Format::Argus => argus::write(path, rig, &options),
            Format::Opencv => opencv::write(path, rig, &options),
            Format::Ros => ros::write(path, rig, &options),
            Format::Kalibr => kalibr::write(path, rig, &options),
            _ => write_rig(path, rig).map(|()| Vec::new()),
        })
    }

    fn camera_options(&self) -> CameraOptions {
        let Convert { cameras: names, size: sizes, origin, drop_skew, .. } = self.args;
        CameraOptions { names: names.clone(), sizes: sizes.clone(), origin: *origin, drop_skew: *drop_skew }
    }

    fn origin(&self) -> PixelOrigin {
        self.args.origin.unwrap_or(PixelOrigin::Dltdv8)
    }

    fn markers(&self) -> Result<&Body, WrongCall> {
        let missing = "poses and marker paths turn into each other by the vehicle's markers: give --vehicle vehicle.toml";
        self.body.as_ref().ok_or_else(|| WrongCall(missing.into()))
    }

    fn rate_hz(&self) -> Result<f64, WrongCall> {
        let missing = "DLTdv's tables have no times: give the frames a second, --rate 30";
        self.args.rate.ok_or_else(|| WrongCall(missing.into()))
    }

    fn point_names(&self) -> Vec<String> {
        match &self.body {
            Some(body) if self.args.points.is_empty() => body.iter().map(|(n, _)| n.clone()).collect(),
            _ => self.args.points.clone(),
        }
    }

    #[cfg(feature = "parquet")]
    fn table(&self) -> Result<Vec<String>> {
        use mavsight_session::foreign::parquet;
        let (input, output) = (&self.args.input, &self.args.output);
        named(match (self.from, self.to) {
            (Format::Parquet, Format::Csv) => parquet::to_csv(input, output),
            _ => parquet::from_csv(input, output),
        })?;
        Ok(Vec::new())
    }

    #[cfg(not(feature = "parquet"))]
    fn table(&self) -> Result<Vec<String>> {
        Err(WrongCall("this build has no Parquet: build with --features parquet".into()).into())
    }
}

fn turn(paths: &mut MarkerPaths, by: impl Fn(Vector3<f64>) -> Vector3<f64>) {
    paths.points_m.iter_mut().flatten().flatten().for_each(|p| *p = by(*p));
}
