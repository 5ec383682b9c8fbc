//! Lines drawn over a picture.

use mavsight_geometry::ImageSize;
use nalgebra::Vector2;

/// Draws a path over packed sRGB bytes: a smooth line, `width_px` wide. Points that are not finite break the
/// line.
pub fn draw_path(rgb: &mut [u8], size: ImageSize, points: &[Vector2<f64>], color: [u8; 3], width_px: f64) {
    let reach = width_px / 2.0 + 1.0;
    let (width, height) = (size.width_px as usize, size.height_px as usize);
    let mut cover = vec![0.0_f32; width * height];
    for pair in points.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        if !(a + b).iter().all(|v| v.is_finite()) {
            continue;
        }
        let range = |p: f64, q: f64, end: usize| {
            let low = (p.min(q) - reach).clamp(0.0, end as f64) as usize;
            let high = (p.max(q) + reach + 1.0).clamp(0.0, end as f64) as usize;
            low..high
        };
        for y in range(a.y, b.y, height) {
            for x in range(a.x, b.x, width) {
                let p = Vector2::new(x as f64, y as f64);
                let along = b - a;
                let w = ((p - a).dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
                let distance = (p - a - along * w).norm();
                let covered = (width_px / 2.0 + 0.5 - distance).clamp(0.0, 1.0) as f32;
                let slot = &mut cover[y * width + x];
                *slot = slot.max(covered);
            }
        }
    }
    for (pixel, covered) in rgb.chunks_exact_mut(3).zip(cover).filter(|(_, c)| *c > 0.0) {
        for (value, paint) in pixel.iter_mut().zip(color) {
            *value = (f32::from(*value) * (1.0 - covered) + f32::from(paint) * covered).round() as u8;
        }
    }
}
