//! The page in a headless Chromium: poses move, keys act, what is old is not shown as if it were now, nothing
//! is complained of.
//!
//! Skipped where there is no Chromium. With `MAVSIGHT_SCREENSHOTS=DIR` it leaves pictures of the page there.

#![allow(clippy::unwrap_used, clippy::panic)]

#[path = "../../examples/virtual/flight.rs"]
mod flight;

mod chromium;

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use chromium::Chromium;
use flight::{PICTURE_PX, RATE_HZ, VirtualFlight};
use mavsight_link::{CameraState, Event};
use mavsight_page::{Command, Limits, Reach, Server, encode_preview};
use serde_json::json;

/// Signals to the feed.
#[derive(Default)]
struct Orders {
    hide: AtomicBool,
    pause: AtomicBool,
    end: AtomicBool,
}

/// A server that is fed with the virtual flight in real time.
struct Feed {
    server: Arc<Server>,
    orders: Arc<Orders>,
    thread: Option<JoinHandle<()>>,
}

impl Feed {
    /// Begins when the flight is `already_s` old, with its past sent quickly.
    fn start(address: SocketAddr, already_s: f64) -> Self {
        let server = Arc::new(Server::start(address, Reach::Loopback, Limits::default()).unwrap());
        let orders = Arc::new(Orders::default());
        let thread = std::thread::spawn({
            let (server, orders) = (Arc::clone(&server), Arc::clone(&orders));
            move || feed(&server, &orders, already_s)
        });
        Self { server, orders, thread: Some(thread) }
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.orders.end.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

fn feed(server: &Server, orders: &Orders, already_s: f64) {
    let mut flight = VirtualFlight::new(true);
    server.publish(&flight.scene());
    while server.listeners() == 0 && !orders.end.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(5));
    }
    let first = (already_s * RATE_HZ) as u64;
    let mut begun = Instant::now();
    for count in 0_u64.. {
        if orders.end.load(Ordering::Relaxed) {
            return;
        }
        let t_s = count as f64 / RATE_HZ;
        if count < first {
            begun = Instant::now();
            std::thread::sleep(Duration::from_micros(1500));
        } else {
            let due = Duration::from_secs_f64((count - first) as f64 / RATE_HZ);
            std::thread::sleep(due.saturating_sub(begun.elapsed()));
        }
        if orders.pause.load(Ordering::Relaxed) {
            continue;
        }
        flight.has_losses = count < first;
        flight.is_hidden = orders.hide.load(Ordering::Relaxed);
        let now_ns = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as i64;
        flight.step(count, now_ns).iter().for_each(|event| server.publish(event));
        let t_ns = (1e9 * t_s) as i64;
        for camera in 0..2 {
            if count >= first && server.wants_preview(camera, t_ns) {
                let jpeg = encode_preview(PICTURE_PX.0, PICTURE_PX.1, flight.picture(camera, t_s)).unwrap();
                server.preview(camera as u8, t_ns, &jpeg);
            }
        }
    }
}

const WORD: &str = "document.getElementById('tracking-word').textContent";
const VALUES: &str = "[...document.querySelectorAll('#strips output')].map(o => o.textContent).join(';')";

#[test]
fn the_page_shows_the_flight_as_it_is() {
    let Some(mut browser) = Chromium::start() else {
        println!("skipped: no chromium on this machine");
        return;
    };
    let feed = Feed::start("127.0.0.1:0".parse().unwrap(), 25.0);
    let address = feed.server.address();
    browser.look_like(1280, 720, "light");
    browser.open(&feed.server.url());
    poses_move(&mut browser);
    pictures_are_drawn(&mut browser);
    everything_fits(&mut browser);
    keys_ask(&mut browser, &feed.server);
    losses_are_said(&mut browser, &feed);
    assert!(browser.complaints.is_empty(), "{:#?}", browser.complaints);
    lost_connections_are_said_and_made_anew(&mut browser, feed, address);
    // A browser itself notes each attempt that found no server.
    browser.complaints.retain(|complaint| !complaint.contains("ERR_CONNECTION_REFUSED"));
    assert!(browser.complaints.is_empty(), "{:#?}", browser.complaints);
    no_other_page_may_listen(&mut browser, address);
}

