//! Checks of a whole model.

use super::entries::Item;
use crate::document::Source;
use crate::fault::{Fault, ModelError};
use crate::graph::{Graph, Node, Operation, Variable};
use crate::model::{Model, Parameter};
use crate::rigid_body::BODY_PARAMETERS;

/// An order of parameters in which the value of each needs earlier ones alone, or parameters each of which
/// needs the next, and the last the first.
pub(super) fn order_of_values(graph: &Graph, values: &[Option<Node>]) -> Result<Vec<usize>, Vec<usize>> {
    let needs = |k: usize| -> Vec<usize> {
        let own = values[k].map(|node| graph.variables(&[node])).unwrap_or_default();
        let parameter = |v| if let Variable::Parameter(k) = v { Some(k) } else { None };
        own.into_iter().filter_map(parameter).collect()
    };
    let needs: Vec<Vec<usize>> = (0..values.len()).map(needs).collect();
    let mut known = vec![false; values.len()];
    known[..BODY_PARAMETERS.len()].fill(true);
    let mut order = Vec::new();
    loop {
        let ready = |k: &usize| !known[*k] && needs[*k].iter().all(|need| known[*need]);
        let next: Vec<usize> = (0..values.len()).filter(ready).collect();
        if next.is_empty() {
            break;
        }
        next.iter().for_each(|k| known[*k] = true);
        order.extend(next);
    }
    let Some(mut at) = known.iter().position(|known| !known) else { return Ok(order) };
    // Whoever follows needs that are not known comes to a parameter for the second time.
    let mut way = Vec::new();
    while !way.contains(&at) {
        way.push(at);
        at = needs[at].iter().copied().find(|need| !known[*need]).unwrap_or(at);
    }
    let begin = way.iter().position(|k| *k == at).unwrap_or_default();
    Err(way.split_off(begin))
}

/// Operations in all derivatives together, at most: more would take seconds and hundreds of megabytes.
const MOST_DERIVATIVES: usize = 1_000_000;

/// Refuses a model that has too many derivatives: counts, for each operation, the variables it depends on.
pub(super) fn derivatives_are_few(model: &Model, source: Source<'_>) -> Result<(), ModelError> {
    let graph = &model.graph;
    let reached = graph.reached(&model.nodes.rates);
    let place = |variable: Variable| match variable {
        Variable::State(k) => k,
        Variable::Input(k) => model.state_count() + k,
        Variable::Parameter(k) => model.state_count() + model.inputs.len() + k,
    };
    let words = (model.state_count() + model.inputs.len() + model.parameters.len()).div_ceil(64);
    let mut depends = vec![0_u64; words * graph.len()];
    for k in (0..graph.len()).filter(|k| reached[*k]) {
        let (before, own) = depends.split_at_mut(words * k);
        match graph.operation(graph.node(k)) {
            Operation::Variable(variable) => own[place(variable) / 64] |= 1 << (place(variable) % 64),
            other => other.operands().for_each(|node| {
                let operand = &before[words * node.index()..][..words];
                own.iter_mut().zip(operand).for_each(|(own, operand)| *own |= operand);
            }),
        }
    }
    let found = depends.iter().map(|word| word.count_ones() as usize).sum();
    if found <= MOST_DERIVATIVES {
        return Ok(());
    }
    let (what, most) = ("operations in the derivatives of all forces, moments and states", MOST_DERIVATIVES);
    source.fault(0, Fault::TooMany { what, found, most })
}

/// Refuses a parameter that nothing depends on, be it by a definition that nothing uses.
pub(super) fn every_parameter_is_used(
    model: &Model,
    parameters: &[Item<Parameter>],
    definitions: &[(String, Node)],
    source: Source<'_>,
) -> Result<(), ModelError> {
    let nodes = &model.nodes;
    let mut all: Vec<Node> = nodes.rates.clone();
    for more in [&nodes.initial, &nodes.trim, &nodes.derived, &nodes.sensors, &nodes.scales] {
        all.extend(more);
    }
    all.extend(nodes.values.iter().flatten());
    all.extend(nodes.regressors.iter().flatten());
    all.extend(definitions.iter().map(|(_, node)| *node));
    let used = model.graph.variables(&all);
    let unused = |k: &usize| !used.contains(&Variable::Parameter(*k));
    match (BODY_PARAMETERS.len()..parameters.len()).find(unused) {
        Some(k) => source.fault(parameters[k].at, Fault::Unused(parameters[k].item.name.clone())),
        None => Ok(()),
    }
}
