//! The path of a flight in space, as SVG that the page's script turns.

use crate::Figure;
use crate::digits::short;
use mavsight_geometry::Vector3;
use mavsight_pose::Motion;

const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 560.0;
/// Of the view before anybody turns it: from where the first half of a right angle lies behind the viewer.
const AZIMUTH_RAD: f64 = -0.6;
const ELEVATION_RAD: f64 = 0.45;
/// Room for words between the box and the edge of the drawing.
const MARGIN_PX: f64 = 44.0;
/// Points of the path that are drawn, and places at which the aircraft is drawn.
const MOST_POINTS: usize = 700;
const AIRCRAFT: usize = 14;
/// Half the span of the drawn aircraft, of half the box's diagonal.
const SPAN: f64 = 0.07;
/// A box is not thinner than this share of its longest side.
const LEAST_SIDE: f64 = 0.15;

/// The box around the path, from which all is drawn.
struct Room {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

type Line = Vec<Vector3<f64>>;

/// The path with its shadow on the floor and the aircraft at some of its places; none of a motion without samples.
pub(crate) fn path(motion: &Motion) -> Option<Figure> {
    let all: Vec<Vector3<f64>> =
        motion.samples.iter().map(|s| s.world_from_body.translation.vector).collect();
    let room = Room::around(&all)?;
    let every = all.len().div_ceil(MOST_POINTS).max(1);
    // A gap in the motion breaks the path.
    let gap_ns = (motion.longest_step_s() * 1e9) as i64;
    let kept: Vec<usize> = (0..all.len()).filter(|k| k % every == 0 || k + 1 == all.len()).collect();
    let unbroken = |a: &usize, b: &usize| {
        motion.samples[*a..=*b].windows(2).all(|pair| pair[1].t_ns - pair[0].t_ns <= gap_ns)
    };
    let lines: Vec<Line> =
        kept.chunk_by(unbroken).map(|part| part.iter().map(|k| all[*k]).collect()).collect();
    let shadow: Vec<Line> = lines.iter().map(|line| line.iter().map(|p| room.below(p)).collect()).collect();
    let mut svg = room.line("grid", &room.floor()) + &room.line("shadow", &shadow);
    svg += &room.line("drop", &[vec![all[0], room.below(&all[0])]]);
    svg += &room.line("path", &lines);
    svg += &room.line("craft", &aircraft(motion, SPAN * room.reach()));
    let last = all[all.len() - 1];
    svg += &room.scales();
    svg += &(room.dot("start", &all[0]) + &room.dot("end", &last));
    svg += &(room.text("start", &all[0]) + &room.text("end", &last)).replace("<text", "<text dy=\"-14\"");
    let size = room.high - room.low;
    let label = format!(
        "Path in space, {} by {} by {} m: turn it with the mouse, a finger or the arrow keys",
        short(size.x),
        short(size.y),
        short(size.z)
    );
    let corners = [room.low, room.high].map(|p| format!("{:.5} {:.5} {:.5}", p.x, p.y, p.z)).join(" ");
    let markup = format!(
        "<svg role=\"application\" tabindex=\"0\" aria-label=\"{label}\" class=\"space\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
         data-view=\"{corners} {MARGIN_PX} {AZIMUTH_RAD} {ELEVATION_RAD}\">{svg}</svg>"
    );
    Some(Figure {
        markup,
        caption: "Path in 3-D with its shadow on the floor of the box; lengths in m.".to_owned(),
        ..Figure::default()
    })
}

/// Nose and wings of the aircraft at some places.
fn aircraft(motion: &Motion, half: f64) -> Vec<Line> {
    let every = (motion.samples.len() / AIRCRAFT).max(1);
    let drawn = motion.samples.iter().step_by(every).flat_map(|s| {
        let at =
            |v: Vector3<f64>| s.world_from_body.translation.vector + s.world_from_body.rotation * (half * v);
        let (nose, right) = (at(Vector3::x()), at(Vector3::y()));
        [vec![at(Vector3::zeros()), nose], vec![at(-Vector3::y()), right]]
    });
    drawn.collect()
}

impl Room {
    fn around(path: &[Vector3<f64>]) -> Option<Self> {
        let first = path.first()?;
        let (low, high) = path.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
        let least = LEAST_SIDE * (high - low).max().max(1e-3);
        let more = (high - low).map(|side| 0.5 * (least - side).max(0.1 * side));
        Some(Self { low: low - more, high: high + more })
    }

