//! Expressions as a list of steps, each a number from numbers before it.

use crate::graph::{Graph, Node, Operation, Table, Variable};

/// How often a step has to be worked out again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    /// When parameters change.
    Parameters,
    /// When inputs change.
    Inputs,
    /// At each state.
    State,
}

/// Steps of one kind behind each other: one loop without a choice in it takes a third of the time of a choice
/// at each step.
#[derive(Debug, Clone, PartialEq)]
struct Run {
    kind: RunKind,
    from: usize,
    to: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RunKind {
    Add,
    Subtract,
    Multiply,
    Other,
}

impl RunKind {
    fn of(operation: Operation) -> Self {
        match operation {
            Operation::Add(..) => Self::Add,
            Operation::Subtract(..) => Self::Subtract,
            Operation::Multiply(..) => Self::Multiply,
            _ => Self::Other,
        }
    }
}

/// Expressions that are worked out together from parameters, inputs and state.
///
/// Parts that depend on parameters alone are worked out once, parts that depend on parameters and inputs once
/// for each sample of the inputs.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Program {
    /// In an order in which operands come first, behind constants and variables.
    steps: Vec<Operation>,
    /// Both operands of each step.
    operands: Vec<(u32, u32)>,
    /// Runs of each level.
    runs: [Vec<Run>; 3],
    /// Numbers of constants and variables, at their places.
    start: Vec<f64>,
    /// Number of constants and variables.
    given: usize,
    /// Places of parameters, inputs and states: (which, place).
    variables: [Vec<(usize, usize)>; 3],
    outputs: Vec<usize>,
    tables: Vec<Table>,
}

/// The numbers of a program on the way.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Registers(Vec<f64>);

fn level_of(variable: Variable) -> Level {
    match variable {
        Variable::Parameter(_) => Level::Parameters,
        Variable::Input(_) => Level::Inputs,
        Variable::State(_) => Level::State,
    }
}

impl Program {
    pub(crate) fn new(graph: &Graph, outputs: &[Node]) -> Self {
        let reached = graph.reached(outputs);
        let used: Vec<Node> =
            (0..graph.len()).map(|k| graph.node(k)).filter(|n| reached[n.index()]).collect();
        let mut levels = vec![Level::Parameters; graph.len()];
        for node in &used {
            levels[node.index()] = match graph.operation(*node) {
                Operation::Variable(variable) => level_of(variable),
                other => other.operands().map(|a| levels[a.index()]).max().unwrap_or(Level::Parameters),
            };
        }
        let is_given =
            |n: &Node| matches!(graph.operation(*n), Operation::Constant(_) | Operation::Variable(_));
        let (mut order, computed): (Vec<Node>, Vec<Node>) = used.into_iter().partition(is_given);
        let given = order.len();
        let runs = [Level::Parameters, Level::Inputs, Level::State].map(|level| {
            let own = computed.iter().filter(|n| levels[n.index()] == level);
            in_runs(graph, &own.copied().collect::<Vec<Node>>(), &mut order)
        });
        let mut place = vec![0; graph.len()];
        order.iter().enumerate().for_each(|(k, node)| place[node.index()] = k);
        let mut start = vec![f64::NAN; order.len()];
        let mut variables: [Vec<(usize, usize)>; 3] = Default::default();
        for (k, node) in order[..given].iter().enumerate() {
            match graph.operation(*node) {
                Operation::Variable(Variable::Parameter(which)) => variables[0].push((which, k)),
                Operation::Variable(Variable::Input(which)) => variables[1].push((which, k)),
                Operation::Variable(Variable::State(which)) => variables[2].push((which, k)),
                constant => start[k] = constant.evaluate(&[], |_| f64::NAN),
            }
        }
        let steps = order[given..].iter().map(|n| graph.operation(*n).moved(|a| place[a.index()]));
        let steps: Vec<Operation> = steps.collect();
        let pair = |step: &Operation| {
            let mut own = step.operands().map(|a| a.index() as u32);
            let first = own.next().unwrap_or_default();
            (first, own.next().unwrap_or_default())
        };
        Self {
            operands: steps.iter().map(pair).collect(),
            steps,
            runs,
            start,
            given,
            variables,
            outputs: outputs.iter().map(|n| place[n.index()]).collect(),
            tables: graph.tables.clone(),
        }
    }

