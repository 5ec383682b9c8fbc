//! A film of what was found: the cameras side by side, with marks, path, residuals and time.

use crate::ReportError;
use crate::ellipse::{ellipse_95, typical_enlargement};
use crate::marks::{Kind, LETTER_PX, Mark, write_words};
use crate::overlay::{Found, LEAST_SHARE, near, pose_at};
use mavsight_flight::Vehicle;
use mavsight_geometry::{Camera, ImageSize, Vector2};
use mavsight_pose::{CameraClock, RigCamera};
use mavsight_session::RunResults;
use mavsight_vision::Frame;
use rayon::prelude::*;
use tiny_skia::{FilterQuality, Pixmap, PixmapPaint, Transform};

/// The cameras' pictures together are no larger: what every player shows.
const MOST_PX: [f64; 2] = [1920.0, 1080.0];
/// A small picture is enlarged so much at most: beyond, it shows its pixels.
const MOST_SCALE: f64 = 2.0;
/// Below the pictures: the legend and the room around it.
const LEGEND_PX: u32 = 32;
const MARGIN_PX: i32 = 6;
/// Marks are of the page's size in a picture of this width.
const PAGE_WIDTH_PX: f64 = 1440.0;
/// Side of the close-up, of the picture's shorter side.
const CLOSE_UP: f64 = 0.4;
/// Marks of a close-up, of the page's size.
const CLOSE_UP_MARKS: f64 = 0.6;
/// A path's points are not nearer together, px of the film.
const STEP_PX: f64 = 1.5;

/// A frame of a camera, where its time by the common clock is known.
#[derive(Debug, Clone, Copy)]
pub struct FilmShot<'a> {
    /// The frame.
    pub frame: &'a Frame,
    /// Its time stamp by the camera's own clock.
    pub stamp_ns: i64,
    /// Unit vector in the image along which a rolling shutter goes.
    pub readout: Vector2<f64>,
}

/// Draws frames of all cameras with what was found in them.
///
/// White rings: balls as detected. Yellow crosses: balls as the pose puts them. Red, green, blue: the body's x, y and z axis.
/// White line: the body origin so far. In the close-up of the aircraft, pink and enlarged by a factor that the picture says: at
/// each cross its residual with the 95 % ellipse of the detection's covariance, and at the body origin the 95 % ellipse of the
/// pose's.
pub struct OverlayFilm<'a> {
    vehicle: &'a Vehicle,
    results: &'a RunResults,
    panels: Vec<Panel>,
    size: ImageSize,
    enlargement: f64,
}

/// The place of one camera in the film.
struct Panel {
    index: usize,
    name: String,
    camera: Camera,
    clock: CameraClock,
    left_px: u32,
    top_px: u32,
    scale: f64,
    size: ImageSize,
    path: Vec<Vec<[f64; 2]>>,
    /// Upper left corner of the close-up in the panel.
    close_up: [f64; 2],
    /// The widest part of the frame that it has shown, so that it does not zoom to and fro.
    close_up_px: f64,
}

impl<'a> OverlayFilm<'a> {
    /// A film of all cameras of the results; residuals are enlarged by a factor, or else so that a typical 95 % ellipse is seen.
    ///
    /// # Errors
    /// [`ReportError::Picture`] where the results have no cameras.
    pub fn new(
        vehicle: &'a Vehicle,
        results: &'a RunResults,
        enlargement: Option<f64>,
    ) -> Result<Self, ReportError> {
        let cameras = results.rig.as_ref().map_or(&[][..], |rig| &rig.cameras);
        let side = |value: fn(&ImageSize) -> u32| cameras.iter().map(|c| value(&c.camera.size)).max();
        let (Some(width), Some(height)) = (side(|s| s.width_px), side(|s| s.height_px)) else {
            return Err(ReportError::Picture);
        };
        // Two beside each other, more in a square.
        let columns = cameras.len().min(2).max((cameras.len() as f64).sqrt().ceil() as usize);
        let rows = cameras.len().div_ceil(columns);
        let room = |most: f64, count: usize, side: u32| most / (count as f64 * f64::from(side));
        let scale = room(MOST_PX[0], columns, width).min(room(MOST_PX[1], rows, height)).min(MOST_SCALE);
        // H.264 has colours for pairs of pixels.
        let even = |side: u32| 2 * ((f64::from(side) * scale / 2.0).floor() as u32).max(1);
        let panel = |(k, camera): (usize, &RigCamera)| Panel {
            index: k,
            name: camera.name.clone(),
            camera: camera.camera,
            clock: results.camera_clocks.get(k).map_or_else(CameraClock::default, |c| c.clock),
            left_px: (k % columns) as u32 * even(width),
            top_px: (k / columns) as u32 * even(height),
            scale,
            size: ImageSize {
                width_px: even(camera.camera.size.width_px),
                height_px: even(camera.camera.size.height_px),
            },
            path: Vec::new(),
            close_up: [0.0; 2],
            close_up_px: 0.0,
        };
        let mut panels: Vec<Panel> = cameras.iter().enumerate().map(panel).collect();
        panels.iter_mut().for_each(|panel| panel.close_up = panel.emptiest_corner(results));
        let size = ImageSize {
            width_px: columns as u32 * even(width),
            height_px: rows as u32 * even(height) + LEGEND_PX,
        };
        let enlargement =
            enlargement.unwrap_or_else(|| typical_enlargement(results, CLOSE_UP * scale / LEAST_SHARE));
        Ok(Self { vehicle, results, panels, size, enlargement })
    }

