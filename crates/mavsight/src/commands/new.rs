//! `new`: a session from videos and answers.

mod ask;
mod files;
mod read;

use super::{named, require_folder};
use crate::cli::{New, WrongCall};
use crate::out::outln;
use anyhow::Result;
use ask::{Asker, Question};
use mavsight_engine::{FilmLook, colors_in_pictures, look_at};
use mavsight_flight::{Color, Marker};
use mavsight_model::SHELF;
use mavsight_pipeline::ControlPointRow;
use mavsight_pose::{MeasuredBetween, PointNetwork, measurement_words, points_from_distances};
use mavsight_session::{DistanceTable, read_control_points, read_image};
use mavsight_vision::Frame;
pub(super) use read::color as word_color;
use std::path::{Path, PathBuf};

/// What is known of the session once all is answered.
pub(super) struct Answers {
    pub(super) name: String,
    pub(super) cameras: Vec<Camera>,
    pub(super) model: Option<String>,
    pub(super) mass_kg: f64,
    pub(super) inertia_kg_m2: [f64; 3],
    pub(super) markers: Vec<Marker>,
    pub(super) inputs: Option<PathBuf>,
    pub(super) control: Vec<ControlPointRow>,
    /// Where the control points come from, in words for their file.
    pub(super) survey: String,
}

/// A recording with what it shows.
pub(super) struct Camera {
    pub(super) name: String,
    pub(super) video: PathBuf,
    pub(super) still: Option<PathBuf>,
    pub(super) look: FilmLook,
}

pub(crate) fn new(args: &New) -> Result<()> {
    require_folder(&args.dir)?;
    let written = args.dir.join("session.toml");
    if written.exists() {
        let message = format!("{}: is there already: name another folder, or remove it", written.display());
        return Err(WrongCall(message).into());
    }
    let mut asker = Asker::new();
    let cameras = cameras(args, &mut asker)?;
    let answers = answers(args, cameras, &mut asker)?;
    let Some(answers) = answers else { return asker.finish() };
    asker.finish()?;
    files::write(&args.dir, &answers)?;
    outln!("{}\n{}", answers.survey, files::written(&args.dir));
    let written = written.display();
    outln!("Next: mavsight check {written}");
    if cfg!(feature = "page") {
        outln!("Where it does not find balls by their colours: mavsight pick {written}");
    }
    Ok(())
}

/// What to do without a control frame.
const NO_FRAME: &str =
    "No control frame yet? `mavsight targets print` writes a plan of one and a form for its distances";

/// The recordings, and what each shows.
fn cameras(args: &New, asker: &mut Asker) -> Result<Vec<Camera>> {
    let mut videos = args.from.clone();
    if videos.is_empty() {
        let question =
            Question { flag: "--from", text: "The video of each camera, one a line", default: None };
        asker.ask_lines(&[], &question, |line| read::file(line).map(|path| videos.push(path)))?;
    }
    let looks: Vec<FilmLook> = videos.iter().map(|v| named(look_at(v))).collect::<Result<_>>()?;
    let mut cameras: Vec<Camera> = Vec::new();
    for (k, (video, look)) in videos.into_iter().zip(looks).enumerate() {
        let stem = video.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        let is_free = !stem.is_empty() && cameras.iter().all(|c| c.name != stem);
        let name = if is_free { stem } else { format!("cam{}", k + 1) };
        eprintln!("{}: {}", video.display(), look.words());
        let still = args.still.get(k).cloned().or_else(|| read::still_beside(&video));
        cameras.push(Camera { name, video, still, look });
    }
    if cameras.iter().any(|c| c.still.is_none()) && !cameras.is_empty() {
        let text = "The image of the control balls by each camera, in the order of the videos, one a line";
        let question = Question { flag: "--still", text, default: None };
        let mut stills = Vec::new();
        asker.ask_lines(&[], &question, |line| read::file(line).map(|path| stills.push(path)))?;
        if stills.is_empty() && asker.is_asking() {
            return Err(
                WrongCall(format!("each camera needs an image of the control balls. {NO_FRAME}")).into()
            );
        }
        for (camera, still) in cameras.iter_mut().zip(stills) {
            camera.still = Some(still);
        }
    }
    Ok(cameras)
}

