//! Checks of a whole model.

use super::entries::Item;
use crate::document::Source;
use crate::fault::{Fault, ModelError};
use crate::graph::{Graph, Node, Variable};
use crate::model::{Model, Parameter};
use crate::rigid_body::BODY_PARAMETERS;

/// An order of parameters in which the value of each needs earlier ones alone, or parameters that need each
/// other.
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
    let left: Vec<usize> = (0..values.len()).filter(|k| !known[*k]).collect();
    if left.is_empty() { Ok(order) } else { Err(left) }
}

/// Refuses a parameter that nothing depends on, be it by a definition that nothing uses.
pub(super) fn every_parameter_is_used(
    model: &Model,
    parameters: &[Item<Parameter>],
    source: Source<'_>,
) -> Result<(), ModelError> {
    let nodes = &model.nodes;
    let mut all: Vec<Node> = nodes.rates.clone();
    for more in [&nodes.initial, &nodes.trim, &nodes.derived, &nodes.sensors, &nodes.scales] {
        all.extend(more);
    }
    all.extend(nodes.values.iter().flatten());
    all.extend(nodes.regressors.iter().flatten());
    all.extend(nodes.definitions.iter().map(|(_, node)| *node));
    let used = model.graph.variables(&all);
    let unused = |k: &usize| !used.contains(&Variable::Parameter(*k));
    match (BODY_PARAMETERS.len()..parameters.len()).find(unused) {
        Some(k) => source.fault(parameters[k].at, Fault::Unused(parameters[k].item.name.clone())),
        None => Ok(()),
    }
}
