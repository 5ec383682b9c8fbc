//! Exact derivatives: forward through a graph by the chain rule.

use super::{Function, Graph, Node, Operation, Variable};

impl Graph {
    /// The exact derivatives of some nodes by a variable: forward through the graph by the chain rule.
    ///
    /// At a kink (of `abs`, `min`, `max`, a table) the derivative is that of one side. Where the argument of
    /// a root does not change, the root does not either: the length of a velocity has derivatives at rest,
    /// zero.
    pub(crate) fn derivatives(&mut self, of: &[Node], by: Variable) -> Vec<Node> {
        let reached = self.reached(of);
        let zero = self.constant(0.0);
        let mut slopes: Vec<Node> = vec![zero; reached.len()];
        for k in (0..reached.len()).filter(|k| reached[*k]) {
            let operation = self.operations[k];
            slopes[k] = match operation {
                Operation::Variable(v) if v == by => self.constant(1.0),
                _ if operation.operands().all(|a| slopes[a.index()] == zero) => zero,
                _ => self.chain(Node(k as u32), operation, |node| slopes[node.index()]),
            };
        }
        of.iter().map(|node| slopes[node.index()]).collect()
    }

    fn chain(&mut self, node: Node, operation: Operation, d: impl Fn(Node) -> Node) -> Node {
        use Operation as O;
        match operation {
            O::Constant(_) | O::Variable(_) => self.constant(0.0),
            O::Add(a, b) => self.add(d(a), d(b)),
            O::Subtract(a, b) => self.subtract(d(a), d(b)),
            O::Multiply(a, b) => {
                let (left, right) = (self.multiply(d(a), b), self.multiply(a, d(b)));
                self.add(left, right)
            }
            // Of one over b, which is the only division left.
            O::Divide(_, b) => {
                let square = self.multiply(node, node);
                let slope = self.negate(square);
                self.multiply(slope, d(b))
            }
            O::Minimum(a, b) => self.chosen(b, a, d(a), d(b)),
            O::Maximum(a, b) => self.chosen(a, b, d(a), d(b)),
            O::Atan2(y, x) => {
                let (left, right) = (self.multiply(x, d(y)), self.multiply(y, d(x)));
                let (xx, yy) = (self.multiply(x, x), self.multiply(y, y));
                let (above, below) = (self.subtract(left, right), self.add(xx, yy));
                self.divide(above, below)
            }
            O::IntegerPower(a, n) => {
                let (power, factor) = (self.make(O::IntegerPower(a, n - 1)), self.constant(f64::from(n)));
                let slope = self.multiply(factor, power);
                self.multiply(slope, d(a))
            }
            O::Power(a, b) => {
                let one = self.constant(1.0);
                let less = self.subtract(b, one);
                let power = self.power(a, less);
                let base = self.multiply(b, power);
                let by_base = self.make(O::Scaled(d(a), base));
                if self.is(d(b), 0.0) {
                    return by_base;
                }
                let log = self.apply(Function::Log, a);
                let turned = self.multiply(node, d(b));
                let by_exponent = self.make(O::Scaled(turned, log));
                self.add(by_base, by_exponent)
            }
            O::Scaled(a, b) => {
                let (left, right) = (self.make(O::Scaled(d(a), b)), self.make(O::Scaled(a, d(b))));
                self.add(left, right)
            }
            O::Above(a, b) => self.make(O::Above(a, d(b))),
            O::NotAbove(a, b) => self.make(O::NotAbove(a, d(b))),
            O::Apply(function, a) => {
                let slope = self.slope_of(node, function, a);
                match function {
                    Function::Sqrt | Function::Asin | Function::Acos => self.make(O::Scaled(d(a), slope)),
                    _ => self.multiply(slope, d(a)),
                }
            }
        }
    }

    /// `first` where `high` is above `low`, else `second`.
    fn chosen(&mut self, high: Node, low: Node, first: Node, second: Node) -> Node {
        let above = self.subtract(high, low);
        let first = self.make(Operation::Above(above, first));
        let second = self.make(Operation::NotAbove(above, second));
        self.add(first, second)
    }

    fn slope_of(&mut self, node: Node, function: Function, a: Node) -> Node {
        let one = self.constant(1.0);
        match function {
            Function::Sin => self.apply(Function::Cos, a),
            Function::Cos => {
                let sin = self.apply(Function::Sin, a);
                self.negate(sin)
            }
            Function::Tan => {
                let square = self.multiply(node, node);
                self.add(one, square)
            }
            Function::Asin | Function::Acos => {
                // (1 - a)(1 + a) keeps the digits near the ends that 1 - a² loses.
                let (left, right) = (self.subtract(one, a), self.add(one, a));
                let square = self.multiply(left, right);
                let root = self.apply(Function::Sqrt, square);
                let slope = self.divide(one, root);
                if function == Function::Asin { slope } else { self.negate(slope) }
            }
            Function::Atan => {
                let square = self.multiply(a, a);
                let below = self.add(one, square);
                self.divide(one, below)
            }
            Function::Sqrt => {
                let half = self.constant(0.5);
                self.divide(half, node)
            }
            Function::Exp => node,
            Function::Log => self.divide(one, a),
            Function::Tanh => {
                // 4/(eᵃ + e⁻ᵃ)² keeps the digits far from zero that 1 - tanh² loses.
                let (minus, four) = (self.negate(a), self.constant(4.0));
                let (up, down) = (self.apply(Function::Exp, a), self.apply(Function::Exp, minus));
                let sum = self.add(up, down);
                let square = self.multiply(sum, sum);
                self.divide(four, square)
            }
            Function::Abs => self.apply(Function::Sign, a),
            Function::Table(k) => self.apply(Function::Slope(k), a),
            Function::Sign | Function::Slope(_) => self.constant(0.0),
        }
    }
}
