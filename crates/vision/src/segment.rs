//! Connected regions of coloured pixels that have the size and the shape of a ball.

use crate::color::{ColorModel, LEAST_CHROMA, Seen};
use crate::colored::{Chromatic, Collector};
use crate::window::Window;
use crate::{Frame, Vector2};

/// A region of one colour.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Region {
    pub(crate) pixel: Vector2<f64>,
    pub(crate) area_px: f64,
    /// Sum of chroma, to rank regions before they are looked at closely.
    pub(crate) strength: f64,
    hue: [f32; 2],
}

impl Region {
    /// Mean colour of the region.
    pub(crate) fn seen(&self) -> Seen {
        Seen::pure(self.hue)
    }
}

/// Ratio of long to short axis of a region of a few pixels that may still be a ball, smeared by motion or cut
/// by an arm.
const MOST_ELONGATED: f64 = 2.5;
/// Least part of its bounding ellipse that a region fills; a disc on a pixel grid fills about one.
const LEAST_FILLED: f64 = 0.5;
/// The same of two regions that may be one ball with an arm across: without the gap a disc, which two discs
/// side by side are not.
const MOST_ELONGATED_OF_TWO: f64 = 1.6;
/// Least area of the smaller of the two over that of the larger: less is not missed.
const LEAST_OF_TWO: f64 = 0.2;
/// Regions, the strongest, that are looked at two by two.
const MOST_JOINED: usize = 8;
/// Halvings of sensitivity after which a region that is still too large is given up.
const LEVELS: usize = 6;

/// Share of what was needed that is forgotten from frame to frame: it fades in some seconds of video.
const FORGOTTEN: usize = 64;
/// Of the pixels needed of late, so many times are kept in the lists, and so many more.
const KEPT: usize = 2;
const KEPT_BESIDE: usize = 1024;

/// Working space, reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Segmenter {
    colored: Collector,
    /// Most coloured pixels of late.
    needed: usize,
    /// Pixels of one marker at the present level, and those of the next, by their number among the collected.
    level: Vec<u32>,
    next: Vec<u32>,
    /// All pixels of the level.
    runs: Vec<Run>,
    /// For each of these pixels its region's number.
    region: Vec<u32>,
    sums: Vec<Sums>,
    strongest: Vec<Sums>,
    pub(crate) regions_found: Vec<Region>,
}

/// Neighbouring pixels of a row, the end not included.
#[derive(Debug, Clone, Copy)]
struct Run {
    y: u32,
    begin: u32,
    end: u32,
    /// An earlier run of its region, or itself.
    parent: usize,
    region: u32,
}

impl Run {
    /// Whether neither this nor what comes before it can touch a later run, nor any behind that.
    fn ends_before(&self, run: &Self) -> bool {
        self.y + 1 < run.y || (self.y + 1 == run.y && self.end < run.begin)
    }
}

/// Moments of a region. Every pixel weighs alike: weighed by its colour, a ball that is lit from above would
/// seem to lie up to a sixth of its radius too high.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: f64,
    hue: [f32; 2],
    chroma: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
}

impl Segmenter {
    /// Collects the coloured pixels of a window.
    pub(crate) fn collect(&mut self, frame: &Frame, window: &Window) {
        self.colored.collect(frame, window);
    }

    /// Gives back memory that one picture has needed and others do not: one of noise is coloured all over. For once a
    /// frame, when nobody waits.
    pub(crate) fn give_back(&mut self) {
        self.needed = self.colored.found.len().max(self.needed - self.needed / FORGOTTEN);
        let kept = KEPT * self.needed + KEPT_BESIDE;
        shrink(&mut self.colored.found, kept);
        shrink(&mut self.level, kept);
        shrink(&mut self.next, kept);
        shrink(&mut self.runs, kept);
        shrink(&mut self.region, kept);
        shrink(&mut self.sums, kept);
        shrink(&mut self.strongest, kept);
        shrink(&mut self.regions_found, kept);
    }

