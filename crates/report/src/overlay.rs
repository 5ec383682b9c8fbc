//! A frame of each camera with what was found in it.

use crate::marks::{Kind, Mark};
use crate::symbols::escaped;
use crate::{Figure, ReportError};
use base64::Engine;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::FilterType;
use mavsight_flight::Vehicle;
use mavsight_geometry::{Camera, ImageSize, Isometry3, Matrix2, Point3, Vector2, Vector3};
use mavsight_pipeline::TimedFrame;
use mavsight_pose::MarkerObservation;
use mavsight_session::RunResults;
use mavsight_vision::Frame;

/// Widest picture of a whole frame, and of a part of one.
const WHOLE_PX: u32 = 1280;
const PART_PX: u32 = 720;
const JPEG_QUALITY: u8 = 85;
/// Radius of a ring around a detection, and half a cross at a prediction, in the picture of the page.
const RING: f64 = 17.0;
const CROSS: f64 = 9.0;
/// The part of a frame that is shown reaches so many times as far as the balls.
const AROUND: f64 = 1.7;
/// It is not smaller than this share of the frame's height.
pub(crate) const LEAST_SHARE: f64 = 0.2;

/// The part of a frame around the aircraft, with the balls as they were detected, as the pose puts them, and the
/// body's axes.
pub(crate) struct Overlay {
    /// Which camera and when.
    pub title: String,
    /// SVG.
    pub markup: String,
    /// The part of the frame alone, as an `<img>`'s address.
    pub address: String,
    /// Balls detected.
    pub detected: usize,
}

/// The overlay of each camera that has a frame in which something of the aircraft was found.
pub(crate) fn overlays(vehicle: &Vehicle, results: &RunResults) -> Result<Vec<Overlay>, ReportError> {
    let cameras = results.rig.iter().flat_map(|rig| &rig.cameras).zip(&results.pictures).enumerate();
    let drawn = cameras.map(|(k, (camera, picture))| {
        let found = Found::of(k, &camera.camera, vehicle, results, |_| picture.t_ns);
        let title = format!("{} at {:.2} s", camera.name, picture.t_ns as f64 * 1e-9);
        found.map(|found| found.draw(&title, picture)).transpose()
    });
    Ok(drawn.collect::<Result<Vec<_>, ReportError>>()?.into_iter().flatten().collect())
}

/// What was found of the aircraft in a frame.
pub(crate) struct Found {
    pub detected: Vec<Vector2<f64>>,
    pub predicted: Vec<Vector2<f64>>,
    /// The origin and the ends of the axes.
    pub axes: Option<[Vector2<f64>; 4]>,
    /// Detections less predictions, each at its prediction, with the detection's covariance, px².
    pub residuals: Vec<Residual>,
}

/// How far a ball was detected from where the pose puts it.
pub(crate) struct Residual {
    pub predicted: Vector2<f64>,
    pub residual_px: Vector2<f64>,
    pub covariance_px2: Matrix2<f64>,
}

impl Found {
    /// What was found at a time of the common clock; a function gives the time at which the row of a pixel was exposed.
    pub(crate) fn of(
        k: usize,
        camera: &Camera,
        vehicle: &Vehicle,
        results: &RunResults,
        exposed_ns: impl Fn(&Vector2<f64>) -> i64,
    ) -> Option<Self> {
        let middle = Vector2::new(f64::from(camera.size.width_px), f64::from(camera.size.height_px)) / 2.0;
        // The middle of a ball's image is not the image of its centre.
        let pixel = |(in_body, radius_m): (Vector3<f64>, f64), t_ns: i64| {
            let in_world = pose_at(results, t_ns)? * Point3::from(in_body);
            Some(camera.project_ball(&in_world.coords, radius_m).ok()?.pixel)
        };
        // A row is exposed at a time that depends on where in the image it is.
        let seen = |ball: (Vector3<f64>, f64)| {
            let about = pixel(ball, exposed_ns(&middle))?;
            pixel(ball, exposed_ns(&about))
        };
        let place = |in_body: Vector3<f64>| seen((in_body, 0.0));
        let mut found = Self { detected: vec![], predicted: vec![], axes: None, residuals: vec![] };
        for (marker, ball) in vehicle.marker.iter().enumerate() {
            // The poses are of the markers as the flight has shown them, where it has.
            let built = results.body.get(marker).map(|b| (b.position_m, b.diameter_m));
            let (position_m, diameter_m) = built.unwrap_or((ball.position_m.into(), ball.diameter_m));
            let predicted = seen((position_m, diameter_m / 2.0));
            let t_ns = exposed_ns(predicted.as_ref().unwrap_or(&middle));
            let own = near(&results.markers, t_ns, |o| o.t_ns).iter();
            let own = own.filter(|o| o.camera == k && o.marker == marker);
            let detected = detection_at(own, t_ns);
            if let Some((predicted, (pixel, covariance_px2))) = predicted.zip(detected) {
                let residual_px = pixel - predicted;
                found.residuals.push(Residual { predicted, residual_px, covariance_px2 });
            }
            found.predicted.extend(predicted);
            found.detected.extend(detected.map(|d| d.0));
        }
        let reach_m = vehicle.marker.iter().map(|m| Vector3::from(m.position_m).norm()).fold(0.0, f64::max);
        let end = |k: usize| place(Vector3::ith(k, reach_m));
        if let [Some(origin), Some(x), Some(y), Some(z)] = [place(Vector3::zeros()), end(0), end(1), end(2)] {
            found.axes = Some([origin, x, y, z]);
        }
        (!found.detected.is_empty() || !found.predicted.is_empty()).then_some(found)
    }

