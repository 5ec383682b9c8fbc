//! Where other programs count pixels from.

use mavsight_geometry::{Matrix3, Vector2};

/// Origin and direction of pixel coordinates.
///
/// MATLAB's intrinsic coordinates put the centre of the first pixel at (1, 1) (MathWorks, "Image Coordinate
/// Systems"); OpenCV, like this program, at (0, 0).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelOrigin {
    /// As in this program: (0, 0) is the centre of the top-left pixel, v down.
    TopLeftZero,
    /// DLTdv8: (1, 1) is the centre of the top-left pixel, v down.
    Dltdv8,
    /// DLTdv5 to 7 flip the image (`flipud`): (1, 1) is the centre of the bottom-left pixel, v up.
    Dltdv5,
    /// Argus: u from 0, v = height - v of OpenCV, up.
    Argus,
}

impl PixelOrigin {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::TopLeftZero => "zero",
            Self::Dltdv8 => "dltdv8",
            Self::Dltdv5 => "dltdv5",
            Self::Argus => "argus",
        }
    }

    pub(super) fn describe(self) -> &'static str {
        match self {
            Self::TopLeftZero => "this program, from 0 at the top left",
            Self::Dltdv8 => "DLTdv8, from 1 at the top left",
            Self::Dltdv5 => "DLTdv5 to 7, from 1 at the lower left",
            Self::Argus => "Argus, from 0 and the lower left",
        }
    }

    pub(super) fn is_top_left(self) -> bool {
        matches!(self, Self::TopLeftZero | Self::Dltdv8)
    }

    /// The affine map from their pixels to ours in an image of that height.
    pub(super) fn ours_from_theirs(self, height_px: u32) -> Matrix3<f64> {
        let (du, sign, dv) = match self {
            Self::TopLeftZero => (0.0, 1.0, 0.0),
            Self::Dltdv8 => (-1.0, 1.0, -1.0),
            Self::Dltdv5 => (-1.0, -1.0, f64::from(height_px)),
            Self::Argus => (0.0, -1.0, f64::from(height_px)),
        };
        Matrix3::new(1.0, 0.0, du, 0.0, sign, dv, 0.0, 0.0, 1.0)
    }

    pub(super) fn theirs_from_ours(self, height_px: u32) -> Matrix3<f64> {
        let m = self.ours_from_theirs(height_px);
        let sign = m[(1, 1)];
        Matrix3::new(1.0, 0.0, -m[(0, 2)], 0.0, sign, -sign * m[(1, 2)], 0.0, 0.0, 1.0)
    }

    pub(super) fn to_ours(self, theirs: Vector2<f64>, height_px: u32) -> Vector2<f64> {
        (self.ours_from_theirs(height_px) * theirs.push(1.0)).xy()
    }

    pub(super) fn to_theirs(self, ours: Vector2<f64>, height_px: u32) -> Vector2<f64> {
        (self.theirs_from_ours(height_px) * ours.push(1.0)).xy()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_of_a_640_by_480_image() {
        let (first, last) = (Vector2::new(0.0, 0.0), Vector2::new(639.0, 479.0));
        let want = [
            (PixelOrigin::TopLeftZero, (0.0, 0.0), (639.0, 479.0)),
            (PixelOrigin::Dltdv8, (1.0, 1.0), (640.0, 480.0)),
            (PixelOrigin::Dltdv5, (1.0, 480.0), (640.0, 1.0)),
            (PixelOrigin::Argus, (0.0, 480.0), (639.0, 1.0)),
        ];
        for (origin, a, b) in want {
            assert_eq!(origin.to_theirs(first, 480), Vector2::new(a.0, a.1), "{origin:?}");
            assert_eq!(origin.to_theirs(last, 480), Vector2::new(b.0, b.1), "{origin:?}");
            assert_eq!(origin.to_ours(Vector2::new(b.0, b.1), 480), last, "{origin:?}");
        }
    }
}