    fn middle(&self) -> Vector3<f64> {
        0.5 * (self.low + self.high)
    }

    fn reach(&self) -> f64 {
        0.5 * (self.high - self.low).norm()
    }

    fn below(&self, p: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(p.x, p.y, self.low.z)
    }

    /// The floor's lines, at round lengths, and the upright edge.
    fn floor(&self) -> Vec<Line> {
        let (low, high) = (self.low, self.high);
        let step = round_step((high - low).xy().max());
        let mut lines = vec![vec![low, Vector3::new(low.x, low.y, high.z)]];
        for x in [low.x, high.x].into_iter().chain(marks(low.x, high.x, step)) {
            lines.push(vec![Vector3::new(x, low.y, low.z), Vector3::new(x, high.y, low.z)]);
        }
        for y in [low.y, high.y].into_iter().chain(marks(low.y, high.y, step)) {
            lines.push(vec![Vector3::new(low.x, y, low.z), Vector3::new(high.x, y, low.z)]);
        }
        lines
    }

    /// Names of the axes and lengths along them.
    fn scales(&self) -> String {
        let (low, high, middle) = (self.low, self.high, self.middle());
        let beyond = 0.12 * self.reach();
        let step = round_step((high - low).max());
        let decimals = if step < 0.1 { 2 } else { 1 };
        let mut out = String::from("<g class=\"scale\">");
        for x in marks(low.x, high.x, step) {
            out += &self.text(&format!("{x:.decimals$}"), &Vector3::new(x, low.y - 0.5 * beyond, low.z));
        }
        for y in marks(low.y, high.y, step) {
            out += &self.text(&format!("{y:.decimals$}"), &Vector3::new(high.x + 0.5 * beyond, y, low.z));
        }
        for z in marks(low.z, high.z, step) {
            out += &self.text(&format!("{z:.decimals$}"), &Vector3::new(low.x, low.y, z));
        }
        out += "</g>";
        out += &self.text("X", &Vector3::new(middle.x, low.y - 1.3 * beyond, low.z));
        out += &self.text("Y", &Vector3::new(high.x + 1.3 * beyond, middle.y, low.z));
        out + &self.text("Z", &Vector3::new(low.x, low.y, high.z + 0.4 * beyond))
    }

    /// A point on the page, with the box as large as it may be; the script has the same lines.
    fn pixel(&self, p: &Vector3<f64>) -> [f64; 2] {
        let corner =
            |k: usize, axis: usize| if k >> axis & 1 == 1 { self.high[axis] } else { self.low[axis] };
        let corners = (0..8).map(|k| self.turned(&Vector3::new(corner(k, 0), corner(k, 1), corner(k, 2))));
        let [across, up] =
            corners.fold([1e-9_f64; 2], |[x, y], [across, up]| [x.max(across.abs()), y.max(up.abs())]);
        let scale = ((0.5 * WIDTH - MARGIN_PX) / across).min((0.5 * HEIGHT - MARGIN_PX) / up);
        let [x, y] = self.turned(p);
        [0.5 * WIDTH + scale * x, 0.5 * HEIGHT - scale * y]
    }

    /// A point from the middle of the box across the page and up.
    fn turned(&self, p: &Vector3<f64>) -> [f64; 2] {
        let v = p - self.middle();
        let ((sin_a, cos_a), (sin_e, cos_e)) = (AZIMUTH_RAD.sin_cos(), ELEVATION_RAD.sin_cos());
        [v.x * cos_a + v.y * sin_a, v.z * cos_e + (v.y * cos_a - v.x * sin_a) * sin_e]
    }

