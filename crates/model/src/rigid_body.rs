//! The rigid body that every model moves: its names, and Newton's and Euler's equations.

use crate::graph::{Function, Graph, Node, Variable};
use crate::unit::Unit;

/// States of the rigid body: position in the world (3), level_from_body as w, x, y, z (4), velocity in body
/// axes (3), rates (3).
pub const RIGID_STATES: usize = 13;

/// Parameters that every model has, in this order before its own: mass, moments and products of inertia,
/// gravity, density of the air.
pub const BODY_PARAMETERS: [&str; 9] = ["mass", "I_xx", "I_yy", "I_zz", "I_xy", "I_xz", "I_yz", "g", "rho"];

/// The unit of one of [`BODY_PARAMETERS`].
pub(crate) fn unit_of(body_parameter: usize) -> Unit {
    let inertia = Unit::KILOGRAM.times(Unit::METRE.to_the(2.0));
    match body_parameter {
        0 => Unit::KILOGRAM,
        7 => Unit::METRE.over(Unit::SECOND.to_the(2.0)),
        8 => Unit::KILOGRAM.over(Unit::METRE.to_the(3.0)),
        _ => inertia,
    }
}

type Vector = [Node; 3];

/// Nodes of the rigid body's state, and of what follows from it.
pub(crate) struct RigidBody {
    pub(crate) position: Vector,
    /// w, x, y, z.
    quaternion: [Node; 4],
    pub(crate) velocity: Vector,
    pub(crate) rates: Vector,
    /// One over the square of the quaternion's length, times two.
    twice_over_square: Node,
    square: Node,
}

/// Force and moment on the body, body axes.
pub(crate) struct Load {
    pub(crate) force: Vector,
    pub(crate) moment: Vector,
}

/// What the rigid body does under a load.
pub(crate) struct Acceleration {
    /// Derivatives of the 13 states.
    pub(crate) rates_of_state: Vec<Node>,
    /// Force over mass.
    pub(crate) specific_force: Vector,
    pub(crate) angular: Vector,
}

fn cross(graph: &mut Graph, a: Vector, b: Vector) -> Vector {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
        let (left, right) = (graph.multiply(a[i], b[j]), graph.multiply(a[j], b[i]));
        graph.subtract(left, right)
    })
}

fn dot(graph: &mut Graph, a: &[Node], b: &[Node]) -> Node {
    let terms: Vec<Node> = a.iter().zip(b).map(|(a, b)| graph.multiply(*a, *b)).collect();
    graph.sum(&terms)
}

impl RigidBody {
    pub(crate) fn new(graph: &mut Graph) -> Self {
        let mut state = |k: usize| graph.variable(Variable::State(k));
        let position = [state(0), state(1), state(2)];
        let quaternion = [state(3), state(4), state(5), state(6)];
        let velocity = [state(7), state(8), state(9)];
        let rates = [state(10), state(11), state(12)];
        let square = dot(graph, &quaternion, &quaternion);
        let two = graph.constant(2.0);
        let twice_over_square = graph.divide(two, square);
        Self { position, quaternion, velocity, rates, twice_over_square, square }
    }

    /// level_from_body, row by row, for a quaternion of any length.
    fn rotation(&self, graph: &mut Graph) -> [Vector; 3] {
        let [w, x, y, z] = self.quaternion;
        let s = self.twice_over_square;
        let one = graph.constant(1.0);
        let mut pair = |a: Node, b: Node| {
            let product = graph.multiply(a, b);
            graph.multiply(s, product)
        };
        let (xx, yy, zz) = (pair(x, x), pair(y, y), pair(z, z));
        let (xy, xz, yz) = (pair(x, y), pair(x, z), pair(y, z));
        let (wx, wy, wz) = (pair(w, x), pair(w, y), pair(w, z));
        let mut less = |a: Node, b: Node| {
            let sum = graph.add(a, b);
            graph.subtract(one, sum)
        };
        let diagonal = [less(yy, zz), less(xx, zz), less(xx, yy)];
        [
            [diagonal[0], graph.subtract(xy, wz), graph.add(xz, wy)],
            [graph.add(xy, wz), diagonal[1], graph.subtract(yz, wx)],
            [graph.subtract(xz, wy), graph.add(yz, wx), diagonal[2]],
        ]
    }

