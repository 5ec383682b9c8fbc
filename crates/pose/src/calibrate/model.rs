//! The nested family of camera models, and the priors of their parameters.

use mavsight_geometry::camera_parameters::{DISTORTION, INTRINSICS};
use mavsight_geometry::{Camera, CameraChange};
use std::fmt;
use std::str::FromStr;

/// Shape of a camera's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Pixels {
    /// Square and upright, as lithography makes them: pose, one focal length, principal point.
    Square,
    /// Upright rectangles: a focal length for each axis.
    Rectangular,
    /// Rectangular and sheared: with the pose the eleven parameters of a DLT.
    Skewed,
}

/// Terms of lens distortion that are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lens {
    /// None.
    Straight,
    /// k1.
    K1,
    /// k1 and k2.
    K1K2,
    /// k1, k2, p1 and p2.
    Tangential,
    /// k1, k2, p1, p2 and k3.
    Full,
}

/// One model of the family; each is contained in those with the same or more freedom in both parts.
///
/// `pinhole` is the least, `dlt-11` has all of a linear camera, `dlt-16` all sixteen parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct CameraModel {
    /// Shape of the pixels.
    pub pixels: Pixels,
    /// Distortion.
    pub lens: Lens,
}

const PIXELS: [(Pixels, &str); 3] =
    [(Pixels::Square, "pinhole"), (Pixels::Rectangular, "pinhole-fx-fy"), (Pixels::Skewed, "dlt-11")];
const LENSES: [(Lens, &str); 5] = [
    (Lens::Straight, ""),
    (Lens::K1, "+k1"),
    (Lens::K1K2, "+k1+k2"),
    (Lens::Tangential, "+k1+k2+p1+p2"),
    (Lens::Full, "+k1+k2+p1+p2+k3"),
];

/// Spreads of real cameras, as standard deviations about a centred pinhole with square pixels. They bound
/// undetermined parameters and weigh one model against another; the data overrule them where they can.
///
/// Angle across the width 20° to 110°: ln(f/width) about 0, spread 0.7.
const LOG_FOCAL_STD: f64 = 0.7;
/// Principal point, of the width: lenses are mounted to a few per cent of the sensor (Clarke, Wang & Fryer
/// 1998).
const PRINCIPAL_POINT_STD: f64 = 0.03;
/// Where pixels are not square (digitised or squeezed video) they differ by some per cent.
const ASPECT_STD: f64 = 0.02;
/// Where the axes are sheared, by a fraction of a degree to a degree.
const SKEW_STD: f64 = 0.01;
/// Radial terms of ordinary lenses in normalised coordinates, |k1| and |k2| up to some tenths; tangential
/// ones are two orders smaller (Brown 1971; Weng, Cohen & Herniou 1992).
const RADIAL_STD: f64 = 0.3;
const TANGENTIAL_STD: f64 = 0.005;

/// The prior of one column of a model's basis.
pub(super) struct PriorRow {
    pub(super) column: usize,
    /// Distance from the expected value in standard deviations.
    pub(super) residual: f64,
    /// Derivative of that by the parameter.
    pub(super) slope: f64,
}

impl CameraModel {
    /// The least model.
    pub const PINHOLE: Self = Self { pixels: Pixels::Square, lens: Lens::Straight };
    /// All sixteen parameters.
    pub const DLT_16: Self = Self { pixels: Pixels::Skewed, lens: Lens::Full };

    /// Number of parameters: those of the pose, of the pixels and of the lens.
    pub fn parameters(&self) -> usize {
        self.basis().len()
    }

    /// The models with more freedom in one of the parts, by a step or two: the second may be worth it without
    /// the first.
    pub(super) fn wider(&self) -> Vec<Self> {
        let pixels = PIXELS.iter().map(|p| p.0).filter(|p| *p > self.pixels).take(2);
        let lenses = LENSES.iter().map(|l| l.0).filter(|l| *l > self.lens).take(2);
        let with_pixels = pixels.map(|pixels| Self { pixels, lens: self.lens });
        with_pixels.chain(lenses.map(|lens| Self { pixels: self.pixels, lens })).collect()
    }

    /// The free directions as columns of a [`CameraChange`]: pose, f, cx, cy, then what the model adds.
    pub(super) fn basis(&self) -> Vec<CameraChange> {
        let unit = |rows: &[usize]| {
            let mut column = CameraChange::zeros();
            rows.iter().for_each(|r| column[*r] = 1.0);
            column
        };
        let mut out: Vec<CameraChange> = (0..6).map(|k| unit(&[k])).collect();
        out.push(unit(&[INTRINSICS, INTRINSICS + 1]));
        out.extend([unit(&[INTRINSICS + 3]), unit(&[INTRINSICS + 4])]);
        if self.pixels >= Pixels::Rectangular {
            out.push(unit(&[INTRINSICS + 1]));
        }
        if self.pixels >= Pixels::Skewed {
            out.push(unit(&[INTRINSICS + 2]));
        }
        out.extend((0..self.lens_terms()).map(|k| unit(&[DISTORTION + k])));
        out
    }

