//! The report of a flight, as its reader sees it: what is in it, and in a browser what is on the first screen of a
//! laptop and of a phone. The browser's part is skipped where there is no Chromium; the rules of axe are checked where
//! `MAVSIGHT_AXE` names its axe.min.js.

#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

#[allow(dead_code)]
#[path = "../../page/tests/browser/chromium.rs"]
mod chromium;

use chromium::Chromium;
use common::{Session, mavsight};
use std::path::Path;

#[test]
fn the_first_screen_shows_the_flight_and_all_else_is_below() {
    let session = Session::new();
    let out = session.path("results");
    let mut run = mavsight();
    let run = run.arg("run").arg(session.path("session.toml")).arg("--out").arg(&out).assert().success();
    let printed = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
    assert!(printed.lines().count() <= 25, "{printed}");
    assert!(
        printed.lines().take_while(|l| !l.starts_with("Results:")).all(|l| l.chars().count() <= 100),
        "{printed}"
    );
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.len() < 3_000_000, "{} bytes", page.len());
    rings_and_crosses_agree(&page);
    let appendix = page.split("Appendix: as in the paper").nth(1).unwrap();
    let places = [
        "Table 1",
        "Table 2",
        "Figure 4",
        "Figure 6",
        "Figure 7",
        "Figure 8",
        "Figure 9",
        "Figure 10",
        "Figure 11",
    ];
    let places: Vec<usize> =
        places.iter().map(|place| appendix.find(&format!(">{place}:")).expect("a place")).collect();
    assert!(places.is_sorted(), "{places:?}");
    let film = out.join("flight.mp4");
    let command =
        format!("mavsight overlay {} --out {}", session.path("session.toml").display(), film.display());
    assert!(page.replace("&#x2f;", "/").contains(&command) && !page.contains("<video"), "{command}");
    match Chromium::start() {
        Some(mut browser) => {
            a_browser_shows_it(&out.join("report.html"), &mut browser);
            a_browser_plays_the_film(&session, &out, &mut browser);
        }
        None => println!("skipped: no chromium on this machine"),
    }
}

/// Where balls were detected, and where the pose puts them, come from different ends of the chain: in a sharp film they are
/// within a pixel of each other.
fn rings_and_crosses_agree(page: &str) {
    let overlay = page.split("class=\"tile\"").nth(1).unwrap();
    let number = |text: &str, key: &str| -> f64 {
        text.split(key).nth(1).and_then(|t| t.split(['"', ' ', 'h']).next()).unwrap().parse().unwrap()
    };
    let rings: Vec<[f64; 2]> = overlay
        .split("class=\"detected\"")
        .skip(1)
        .map(|ring| [number(ring, "cx=\""), number(ring, "cy=\"")])
        .collect();
    let crosses: Vec<[f64; 2]> = overlay
        .split("class=\"predicted\"")
        .skip(1)
        .map(|cross| {
            let d = cross.split("d=\"M").nth(1).unwrap();
            let mut numbers = d.split([' ', 'L', 'M']).map(|n| n.parse::<f64>().unwrap_or(f64::NAN));
            [numbers.next().unwrap() + 9.0, numbers.next().unwrap()]
        })
        .collect();
    assert_eq!((rings.len(), crosses.len()), (8, 8), "four balls before two cameras");
    // A picture is 720 wide, of a part of the frame that is at least a fifth of 480 pixels.
    let pixel = 720.0 / (0.2 * 480.0);
    for (ring, cross) in rings.iter().zip(&crosses) {
        let apart = (ring[0] - cross[0]).hypot(ring[1] - cross[1]);
        assert!(apart < pixel, "{ring:?} {cross:?}");
    }
}