    fn draw(&self, title: &str, picture: &TimedFrame) -> Result<Overlay, ReportError> {
        let part = self.part(picture.frame.size);
        let address = part_of(&picture.frame, part)?;
        let scale = f64::from(PART_PX) / part.width;
        // The middle of the first pixel is half a pixel from the corner.
        let at = |p: &Vector2<f64>| [scale * (p.x + 0.5 - part.left), scale * (p.y + 0.5 - part.top)];
        let marks: String = self.marks(at, 1.0).iter().map(Mark::svg).collect();
        let side = PART_PX;
        let label = format!(
            "{}: {} balls detected, {} as the pose puts them, and the body's axes",
            escaped(title),
            self.detected.len(),
            self.predicted.len()
        );
        let markup = format!(
            "<svg role=\"img\" aria-label=\"{label}\" class=\"overlay\" viewBox=\"0 0 {side} {side}\"><image width=\"{side}\" \
             height=\"{side}\" href=\"{address}\"/>{marks}<text class=\"mark\" x=\"14\" y=\"34\">{}</text></svg>",
            escaped(title)
        );
        Ok(Overlay { title: title.to_owned(), markup, address, detected: self.detected.len() })
    }

    /// Axes, rings and crosses at places of a picture, so many times as large as in the page.
    pub(crate) fn marks(&self, at: impl Fn(&Vector2<f64>) -> [f64; 2], scale: f64) -> Vec<Mark> {
        let mut marks = Vec::new();
        if let Some([origin, ends @ ..]) = &self.axes {
            for (k, (end, name)) in ends.iter().zip(["x", "y", "z"]).enumerate() {
                let [x, y] = at(end);
                marks.push(Mark::Lines(Kind::Axis(k), vec![vec![at(origin), [x, y]]]));
                marks.push(Mark::Words([x + 8.0 * scale, y + 8.0 * scale], name.to_owned()));
            }
        }
        marks.extend(self.detected.iter().map(|p| Mark::Ring(Kind::Detected, at(p), RING * scale)));
        marks.extend(self.predicted.iter().map(|p| Mark::cross(Kind::Predicted, at(p), CROSS * scale)));
        marks
    }

    /// A square around all that was found.
    pub(crate) fn part(&self, size: ImageSize) -> Part {
        self.part_of_width(size, 0.0)
    }

    /// The same, not smaller than said.
    pub(crate) fn part_of_width(&self, size: ImageSize, least_px: f64) -> Part {
        let all = || self.detected.iter().chain(&self.predicted).chain(self.axes.iter().flatten());
        let bounds =
            |value: fn(&Vector2<f64>) -> f64| crate::chart::bounds(all().map(value)).unwrap_or_default();
        let ((left, right), (top, bottom)) = (bounds(|p| p.x), bounds(|p| p.y));
        let most = f64::from(size.width_px.min(size.height_px));
        let around = AROUND * f64::max(right - left, bottom - top);
        let width = around.max(LEAST_SHARE * most).max(least_px).min(most).round();
        let corner =
            |middle: f64, side: u32| (middle - width / 2.0).clamp(0.0, f64::from(side) - width).round();
        Part {
            left: corner(0.5 * (left + right), size.width_px),
            top: corner(0.5 * (top + bottom), size.height_px),
            width,
        }
    }
}

/// A square part of a frame, in pixels from the corner of the first.
#[derive(Clone, Copy)]
pub(crate) struct Part {
    pub left: f64,
    pub top: f64,
    pub width: f64,
}