    fn line(&self, class: &str, lines: &[Line]) -> String {
        let places = |line: &Line| {
            line.iter().map(|p| format!("{:.4} {:.4} {:.4}", p.x, p.y, p.z)).collect::<Vec<_>>().join(" ")
        };
        let drawn = |line: &Line| {
            let points: Vec<String> =
                line.iter().map(|p| self.pixel(p)).map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
            format!("M{}", points.join("L"))
        };
        let data: Vec<String> = lines.iter().map(places).collect();
        let path: String = lines.iter().map(drawn).collect();
        format!("<path class=\"{class}\" data-p=\"{}\" d=\"{path}\"/>", data.join(";"))
    }

    fn dot(&self, class: &str, p: &Vector3<f64>) -> String {
        let [x, y] = self.pixel(p);
        let data = format!("{:.4} {:.4} {:.4}", p.x, p.y, p.z);
        format!("<circle class=\"{class}\" r=\"5\" data-p=\"{data}\" cx=\"{x:.1}\" cy=\"{y:.1}\"/>")
    }

    fn text(&self, text: &str, p: &Vector3<f64>) -> String {
        let [x, y] = self.pixel(p);
        let data = format!("{:.4} {:.4} {:.4}", p.x, p.y, p.z);
        format!("<text data-p=\"{data}\" x=\"{x:.1}\" y=\"{y:.1}\">{text}</text>")
    }
}

/// About a third of a length: 1, 2 or 5 times a power of ten.
fn round_step(length: f64) -> f64 {
    let rough = (length / 3.0).max(1e-6);
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0].into_iter().rev().find(|step| step * power <= rough).unwrap_or(1.0);
    step * power
}

fn marks(low: f64, high: f64, step: f64) -> impl Iterator<Item = f64> {
    let first = (low / step).ceil() as i64;
    (first..).map(move |k| k as f64 * step).take_while(move |value| *value <= high).take(20)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{Isometry3, UnitQuaternion};
    use mavsight_pose::{Doubts, MotionCovariance, MotionSample};

    fn motion(times_ms: &[i64]) -> Motion {
        let sample = |t_ms: &i64| MotionSample {
            t_ns: t_ms * 1_000_000,
            world_from_body: Isometry3::from_parts(
                Vector3::new(*t_ms as f64 * 1e-3, 0.0, 1.5).into(),
                UnitQuaternion::identity(),
            ),
            velocity_in_body_m_s: Vector3::x(),
            rates_rad_s: Vector3::zeros(),
            specific_force_m_s2: Vector3::zeros(),
            angular_acceleration_rad_s2: Vector3::zeros(),
            covariance: MotionCovariance::default(),
        };
        Motion {
            samples: times_ms.iter().map(sample).collect(),
            unknown_ns: vec![],
            doubts: Doubts::default(),
            translation_bandwidth_hz: 10.0,
            rotation_bandwidth_hz: 10.0,
            sample_interval_s: 0.03,
        }
    }

    #[test]
    fn all_is_within_the_drawing_and_a_gap_breaks_the_path() {
        let svg = path(&motion(&[0, 30, 60, 900, 930, 960])).expect("a path").markup;
        let line = svg.split("class=\"path\"").nth(1).expect("the path");
        let d = line.split(" d=\"").nth(1).and_then(|d| d.split('"').next()).expect("its places");
        assert_eq!((d.matches('M').count(), d.matches('L').count()), (2, 4), "{d}");
        let numbers: Vec<f64> = d.split(['M', 'L', ' ']).filter_map(|n| n.parse().ok()).collect();
        let is_inside = |xy: &[f64]| (0.0..WIDTH).contains(&xy[0]) && (0.0..HEIGHT).contains(&xy[1]);
        assert!(numbers.len() == 12 && numbers.chunks(2).all(is_inside), "{numbers:?}");
        assert!(svg.contains(">start<") && svg.contains(">end<") && !svg.contains("NaN"));
    }

    #[test]
    fn a_flight_at_one_place_is_drawn_and_none_is_not() {
        assert!(!path(&motion(&[0])).expect("a place").markup.contains("NaN"));
        assert!(path(&motion(&[])).is_none());
    }
}
