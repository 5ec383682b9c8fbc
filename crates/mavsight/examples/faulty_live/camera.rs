//! A camera that films the loop over and over, with faults.

use crate::faults::{Fault, Kind};
use crate::film::{Film, INTERVAL_NS, RATE_HZ, SharedFilm, time_ns};
use crate::log::Log;
use crate::spoil::{Bar, Spoiler};
use mavsight::geometry::Vector2;
use mavsight::live::{CameraSetup, FlightClock, Interrupt, Next, Source};
use mavsight::pose::CameraClock;
use mavsight::random::Random;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Longest sleep between looks at whether somebody wants the wait to end.
const CHECK: Duration = Duration::from_millis(20);
/// Time between frames that wait in one line.
const APART_NS: i64 = 1_000_000;

/// A frame on its way.
struct Shot {
    arrives_ns: i64,
    stamp_ns: i64,
    /// Its own number, and that of the frame whose picture it shows.
    number: u64,
    shows: u64,
    fault: Option<usize>,
    /// Whether its stamp is right and all balls are as they were filmed.
    is_well: bool,
}

/// What one camera films, whoever has it open.
struct Camera {
    index: usize,
    film: SharedFilm,
    faults: Arc<Vec<Fault>>,
    log: Arc<Log>,
    random: Random,
    spoiler: Spoiler,
    /// The frame that is filmed next, and those that have not arrived yet.
    next: u64,
    coming: Vec<Shot>,
    /// When the last frame arrived that others cannot overtake.
    arrived_ns: i64,
    /// The latest number that has arrived.
    latest: Option<u64>,
    /// The picture of the frame before the next.
    shown: u64,
}

impl Camera {
    fn fault_at(&self, frame: u64) -> Option<usize> {
        let at = self.faults.partition_point(|f| f.frames.1 <= frame);
        (at < self.faults.len() && self.faults[at].is_at(self.index, frame)).then_some(at)
    }

    /// Films the next frame: puts it among those to come, if it is to come.
    fn film_next(&mut self) {
        let number = self.next;
        self.next += 1;
        let (t_ns, at) = (time_ns(number), self.fault_at(number));
        let mut shot =
            Shot { arrives_ns: t_ns, stamp_ns: t_ns, number, shows: number, fault: at, is_well: true };
        let faults = Arc::clone(&self.faults);
        let Some(fault) = at.map(|k| &faults[k]) else {
            self.in_line(shot);
            return;
        };
        let share = 0.1 + 0.8 * fault.strength;
        match fault.kind {
            Kind::Silent | Kind::Unplugged => return fault.begins(number),
            Kind::Dropped if self.random.uniform() < share => return fault.begins(number),
            Kind::Late => {
                let part = if fault.is_other_way { self.random.uniform() } else { 1.0 };
                shot.arrives_ns += (part * (0.02 + 0.4 * fault.strength) * 1e9) as i64;
                fault.begins(number);
            }
            Kind::Reordered if number.is_multiple_of(2) && self.random.uniform() < share => {
                shot.arrives_ns += INTERVAL_NS + 3_000_000;
                fault.begins(number);
                self.coming.push(shot);
                return;
            }
            Kind::Duplicated if self.random.uniform() < share => {
                fault.begins(number);
                if fault.is_other_way {
                    // The frame before once more, in place of this one.
                    (shot.shows, shot.is_well) = (self.shown, false);
                } else {
                    let again = Shot { arrives_ns: t_ns + 5_000_000, is_well: false, ..shot };
                    self.coming.push(again);
                }
            }
            Kind::Frozen => {
                (shot.shows, shot.is_well) = (fault.frames.0.saturating_sub(1), false);
                fault.begins(number);
            }
            Kind::ClockStep => {
                (shot.stamp_ns, shot.is_well) = (t_ns + fault.step_ns(), false);
                fault.begins(number);
            }
            Kind::Hidden => {
                shot.is_well = !Bar::of(fault, &self.film, self.index, number).touches_a_ball;
                if !shot.is_well {
                    fault.begins(number);
                }
            }
            Kind::Dark | Kind::Overexposed | Kind::Noisy | Kind::Blurred => {
                shot.is_well = false;
                fault.begins(number);
            }
            Kind::Dropped | Kind::Reordered | Kind::Duplicated => {}
        }
        self.in_line(shot);
    }

    /// A frame that comes behind those before it.
    fn in_line(&mut self, mut shot: Shot) {
        shot.arrives_ns = shot.arrives_ns.max(self.arrived_ns + APART_NS);
        (self.arrived_ns, self.shown) = (shot.arrives_ns, shot.shows);
        self.coming.push(shot);
    }

    /// The frame that arrives next.
    fn take_next(&mut self) -> Shot {
        loop {
            let first = (0..self.coming.len()).min_by_key(|k| self.coming[*k].arrives_ns);
            // None that is filmed later arrives before it is filmed.
            if let Some(first) = first.filter(|k| self.coming[*k].arrives_ns <= time_ns(self.next)) {
                return self.coming.swap_remove(first);
            }
            self.film_next();
        }
    }