fn poses_move(browser: &mut Chromium) {
    browser.wait_for(&format!("{WORD} === 'Tracking'"));
    browser.wait_for(
        "document.body.dataset.live === 'true' && Number(document.getElementById('time').textContent) > 25",
    );
    let mut seen = std::collections::BTreeSet::new();
    let begun = Instant::now();
    while seen.len() < 5 {
        assert!(begun.elapsed() < Duration::from_secs(15), "poses stand still: {seen:?}");
        // A machine with much else to do may pause the page; what it shows then is no pose.
        let now = browser.text(&format!("document.body.dataset.live === 'true' ? {VALUES} : ''"));
        if !now.is_empty() {
            seen.insert(now);
        }
        std::thread::sleep(Duration::from_millis(150));
    }
    for text in seen.iter().flat_map(|texts| texts.split(';')) {
        let (value, twice) = text.split_once(" ± ").unwrap_or_else(|| panic!("no interval: {text:?}"));
        let value: f64 = value.replace('−', "-").parse().unwrap();
        assert!(value.abs() <= 180.0 && twice.parse::<f64>().unwrap() > 0.0, "{text}");
    }
    browser.wait_for("(rate => rate > 10 && rate < 80)(Number(document.getElementById('rate').textContent))");
    browser.wait_for("document.querySelectorAll('#parameters li[data-enough=true]').length > 0");
}

fn pictures_are_drawn(browser: &mut Chromium) {
    browser.wait_for("document.querySelectorAll('#pictures canvas').length === 2");
    let colours = "(canvas => { const d = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data; \
        const seen = new Set(); for (let k = 0; k < d.length; k += 4) seen.add(d[k] >> 4 << 8 | d[k + 1] >> 4 << 4 | d[k + 2] >> 4); \
        return seen.size; })";
    for canvas in
        ["'#pictures figure:nth-child(1) canvas'", "'#pictures figure:nth-child(2) canvas'", "'canvas#room'"]
    {
        browser.wait_for(&format!("{colours}(document.querySelector({canvas})) > 20"));
    }
    browser.wait_for("/×\\d/.test(document.getElementById('residual-scale').textContent)");
    browser.wait_for("/2σ.*×\\d/.test(document.getElementById('room-caption').textContent)");
}

fn everything_fits(browser: &mut Chromium) {
    let (overflow, cut) = (
        "document.documentElement.scrollHeight > innerHeight || document.documentElement.scrollWidth > innerWidth",
        "[...document.querySelectorAll('section, nav, #tracking, .facts')].filter(e => { const r = e.getBoundingClientRect(); \
         return r.bottom > innerHeight || r.right > innerWidth || r.height < 25 || r.width < 40; }).map(e => e.className || e.id)",
    );
    browser.photograph("page-light");
    colours_can_be_read(browser);
    assert_eq!(browser.value(overflow), false, "scrolls at 1280x720");
    assert_eq!(browser.value(cut), json!([]), "cut off at 1280x720");
    browser.look_like(1280, 720, "dark");
    browser.wait_for("getComputedStyle(document.body).colorScheme === 'dark'");
    browser.photograph("page-dark");
    colours_can_be_read(browser);
    browser.look_like(390, 844, "light");
    std::thread::sleep(Duration::from_millis(200));
    browser.photograph("page-phone");
    assert_eq!(browser.value("document.documentElement.scrollWidth"), 390, "scrolls sideways on a phone");
    let small = "[...document.querySelectorAll('nav button')].filter(b => b.getBoundingClientRect().height < 40).length";
    assert_eq!(browser.value(small), 0, "buttons too small for fingers");
    browser.look_like(1280, 720, "light");
    std::thread::sleep(Duration::from_millis(200));
}

