//! Shapes that a ray can meet.

use nalgebra::Vector3;

type V = Vector3<f64>;

/// A ray; the direction has length one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    pub origin: V,
    pub direction: V,
}

/// The square of an image that a ray stands for: its two directions and its angular width.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Footprint {
    pub sides: [V; 2],
    pub width_rad: f64,
}

impl Footprint {
    /// Part of the square on the near side of a straight edge at a distance from its middle, across a
    /// direction: two boxes convolved.
    fn covered(&self, distance_rad: f64, across: &V) -> f64 {
        let [x, y] = self.sides.map(|side| side.dot(across).abs());
        let (long, short) = (x.max(y), x.min(y));
        let distance = distance_rad / self.width_rad * x.hypot(y);
        let left = (0.5 * (long + short) - distance.abs()).max(0.0);
        let uncovered = if left < short {
            left * left / (2.0 * long * short)
        } else {
            (0.5 - distance.abs() / long).max(0.0)
        };
        if distance > 0.0 { 1.0 - uncovered } else { uncovered }
    }
}

impl Ray {
    /// The hit of the ray on a ball, and the share of the ray's footprint that the ball covers, its rim taken
    /// as a straight edge. A ray that just misses hits the rim.
    pub(crate) fn cover_by_ball(&self, centre: &V, radius: f64, footprint: &Footprint) -> Option<(Hit, f64)> {
        let to = self.origin - centre;
        let distance_m = -to.dot(&self.direction);
        if distance_m <= NEAR_M {
            return None;
        }
        let nearest = to + self.direction * distance_m;
        let away_m = nearest.norm();
        let covered = footprint.covered((radius - away_m) / distance_m, &nearest);
        let hit = meet_ball(self, centre, radius);
        let hit = hit.or((covered > 0.0).then(|| Hit { distance_m, normal: nearest / away_m }))?;
        Some((hit, covered))
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Hit {
    pub distance_m: f64,
    pub normal: V,
}

#[derive(Debug, Clone, Copy)]
pub(crate) enum Shape {
    /// A box turned about the vertical.
    Block {
        centre: V,
        half: V,
        yaw: (f64, f64),
    },
    Ball {
        centre: V,
        radius: f64,
    },
    Ellipsoid {
        centre: V,
        semi: V,
    },
    Capsule {
        from: V,
        to: V,
        radius: f64,
    },
    /// A ring between two radii, level in its own axes.
    Ring {
        centre: V,
        inner: f64,
        outer: f64,
    },
}

const NEAR_M: f64 = 1e-4;

impl Shape {
    pub(crate) fn block(centre: [f64; 3], size: [f64; 3], yaw_deg: f64) -> Self {
        let (s, c) = yaw_deg.to_radians().sin_cos();
        Self::Block { centre: V::from(centre), half: V::from(size) / 2.0, yaw: (s, c) }
    }

    /// A line and a radius: all points within the radius of the line hold the shape.
    pub(crate) fn core(&self) -> ([V; 2], f64) {
        match self {
            Self::Block { centre, half, .. } => ([*centre; 2], half.norm()),
            Self::Ball { centre, radius } => ([*centre; 2], *radius),
            Self::Ellipsoid { centre, semi } => ([*centre; 2], semi.amax()),
            Self::Capsule { from, to, radius } => ([*from, *to], *radius),
            Self::Ring { centre, outer, .. } => ([*centre; 2], *outer),
        }
    }

    /// Centre and radius of a ball that holds the shape.
    pub(crate) fn bound(&self) -> (V, f64) {
        let ([from, to], radius) = self.core();
        ((from + to) / 2.0, (to - from).norm() / 2.0 + radius)
    }

    pub(crate) fn bounds(&self) -> (V, V) {
        let about = |centre: &V, half: V| (centre - half, centre + half);
        match self {
            Self::Block { centre, half, yaw: (s, c) } => {
                let x = half.x * c.abs() + half.y * s.abs();
                let y = half.x * s.abs() + half.y * c.abs();
                about(centre, V::new(x, y, half.z))
            }
            Self::Ball { centre, radius } => about(centre, V::repeat(*radius)),
            Self::Ellipsoid { centre, semi } => about(centre, *semi),
            Self::Capsule { from, to, radius } => {
                (from.inf(to).add_scalar(-radius), from.sup(to).add_scalar(*radius))
            }
            Self::Ring { centre, outer, .. } => about(centre, V::new(*outer, *outer, 1e-6)),
        }
    }

    /// The first hit ahead of the ray's origin.
    pub(crate) fn meet(&self, ray: &Ray) -> Option<Hit> {
        match self {
            Self::Block { centre, half, yaw } => meet_block(ray, centre, half, *yaw),
            Self::Ball { centre, radius } => meet_ball(ray, centre, *radius),
            Self::Ellipsoid { centre, semi } => {
                let scale = |v: V| v.component_div(semi);
                let direction = scale(ray.direction);
                let length = direction.norm();
                let unit = Ray { origin: scale(ray.origin - centre), direction: direction / length };
                let hit = meet_ball(&unit, &V::zeros(), 1.0)?;
                Some(Hit { distance_m: hit.distance_m / length, normal: scale(hit.normal).normalize() })
            }
            Self::Capsule { from, to, radius } => meet_capsule(ray, from, to, *radius),
            Self::Ring { centre, inner, outer } => {
                let t = (centre.z - ray.origin.z) / ray.direction.z;
                if t.is_nan() || t <= NEAR_M {
                    return None;
                }
                let p = ray.origin + ray.direction * t - centre;
                let r = p.x.hypot(p.y);
                let up = V::new(0.0, 0.0, -ray.direction.z.signum());
                (r >= *inner && r <= *outer).then_some(Hit { distance_m: t, normal: up })
            }
        }
    }
}

fn meet_ball(ray: &Ray, centre: &V, radius: f64) -> Option<Hit> {
    let to = ray.origin - centre;
    let b = to.dot(&ray.direction);
    let disc = b * b - to.norm_squared() + radius * radius;
    if disc < 0.0 {
        return None;
    }
    let root = disc.sqrt();
    let t = if -b - root > NEAR_M { -b - root } else { -b + root };
    (t > NEAR_M).then(|| Hit { distance_m: t, normal: (to + ray.direction * t) / radius })
}

fn meet_block(ray: &Ray, centre: &V, half: &V, (s, c): (f64, f64)) -> Option<Hit> {
    let into = |v: V| V::new(c * v.x + s * v.y, -s * v.x + c * v.y, v.z);
    let out = |v: V| V::new(c * v.x - s * v.y, s * v.x + c * v.y, v.z);
    let (o, d) = (into(ray.origin - centre), into(ray.direction));
    let (mut enter, mut leave, mut axis) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for k in 0..3 {
        let inverse = 1.0 / d[k];
        let (a, b) = ((-half[k] - o[k]) * inverse, (half[k] - o[k]) * inverse);
        let (a, b) = if a < b { (a, b) } else { (b, a) };
        if a > enter {
            (enter, axis) = (a, k);
        }
        leave = leave.min(b);
    }
    if enter > leave || enter < NEAR_M {
        return None;
    }
    let mut normal = V::zeros();
    normal[axis] = -d[axis].signum();
    Some(Hit { distance_m: enter, normal: out(normal) })
}

fn meet_capsule(ray: &Ray, from: &V, to: &V, radius: f64) -> Option<Hit> {
    let (axis, start) = (to - from, ray.origin - from);
    let (aa, ad, ao) = (axis.norm_squared(), axis.dot(&ray.direction), axis.dot(&start));
    let a = aa - ad * ad;
    let b = aa * start.dot(&ray.direction) - ao * ad;
    let c = aa * start.norm_squared() - ao * ao - radius * radius * aa;
    let disc = b * b - a * c;
    if disc >= 0.0 && a > 1e-12 {
        let t = (-b - disc.sqrt()) / a;
        let along = ao + t * ad;
        if t > NEAR_M && along > 0.0 && along < aa {
            let normal = (start + ray.direction * t - axis * (along / aa)) / radius;
            return Some(Hit { distance_m: t, normal });
        }
    }
    let ends = [meet_ball(ray, from, radius), meet_ball(ray, to, radius)];
    ends.into_iter().flatten().min_by(|x, y| x.distance_m.total_cmp(&y.distance_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn inside(shape: &Shape, p: &V) -> bool {
        match shape {
            Shape::Block { centre, half, yaw: (s, c) } => {
                let v = p - centre;
                let v = V::new(c * v.x + s * v.y, -s * v.x + c * v.y, v.z);
                (0..3).all(|k| v[k].abs() < half[k])
            }
            Shape::Ball { centre, radius } => (p - centre).norm() < *radius,
            Shape::Ellipsoid { centre, semi } => (p - centre).component_div(semi).norm() < 1.0,
            Shape::Capsule { from, to, radius } => {
                let w = ((p - from).dot(&(to - from)) / (to - from).norm_squared()).clamp(0.0, 1.0);
                (p - from - (to - from) * w).norm() < *radius
            }
            Shape::Ring { .. } => false,
        }
    }

    proptest! {
        /// In cells of an eighth of a pixel of 1/640: the cone around the ball by its closed form.
        #[test]
        fn a_disc_has_its_area_and_its_middle(u in -0.5..0.5, v in -0.5..0.5, radius_px in 2.5..8.0) {
            const CELL: f64 = 1.0 / (8.0 * 640.0);
            let (distance_m, centre) = (5.0, V::new(u / 640.0, v / 640.0, 1.0).normalize() * 5.0);
            let radius_m = radius_px / 640.0 * distance_m;
            let reach = (8.0 * (radius_px + 2.0)) as i32;
            let (mut area, mut at) = (0.0, [0.0_f64; 2]);
            let footprint = Footprint { sides: [V::x(), V::y()], width_rad: CELL };
            for (i, j) in (-reach..reach).flat_map(|j| (-reach..reach).map(move |i| (i, j))) {
                let place = [i, j].map(|k| (f64::from(k) + 0.5) * CELL);
                let ray = Ray { origin: V::zeros(), direction: V::new(place[0], place[1], 1.0).normalize() };
                let Some((hit, covered)) = ray.cover_by_ball(&centre, radius_m, &footprint) else { continue };
                prop_assert!((0.0..=1.0).contains(&covered) && (hit.normal.norm() - 1.0).abs() < 1e-9);
                area += covered;
                (0..2).for_each(|k| at[k] += covered * place[k]);
            }
            let seen_px = 640.0 * radius_m / (distance_m * distance_m - radius_m * radius_m).sqrt();
            let got_px = (area / std::f64::consts::PI).sqrt() / 8.0;
            prop_assert!((got_px - seen_px).abs() < 4e-4, "{} is not {}", got_px, seen_px);
            for (at, want) in at.iter().zip([u, v] as [f64; 2]) {
                let got = 640.0 * at / area;
                prop_assert!((got - want).abs() < 1e-4, "{} is not {}", got, want);
            }
        }

        #[test]
        fn rays_stop_where_the_solid_begins(x in -3.0..3.0, y in -3.0..3.0, z in -3.0..3.0, which in 0usize..4, aim in -0.3..0.3) {
            let shape = [
                Shape::block([0.1, 0.2, 0.0], [1.0, 0.6, 0.8], 30.0),
                Shape::Ball { centre: V::new(0.0, 0.1, 0.0), radius: 0.5 },
                Shape::Ellipsoid { centre: V::zeros(), semi: V::new(0.9, 0.4, 0.3) },
                Shape::Capsule { from: V::new(-0.5, 0.0, 0.0), to: V::new(0.5, 0.2, 0.1), radius: 0.2 },
            ][which];
            let origin = V::new(x, y, z);
            prop_assume!(origin.norm() > 1.5);
            let direction = (V::new(aim, -aim, aim) - origin).normalize();
            let marched = (0..8000).map(|k| f64::from(k) * 1e-3).find(|t| inside(&shape, &(origin + direction * *t)));
            match (marched, shape.meet(&Ray { origin, direction })) {
                (Some(t), Some(hit)) => {
                    prop_assert!((t - hit.distance_m).abs() < 3e-3, "{} {}", t, hit.distance_m);
                    prop_assert!(hit.normal.dot(&direction) < 1e-9 && (hit.normal.norm() - 1.0).abs() < 1e-9);
                }
                (Some(t), None) => prop_assert!(!inside(&shape, &(origin + direction * (t + 0.05))), "missed"),
                (None, Some(hit)) => prop_assert!(!inside(&shape, &(origin + direction * (hit.distance_m + 0.05)))),
                (None, None) => {}
            }
        }
    }
}