    /// Leaves out what was filmed while nobody had the camera open.
    fn skip_to(&mut self, now_ns: i64) {
        self.coming.retain(|shot| shot.arrives_ns > now_ns);
        self.next = self.next.max((now_ns as f64 * 1e-9 * RATE_HZ).ceil().max(0.0) as u64);
    }

    fn picture(&mut self, shot: &Shot) -> mavsight::vision::Frame {
        let mut frame = self.film.frame(self.index, shot.shows).clone();
        if let Some(fault) = shot.fault.map(|k| &self.faults[k]) {
            let film: &Film = &self.film;
            let bar = (fault.kind == Kind::Hidden).then(|| Bar::of(fault, film, self.index, shot.number));
            self.spoiler.spoil(fault, bar, &mut frame);
        }
        frame
    }

    /// Notes a frame that is handed over now.
    fn hand_over(&mut self, shot: &Shot, now_ns: i64) {
        let is_in_order = self.latest.is_none_or(|latest| shot.number > latest);
        self.latest = self.latest.max(Some(shot.number));
        let is_in_time = shot.arrives_ns - time_ns(shot.number) <= INTERVAL_NS;
        if shot.is_well && is_in_order && is_in_time {
            let is_due = now_ns - shot.arrives_ns <= INTERVAL_NS / 2;
            self.log.arrived(self.index, shot.number, is_due);
        }
    }
}

fn locked(camera: &Mutex<Camera>) -> MutexGuard<'_, Camera> {
    camera.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The camera while it is open.
struct Open {
    camera: Arc<Mutex<Camera>>,
    clock: FlightClock,
    ends: Arc<AtomicBool>,
}

impl Open {
    /// Waits for a time; false where the wait is to end before.
    fn waits_until(&self, t_ns: i64) -> bool {
        loop {
            if self.ends.load(Ordering::Relaxed) {
                return false;
            }
            let left = self.clock.until(t_ns);
            if left.is_zero() {
                return true;
            }
            std::thread::sleep(left.min(CHECK));
        }
    }
}

impl Source for Open {
    fn next(&mut self) -> Next {
        let shared = Arc::clone(&self.camera);
        let mut camera = locked(&shared);
        let now = (self.clock.now_ns() as f64 * 1e-9 * RATE_HZ) as u64;
        let is_pulled =
            |frame: u64| camera.fault_at(frame).is_some_and(|k| camera.faults[k].kind == Kind::Unplugged);
        if is_pulled(now) {
            return Next::End("the cable is off".into());
        }
        // What comes before the cable is pulled still arrives.
        let pulled_ns = (camera.next..camera.next + 2).find(|n| is_pulled(*n)).map(time_ns);
        let shot = camera.take_next();
        if let Some(pulled_ns) = pulled_ns.filter(|t_ns| *t_ns < shot.arrives_ns) {
            camera.coming.push(shot);
            self.waits_until(pulled_ns);
            return Next::End("the cable is off".into());
        }
        let frame = Arc::new(camera.picture(&shot));
        if !self.waits_until(shot.arrives_ns) {
            camera.coming.push(shot);
            return Next::End("it was asked to end".into());
        }
        camera.hand_over(&shot, self.clock.now_ns());
        Next::Frame(shot.stamp_ns, frame)
    }

    fn interrupt(&self) -> Option<Interrupt> {
        let ends = Arc::clone(&self.ends);
        Some(Arc::new(move || ends.store(true, Ordering::Relaxed)))
    }
}

/// A camera for a flight, which is opened again as cameras are.
pub(crate) fn setup(
    index: usize,
    film: &SharedFilm,
    faults: &Arc<Vec<Fault>>,
    log: &Arc<Log>,
    seed: u64,
) -> CameraSetup {
    let camera = Arc::new(Mutex::new(Camera {
        index,
        film: Arc::clone(film),
        faults: Arc::clone(faults),
        log: Arc::clone(log),
        random: Random::new(seed, 1 + index as u64),
        spoiler: Spoiler::new(Random::new(seed, 11 + index as u64)),
        next: 0,
        coming: Vec::new(),
        arrived_ns: i64::MIN / 2,
        latest: None,
        shown: 0,
    }));
    let open = move |clock: FlightClock| {
        let mut own = locked(&camera);
        let now_ns = clock.now_ns();
        own.skip_to(now_ns);
        let now = (now_ns as f64 * 1e-9 * RATE_HZ).max(0.0) as u64;
        if let Some(fault) = own.fault_at(now).map(|k| &own.faults[k])
            && fault.kind == Kind::Unplugged
        {
            fault.begins(fault.frames.0);
            return Err("there is no such device".into());
        }
        drop(own);
        let ends = Arc::new(AtomicBool::new(false));
        Ok(Box::new(Open { camera: Arc::clone(&camera), clock, ends }) as Box<dyn Source>)
    };
    let name = film.rig.cameras[index].name.clone();
    CameraSetup {
        name,
        open: Box::new(open),
        reopens: true,
        clock: CameraClock::default(),
        readout: Vector2::y(),
    }
}