    /// Begins with parameters.
    pub(crate) fn with_parameters(&self, values: &[f64]) -> Registers {
        let mut registers = Registers(self.start.clone());
        self.run(Level::Parameters, values, &mut registers);
        registers
    }

    /// Continues with inputs.
    pub(crate) fn set_inputs(&self, values: &[f64], registers: &mut Registers) {
        self.run(Level::Inputs, values, registers);
    }

    /// Continues with a state.
    pub(crate) fn set_state(&self, values: &[f64], registers: &mut Registers) {
        self.run(Level::State, values, registers);
    }

    fn run(&self, level: Level, values: &[f64], registers: &mut Registers) {
        let (level, numbers) = (level as usize, &mut registers.0);
        for (which, place) in &self.variables[level] {
            numbers[*place] = values[*which];
        }
        for Run { kind, from, to } in &self.runs[level] {
            match kind {
                RunKind::Add => self.loop_over(*from, *to, numbers, |a, b| a + b),
                RunKind::Subtract => self.loop_over(*from, *to, numbers, |a, b| a - b),
                RunKind::Multiply => self.loop_over(*from, *to, numbers, |a, b| a * b),
                RunKind::Other => {
                    for k in *from..*to {
                        let step = self.steps[k - self.given];
                        numbers[k] = step.evaluate(&self.tables, |a| numbers[a.index()]);
                    }
                }
            }
        }
    }

    fn loop_over(&self, from: usize, to: usize, numbers: &mut [f64], of: impl Fn(f64, f64) -> f64) {
        let (known, open) = numbers.split_at_mut(from);
        let operands = &self.operands[from - self.given..to - self.given];
        for (out, (a, b)) in open.iter_mut().zip(operands) {
            *out = of(known[*a as usize], known[*b as usize]);
        }
    }

    /// The outputs, in the order asked for.
    pub(crate) fn outputs<'a>(&'a self, registers: &'a Registers) -> impl Iterator<Item = f64> + 'a {
        self.outputs.iter().map(|place| registers.0[*place])
    }

    /// One output.
    pub(crate) fn output(&self, k: usize, registers: &Registers) -> f64 {
        registers.0[self.outputs[k]]
    }

    /// The outputs of a program that needs nothing but parameters and inputs.
    pub(crate) fn values(&self, parameters: &[f64], inputs: &[f64]) -> Vec<f64> {
        let mut registers = self.with_parameters(parameters);
        self.set_inputs(inputs, &mut registers);
        self.outputs(&registers).collect()
    }
}

/// Appends nodes to an order in which operands come first, with as many of one kind behind each other as can
/// be: of those whose operands are there, the kind of which there are most comes next.
fn in_runs(graph: &Graph, nodes: &[Node], order: &mut Vec<Node>) -> Vec<Run> {
    let mut waiting = vec![0; graph.len()];
    let mut users: Vec<Vec<Node>> = vec![Vec::new(); graph.len()];
    nodes.iter().for_each(|node| waiting[node.index()] = 1);
    let is_open = waiting.clone();
    for node in nodes {
        let open = graph.operation(*node).operands().filter(|a| is_open[a.index()] == 1);
        for operand in open {
            waiting[node.index()] += 1;
            users[operand.index()].push(*node);
        }
    }
    const KINDS: [RunKind; 4] = [RunKind::Multiply, RunKind::Add, RunKind::Subtract, RunKind::Other];
    let mut ready: [Vec<Node>; 4] = Default::default();
    let kind = |node: Node| KINDS.iter().position(|k| *k == RunKind::of(graph.operation(node))).unwrap_or(3);
    for node in nodes.iter().filter(|n| waiting[n.index()] == 1) {
        ready[kind(*node)].push(*node);
    }
    let mut runs = Vec::new();
    while let Some(most) = (0..4).max_by_key(|k| ready[*k].len()).filter(|k| !ready[*k].is_empty()) {
        let from = order.len();
        let run = std::mem::take(&mut ready[most]);
        for node in &run {
            for user in &users[node.index()] {
                waiting[user.index()] -= 1;
                if waiting[user.index()] == 1 {
                    ready[kind(*user)].push(*user);
                }
            }
        }
        order.extend(run);
        runs.push(Run { kind: KINDS[most], from, to: order.len() });
    }
    runs
}