/// All that the recordings do not show; none where a script left something out.
fn answers(args: &New, cameras: Vec<Camera>, asker: &mut Asker) -> Result<Option<Answers>> {
    let shelf = SHELF.map(|(name, _)| name).join(", ");
    let text = format!("Flight model ({shelf}, or a model file); none for motion alone");
    let question = Question { flag: "--model", text: &text, default: Some("none") };
    let model = asker.ask(args.model.as_deref(), &question, |text| {
        let is_known = SHELF.iter().any(|(name, _)| *name == text);
        if text == "none" || is_known || Path::new(text).is_file() {
            Ok(Some(text.to_owned()).filter(|t| t != "none"))
        } else {
            Err(format!("{text:?} is neither a model of the shelf ({shelf}) nor a file"))
        }
    })?;
    let question = Question { flag: "--mass", text: "Mass of the aircraft as it flew, kg", default: None };
    let mass_kg = asker.ask(args.mass.as_deref(), &question, read::mass_kg)?;
    let text = "Moments of inertia about forward, right and down, kg m² (Ixx,Iyy,Izz)";
    let question = Question { flag: "--inertia", text, default: None };
    let inertia_kg_m2 = asker.ask(args.inertia.as_deref(), &question, read::three)?;
    let question =
        Question { flag: "--ball-diameter", text: "Diameter of the balls on it, mm", default: None };
    let diameter_mm = asker.ask(args.ball_diameter.as_deref(), &question, read::diameter_mm)?;
    let text = "The balls on it, one a line: colour, then forward, right and down of the centre of gravity in mm (red \
                225 225 100); a colour as picked from a picture may follow (#d02a2a)";
    let question = Question { flag: "--ball", text, default: None };
    let mut markers: Vec<Marker> = Vec::new();
    let mut is_picked = Vec::new();
    asker.ask_lines(&args.ball, &question, |line| {
        markers.push(read::ball(line, &markers)?);
        is_picked.push(read::parts(line).len() > 4);
        Ok(())
    })?;
    let firsts: Vec<Frame> = cameras.iter().map(|c| c.look.first.clone()).collect();
    let names: Vec<&str> = markers.iter().map(|m| m.name.as_str()).collect();
    let words: Vec<Color> = markers.iter().map(|m| m.color).collect();
    let colors = from_pictures("marker", &firsts, &names, &words, &is_picked);
    markers.iter_mut().zip(colors).for_each(|(marker, color)| marker.color = color);
    let question = Question { flag: "--inputs", text: "Table of the recorded inputs", default: Some("none") };
    let inputs = asker.ask(args.inputs.as_deref(), &question, read::file_or_none)?;
    let control = control(args, &cameras, asker)?;
    let (Some(model), Some(mass_kg), Some(inertia_kg_m2), Some(diameter_mm), Some(inputs), Some(control)) =
        (model, mass_kg, inertia_kg_m2, diameter_mm, inputs, control)
    else {
        return Ok(None);
    };
    markers.iter_mut().for_each(|m| m.diameter_m = 1e-3 * diameter_mm);
    let (control, survey) = control;
    let name = args.dir.canonicalize().unwrap_or_else(|_| args.dir.clone());
    let name = name.file_name().map_or_else(|| "flight".to_owned(), |n| n.to_string_lossy().into_owned());
    Ok(Some(Answers { name, cameras, model, mass_kg, inertia_kg_m2, markers, inputs, control, survey }))
}

/// Control points, and where they come from in words.
type Surveyed = (Vec<ControlPointRow>, String);

fn control(args: &New, cameras: &[Camera], asker: &mut Asker) -> Result<Option<Surveyed>> {
    if let Some(path) = &args.control {
        let points = named(read_control_points(path))?;
        let words = format!("{} control points as surveyed in {}", points.len(), path.display());
        return Ok(Some((points, words)));
    }
    let text = "Standard deviation of a distance by the tape measure, mm";
    let question = Question { flag: "--tape-std", text, default: Some("2") };
    let Some(std_mm) = asker.ask(args.tape_std.as_deref(), &question, read::above_zero)? else {
        return Ok(None);
    };
    let mut table = DistanceTable::default();
    let mut rows: Vec<String> = args.distance.clone();
    if let Some(path) = &args.distances {
        table = named(DistanceTable::read(path, 1e-3 * std_mm))?;
    } else {
        let text = "Distances between the control balls: the path of a table of them (print/distances.csv), or one a \
                    line: from, to, metres (red green 3.002); heights as red floor 0.031; plumb lines as violet yellow \
                    plumb. The first three balls counter-clockwise seen from above";
        let question = Question { flag: "--distances", text, default: None };
        let given = std::mem::take(&mut rows);
        asker.ask_lines(&given, &question, |line| match read::parts(line)[..] {
            [from, to, distance] => table.add([from, to, distance], 1e-3 * std_mm),
            [from, to, distance, std_mm] => table.add([from, to, distance], 1e-3 * read::above_zero(std_mm)?),
            _ if Path::new(line.trim()).is_file() => {
                table =
                    DistanceTable::read(Path::new(line.trim()), 1e-3 * std_mm).map_err(|e| e.to_string())?;
                Ok(())
            }
            _ => Err("write a distance as red,green,3.002, or the path of a table that is there".to_owned()),
        })?;
    }
    if table.names.is_empty() && asker.is_asking() {
        return Err(WrongCall(format!("without distances there are no control points. {NO_FRAME}")).into());
    }
    let text = "Diameter of the control balls, mm";
    let question = Question { flag: "--control-diameter", text, default: None };
    let diameter_mm = asker.ask(args.control_diameter.as_deref(), &question, read::diameter_mm)?;
    let colors = control_colors(args, cameras, asker, &table)?;
    let Some(diameter_mm) = diameter_mm.filter(|_| !table.names.is_empty()) else { return Ok(None) };
    let network = points_from_distances(&table.names, &table.measured)
        .map_err(|error| WrongCall(format!("--distances: {error}")))?;
    let row = |(k, name): (usize, &String)| ControlPointRow {
        name: name.clone(),
        position_m: network.points_m[k].map(|x| (1e6 * x).round() / 1e6).into(),
        diameter_m: 1e-3 * diameter_mm,
        color: colors[k],
        std_m: (1e6 * network.std_m(k)).round() / 1e6,
    };
    let points = table.names.iter().enumerate().map(row).collect();
    Ok(Some((points, survey_words(&network, &table))))
}