fn a_browser_shows_it(report: &Path, browser: &mut Chromium) {
    for (width, height, scheme) in
        [(1280, 800, "light"), (390, 844, "light"), (1280, 800, "dark"), (390, 844, "dark")]
    {
        browser.look_like(width, height, scheme);
        browser.open(&format!("file://{}", report.display()));
        // Charts are drawn, and all that a reader wants first is on the screen.
        browser.wait_for("document.querySelectorAll('.tile canvas').length >= 6");
        let tiles = "[...document.querySelectorAll('.tile')].map(t => t.getBoundingClientRect())";
        browser.wait_for(&format!(
            "{tiles}.length === 4 && {tiles}.every(t => t.bottom <= innerHeight && t.height > 100)"
        ));
        browser.wait_for("document.documentElement.scrollWidth <= innerWidth");
        browser.photograph(&format!("report-{width}-{scheme}"));
        // The path turns by the keys.
        let path = "document.querySelector('.space .path').getAttribute('d')";
        let before = browser.text(path);
        browser.value("document.querySelector('.space').focus()");
        browser.press("ArrowLeft", 37, "");
        assert_ne!(browser.text(path), before);
        // A picture fills the screen and goes back.
        browser.value("document.querySelectorAll('.enlarge')[2].click()");
        browser
            .wait_for("document.querySelector('.tile.full').getBoundingClientRect().height === innerHeight");
        browser.press("Escape", 27, "");
        browser.wait_for("!document.querySelector('.tile.full')");
        // What is folded is drawn when it is opened.
        browser.value("document.querySelectorAll('details').forEach(d => { d.open = true; })");
        browser.wait_for("[...document.querySelectorAll('details .drawn > script')].every(s => s.parentElement.querySelector('canvas'))");
        is_accessible(browser);
    }
    let elsewhere = "performance.getEntriesByType('resource').filter(r => !r.name.startsWith('data:')).map(r => r.name).join()";
    assert_eq!(browser.text(elsewhere), "", "nothing is loaded");
    assert!(browser.complaints.is_empty(), "{:#?}", browser.complaints);
}

/// Makes the film beside the report, which an open page plays when it is asked to, and one that is written then at once.
fn a_browser_plays_the_film(session: &Session, out: &Path, browser: &mut Chromium) {
    let (report, toml) = (out.join("report.html"), session.path("session.toml"));
    let made =
        mavsight().arg("overlay").arg(&toml).arg("--out").arg(out.join("flight.mp4")).assert().success();
    assert!(String::from_utf8_lossy(&made.get_output().stdout).contains("report.html plays it"));
    let is_played = "document.querySelector('video')?.readyState >= 1 && document.querySelector('video').videoWidth > 600";
    browser.value("document.querySelector('[data-film]').click()");
    browser.wait_for(is_played);
    mavsight().arg("report").arg(&toml).arg("--out").arg(out).assert().success();
    browser.open(&format!("file://{}", report.display()));
    browser.wait_for(is_played);
    is_accessible(browser);
    assert!(browser.complaints.is_empty(), "{:#?}", browser.complaints);
}

/// What can be checked without axe, and axe where it is at hand.
fn is_accessible(browser: &mut Chromium) {
    let faults = "[['pictures without words', 'img:not([alt]), svg[role=img]:not([aria-label]), img[alt=\"\"]'], \
        ['buttons without words', 'button:empty:not([aria-label])'], ['cells of a head without a scope', 'th:not([scope])'], \
        ['ids twice', [...document.querySelectorAll('[id]')].some((e, k, all) => all.findIndex(o => o.id === e.id) !== k) ? 'body' : 'nothing']] \
        .filter(([, what]) => document.querySelector(what)).map(([words]) => words).join('; ')";
    assert_eq!(browser.text(faults), "");
    let is_whole = "document.documentElement.lang === 'en' && document.title !== '' && document.querySelectorAll('main').length === 1 \
        && document.querySelectorAll('h1').length === 1";
    assert_eq!(browser.value(is_whole), true);
    let Ok(axe) = std::env::var("MAVSIGHT_AXE") else { return };
    browser.value(&format!("{};0", std::fs::read_to_string(axe).unwrap()));
    let violations = browser.text(
        "axe.run(document).then(r => r.violations.map(v => v.id + ': ' + v.nodes[0].html).join('\\n'))",
    );
    assert_eq!(violations, "");
}