    /// Size of the film's frames; both sides are even.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// By how much residuals and ellipses are enlarged.
    pub fn enlargement(&self) -> f64 {
        self.enlargement
    }

    /// Where a pixel of a camera is in the film, px; none of a camera that there is not.
    pub fn place(&self, camera: usize, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let panel = self.panels.get(camera)?;
        let [x, y] = panel.at(&pixel);
        Some(Vector2::new(x + f64::from(panel.left_px) - 0.5, y + f64::from(panel.top_px) - 0.5))
    }

    /// The next frame of the film, at a time by the common clock; a camera without a shot is dark.
    ///
    /// # Errors
    /// [`ReportError::Picture`] for a frame whose size is not that of its pixels.
    pub fn draw(&mut self, t_ns: i64, shots: &[Option<FilmShot<'_>>]) -> Result<Frame, ReportError> {
        let (vehicle, results, enlargement) = (self.vehicle, self.results, self.enlargement);
        let drawn = self.panels.par_iter_mut().zip(shots).filter_map(|(panel, shot)| {
            let shot = shot.as_ref()?;
            Some(panel.draw(shot, vehicle, results, enlargement).map(|p| (panel.left_px, panel.top_px, p)))
        });
        let drawn = drawn.collect::<Result<Vec<_>, ReportError>>()?;
        let mut whole = Pixmap::new(self.size.width_px, self.size.height_px).ok_or(ReportError::Picture)?;
        let row_bytes = 4 * self.size.width_px as usize;
        for (left, top, part) in drawn {
            let bytes = 4 * part.width() as usize;
            for (row, y) in part.data().chunks_exact(bytes).zip(top as usize..) {
                whole.data_mut()[y * row_bytes + 4 * left as usize..][..bytes].copy_from_slice(row);
            }
        }
        self.legend(&mut whole, t_ns);
        let rgb = whole.data().chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        Frame::from_rgb(self.size, rgb).map_err(|_| ReportError::Picture)
    }

    /// Goes on with the path alone, as in a frame that is not shown.
    pub fn pass(&mut self, shots: &[Option<FilmShot<'_>>]) {
        for (panel, shot) in self.panels.iter_mut().zip(shots) {
            let Some(shot) = shot else { continue };
            let found = panel.found(shot, self.vehicle, self.results);
            panel.go_on(found.and_then(|f| f.axes.map(|axes| axes[0])));
        }
    }

    /// The time, and what the marks stand for, in as many words as there is room for.
    fn legend(&self, whole: &mut Pixmap, t_ns: i64) {
        let enlarged = format!("×{} residual, 95 % ellipses", self.enlargement);
        let words = [
            (format!("{:8.3} s", t_ns as f64 * 1e-9), [255, 255, 255]),
            ("o detected".into(), Kind::Detected.rgb()),
            ("+ by the pose".into(), Kind::Predicted.rgb()),
            (enlarged, Kind::Enlarged.rgb()),
            ("x forward".into(), Kind::Axis(0).rgb()),
            ("y right".into(), Kind::Axis(1).rgb()),
            ("z down".into(), Kind::Axis(2).rgb()),
        ];
        let top = (self.size.height_px - LEGEND_PX) as i32 + MARGIN_PX;
        let mut left = MARGIN_PX;
        for (text, rgb) in words {
            let width = LETTER_PX[0] * text.chars().count() as i32;
            if left + width <= self.size.width_px as i32 {
                write_words(&mut whole.as_mut(), [left, top], &text, rgb);
            }
            left += width + 2 * LETTER_PX[0];
        }
    }
}

impl Panel {
    /// A pixel's place from the panel's upper left corner; the middle of the first pixel is half a pixel from there.
    fn at(&self, pixel: &Vector2<f64>) -> [f64; 2] {
        [self.scale * (pixel.x + 0.5), self.scale * (pixel.y + 0.5)]
    }

    fn draw(
        &mut self,
        shot: &FilmShot<'_>,
        vehicle: &Vehicle,
        results: &RunResults,
        enlargement: f64,
    ) -> Result<Pixmap, ReportError> {
        let mut pixels = self.picture(shot.frame)?;
        let t_ns = self.clock.time_ns(shot.stamp_ns);
        let found = self.found(shot, vehicle, results);
        self.go_on(found.as_ref().and_then(|f| f.axes.map(|axes| axes[0])));
        let mut marks = vec![Mark::Lines(Kind::Path, self.path.clone())];
        marks.extend(found.iter().flat_map(|found| found.marks(|p| self.at(p), self.mark_scale())));
        marks.iter().for_each(|mark| mark.draw(&mut pixels.as_mut(), self.mark_scale()));
        if let Some(found) = &found {
            let (close_up, [left, top]) =
                (self.close_up(shot.frame, found, results, (t_ns, enlargement))?, self.close_up);
            let (paint, identity) = (PixmapPaint::default(), Transform::identity());
            pixels.draw_pixmap(left as i32, top as i32, close_up.as_ref(), &paint, identity, None);
        }
        write_words(&mut pixels.as_mut(), [MARGIN_PX, MARGIN_PX], &self.name, [255; 3]);
        Ok(pixels)
    }

    /// The aircraft, near, with residuals and ellipses enlarged.
    fn close_up(
        &mut self,
        frame: &Frame,
        found: &Found,
        results: &RunResults,
        (t_ns, enlargement): (i64, f64),
    ) -> Result<Pixmap, ReportError> {
        let part = found.part_of_width(frame.size, self.close_up_px);
        self.close_up_px = part.width;
        let side = self.close_up_side();
        let scale = side / part.width;
        let at = |p: &Vector2<f64>| [scale * (p.x + 0.5 - part.left), scale * (p.y + 0.5 - part.top)];
        let width = part.width as u32;
        let mut pixels = scaled(part.rgb(frame), [width; 2], [side as u32; 2])?;
        let mut marks =
            self.enlarged(found, results, t_ns, |middle, away| at(&(middle + enlargement * away)));
        marks.extend(found.marks(at, CLOSE_UP_MARKS));
        let frame = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side], [0.0, 0.0]];
        marks.push(Mark::Lines(Kind::Path, vec![frame.to_vec()]));
        marks.iter().for_each(|mark| mark.draw(&mut pixels.as_mut(), CLOSE_UP_MARKS));
        Ok(pixels)
    }