/// The pose at a time, between those before and after it.
pub(crate) fn pose_at(results: &RunResults, t_ns: i64) -> Option<Isometry3<f64>> {
    let known = near(&results.poses, t_ns, |p| p.t_ns).iter();
    let known = known.filter_map(|p| Some((p.t_ns, p.estimate.as_ref().ok()?.world_from_body)));
    let (before, after) = around(known, t_ns)?;
    let part = part_between(before.0, after.0, t_ns);
    Some(before.1.try_lerp_slerp(&after.1, part, 1e-9).unwrap_or(before.1))
}

/// Where a marker was detected at a time, between the detections before and after it, with the covariance of the nearer.
fn detection_at<'a>(
    own: impl Iterator<Item = &'a MarkerObservation>,
    t_ns: i64,
) -> Option<(Vector2<f64>, Matrix2<f64>)> {
    let (before, after) = around(own.map(|o| (o.t_ns, (o.pixel, o.covariance_px2))), t_ns)?;
    let part = part_between(before.0, after.0, t_ns);
    let nearer = if part < 0.5 { before.1.1 } else { after.1.1 };
    Some((before.1.0.lerp(&after.1.0, part), nearer))
}

/// Longest time between two instants between which something is taken as on a line.
const NEAR_NS: i64 = 100_000_000;

/// Those of a list in order of time that are near a time.
pub(crate) fn near<T>(all: &[T], t_ns: i64, time_ns: impl Fn(&T) -> i64) -> &[T] {
    let from = all.partition_point(|item| time_ns(item) <= t_ns - NEAR_NS);
    let to = from + all[from..].partition_point(|item| time_ns(item) < t_ns + NEAR_NS);
    &all[from..to]
}

/// The last of them up to a time and the first from it on, of those that are near it.
fn around<T: Clone>(all: impl Iterator<Item = (i64, T)>, t_ns: i64) -> Option<((i64, T), (i64, T))> {
    let (mut before, mut after) = (None::<(i64, T)>, None::<(i64, T)>);
    for item in all {
        if item.0 <= t_ns && before.as_ref().is_none_or(|b| item.0 > b.0) {
            before = Some(item.clone());
        }
        if item.0 >= t_ns && after.as_ref().is_none_or(|a| item.0 < a.0) {
            after = Some(item);
        }
    }
    // Clocks are rounded: a frame at either end may be a moment outside.
    Some((before.clone().or_else(|| after.clone())?, after.or(before)?))
}

fn part_between(from_ns: i64, to_ns: i64, t_ns: i64) -> f64 {
    if to_ns > from_ns { (t_ns - from_ns) as f64 / (to_ns - from_ns) as f64 } else { 0.0 }
}

/// Figure 4: the object from the first camera; figure 6: the flight's path over a frame of each camera.
pub(crate) fn pictures(results: &RunResults, close_ups: &[Overlay]) -> Result<Vec<Figure>, ReportError> {
    let mut figures = Vec::new();
    let Some(rig) = &results.rig else { return Ok(figures) };
    if let Some(first) = close_ups.first() {
        let caption = format!("Figure 4: the observed object, from a frame of {}.", first.title);
        figures.push(Figure::new(caption, format!("<img alt=\"\" src=\"{}\">", first.address)));
    }
    for (camera, picture) in rig.cameras.iter().zip(&results.pictures) {
        let seen = results.poses.iter().map(|p| {
            let place = p.estimate.as_ref().ok()?.world_from_body.translation.vector;
            Some(camera.camera.project(&place).ok()?.pixel)
        });
        let seen: Vec<Option<Vector2<f64>>> = seen.collect();
        let t_s = picture.t_ns as f64 * 1e-9;
        let caption =
            format!("Figure 6: path of the body origin over the frame of {} at {t_s:.2} s.", camera.name);
        figures.push(Figure::new(caption, with_path(&whole(&picture.frame)?, picture.frame.size, &seen)));
    }
    Ok(figures)
}