/// Every colour of text against the grounds it stands on, by the formula of WCAG 2.2: at least 4.5 to 1.
fn colours_can_be_read(browser: &mut Chromium) {
    let worst = "(() => { const style = getComputedStyle(document.documentElement); \
        const pen = document.createElement('canvas').getContext('2d'); \
        const hex = name => { pen.fillStyle = style.getPropertyValue(name).trim(); return pen.fillStyle; }; \
        const light = name => [1, 3, 5].map(k => parseInt(hex(name).slice(k, k + 2), 16) / 255) \
            .map(c => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4) \
            .reduce((sum, c, k) => sum + c * [0.2126, 0.7152, 0.0722][k], 0); \
        const ratio = (a, b) => (Math.max(light(a), light(b)) + 0.05) / (Math.min(light(a), light(b)) + 0.05); \
        const pairs = ['ink', 'soft', 'gone', 'good', 'bad', 'series-1', 'series-2', 'series-3'].map(name => [name, 'panel']); \
        pairs.push(['good', 'good-wash'], ['busy', 'busy-wash'], ['bad', 'bad-wash'], ['ink', 'bad-wash'], ['soft', 'ground']); \
        return pairs.filter(([a, b]) => !(ratio('--' + a, '--' + b) >= 4.5)).map(pair => pair.join(' on ')); })()";
    assert_eq!(browser.value(worst), json!([]), "too little contrast");
}

fn keys_ask(browser: &mut Chromium, server: &Server) {
    let wait = Duration::from_secs(5);
    browser.press("r", 82, "r");
    assert_eq!(server.next_command(wait), Some(Command::StartRecording));
    let recording = |folder: Option<&str>| Event::Recording {
        folder: folder.map(str::to_owned),
        seconds: 61.0,
        bytes: 2_500_000,
        fault: None,
    };
    server.publish(&recording(Some("flights/1")));
    browser.wait_for("document.getElementById('record').ariaPressed === 'true'");
    assert!(browser.text("document.getElementById('record').textContent").contains("1:01 · 2.5 MB"));
    browser.photograph("page-recording");
    browser.press("r", 82, "r");
    assert_eq!(server.next_command(wait), Some(Command::StopRecording));
    server.publish(&recording(None));
    browser.press("s", 83, "s");
    assert_eq!(server.next_command(wait), Some(Command::SelfCheck));
    browser.press("c", 67, "c");
    browser.wait_for("document.getElementById('sure').open");
    browser.press("Escape", 27, "");
    browser.wait_for("!document.getElementById('sure').open");
    assert_eq!(server.next_command(Duration::from_millis(200)), None, "asked although the user said no");
    browser.press("c", 67, "c");
    browser.wait_for("document.getElementById('sure').open");
    browser.press("Enter", 13, "\r");
    assert_eq!(server.next_command(wait), Some(Command::Calibrate));
    let mut reached = Vec::new();
    for _ in 0..11 {
        browser.press("Tab", 9, "");
        let outline = browser.text("getComputedStyle(document.activeElement).outlineStyle");
        let name = browser.text("document.activeElement.id || document.activeElement.dataset.key || document.activeElement.tagName");
        assert!(name == "BODY" || outline != "none", "{name} has no visible focus");
        reached.push(name);
    }
    for name in ["record", "calibrate", "self-check", "t", "?", "follow", "room", "parameters", "notes"] {
        assert!(reached.iter().any(|other| other == name), "{name} is not reached by Tab: {reached:?}");
    }
    browser.press("?", 191, "?");
    browser.wait_for("document.getElementById('help').open");
    browser.photograph("page-help");
    browser.press("Escape", 27, "");
    browser.value("document.activeElement.blur()");
}