    fn close_up_side(&self) -> f64 {
        (CLOSE_UP * f64::from(self.size.width_px.min(self.size.height_px))).round()
    }

    /// Upper left place of a close-up in the corner below which the aircraft is least often.
    fn emptiest_corner(&self, results: &RunResults) -> [f64; 2] {
        let side = self.close_up_side();
        let (right, bottom) = (f64::from(self.size.width_px) - side, f64::from(self.size.height_px) - side);
        let places: Vec<[f64; 2]> = results
            .poses
            .iter()
            .filter_map(|p| p.estimate.as_ref().ok())
            .filter_map(|e| self.camera.project(&e.world_from_body.translation.vector).ok())
            .map(|seen| self.at(&seen.pixel))
            .collect();
        let below = |corner: &[f64; 2]| {
            let is_in = |v: f64, from: f64| (from - 0.2 * side..from + 1.2 * side).contains(&v);
            places.iter().filter(|p| is_in(p[0], corner[0]) && is_in(p[1], corner[1])).count()
        };
        let corners = [[0.0, bottom], [right, bottom], [right, 0.0], [0.0, 0.0]];
        corners.into_iter().min_by_key(below).unwrap_or_default()
    }

    fn found(&self, shot: &FilmShot<'_>, vehicle: &Vehicle, results: &RunResults) -> Option<Found> {
        let middle =
            0.5 * Vector2::new(f64::from(self.camera.size.width_px), f64::from(self.camera.size.height_px));
        let exposed_ns = |pixel: &Vector2<f64>| {
            let rows_px = shot.readout.dot(&(pixel - middle));
            (self.clock.time_s(shot.stamp_ns, rows_px) * 1e9).round() as i64
        };
        Found::of(self.index, &self.camera, vehicle, results, exposed_ns)
    }