    /// Finds the regions of one marker among the collected pixels whose area lies in `area_px`, into
    /// [`Self::regions_found`].
    ///
    /// A region that is too large is looked at again with only its more strongly coloured pixels: a ball
    /// before a surface of a like hue but less colour.
    pub(crate) fn regions(&mut self, model: &ColorModel, marker: usize, area_px: (f64, f64)) {
        self.regions_found.clear();
        // All are written, each over the last one where that is not the marker's: whether it is is hard to
        // predict.
        self.level.resize(self.colored.found.len(), 0);
        let mut count = 0;
        for (pixel, k) in self.colored.found.iter().zip(0..) {
            self.level[count] = k;
            count += usize::from(model.may_be(marker, pixel.hue));
        }
        self.level.truncate(count);
        let mut least_chroma = LEAST_CHROMA;
        for _ in 0..LEVELS {
            if self.level.is_empty() {
                return;
            }
            let regions = self.connect();
            self.sum(regions);
            let is_large = |sums: &Sums| sums.count > area_px.1;
            let small = self.sums.iter().filter(|s| !is_large(s));
            self.regions_found.extend(small.filter_map(|s| s.region(area_px.0, MOST_ELONGATED)));
            self.join_two(area_px);
            if !self.sums.iter().any(is_large) {
                return;
            }
            least_chroma *= 2.0;
            self.next.clear();
            let pixels = self.level.iter().zip(&self.region);
            let large = pixels.filter(|(_, region)| is_large(&self.sums[**region as usize])).map(|(k, _)| *k);
            let strong = |k: &u32| self.colored.found[*k as usize].seen().chroma >= least_chroma;
            self.next.extend(large.filter(strong));
            std::mem::swap(&mut self.level, &mut self.next);
        }
    }

    /// Adds two regions that an arm may have cut out of one ball as one; each is kept alone, too.
    fn join_two(&mut self, area_px: (f64, f64)) {
        self.strongest.clear();
        let small = self.sums.iter().filter(|s| s.count <= area_px.1 && s.chroma > 0.0);
        self.strongest.extend(small.copied());
        if self.strongest.len() > MOST_JOINED {
            self.strongest.select_nth_unstable_by(MOST_JOINED, |a, b| b.chroma.total_cmp(&a.chroma));
            self.strongest.truncate(MOST_JOINED);
        }
        for (k, one) in self.strongest.iter().enumerate() {
            for other in &self.strongest[..k] {
                let both = one.with(other);
                let is_shared = one.count.min(other.count) >= LEAST_OF_TWO * one.count.max(other.count);
                if is_shared && both.count <= area_px.1 {
                    self.regions_found.extend(both.region(area_px.0, MOST_ELONGATED_OF_TWO));
                }
            }
        }
    }

    /// Joins neighbours, diagonal ones too, and numbers the regions in the order of their first pixels: how
    /// many there are.
    fn connect(&mut self) -> usize {
        self.runs.clear();
        self.region.clear();
        let mut pixels = self.level.iter().map(|k| &self.colored.found[*k as usize]);
        let run_from = |pixel: &Chromatic, parent: usize| Run {
            y: pixel.y,
            begin: pixel.x,
            end: pixel.x + 1,
            parent,
            region: 0,
        };
        let Some(first) = pixels.next() else { return 0 };
        let mut run = run_from(first, 0);
        for pixel in pixels {
            if run.y == pixel.y && run.end == pixel.x {
                run.end += 1;
            } else {
                self.runs.push(run);
                run = run_from(pixel, self.runs.len());
            }
        }
        self.runs.push(run);
        let mut above = 0;
        for index in 0..self.runs.len() {
            let run = self.runs[index];
            while self.runs[above].ends_before(&run) {
                above += 1;
            }
            let mut neighbour = above;
            while self.runs[neighbour].y < run.y && self.runs[neighbour].begin <= run.end {
                self.join(neighbour, index);
                neighbour += 1;
            }
        }
        // A region's first run comes before its others.
        let mut regions = 0;
        for index in 0..self.runs.len() {
            let first = self.root(index);
            if first == index {
                self.runs[index].region = regions;
                regions += 1;
            }
            let (run, region) = (self.runs[index], self.runs[first].region);
            self.region.resize(self.region.len() + (run.end - run.begin) as usize, region);
        }
        regions as usize
    }

    /// The first run of a region so far; the way there is halved (Tarjan & van Leeuwen 1984).
    fn root(&mut self, mut index: usize) -> usize {
        while self.runs[index].parent != index {
            let above = self.runs[index].parent;
            self.runs[index].parent = self.runs[above].parent;
            index = self.runs[index].parent;
        }
        index
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.runs[a.max(b)].parent = a.min(b);
    }