    fn lens_terms(&self) -> usize {
        match self.lens {
            Lens::Straight => 0,
            Lens::K1 => 1,
            Lens::K1K2 => 2,
            Lens::Tangential => 4,
            Lens::Full => 5,
        }
    }

    /// A camera without the terms that the model does not have.
    pub(super) fn restricted(&self, camera: &Camera) -> Camera {
        let mut out = *camera;
        let k = &mut out.intrinsics;
        if self.pixels == Pixels::Square {
            let f = (k.fx_px * k.fy_px).sqrt();
            (k.fx_px, k.fy_px) = (f, f);
        }
        if self.pixels < Pixels::Skewed {
            k.skew_px = 0.0;
        }
        let d = &mut out.distortion;
        let terms = self.lens_terms();
        for (i, value) in [&mut d.k1, &mut d.k2, &mut d.p1, &mut d.p2, &mut d.k3].into_iter().enumerate() {
            if i >= terms {
                *value = 0.0;
            }
        }
        out
    }

    /// The priors at a camera.
    pub(super) fn priors(&self, camera: &Camera) -> Vec<PriorRow> {
        let (k, d) = (&camera.intrinsics, &camera.distortion);
        let (width, height) = (f64::from(camera.size.width_px), f64::from(camera.size.height_px));
        let f = k.fx_px.abs().max(1e-6 * width);
        let across = 1.0 / (PRINCIPAL_POINT_STD * width);
        let mut values = vec![
            ((f / width).ln() / LOG_FOCAL_STD, 1.0 / (f * LOG_FOCAL_STD)),
            ((k.cx_px - (width - 1.0) / 2.0) * across, across),
            ((k.cy_px - (height - 1.0) / 2.0) * across, across),
        ];
        if self.pixels >= Pixels::Rectangular {
            values.push(((k.fy_px / f - 1.0) / ASPECT_STD, 1.0 / (f * ASPECT_STD)));
        }
        if self.pixels >= Pixels::Skewed {
            values.push((k.skew_px / f / SKEW_STD, 1.0 / (f * SKEW_STD)));
        }
        for (i, value) in [d.k1, d.k2, d.p1, d.p2, d.k3].into_iter().enumerate().take(self.lens_terms()) {
            let std = if i == 2 || i == 3 { TANGENTIAL_STD } else { RADIAL_STD };
            values.push((value / std, 1.0 / std));
        }
        values
            .into_iter()
            .enumerate()
            .map(|(i, (residual, slope))| PriorRow { column: 6 + i, residual, slope })
            .collect()
    }
}

impl fmt::Display for CameraModel {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::DLT_16 {
            return out.write_str("dlt-16");
        }
        let pixels = PIXELS.iter().find(|p| p.0 == self.pixels).map_or("", |p| p.1);
        let lens = LENSES.iter().find(|l| l.0 == self.lens).map_or("", |l| l.1);
        write!(out, "{pixels}{lens}")
    }
}

impl FromStr for CameraModel {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let all = PIXELS.iter().flat_map(|p| LENSES.iter().map(|l| Self { pixels: p.0, lens: l.0 }));
        let mut names = Vec::new();
        for model in all {
            if model.to_string() == text {
                return Ok(model);
            }
            names.push(model.to_string());
        }
        Err(format!("{text:?} is no camera model: use one of {}", names.join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_and_the_family_is_nested() {
        let mut models = vec![CameraModel::PINHOLE];
        let mut next = 0;
        while let Some(model) = models.get(next).copied() {
            for wider in model.wider() {
                assert!(wider.parameters() > model.parameters());
                assert!(model.basis().iter().all(|column| {
                    let all = wider.basis();
                    all.contains(column)
                }));
                if !models.contains(&wider) {
                    models.push(wider);
                }
            }
            assert_eq!(model.to_string().parse(), Ok(model));
            next += 1;
        }
        assert_eq!(models.len(), 15);
        assert_eq!(CameraModel::DLT_16.parameters(), 16);
        assert_eq!(CameraModel { pixels: Pixels::Skewed, lens: Lens::Straight }.parameters(), 11);
        assert!("pinhole+k9".parse::<CameraModel>().unwrap_err().contains("dlt-16"));
    }
}
