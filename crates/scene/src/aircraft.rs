//! The filmed objects: the helicopter with its balls, and the control frame.

use crate::shapes::Shape;
use nalgebra::Vector3;

type V = Vector3<f64>;

/// A coloured ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaintedBall {
    /// Centre in the axes of its carrier.
    pub centre_m: Vector3<f64>,
    /// Radius.
    pub radius_m: f64,
    /// Colour in linear light, 0 to 1.
    pub linear: [f64; 3],
}

/// A part of a moving object: shape, linear colour, gloss, and the share of light that passes through it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Part {
    pub shape: Shape,
    pub linear: [f64; 3],
    pub gloss: f64,
    pub passes: f64,
    pub bound: (V, f64),
}

impl Part {
    pub(crate) fn new(shape: Shape, linear: [f64; 3], gloss: f64, passes: f64) -> Self {
        Self { shape, linear, gloss, passes, bound: shape.bound() }
    }
}

/// What a flight carries through the room, coloured balls above all, in its body axes (x forward, y right, z down).
#[derive(Debug, Clone)]
pub struct Aircraft {
    pub(crate) parts: Vec<Part>,
}

impl Aircraft {
    /// The paper's helicopter; an arm leads from under the hull to each ball.
    pub fn helicopter(balls: &[PaintedBall]) -> Self {
        let dark = [0.02, 0.02, 0.024];
        let metal = [0.28, 0.28, 0.30];
        let capsule =
            |a: [f64; 3], b: [f64; 3], r: f64| Shape::Capsule { from: V::from(a), to: V::from(b), radius: r };
        let ellipsoid = |centre: [f64; 3], semi: [f64; 3]| Shape::Ellipsoid {
            centre: V::from(centre),
            semi: V::from(semi),
        };
        let mut parts = vec![
            Part::new(ellipsoid([0.02, 0.0, 0.01], [0.12, 0.045, 0.05]), dark, 0.25, 0.0),
            Part::new(ellipsoid([0.09, 0.0, 0.015], [0.055, 0.038, 0.036]), [0.05, 0.06, 0.08], 0.5, 0.0),
            Part::new(capsule([-0.08, 0.0, 0.0], [-0.30, 0.0, -0.02], 0.008), dark, 0.1, 0.0),
            Part::new(Shape::block([-0.29, 0.0, -0.04], [0.05, 0.004, 0.09], 0.0), dark, 0.1, 0.0),
            Part::new(capsule([0.0, 0.0, -0.02], [0.0, 0.0, -0.23], 0.004), metal, 0.3, 0.0),
            Part::new(capsule([0.0, -0.12, -0.225], [0.0, 0.12, -0.225], 0.003), metal, 0.2, 0.4),
        ];
        for z in [-0.12, -0.20] {
            let disc = Shape::Ring { centre: V::new(0.0, 0.0, z), inner: 0.02, outer: 0.25 };
            parts.push(Part::new(disc, [0.03; 3], 0.0, 0.88));
        }
        for side in [-0.07, 0.07] {
            parts.push(Part::new(capsule([-0.1, side, 0.095], [0.12, side, 0.095], 0.004), metal, 0.2, 0.0));
            for x in [-0.05, 0.06] {
                let strut = capsule([x, side * 0.4, 0.04], [x, side, 0.095], 0.003);
                parts.push(Part::new(strut, metal, 0.2, 0.0));
            }
        }
        for ball in balls {
            let hub = V::new(0.0, 0.0, ball.centre_m.z);
            let arm = Shape::Capsule { from: hub, to: ball.centre_m, radius: 0.002 };
            parts.push(Part::new(arm, [0.30, 0.30, 0.31], 0.1, 0.0));
            parts.push(painted(ball));
        }
        Self { parts }
    }