    fn sum(&mut self, regions: usize) {
        self.sums.clear();
        self.sums.resize(regions, Sums::default());
        let mut left = &self.level[..];
        for run in &self.runs {
            let (pixels, behind) = left.split_at((run.end - run.begin) as usize);
            left = behind;
            let into = &mut self.sums[self.region[self.level.len() - behind.len() - 1] as usize];
            let mut sums = *into;
            let y = f64::from(run.y);
            for index in pixels {
                let pixel = &self.colored.found[*index as usize];
                let x = f64::from(pixel.x);
                sums.count += 1.0;
                sums.chroma += f64::from(pixel.seen().chroma);
                sums.hue[0] += pixel.hue[0];
                sums.hue[1] += pixel.hue[1];
                sums.x += x;
                sums.y += y;
                sums.xx += x * x;
                sums.xy += x * y;
                sums.yy += y * y;
            }
            *into = sums;
        }
    }
}

/// Empties and shrinks a list that has grown to more than twice what is kept.
fn shrink<T>(list: &mut Vec<T>, kept: usize) {
    if list.capacity() > 2 * kept {
        list.clear();
        list.shrink_to(kept);
    }
}

impl Sums {
    /// Those of two regions together.
    fn with(&self, other: &Self) -> Self {
        Self {
            count: self.count + other.count,
            hue: [self.hue[0] + other.hue[0], self.hue[1] + other.hue[1]],
            chroma: self.chroma + other.chroma,
            x: self.x + other.x,
            y: self.y + other.y,
            xx: self.xx + other.xx,
            xy: self.xy + other.xy,
            yy: self.yy + other.yy,
        }
    }