    fn mark_scale(&self) -> f64 {
        f64::from(self.size.width_px) / PAGE_WIDTH_PX
    }

    /// The frame in the panel's size.
    fn picture(&self, frame: &Frame) -> Result<Pixmap, ReportError> {
        let [from, to] = [frame.size, self.size].map(|s| [s.width_px, s.height_px]);
        scaled(frame.to_rgb(), from, to)
    }

    /// Takes the path on to where the body origin is seen now; where there is no pose, it is broken.
    fn go_on(&mut self, origin: Option<Vector2<f64>>) {
        let Some(place) = origin.map(|p| self.at(&p)) else {
            if self.path.last().is_some_and(|line| !line.is_empty()) {
                self.path.push(Vec::new());
            }
            return;
        };
        if self.path.is_empty() {
            self.path.push(Vec::new());
        }
        let Some(line) = self.path.last_mut() else { return };
        if line.last().is_none_or(|last| (last[0] - place[0]).hypot(last[1] - place[1]) > STEP_PX) {
            line.push(place);
        }
    }

    /// Residuals with the ellipses to compare them with, and the pose's ellipse at the body origin.
    fn enlarged(
        &self,
        found: &Found,
        results: &RunResults,
        t_ns: i64,
        place: impl Fn(&Vector2<f64>, &Vector2<f64>) -> [f64; 2],
    ) -> Vec<Mark> {
        let drawn = |middle: &Vector2<f64>, lines: Vec<Vec<Vector2<f64>>>| {
            let lines = lines.iter().map(|line| line.iter().map(|p| place(middle, p)).collect());
            Mark::Lines(Kind::Enlarged, lines.collect())
        };
        let residuals = found.residuals.iter().map(|r| {
            drawn(&r.predicted, vec![vec![Vector2::zeros(), r.residual_px], ellipse_95(&r.covariance_px2)])
        });
        let origin = found.axes.zip(pose_at(results, t_ns)).and_then(|(axes, world_from_body)| {
            let poses = near(&results.poses, t_ns, |p| p.t_ns).iter();
            let poses = poses.filter_map(|p| Some((p.t_ns, p.estimate.as_ref().ok()?)));
            let (_, nearest) = poses.min_by_key(|(at_ns, _)| (at_ns - t_ns).abs())?;
            let seen = self.camera.project(&world_from_body.translation.vector).ok()?;
            let d_pixel = seen.d_pixel_d_point_in_world;
            let position_cov = nearest.covariance().fixed_view::<3, 3>(0, 0).into_owned();
            Some(drawn(&axes[0], vec![ellipse_95(&(d_pixel * position_cov * d_pixel.transpose()))]))
        });
        residuals.chain(origin).collect()
    }
}

/// A picture in another size.
fn scaled(rgb: Vec<u8>, [width, height]: [u32; 2], to: [u32; 2]) -> Result<Pixmap, ReportError> {
    let mut image = image::RgbImage::from_raw(width, height, rgb).ok_or(ReportError::Picture)?;
    if to[0] < width {
        image = image::imageops::thumbnail(&image, to[0], to[1]);
    }
    let mut pixels = Pixmap::new(image.width(), image.height()).ok_or(ReportError::Picture)?;
    for (to, from) in pixels.data_mut().chunks_exact_mut(4).zip(image.as_raw().chunks_exact(3)) {
        to.copy_from_slice(&[from[0], from[1], from[2], 255]);
    }
    if to[0] <= width {
        return Ok(pixels);
    }
    let mut large = Pixmap::new(to[0], to[1]).ok_or(ReportError::Picture)?;
    let paint = PixmapPaint { quality: FilterQuality::Bilinear, ..PixmapPaint::default() };
    let scale = Transform::from_scale(to[0] as f32 / width as f32, to[1] as f32 / height as f32);
    large.draw_pixmap(0, 0, pixels.as_ref(), &paint, scale, None);
    Ok(large)
}