    /// A dark hub in the origin and an arm to each ball: any aircraft of whose hull nothing is known. Hub and arms are in
    /// proportion to the farthest ball, so that they hide as little of an aircraft of 20 cm as of one of 2 m.
    pub fn hub_with_arms(balls: &[PaintedBall]) -> Self {
        let reach_m = balls.iter().map(|ball| ball.centre_m.norm()).fold(0.0, f64::max);
        let hub = Shape::Ellipsoid { centre: V::zeros(), semi: V::new(0.15, 0.15, 0.08) * reach_m };
        let arm = |ball: &PaintedBall| {
            let arm = Shape::Capsule { from: V::zeros(), to: ball.centre_m, radius: 0.012 * reach_m };
            Part::new(arm, [0.05; 3], 0.1, 0.0)
        };
        let mut parts = vec![Part::new(hub, [0.02, 0.02, 0.024], 0.25, 0.0)];
        parts.extend(balls.iter().flat_map(|ball| [arm(ball), painted(ball)]));
        Self { parts }
    }

    /// Balls joined by a stick of 6 mm, from the first to the last.
    pub fn stick(balls: &[PaintedBall]) -> Self {
        let mut parts: Vec<Part> = balls.iter().map(painted).collect();
        if let [first, .., last] = balls {
            let stick = Shape::Capsule { from: first.centre_m, to: last.centre_m, radius: 0.003 };
            parts.push(Part::new(stick, [0.30; 3], 0.1, 0.0));
        }
        Self { parts }
    }

    /// A chessboard in the plane z = 0, which is seen from -z: `columns` by `rows` inner corners, of which
    /// the first is the origin; x along a row, y from row to row. The square beyond the first corner is dark.
    pub fn board(columns: usize, rows: usize, square_m: f64) -> Self {
        let (paper, ink) = ([0.75; 3], [0.02; 3]);
        let half = |n: usize| 0.5 * (n as f64 - 1.0) * square_m;
        let size = |n: usize| (n as f64 + 3.0) * square_m;
        let sheet =
            Shape::block([half(columns), half(rows), 0.002], [size(columns), size(rows), 0.0036], 0.0);
        let mut parts = vec![Part::new(sheet, paper, 0.0, 0.0)];
        for j in 0..=rows {
            for i in (0..=columns).filter(|i| (i + j) % 2 == 0) {
                let centre = [(i as f64 - 0.5) * square_m, (j as f64 - 0.5) * square_m, 1e-4];
                parts.push(Part::new(Shape::block(centre, [square_m, square_m, 2e-4], 0.0), ink, 0.0, 0.0));
            }
        }
        Self { parts }
    }
}

/// Balls at surveyed places on thin rods, in world axes.
#[derive(Debug, Clone)]
pub struct ControlFrame {
    pub(crate) parts: Vec<Part>,
}

impl ControlFrame {
    /// A white rod of 3 mm joins every two balls that differ in one coordinate only.
    pub fn new(balls: &[PaintedBall]) -> Self {
        let mut parts: Vec<Part> = balls.iter().map(painted).collect();
        for (k, a) in balls.iter().enumerate() {
            for b in &balls[k + 1..] {
                let differing = (b.centre_m - a.centre_m).iter().filter(|d| d.abs() > 1e-6).count();
                if differing == 1 {
                    let rod = Shape::Capsule { from: a.centre_m, to: b.centre_m, radius: 0.0015 };
                    parts.push(Part::new(rod, [0.45; 3], 0.1, 0.0));
                }
            }
        }
        Self { parts }
    }

    /// This aircraft with each ball moved by an offset and the rods unchanged: a ball that is not round
    /// appears off its place, differently to each camera.
    #[must_use]
    pub fn with_balls_off(mut self, by_m: &[Vector3<f64>]) -> Self {
        let balls = self.parts.iter_mut().filter(|p| matches!(p.shape, Shape::Ball { .. }));
        for (ball, by) in balls.zip(by_m) {
            if let Shape::Ball { centre, radius } = ball.shape {
                let moved = Shape::Ball { centre: centre + by, radius };
                *ball = Part::new(moved, ball.linear, ball.gloss, ball.passes);
            }
        }
        self
    }
}

fn painted(ball: &PaintedBall) -> Part {
    Part::new(Shape::Ball { centre: ball.centre_m, radius: ball.radius_m }, ball.linear, 0.06, 0.0)
}
