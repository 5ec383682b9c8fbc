//! The nested family of camera models, and the priors of their parameters.

use crate::PoseError;
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
/// Principal point, of the width: lenses are mounted to a few per cent (Clarke, Wang & Fryer 1998).
const PRINCIPAL_POINT_STD: f64 = 0.03;
/// Where pixels are not square (digitised or squeezed video) they differ by some per cent.
const ASPECT_STD: f64 = 0.02;
/// Where the axes are sheared, by a fraction of a degree to a degree.
const SKEW_STD: f64 = 0.01;
/// Radial terms of ordinary lenses in normalised coordinates, |k1| and |k2| up to some tenths; tangential
/// ones are two orders smaller (Brown 1971; Weng, Cohen & Herniou 1992).
const RADIAL_STD: f64 = 0.3;
const TANGENTIAL_STD: f64 = 0.005;

/// Prior knowledge of one parameter.
pub(super) struct Prior {
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

    /// Models with more freedom in one part by a step or two, as the second may be worth it without the
    /// first.
    pub(super) fn wider(&self) -> Vec<Self> {
        let pixels = PIXELS[self.pixels as usize + 1..].iter().take(2).map(|p| Self { pixels: p.0, ..*self });
        let lenses = LENSES[self.lens as usize + 1..].iter().take(2).map(|l| Self { lens: l.0, ..*self });
        pixels.chain(lenses).collect()
    }

    /// The free directions as columns of a [`CameraChange`]: pose, f, cx, cy, then what the model adds.
    pub(super) fn basis(&self) -> Vec<CameraChange> {
        let mut columns: Vec<Vec<usize>> = (0..6).map(|k| vec![k]).collect();
        columns.extend([vec![INTRINSICS, INTRINSICS + 1], vec![INTRINSICS + 3], vec![INTRINSICS + 4]]);
        columns
            .extend([INTRINSICS + 1, INTRINSICS + 2].map(|k| vec![k]).into_iter().take(self.pixels as usize));
        columns.extend((0..self.lens_terms()).map(|k| vec![DISTORTION + k]));
        let column = |rows: &Vec<usize>| CameraChange::from_fn(|k, _| f64::from(u8::from(rows.contains(&k))));
        columns.iter().map(column).collect()
    }

    fn lens_terms(&self) -> usize {
        [0, 1, 2, 4, 5][self.lens as usize]
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
        let terms = [&mut d.k1, &mut d.k2, &mut d.p1, &mut d.p2, &mut d.k3];
        terms.into_iter().skip(self.lens_terms()).for_each(|term| *term = 0.0);
        out
    }

    /// The priors at a camera, of all columns of the basis but the pose's.
    pub(super) fn priors(&self, camera: &Camera) -> Vec<Prior> {
        let (k, d) = (&camera.intrinsics, &camera.distortion);
        let (width, height) = (f64::from(camera.size.width_px), f64::from(camera.size.height_px));
        let f = k.fx_px.abs().max(1e-6 * width);
        let linear = |value: f64, std: f64| Prior { residual: value / std, slope: 1.0 / std };
        let of_pixels = [
            Prior { residual: (k.fy_px / f - 1.0) / ASPECT_STD, slope: 1.0 / (f * ASPECT_STD) },
            linear(k.skew_px, f * SKEW_STD),
        ];
        let mut out = vec![
            Prior { residual: (f / width).ln() / LOG_FOCAL_STD, slope: 1.0 / (f * LOG_FOCAL_STD) },
            linear(k.cx_px - (width - 1.0) / 2.0, PRINCIPAL_POINT_STD * width),
            linear(k.cy_px - (height - 1.0) / 2.0, PRINCIPAL_POINT_STD * width),
        ];
        out.extend(of_pixels.into_iter().take(self.pixels as usize));
        let radial = |value| linear(value, RADIAL_STD);
        let tangential = |value| linear(value, TANGENTIAL_STD);
        let of_lens = [radial(d.k1), radial(d.k2), tangential(d.p1), tangential(d.p2), radial(d.k3)];
        out.extend(of_lens.into_iter().take(self.lens_terms()));
        out
    }
}

impl fmt::Display for CameraModel {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::DLT_16 {
            return out.write_str("dlt-16");
        }
        write!(out, "{}{}", PIXELS[self.pixels as usize].1, LENSES[self.lens as usize].1)
    }
}

impl FromStr for CameraModel {
    type Err = PoseError;

    fn from_str(text: &str) -> Result<Self, PoseError> {
        let mut all = PIXELS.iter().flat_map(|p| LENSES.iter().map(|l| Self { pixels: p.0, lens: l.0 }));
        let known = || all.clone().map(|model| model.to_string()).collect::<Vec<_>>().join(", ");
        let refused = PoseError::UnknownModel { model: text.to_owned(), known: known() };
        all.find(|model| model.to_string() == text).ok_or(refused)
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
                assert!(wider.basis().len() > model.basis().len());
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
        assert_eq!(CameraModel::DLT_16.basis().len(), 16);
        assert_eq!(CameraModel { pixels: Pixels::Skewed, lens: Lens::Straight }.basis().len(), 11);
        assert!("pinhole+k9".parse::<CameraModel>().unwrap_err().to_string().contains("dlt-16"));
    }
}
