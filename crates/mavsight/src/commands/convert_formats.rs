//! Which format a file has, by its name and by its first lines.

use crate::cli::{Format, WrongCall};
use mavsight_log::Log;
use std::io::Read;
use std::path::Path;

/// What a file may be about; formats of one kind turn into each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Cameras,
    Poses,
    Paths,
    Pixels,
    Control,
    Offsets,
    Table,
    /// Vehicle files of schema 1.
    Vehicle,
    /// Equation files of schema 1.
    Equations,
    /// Logs of aircraft.
    Log,
}

impl Kind {
    /// This program's own format; with a vehicle, marker paths become poses.
    fn own(self, has_vehicle: bool) -> Option<Format> {
        match self {
            Self::Cameras => Some(Format::Rig),
            Self::Poses => Some(Format::Pose),
            Self::Paths if has_vehicle => Some(Format::Pose),
            Self::Paths => Some(Format::Paths),
            Self::Pixels => Some(Format::Markers),
            Self::Control => Some(Format::Control),
            Self::Offsets | Self::Table | Self::Vehicle | Self::Equations | Self::Log => None,
        }
    }
}

impl Format {
    pub(super) fn kind(self) -> Kind {
        match self {
            Self::Rig | Self::Dlt | Self::Argus | Self::Opencv | Self::Ros | Self::Kalibr => Kind::Cameras,
            Self::Pose | Self::Tum | Self::Euroc => Kind::Poses,
            Self::Paths | Self::Trc | Self::C3d | Self::Xyzpts => Kind::Paths,
            Self::Markers | Self::Xypts => Kind::Pixels,
            Self::Control | Self::Object => Kind::Control,
            Self::Offsets => Kind::Offsets,
            Self::Csv | Self::Parquet => Kind::Table,
            Self::Vehicle => Kind::Vehicle,
            Self::Equations => Kind::Equations,
            Self::Log => Kind::Log,
        }
    }

    fn by_name(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_lowercase();
        let has = |part: &str| name.contains(part);
        let extension = name.rsplit_once('.').map_or("", |(_, e)| e);
        Some(match extension {
            "toml" => Self::Rig,
            "trc" => Self::Trc,
            "c3d" => Self::C3d,
            "parquet" => Self::Parquet,
            "ulg" => Self::Log,
            "tum" => Self::Tum,
            "csv" | "tsv" if has("xyzpts") => Self::Xyzpts,
            "csv" | "tsv" if has("xypts") => Self::Xypts,
            "csv" | "tsv" if has("offsets") => Self::Offsets,
            "csv" if has("dltcoefs") || has("dlt-coefficients") => Self::Dlt,
            "csv" if has("euroc") => Self::Euroc,
            "csv" if has("control_points") => Self::Control,
            "csv" if has("object") => Self::Object,
            "csv" if has("positions") => Self::Paths,
            "csv" if has("markers") => Self::Markers,
            "csv" if has("pose") || has("motion") => Self::Pose,
            "txt" if has("profile") => Self::Argus,
            "txt" if has("tum") => Self::Tum,
            "yaml" | "yml" if has("camchain") => Self::Kalibr,
            "yaml" | "yml" if has("camera_info") => Self::Ros,
            "yaml" | "yml" if has("opencv") => Self::Opencv,
            "yml" => Self::Opencv,
            _ => return None,
        })
    }

    /// What the first lines say; it stands above the name, which people choose.
    fn by_content(path: &Path) -> Option<Self> {
        let mut head = Vec::new();
        std::fs::File::open(path).ok()?.take(4096).read_to_end(&mut head).ok()?;
        if Log::is_one(&head) {
            return Some(Self::Log);
        }
        let head = String::from_utf8_lossy(&head);
        let has = |part: &str| head.contains(part);
        let first = head.lines().next().unwrap_or("");
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match extension.as_str() {
            "toml" if has("mass_kg") && has("inertia_kg_m2") => Some(Self::Vehicle),
            "toml" if has("measured") && has("regressors") => Some(Self::Equations),
            "yaml" | "yml" if has("opencv-matrix") => Some(Self::Opencv),
            "yaml" | "yml" if has("camera_model") && has("cam0") => Some(Self::Kalibr),
            "yaml" | "yml" if has("distortion_model") && has("camera_matrix") => Some(Self::Ros),
            "csv" if first.starts_with("#timestamp") => Some(Self::Euroc),
            "csv" if first.starts_with("t_s,") && first.contains("phi_rad") => Some(Self::Pose),
            "csv" if first.starts_with("t_s,marker,x_m") => Some(Self::Paths),
            "csv" if first.starts_with("t_s,camera,marker") => Some(Self::Markers),
            "csv" if first.starts_with("name,x_m,y_m,z_m") => Some(Self::Control),
            _ => None,
        }
    }
}

/// The formats of both files: what is given, else what content and names say; OUT by the kind of IN where
/// it ends in `.csv`.
pub(super) fn formats(
    input: &Path,
    output: &Path,
    from: Option<Format>,
    to: Option<Format>,
    has_vehicle: bool,
) -> Result<(Format, Format), WrongCall> {
    let unknown = |path: &Path, flag: &str| {
        WrongCall(format!(
            "{}: its format cannot be determined: give {flag} (see mavsight help convert)",
            path.display()
        ))
    };
    let ends_in =
        |path: &Path, extension: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
    let is_log = || Format::by_content(input).or_else(|| Format::by_name(input)) == Some(Format::Log);
    if from == Some(Format::Log) || (from.is_none() && is_log()) {
        return Ok((
            Format::Log,
            to.or_else(|| ends_in(output, "csv").then_some(Format::Csv))
                .ok_or_else(|| unknown(output, "--to"))?,
        ));
    }
    // A table of any kind goes to and from Parquet as it is.
    if to == Some(Format::Parquet) || (to.is_none() && ends_in(output, "parquet")) {
        return Ok((from.unwrap_or(Format::Csv), Format::Parquet));
    }
    let of_output = to.or_else(|| Format::by_name(output));
    if from == Some(Format::Parquet) || (from.is_none() && ends_in(input, "parquet")) {
        let plain = of_output.is_none_or(|f| ends_in(output, "csv") && f != Format::Euroc && to.is_none());
        if plain || of_output == Some(Format::Csv) {
            return Ok((Format::Parquet, Format::Csv));
        }
        // Our own tables are read from Parquet too.
        let from =
            of_output.map(Format::kind).filter(|kind| *kind != Kind::Cameras && *kind != Kind::Control);
        let from = from.and_then(|kind| kind.own(has_vehicle)).ok_or_else(|| unknown(input, "--from"))?;
        return Ok((from, of_output.ok_or_else(|| unknown(output, "--to"))?));
    }
    let from = from
        .or_else(|| Format::by_content(input))
        .or_else(|| Format::by_name(input))
        .ok_or_else(|| unknown(input, "--from"))?;
    let has_own_name = ends_in(output, "csv") || from.kind() == Kind::Cameras && ends_in(output, "toml");
    let to = of_output.or_else(|| from.kind().own(has_vehicle).filter(|_| has_own_name));
    let to = match (from.kind(), to) {
        (Kind::Offsets, None | Some(Format::Rig)) => Format::Offsets,
        (Kind::Vehicle, Some(Format::Rig)) => Format::Vehicle,
        (Kind::Equations, Some(Format::Rig)) => Format::Equations,
        (_, Some(to)) => to,
        (_, None) => return Err(unknown(output, "--to")),
    };
    Ok((from, to))
}
