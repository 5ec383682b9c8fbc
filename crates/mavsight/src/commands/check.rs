//! `check`: what is ready, and what to mend first.

use super::named;
use crate::cli::Check;
use crate::out::outln;
use crate::progress::Bars;
use anyhow::Result;
use mavsight_engine::{CameraCheck, Harm, SessionCheck};
use mavsight_session::Session;
use std::path::Path;

pub(crate) fn check(args: &Check) -> Result<()> {
    let session = named(Session::load(&args.session))?;
    let path = &session.path;
    let bars = Bars::new();
    let found = mavsight_engine::check(&session, &bars);
    bars.done();
    let by_click = by_click(&found, path);
    print(&found, by_click.as_deref())?;
    let page = args.out.clone().unwrap_or_else(|| path.with_file_name("check.html"));
    super::check_page::write(&page, &found, by_click.as_deref())?;
    outln!("Pictures: {}", page.display());
    anyhow::ensure!(found.is_ready(), "{}: mend this first", path.display());
    if found.is_filmed() {
        outln!("Next: mavsight run {} --out {}", path.display(), path.with_file_name("results").display());
    } else {
        outln!("Next: mavsight live {}", path.display());
    }
    Ok(())
}

/// What of the list a click may mend, and by which command; none where there is nothing of the kind.
fn by_click(found: &SessionCheck, session: &Path) -> Option<String> {
    let mend = found.items.iter().filter(|i| i.harm != Harm::Remark).enumerate();
    let numbers: Vec<String> =
        mend.filter(|(_, item)| item.by_click).map(|(k, _)| (k + 1).to_string()).collect();
    let is_there = cfg!(feature = "page") && !numbers.is_empty();
    is_there.then(|| {
        format!(
            "For {}: click on the balls, and their colours are taken from the pictures: mavsight pick {}",
            numbers.join(", "),
            session.display()
        )
    })
}

fn print(found: &SessionCheck, by_click: Option<&str>) -> Result<()> {
    let (mend, remarks): (Vec<_>, Vec<_>) = found.items.iter().partition(|i| i.harm != Harm::Remark);
    if !mend.is_empty() {
        outln!("Mend this first, the most harmful at the top:");
    }
    for (k, item) in mend.iter().enumerate() {
        let causes: Vec<&str> = item.causes.iter().map(|c| c.words()).collect();
        let cause = match causes.len() {
            0 => String::new(),
            _ => format!("{}: ", causes.join(" or ")),
        };
        outln!("{:2}. {cause}{}", k + 1, item.text);
    }
    if let Some(text) = by_click {
        outln!("{text}");
    }
    outln!("{}", if found.is_ready() { "Ready:" } else { "Seen:" });
    for camera in &found.cameras {
        outln!("  {}: {}", camera.name, words(camera, found));
    }
    if let Some((position_std_m, angle_std_rad)) = found.pose_std {
        let (measured, all) = found.instants;
        outln!(
            "  poses at {measured} of {all} instants, to {:.1} mm and {:.2}° a coordinate (standard deviation)",
            1e3 * position_std_m,
            angle_std_rad.to_degrees()
        );
    }
    for remark in remarks {
        outln!("  {}", remark.text);
    }
    Ok(())
}

/// One camera in a line.
fn words(camera: &CameraCheck, found: &SessionCheck) -> String {
    let Some(size) = camera.size else { return "no picture".into() };
    let mut all = vec![format!("{}×{} px", size.width_px, size.height_px)];
    if let Some(rms_px) = camera.calibration_rms_px {
        all.push(format!("calibrated to {rms_px:.2} px"));
    }
    if camera.frames > 0 {
        all.push(format!("{} frames at {:.2}/s", camera.frames, camera.rate_hz));
    }
    if let Some(edge_px) = camera.edge_px {
        all.push(format!("edges blurred by {edge_px:.1} px"));
    }
    if let Some(exposure) = camera.exposure {
        let (ms, std_ms) = (1e3 * exposure.exposure_s, 1e3 * exposure.std_s);
        all.push(format!("exposes for {ms:.0} ± {std_ms:.0} ms"));
    }
    let seen =
        found.markers.iter().zip(&camera.seen).map(|((name, _), s)| format!("{name} {:.0} %", 100.0 * s));
    let seen: Vec<String> = seen.collect();
    if !seen.is_empty() {
        all.push(format!("sees {}", seen.join(", ")));
    }
    all.join("; ")
}