    fn region(&self, least_area_px: f64, most_elongated: f64) -> Option<Region> {
        if self.count < least_area_px || self.chroma <= 0.0 {
            return None;
        }
        let (x, y) = (self.x / self.count, self.y / self.count);
        // A pixel is a square with a variance of 1/12 of its own.
        let xx = self.xx / self.count - x * x + 1.0 / 12.0;
        let yy = self.yy / self.count - y * y + 1.0 / 12.0;
        let xy = self.xy / self.count - x * y;
        let mean = 0.5 * (xx + yy);
        let apart = (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
        let (long, short) = (mean + apart, (mean - apart).max(1e-9));
        // A uniform ellipse has semi-axes twice the square roots of its principal variances.
        let ellipse_px = 4.0 * std::f64::consts::PI * (long * short).sqrt();
        let ball = (long / short).sqrt() <= most_elongated && self.count >= LEAST_FILLED * ellipse_px;
        ball.then(|| Region {
            pixel: Vector2::new(x, y),
            area_px: self.count,
            strength: self.chroma,
            hue: self.hue,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIDE: i32 = 9;

    /// Regions by flooding each from its first pixel.
    fn flooded(set: &[bool]) -> Vec<u32> {
        let mut region = vec![None; set.len()];
        let mut count = 0;
        for first in (0..set.len()).filter(|k| set[*k]) {
            let mut open = if region[first].is_none() { vec![first as i32] } else { continue };
            while let Some(at) = open.pop() {
                if region[at as usize].replace(count).is_some() {
                    continue;
                }
                let near = |k: &i32| (k % SIDE - at % SIDE).abs() <= 1 && (k / SIDE - at / SIDE).abs() <= 1;
                open.extend(
                    (0..SIDE * SIDE).filter(|k| near(k) && set[*k as usize] && region[*k as usize].is_none()),
                );
            }
            count += 1;
        }
        region.into_iter().flatten().collect()
    }

    #[test]
    fn a_ball_lit_from_above_lies_where_it_is() {
        const RADIUS_PX: f64 = 6.0;
        let middle = Vector2::new(20.3, 17.6);
        let mut segmenter = Segmenter::default();
        for (x, y) in (0..40_u32).flat_map(|y| (0..40_u32).map(move |x| (x, y))) {
            let away = (Vector2::new(f64::from(x), f64::from(y)) - middle) / RADIUS_PX;
            if away.norm_squared() < 1.0 {
                let hue = [(0.5 - 0.4 * away.y) as f32, 0.0];
                segmenter.level.push(segmenter.colored.found.len() as u32);
                segmenter.colored.found.push(Chromatic { x, y, hue });
            }
        }
        let regions = segmenter.connect();
        segmenter.sum(regions);
        assert_eq!(regions, 1);
        let region = segmenter.sums[0].region(1.0, MOST_ELONGATED).expect("a disc");
        let away_px = (region.pixel - middle).norm();
        assert!(away_px < 0.1, "{away_px}");
    }

    /// Places of the regions that may be a ball of 4 px radius, of red pixels where `is_red`.
    fn regions_of(is_red: impl Fn(Vector2<f64>) -> bool) -> Vec<Vector2<f64>> {
        let red = crate::BallColor { name: "red".into(), rgb: [200, 30, 30] };
        let model = ColorModel::new(&[red]).expect("a colour");
        let hue = Seen::of(crate::color::to_linear([200, 30, 30])).hue;
        let mut segmenter = Segmenter::default();
        for (x, y) in (0..40_u32).flat_map(|y| (0..40_u32).map(move |x| (x, y))) {
            if is_red(Vector2::new(f64::from(x), f64::from(y))) {
                segmenter.colored.found.push(Chromatic { x, y, hue });
            }
        }
        segmenter.regions(&model, 0, (8.0, 70.0));
        segmenter.regions_found.iter().map(|b| b.pixel).collect()
    }

    #[test]
    fn what_one_picture_of_noise_needs_is_given_back() {
        let size = crate::ImageSize { width_px: 320, height_px: 240 };
        let frame = |rgb: [u8; 3]| Frame::from_rgb(size, rgb.repeat(size.area_px())).expect("a frame");
        let (colored, grey) = (frame([200, 30, 30]), frame([90; 3]));
        let red = crate::BallColor { name: "red".into(), rgb: [200, 30, 30] };
        let model = ColorModel::new(&[red]).expect("a colour");
        let mut segmenter = Segmenter::default();
        let mut look = |frame: &Frame| {
            segmenter.collect(frame, &Window::whole(frame));
            segmenter.regions(&model, 0, (8.0, 70.0));
            segmenter.give_back();
            let pixels = segmenter.level.capacity() + segmenter.next.capacity();
            segmenter.colored.found.capacity() + pixels + segmenter.region.capacity()
        };
        let most = look(&colored);
        assert!(most >= 3 * size.area_px(), "{most}");
        // What a camera sees again and again is not asked for anew.
        assert!((0..5).all(|_| look(&grey) == most));
        let least = (0..1000).map(|_| look(&grey)).last().unwrap_or(most);
        assert!(least < most / 10, "{least} of {most}");
    }

    fn is_in_disc(pixel: Vector2<f64>, middle: [f64; 2], radius_px: f64) -> bool {
        (pixel - Vector2::from(middle)).norm() < radius_px
    }

    #[test]
    fn a_ball_with_an_arm_across_is_one_and_two_side_by_side_are_two() {
        let cut = regions_of(|at| is_in_disc(at, [20.0, 18.0], 4.0) && !(17.0..=18.0).contains(&at.y));
        assert!(cut.iter().any(|at| (at - Vector2::new(20.0, 18.0)).norm() < 0.7), "{cut:?}");
        // Small ones, so that their area together is no reason to keep them apart.
        let beside = regions_of(|at| is_in_disc(at, [14.0, 18.0], 3.2) || is_in_disc(at, [21.5, 18.0], 3.2));
        assert_eq!(beside.len(), 2, "{beside:?}");
    }

    proptest! {
        #[test]
        fn regions_are_those_that_flooding_finds(set in prop::collection::vec(any::<bool>(), (SIDE * SIDE) as usize)) {
            let mut segmenter = Segmenter::default();
            for k in (0..SIDE * SIDE).filter(|k| set[*k as usize]) {
                let pixel = Chromatic { x: (k % SIDE) as u32, y: (k / SIDE) as u32, hue: [1.0, 0.0] };
                segmenter.level.push(segmenter.colored.found.len() as u32);
                segmenter.colored.found.push(pixel);
            }
            let want = flooded(&set);
            let count = segmenter.connect();
            prop_assert_eq!(&segmenter.region, &want);
            prop_assert_eq!(count as u32, want.iter().max().map_or(0, |most| most + 1));
        }
    }
}