    /// phi, theta, psi of the 3-2-1 sequence.
    pub(crate) fn euler_angles(&self, graph: &mut Graph) -> Vector {
        let r = self.rotation(graph);
        let up = graph.negate(r[2][0]);
        // An arc sine would lose half its digits near the vertical, and have no value where rounding exceeds
        // one.
        let squares = dot(graph, &r[2][1..], &r[2][1..]);
        let across = graph.apply(Function::Sqrt, squares);
        [graph.atan2(r[2][1], r[2][2]), graph.atan2(up, across), graph.atan2(r[1][0], r[0][0])]
    }

    /// Newton's and Euler's equations in body axes (Stevens & Lewis 2003, section 1.4), and kinematics: world
    /// axes are level axes with y and z reversed.
    ///
    /// The quaternion's length is drawn back to one with a time constant of one second, which does not change
    /// the attitude.
    pub(crate) fn accelerate(
        &self,
        graph: &mut Graph,
        body: &[Node; BODY_PARAMETERS.len()],
        load: &Load,
    ) -> Acceleration {
        let [mass, .., gravity, _] = *body;
        let rotation = self.rotation(graph);
        let level = rotation.map(|row| dot(graph, &row, &self.velocity));
        let position = [level[0], graph.negate(level[1]), graph.negate(level[2])];
        let specific_force = load.force.map(|f| graph.divide(f, mass));
        let turning = cross(graph, self.velocity, self.rates);
        let velocity = [0, 1, 2].map(|k| {
            let weight = graph.multiply(gravity, rotation[2][k]);
            let sum = graph.add(specific_force[k], weight);
            graph.add(sum, turning[k])
        });
        let angular = self.angular(graph, body, load.moment);
        let mut rates_of_state: Vec<Node> = position.to_vec();
        rates_of_state.extend(self.turn(graph));
        rates_of_state.extend(velocity);
        rates_of_state.extend(angular);
        Acceleration { rates_of_state, specific_force, angular }
    }

    /// q (0, rates)/2 + q (1 - |q|²)/2.
    fn turn(&self, graph: &mut Graph) -> Vec<Node> {
        let [w, x, y, z] = self.quaternion;
        let [p, q, r] = self.rates;
        let (half, one) = (graph.constant(0.5), graph.constant(1.0));
        let short = graph.subtract(one, self.square);
        let [minus_p, minus_q, minus_r] = [p, q, r].map(|rate| graph.negate(rate));
        [[minus_p, minus_q, minus_r], [p, r, minus_q], [q, minus_r, p], [r, q, minus_p]]
            .into_iter()
            .zip([[x, y, z], [w, y, z], [w, x, z], [w, x, y]])
            .zip(self.quaternion)
            .map(|((rates, parts), own)| {
                let turned = dot(graph, &rates, &parts);
                let drawn = graph.multiply(short, own);
                let sum = graph.add(turned, drawn);
                graph.multiply(half, sum)
            })
            .collect()
    }

    /// I⁻¹ (M - ω × I ω) by cofactors.
    fn angular(&self, graph: &mut Graph, body: &[Node; BODY_PARAMETERS.len()], moment: Vector) -> Vector {
        let [_, xx, yy, zz, xy, xz, yz, ..] = *body;
        let [xy, xz, yz] = [xy, xz, yz].map(|product| graph.negate(product));
        let inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let momentum = inertia.map(|row| dot(graph, &row, &self.rates));
        let gyroscopic = cross(graph, momentum, self.rates);
        let total = [0, 1, 2].map(|k| graph.add(moment[k], gyroscopic[k]));
        // Rows of the adjugate of a symmetric matrix are cross products of its rows.
        let adjugate = [
            cross(graph, inertia[1], inertia[2]),
            cross(graph, inertia[2], inertia[0]),
            cross(graph, inertia[0], inertia[1]),
        ];
        let determinant = dot(graph, &inertia[0], &adjugate[0]);
        adjugate.map(|row| {
            let above = dot(graph, &row, &total);
            graph.divide(above, determinant)
        })
    }
}