/// A picture with a white line on a black one over it, broken where there is no point.
fn with_path(address: &str, size: ImageSize, points: &[Option<Vector2<f64>>]) -> String {
    let (mut path, mut last) = (String::new(), None::<Vector2<f64>>);
    for point in points {
        let Some(p) = point else {
            last = None;
            continue;
        };
        // Steps of less than half a pixel do not show.
        if last.is_none_or(|last| (p - last).norm() > 0.5) {
            // The middle of the first pixel is half a pixel from the corner.
            path += &format!("{}{:.1} {:.1}", if last.is_some() { "L" } else { "M" }, p.x + 0.5, p.y + 0.5);
            last = Some(*p);
        }
    }
    let line = |color: &str, width: f64| {
        format!("<path d=\"{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\"/>")
    };
    format!(
        "<svg role=\"img\" viewBox=\"0 0 {0} {1}\"><image width=\"{0}\" height=\"{1}\" href=\"{address}\"/>{2}{3}</svg>",
        size.width_px,
        size.height_px,
        line("#000", 3.5),
        line("#fff", 1.8)
    )
}

fn whole(frame: &Frame) -> Result<String, ReportError> {
    let ImageSize { width_px, height_px } = frame.size;
    jpeg(frame.to_rgb(), width_px, height_px, WHOLE_PX)
}

fn part_of(frame: &Frame, part: Part) -> Result<String, ReportError> {
    let width = part.width as u32;
    jpeg(part.rgb(frame), width, width, PART_PX)
}

impl Part {
    /// Its pixels.
    pub(crate) fn rgb(&self, frame: &Frame) -> Vec<u8> {
        let [left, top, width] = [self.left, self.top, self.width].map(|v| v as usize);
        let mut rgb = vec![0; 3 * width * width];
        for (row, y) in rgb.chunks_exact_mut(3 * width.max(1)).zip(top..) {
            frame.rgb_row(y, left, left + width, row);
        }
        rgb
    }
}

/// A picture as the address of an image, not wider than said.
fn jpeg(rgb: Vec<u8>, width: u32, height: u32, most: u32) -> Result<String, ReportError> {
    let mut image = image::RgbImage::from_raw(width, height, rgb).ok_or(ReportError::Picture)?;
    if width > most {
        let height = (u64::from(height) * u64::from(most) / u64::from(width)).max(1) as u32;
        image = image::imageops::resize(&image, most, height, FilterType::Triangle);
    }
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
        .encode_image(&image)
        .map_err(|_| ReportError::Picture)?;
    Ok(format!("data:image/jpeg;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_two_instants_a_ball_is_on_the_line_and_far_from_them_nowhere() {
        let seen = |t_ms: i64, u: f64| MarkerObservation {
            t_ns: t_ms * 1_000_000,
            camera: 0,
            marker: 0,
            pixel: Vector2::new(u, 10.0),
            covariance_px2: mavsight_geometry::Matrix2::identity(),
        };
        let all = [seen(0, 100.0), seen(30, 130.0), seen(60, 190.0)];
        let at = |t_ms: i64| {
            let t_ns = t_ms * 1_000_000;
            detection_at(near(&all, t_ns, |o| o.t_ns).iter(), t_ns).map(|p| p.0.x)
        };
        assert_eq!((at(30), at(40), at(61)), (Some(130.0), Some(150.0), Some(190.0)));
        assert_eq!(at(500), None);
    }

    fn nothing() -> Found {
        Found { detected: vec![], predicted: vec![], axes: None, residuals: vec![] }
    }

    #[test]
    fn the_part_of_a_frame_is_a_square_within_it() {
        let size = ImageSize { width_px: 64, height_px: 48 };
        let found = |x: f64, y: f64| Found { detected: vec![Vector2::new(x, y)], ..nothing() };
        for (x, y) in [(0.0, 0.0), (63.0, 47.0), (-500.0, 20.0), (30.0, 20.0)] {
            let Part { left, top, width } = found(x, y).part(size);
            assert!(left >= 0.0 && top >= 0.0 && width >= 1.0, "{left} {top} {width}");
            assert!(left + width <= 64.0 && top + width <= 48.0, "{left} {top} {width}");
        }
        let wide = Found { detected: vec![Vector2::zeros(), Vector2::new(60.0, 0.0)], ..nothing() };
        assert_eq!(wide.part(size).width, 48.0);
    }

    #[test]
    fn a_large_picture_is_made_smaller_and_one_of_other_pixels_refused() {
        let address = jpeg(vec![90; 3 * 40 * 20], 40, 20, 10).expect("a picture");
        let bytes = address.strip_prefix("data:image/jpeg;base64,").expect("its address");
        let bytes = base64::engine::general_purpose::STANDARD.decode(bytes).expect("its bytes");
        let image = image::load_from_memory(&bytes).expect("a picture");
        assert_eq!((image.width(), image.height()), (10, 5));
        assert!(matches!(jpeg(vec![0; 5], 2, 2, 10), Err(ReportError::Picture)));
    }
}
