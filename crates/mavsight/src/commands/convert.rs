//! Files of other programs, both ways.

use super::convert_formats::{Kind, formats};
use super::named;
use crate::cli::{Convert, Format, Frame, Origin, Up, WrongCall};
use crate::out::outln;
use anyhow::Result;
use clap::ValueEnum;
use mavsight_geometry::{ImageSize, Vector3};
use mavsight_pose::Rig;
use mavsight_session::foreign::dltdv;
use mavsight_session::foreign::dltdv_points::{self, PointOptions};
use mavsight_session::foreign::frames::AxesOf;
use mavsight_session::foreign::marker_paths::{self, MarkerPaths};
use mavsight_session::foreign::pixels::PixelOrigin;
use mavsight_session::foreign::poses::{
    TimedPose, Trajectory, read_pose_table, read_trajectory, write_pose_table, write_trajectory,
};
use mavsight_session::foreign::{CameraFormat, CameraOptions, Noted, c3d, read_cameras, trc, write_cameras};
use mavsight_session::{
    RunResults, cameras_of, load_vehicle, read_rig, tables, write_control_points, write_markers, write_rig,
};
use std::path::{Path, PathBuf};

/// `mavsight convert`
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
    let call = Call { args, from, to, body: body(args)? };
    let notes = match (from.kind(), to.kind()) {
        (Kind::Cameras, Kind::Cameras) => call.cameras()?,
        (Kind::Poses | Kind::Paths, Kind::Poses | Kind::Paths) => call.trajectory()?,
        (Kind::Pixels, Kind::Pixels) => call.pixels()?,
        (Kind::Control, Kind::Control) => call.control()?,
        (Kind::Offsets, Kind::Offsets) => call.offsets()?,
        (_, Kind::Table) => call.table()?,
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

/// A format as the options call it.
fn name_of(format: Format) -> String {
    format.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

/// A format of other programs for cameras.
fn camera_format(format: Format) -> Option<CameraFormat> {
    Some(match format {
        Format::Dlt => CameraFormat::Dlt,
        Format::Argus => CameraFormat::Argus,
        Format::Opencv => CameraFormat::Opencv,
        Format::Ros => CameraFormat::Ros,
        Format::Kalibr => CameraFormat::Kalibr,
        _ => return None,
    })
}

/// A format of other programs for poses.
fn trajectory(format: Format) -> Option<Trajectory> {
    match format {
        Format::Tum => Some(Trajectory::Tum),
        Format::Euroc => Some(Trajectory::Euroc),
        _ => None,
    }
}

/// Markers by name, in body axes.
type Body = Vec<(String, Vector3<f64>)>;

/// The vehicle's markers, where a vehicle is given.
fn body(args: &Convert) -> Result<Option<Body>> {
    let Some(path) = &args.vehicle else { return Ok(None) };
    let vehicle = named(load_vehicle(path))?;
    Ok(Some(vehicle.marker.into_iter().map(|m| (m.name, Vector3::from(m.position_m))).collect()))
}

struct Call<'a> {
    args: &'a Convert,
    from: Format,
    to: Format,
    body: Option<Body>,
}

impl Call<'_> {
    fn sizes(&self) -> Vec<ImageSize> {
        self.args.size.iter().map(|s| s.0).collect()
    }

    fn origin(&self) -> Option<PixelOrigin> {
        self.args.origin.map(|o| match o {
            Origin::Zero => PixelOrigin::TopLeftZero,
            Origin::Dltdv8 => PixelOrigin::Dltdv8,
            Origin::Dltdv5 => PixelOrigin::Dltdv5,
            Origin::Argus => PixelOrigin::Argus,
        })
    }

    fn axes(&self) -> AxesOf {
        match self.args.frame {
            Frame::World => AxesOf::World,
            Frame::WorldFlu => AxesOf::WorldFlu,
            Frame::Ned => AxesOf::Ned,
            Frame::Enu => AxesOf::Enu,
        }
    }

    fn camera_options(&self) -> CameraOptions {
        CameraOptions {
            names: self.args.cameras.clone(),
            sizes: self.sizes(),
            origin: self.origin(),
            drop_skew: self.args.drop_skew,
        }
    }

    fn cameras(&self) -> Result<Vec<String>> {
        let path = &self.args.input;
        let read = named(match camera_format(self.from) {
            Some(format) => read_cameras(path, format, &self.camera_options()),
            None => read_rig(path).map(Noted::plain),
        })?;
        let mut notes = read.notes;
        for (path, camera) in self.outputs(&read.value) {
            let rig = self.chosen(&read.value, camera.as_deref())?;
            notes.extend(named(match camera_format(self.to) {
                Some(format) => write_cameras(&path, format, &rig, &self.camera_options()),
                None => write_rig(&path, &rig).map(|()| Vec::new()),
            })?);
        }
        Ok(notes)
    }

    /// The file, or one a camera where the name asks for it.
    fn outputs(&self, rig: &Rig) -> Vec<(PathBuf, Option<String>)> {
        let out = self.args.output.to_string_lossy();
        if out.contains("{camera}") {
            let one = |name: &String| (PathBuf::from(out.replace("{camera}", name)), Some(name.clone()));
            rig.cameras.iter().map(|c| one(&c.name)).collect()
        } else {
            vec![(self.args.output.clone(), self.args.camera.clone())]
        }
    }

    fn chosen(&self, rig: &Rig, camera: Option<&str>) -> Result<Rig> {
        let Some(name) = camera else { return Ok(rig.clone()) };
        named(cameras_of(rig, &[name], &self.args.input))
    }

    fn trajectory(&self) -> Result<Vec<String>> {
        let mut notes = Vec::new();
        if self.from.kind() == Kind::Poses {
            let poses = self.read_poses()?;
            if self.to.kind() == Kind::Poses {
                return self.write_poses(&poses);
            }
            let body = self.body.as_ref().ok_or_else(|| self.needs_vehicle())?;
            return self.write_paths(marker_paths::paths_of_body(&poses, body));
        }
        let paths = self.read_paths(&mut notes)?;
        if self.to.kind() == Kind::Paths {
            notes.extend(self.write_paths(paths)?);
            return Ok(notes);
        }
        let body = self.body.as_ref().ok_or_else(|| self.needs_vehicle())?;
        let poses = named(marker_paths::poses_of_body(&self.args.input, &paths, body))?;
        notes.extend(poses.notes);
        notes.extend(self.write_poses(&poses.value)?);
        Ok(notes)
    }

    fn needs_vehicle(&self) -> WrongCall {
        WrongCall("poses and marker paths turn into each other by the vehicle's markers: give --vehicle vehicle.toml".into())
    }

    fn read_poses(&self) -> Result<Vec<TimedPose>> {
        let path = &self.args.input;
        named(match trajectory(self.from) {
            Some(format) => read_trajectory(path, format, self.axes()),
            None => read_pose_table(path),
        })
    }

    fn write_poses(&self, poses: &[TimedPose]) -> Result<Vec<String>> {
        let path = &self.args.output;
        named(match trajectory(self.to) {
            Some(format) => write_trajectory(path, format, poses, self.axes()),
            None => write_pose_table(path, poses).map(|()| Vec::new()),
        })
    }

    fn rate_hz(&self) -> Result<f64> {
        let missing =
            || WrongCall("DLTdv's tables have no times: give the frames a second, --rate 30".into());
        Ok(self.args.rate.ok_or_else(missing)?)
    }

    fn read_paths(&self, notes: &mut Vec<String>) -> Result<MarkerPaths> {
        let path = &self.args.input;
        let mut paths = match self.from {
            Format::Trc => named(trc::read(path))?,
            Format::C3d => {
                let read = named(c3d::read(path))?;
                notes.extend(read.notes);
                read.value
            }
            Format::Xyzpts => named(dltdv_points::read_xyzpts(path, self.rate_hz()?, &self.args.points))?,
            _ => named(marker_paths::read_table(path))?,
        };
        if self.from != Format::Paths && self.args.up == Up::Y {
            turn(&mut paths, |p| Vector3::new(p.x, -p.z, p.y));
        }
        Ok(paths)
    }

    fn write_paths(&self, mut paths: MarkerPaths) -> Result<Vec<String>> {
        let path = &self.args.output;
        if self.to != Format::Paths && self.args.up == Up::Y {
            turn(&mut paths, |p| Vector3::new(p.x, p.z, -p.y));
        }
        named(match self.to {
            Format::Trc => trc::write(path, &paths).map(|()| Vec::new()),
            Format::C3d => c3d::write(path, &paths),
            Format::Xyzpts => dltdv_points::write_xyzpts(path, &paths),
            _ => marker_paths::write_table(path, &paths).map(|()| Vec::new()),
        })
    }

    /// Names of the points: those given, else the vehicle's markers.
    fn point_names(&self) -> Vec<String> {
        match &self.body {
            Some(body) if self.args.points.is_empty() => body.iter().map(|(n, _)| n.clone()).collect(),
            _ => self.args.points.clone(),
        }
    }

    fn pixels(&self) -> Result<Vec<String>> {
        let (path, origin) = (&self.args.input, self.origin().unwrap_or(PixelOrigin::Dltdv8));
        let (cameras, points) = (self.args.cameras.clone(), self.point_names());
        let tracks: RunResults = if self.from == Format::Xypts {
            let (rate_hz, sizes, std_px) = (self.rate_hz()?, self.sizes(), self.args.std);
            let options = PointOptions { rate_hz, origin, sizes, cameras, points, std_px };
            named(dltdv_points::read_xypts(path, &options))?
        } else {
            named(dltdv_points::read_marker_table(path, &cameras, &points))?
        };
        if self.to == Format::Xypts {
            return named(dltdv_points::write_xypts(&self.args.output, &tracks, origin, &self.sizes()));
        }
        named(write_markers(&self.args.output, &tracks))?;
        Ok(vec![format!(
            "pixels are taken as those of --origin {}, good to {} px (--std)",
            origin.name(),
            self.args.std
        )])
    }

    fn control(&self) -> Result<Vec<String>> {
        let read = match self.from {
            Format::Object => named(dltdv::read_control_object(&self.args.input))?,
            _ => Noted::plain(named(tables::read_control_points(&self.args.input))?),
        };
        let mut notes = read.notes;
        match self.to {
            Format::Object => {
                notes.extend(named(dltdv::write_control_object(&self.args.output, &read.value))?)
            }
            _ => named(write_control_points(&self.args.output, &read.value))?,
        }
        Ok(notes)
    }

    fn offsets(&self) -> Result<Vec<String>> {
        let offsets = named(dltdv_points::read_offsets(&self.args.input, self.rate_hz()?))?;
        let name = |k: usize| self.args.cameras.get(k).cloned().unwrap_or_else(|| format!("cam{}", k + 1));
        let lines: String = offsets
            .iter()
            .enumerate()
            .map(|(k, s)| format!("[[camera]]\nname = {:?}\ntime_offset_s = {s:?}\n", name(k)))
            .collect();
        named(mavsight_session::write_whole(&self.args.output, lines.as_bytes()))?;
        Ok(vec!["these lines belong into the cameras of session.toml".into()])
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
