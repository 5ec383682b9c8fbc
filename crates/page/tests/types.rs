//! The page's types are those of the events: `web/src/examples.ts` holds one of each as it is really sent,
//! and the TypeScript compiler compares them with `web/src/events.ts` (names, types, and nothing too much)
//! whenever the page is built.
//!
//! `MAVSIGHT_WRITE=1 cargo test -p mavsight-page --test types` writes the file again.

#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_link::{
    CameraState, CameraView, DetectedBall, Event, MarkerView, Parameter, PoseEvent, Scene, Tracking,
};

fn pose(tracking: Tracking, is_measured: bool) -> Event {
    Event::Pose(Box::new(PoseEvent {
        t_s: 1.5,
        sequence: 90,
        captured_ns: 1_795_000_000_000_000_000,
        valid: is_measured,
        tracking,
        position_m: is_measured.then_some([1.0, 2.0, 3.0]),
        attitude: is_measured.then_some([0.5, 0.5, 0.5, 0.5]),
        euler_rad: is_measured.then_some([0.1, 0.2, 0.3]),
        covariance: is_measured.then_some([0.25; 21]),
        velocity_in_body_m_s: is_measured.then_some([0.5; 3]),
        velocity_std_m_s: is_measured.then_some([0.5; 3]),
        rates_rad_s: is_measured.then_some([0.5; 3]),
        rates_std_rad_s: is_measured.then_some([0.5; 3]),
        residual_px: is_measured.then_some(0.25),
        latency_ms: 0.75,
        reason: (!is_measured).then(|| "hidden".to_owned()),
    }))
}

fn camera(state: CameraState) -> Event {
    Event::Camera {
        camera: 0,
        state,
        rate_hz: 60.0,
        latency_ms: 0.5,
        missing: 3,
        dropped: 2,
        markers: vec![1.0, 0.5],
        reason: (state != CameraState::Running).then(|| "cable".to_owned()),
    }
}

fn scene() -> Event {
    Event::Scene(Scene {
        name: "room".to_owned(),
        cameras: vec![CameraView {
            name: "cam1".to_owned(),
            width_px: 640,
            height_px: 480,
            centre_m: [1.0, 2.0, 3.0],
            corners: [[0.5, 0.5, 1.0]; 4],
        }],
        markers: vec![MarkerView {
            name: "red".to_owned(),
            rgb: [219, 18, 18],
            in_body_m: [0.25, 0.25, 0.5],
            diameter_m: 0.05,
        }],
        volume_m: [[-2.0, -2.0, 0.0], [2.0, 2.0, 2.5]],
    })
}

/// Every variant, and each of its states and options.
fn examples() -> Vec<Event> {
    use CameraState::{Dark, Frozen, Gone, Moved, Running, Stalled, Starting};
    use Tracking::{Acquiring, Lost, Reacquired};
    let known_ball = DetectedBall {
        u_px: 1.5,
        v_px: 2.5,
        diameter_px: 9.5,
        marker: Some(0),
        residual_px: Some([0.1, 0.2]),
    };
    let other_ball = DetectedBall { marker: None, residual_px: None, ..known_ball.clone() };
    let known =
        Parameter { name: "C_X.u".to_owned(), value: Some(0.5), half_width: Some(0.25), enough: true };
    let unknown = Parameter { value: None, half_width: None, enough: false, ..known.clone() };
    let recording = |folder: Option<&str>, fault: Option<&str>| Event::Recording {
        folder: folder.map(str::to_owned),
        seconds: 1.5,
        bytes: 1000,
        fault: fault.map(str::to_owned),
    };
    let mut examples = vec![
        scene(),
        pose(Tracking::Tracking, true),
        Event::Detections { camera: 0, t_s: 1.5, seen: vec![known_ball, other_ball] },
    ];
    examples.extend([Acquiring, Lost, Reacquired].map(|tracking| pose(tracking, false)));
    examples.extend([Starting, Running, Stalled, Gone, Moved, Frozen, Dark].map(camera));
    examples.extend([
        Event::Parameters { t_s: 1.5, parameters: vec![known, unknown], enough: false },
        recording(Some("flight"), None),
        recording(None, Some("the disk is full")),
        Event::Note { t_s: 1.5, fault: false, text: "calibrated".to_owned() },
    ]);
    examples
}

#[test]
fn the_examples_that_the_page_is_checked_against_are_what_is_sent() {
    let mut text = String::from(
        "// Written by `tests/types.rs` of the server: events as they are really sent. The compiler holds the page's types to them.\n\n\
         import type { FlightEvent } from \"./events.ts\";\n\nexport const examples = [\n",
    );
    for example in examples() {
        text += &format!("  {},\n", serde_json::to_string(&example).unwrap());
    }
    text += "] satisfies FlightEvent[];\n";
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("web/src/examples.ts");
    if std::env::var_os("MAVSIGHT_WRITE").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap();
    assert_eq!(
        committed, text,
        "the events have changed: write the file again, then make the page's types fit"
    );
}