fn losses_are_said(browser: &mut Chromium, feed: &Feed) {
    let text = "<img src=x onerror=alert(1)> is text";
    feed.server.publish(&Event::Note { t_s: 1.0, fault: true, text: text.to_owned() });
    browser.wait_for("document.getElementById('notes').textContent.includes('is text')");
    browser.wait_for("document.getElementById('alarm').textContent.includes('is text')");
    assert_eq!(browser.value("document.querySelectorAll('#notes img').length"), 0, "a note became markup");
    feed.server.publish(&Event::Camera {
        camera: 0,
        state: CameraState::Gone,
        rate_hz: 0.0,
        latency_ms: 0.0,
        missing: 0,
        dropped: 0,
        markers: vec![0.0; 4],
        reason: Some("Its stream has ended.".to_owned()),
    });
    browser.wait_for(
        "document.getElementById('notes').textContent.includes('cam1 is gone. Its stream has ended.')",
    );
    feed.orders.hide.store(true, Ordering::Relaxed);
    browser.wait_for(&format!("{WORD} === 'Lost'"));
    browser.wait_for("document.body.dataset.live === 'false'");
    browser.wait_for(&format!("{VALUES} === '–;–;–;–;–;–;–;–;–'"));
    assert!(browser.text("document.getElementById('tracking-why').textContent").contains("ago"));
    browser.photograph("page-lost");
    feed.orders.hide.store(false, Ordering::Relaxed);
    browser.wait_for(&format!("{WORD} === 'Reacquired'"));
    browser.wait_for(&format!("{WORD} === 'Tracking'"));
    feed.orders.pause.store(true, Ordering::Relaxed);
    let said = browser.wait_for(&format!("{WORD} === 'No frames'"));
    assert!(said < Duration::from_secs(5), "{said:?}");
    browser.wait_for("document.body.dataset.live === 'false'");
    the_view_turns(browser);
    feed.orders.pause.store(false, Ordering::Relaxed);
    browser.wait_for("document.body.dataset.live === 'true'");
}

/// By key, mouse and wheel; to be seen while the aircraft stands still in the picture.
fn the_view_turns(browser: &mut Chromium) {
    browser.value("document.getElementById('room').focus()");
    let picture = "document.getElementById('room').toDataURL()";
    std::thread::sleep(Duration::from_millis(500));
    let still = browser.text(picture);
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(browser.text(picture), still, "the view moves by itself");
    browser.value(&format!("window.before = {picture}"));
    let mut differs = |act: &dyn Fn(&mut Chromium)| {
        browser.value(&format!("window.before = {picture}"));
        act(browser);
        browser.wait_for(&format!("{picture} !== window.before"));
    };
    differs(&|browser| browser.press("ArrowLeft", 37, ""));
    differs(&|browser| browser.press("ArrowUp", 38, ""));
    differs(&|browser| browser.press("+", 187, "+"));
    differs(&|browser| browser.drag((600, 300), (680, 260)));
    browser.press("f", 70, "f");
    browser.wait_for("document.getElementById('follow').ariaPressed === 'true'");
    browser.press("0", 48, "0");
    browser.wait_for(&format!("{picture} === {still:?}"));
}

fn lost_connections_are_said_and_made_anew(browser: &mut Chromium, feed: Feed, address: SocketAddr) {
    drop(feed);
    let said = browser.wait_for(&format!("{WORD} === 'Connection lost'"));
    assert!(said < Duration::from_secs(5), "{said:?}");
    assert_eq!(browser.value("document.body.dataset.live"), "false");
    assert_eq!(browser.text(VALUES), "–;–;–;–;–;–;–;–;–");
    browser.press("s", 83, "s");
    browser.wait_for("document.getElementById('notes').textContent.includes('nothing was done')");
    std::thread::sleep(Duration::from_secs(1));
    browser.photograph("page-disconnected");
    let feed = Feed::start(address, 0.0);
    browser.wait_for(&format!("{WORD} === 'Tracking' && document.body.dataset.live === 'true'"));
    drop(feed);
}

/// What a page of another origin gets in a real browser.
fn no_other_page_may_listen(browser: &mut Chromium, address: SocketAddr) {
    let server = Server::start(address, Reach::Loopback, Limits::default()).unwrap();
    browser.call("Page.navigate", json!({ "url": "data:text/html,<title>other</title>" }));
    browser.wait_for("document.title === 'other'");
    let tries = format!(
        "new Promise(done => {{ const socket = new WebSocket('ws://{address}/events'); \
         socket.onopen = () => done('open'); socket.onerror = () => done('refused'); }})"
    );
    assert_eq!(browser.text(&tries), "refused");
    let reads = format!("fetch('http://{address}/').then(() => 'read', () => 'refused')");
    assert_eq!(browser.text(&reads), "refused");
    assert_eq!(server.listeners(), 0);
}
