//! What a reader sees first: three sentences and four pictures.

use crate::digits::short;
use crate::findings::sentence_case;
use crate::html::Figure;
use crate::intervals::Estimates;
use crate::overlay::Overlay;
use crate::parameters::{lead, words};
use crate::{Summary, space};
use mavsight_flight::Vehicle;
use mavsight_session::RunResults;

/// What flew, how good the motion is, how good the parameters are; names of quantities as in tables.
pub(crate) fn sentences(vehicle: &Vehicle, results: &RunResults, summary: &Summary) -> Vec<String> {
    [Some(flown(vehicle, results)), motion(results, summary), parameters(results, summary)]
        .into_iter()
        .flatten()
        .collect()
}

fn flown(vehicle: &Vehicle, results: &RunResults) -> String {
    let times = || results.poses.iter().map(|p| p.t_ns);
    let span_s = times().max().unwrap_or(0).saturating_sub(times().min().unwrap_or(0)) as f64 * 1e-9;
    let measured = results.poses.iter().filter(|p| p.estimate.is_ok()).count();
    let by = match results.camera_names.len() {
        0 => String::new(),
        1 => " before one camera".to_owned(),
        count => format!(" before {count} cameras"),
    };
    format!(
        "{}: {span_s:.1} s of flight{by}; {measured} of {} instants have a pose.",
        sentence_case(&vehicle.name),
        results.poses.len()
    )
}

/// The note that says what there is not, and why.
fn refusal(results: &RunResults, words: &str) -> Option<String> {
    let note = results.notes.iter().find(|note| note.starts_with(words))?;
    Some(format!("{}.", note.trim_end_matches('.')))
}

fn motion(results: &RunResults, summary: &Summary) -> Option<String> {
    if results.motion.is_none() {
        return refusal(results, "No motion");
    }
    let number = |section: &str, key: &str| summary.figure(section, key)?.value.as_f64().map(short);
    let (position, pitch) = (number("motion", "position_std_mm")?, number("motion", "theta_std_deg")?);
    let mut text =
        format!("Its position is known to {position} mm and its pitch to {pitch}° (standard deviations)");
    let turned = || summary.figure("truth", "motion_attitude_rms_deg")?.value.get(1)?.as_f64().map(short);
    if let Some((position, pitch)) = number("truth", "motion_position_rms_mm").zip(turned()) {
        text += &format!("; against truth it errs by {position} mm and {pitch}°");
    }
    Some(text + ".")
}

fn parameters(results: &RunResults, summary: &Summary) -> Option<String> {
    let estimates = Estimates::of(results);
    let Some(first) = estimates.first() else {
        return refusal(results, "No parameters").or_else(|| refusal(results, "No equation error"));
    };
    let (determined, all) = estimates.determined();
    let mut text = format!("The flight determines {determined} of {all} parameters ({})", words(first));
    let inside = summary.figure("truth", &format!("{first}_inside_of"));
    if let Some((inside, of)) = inside.and_then(|row| Some((row.value.get(0)?, row.value.get(1)?))) {
        text += &format!("; {inside} of {of} true values lie inside their 95 % intervals");
    }
    let is_of_use = |output: &str| {
        let fit = results.identification.as_ref().and_then(|i| i.fit(output, lead(i)?));
        fit.is_none_or(|fit| fit.explains)
    };
    let explained = summary.rows.iter().filter(|r| r.section == "fit").filter_map(|r| {
        let output =
            r.key.strip_suffix("_r2").filter(|o| !o.ends_with("predicted") && !o.contains("held_out"))?;
        if !is_of_use(output) {
            return None;
        }
        Some(format!("{:.0} % of {output}", 100.0 * r.value.as_f64()?.max(0.0)))
    });
    let explained: Vec<String> = explained.collect();
    if let [all @ .., last] = &explained[..] {
        let others = if all.is_empty() { String::new() } else { format!("{} and ", all.join(", ")) };
        text += &format!("; the fitted equations explain {others}{last}");
    }
    Some(text + ".")
}

/// The four pictures, of which those are left out that the flight does not give: overlay, path, angles, and
/// coefficients, in whose place velocities stand where there are none.
pub(crate) fn pictures(
    results: &RunResults,
    overlays: &[Overlay],
    motion: &[Figure],
    coefficients: &[Figure],
) -> Vec<Figure> {
    let of = |figure: Option<&Figure>, caption: &str| figure.map(|figure| figure.again(caption));
    let fourth = of(coefficients.first(), "Coefficients from the motion, and as fitted")
        .or_else(|| of(motion.get(2), "Velocity in body axes with 95 % bands"));
    let path = results.motion.as_ref().and_then(space::path);
    let angles = of(motion.get(1), "Angles with 95 % bands");
    [overlay(overlays), path, angles, fourth].into_iter().flatten().collect()
}

/// The two cameras that saw most balls, side by side.
fn overlay(overlays: &[Overlay]) -> Option<Figure> {
    let mut best: Vec<&Overlay> = overlays.iter().collect();
    best.sort_by_key(|o| std::cmp::Reverse(o.detected));
    best.truncate(2);
    let markup: String = best.iter().map(|o| o.markup.as_str()).collect();
    let caption =
        "Balls as detected (rings) and as the pose puts them (crosses); body axes x, y, z".to_owned();
    (!best.is_empty()).then(|| Figure {
        caption,
        markup: format!("<div class=\"pair\">{markup}</div>"),
        ..Figure::default()
    })
}