/// The colours of control points: as picked, or as they are called.
fn control_colors(
    args: &New,
    cameras: &[Camera],
    asker: &mut Asker,
    table: &DistanceTable,
) -> Result<Vec<Color>> {
    let names = &table.names;
    let mut picked: Vec<(String, Color)> = Vec::new();
    let read = |line: &str, picked: &mut Vec<(String, Color)>| {
        let (name, code) = line.split_once(['=', ' ']).ok_or("write a colour as orange=#b05020")?;
        picked.push((name.to_owned(), read::color(code)?));
        Ok(())
    };
    let is_called = |name: &String| args.control_color.iter().any(|c| c.starts_with(&format!("{name}=")));
    let unknown: Vec<&str> =
        names.iter().filter(|n| !is_called(n) && read::color(n).is_err()).map(String::as_str).collect();
    let text = format!("Colours of {} as picked from a picture, one a line (p1 #b05020)", unknown.join(", "));
    let question = Question { flag: "--control-color", text: &text, default: None };
    if !args.control_color.is_empty() || !unknown.is_empty() {
        asker.ask_lines(&args.control_color, &question, |line| read(line, &mut picked))?;
    }
    let own = |name: &String| {
        let picked = picked.iter().find(|(of, _)| of == name).map(|(_, color)| *color);
        picked.map_or_else(|| read::color(name), Ok)
    };
    let known = |name: &String| own(name).map_err(|_| no_color(table, name));
    let words: Vec<Color> = names.iter().map(known).collect::<Result<_, WrongCall>>()?;
    let is_picked: Vec<bool> = names.iter().map(|n| picked.iter().any(|(of, _)| of == n)).collect();
    let stills: Vec<Frame> =
        cameras.iter().filter_map(|c| c.still.as_ref()).filter_map(|path| read_image(path).ok()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    Ok(from_pictures("control ball", &stills, &names, &words, &is_picked))
}

/// Refuses a ball of the table that is called by no colour: misspelt in the table, or called otherwise.
fn no_color(table: &DistanceTable, name: &str) -> WrongCall {
    let of = |between: MeasuredBetween| match between {
        MeasuredBetween::Height(a) => [a, a],
        MeasuredBetween::Distance(a, b) | MeasuredBetween::Plumb(a, b) => [a, b],
    };
    let is_its = |between: MeasuredBetween| of(between).iter().any(|k| table.names[*k] == name);
    let rows = table.measured.iter().map(|m| m.between).filter(|between| is_its(*between));
    let rows: Vec<String> = rows.map(|between| measurement_words(&table.names, between)).collect();
    let others: Vec<&str> = table.names.iter().filter(|n| *n != name).map(String::as_str).collect();
    WrongCall(format!(
        "distances: the ball {name:?} ({}) is called by no colour: correct the name if it is one of {}, or give --control-color {name}=#RRGGBB",
        rows.join("; "),
        others.join(", ")
    ))
}

/// Colours that were not picked, as pictures have them where they show balls that may be called so.
fn from_pictures(
    what: &str,
    pictures: &[Frame],
    names: &[&str],
    words: &[Color],
    is_picked: &[bool],
) -> Vec<Color> {
    if is_picked.iter().all(|picked| *picked) {
        return words.to_vec();
    }
    let proposed = colors_in_pictures(pictures, words);
    let mut colors = words.to_vec();
    for (k, own) in colors.iter_mut().enumerate().filter(|(k, _)| !is_picked[*k]) {
        match proposed[k] {
            Some(color) => {
                eprintln!("{what} {}: {color}, as the pictures have it", names[k]);
                *own = color;
            }
            None => {
                eprintln!("{what} {}: {own}, as it is called: no picture has a ball of that colour", names[k])
            }
        }
    }
    colors
}

fn survey_words(network: &PointNetwork, table: &DistanceTable) -> String {
    let std_mm = (0..table.names.len()).map(|k| 1e3 * network.std_m(k)).fold(0.0, f64::max);
    let mut words = format!(
        "{} control points by {} measured distances: coordinates to {std_mm:.1} mm at worst, residuals {:.2} times the stated deviation",
        table.names.len(),
        table.measured.len(),
        (network.chi_square / network.redundancy.max(1) as f64).sqrt()
    );
    if let Some(k) = network.left_out {
        words += &format!(
            "; {} disagrees with all others by {:.0} mm and is left out: measure it again",
            measurement_words(&table.names, table.measured[k].between),
            1e3 * network.residuals_m[k]
        );
    }
    words
}
