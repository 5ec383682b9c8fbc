//! A flight-model file worked out from its text in 57 digits, with nothing of the crate: an independent check
//! of its parser, its graph, its rigid body and its derivatives.

mod number;
mod tape;

pub(crate) use number::Constants;
pub(crate) use tape::Tape;

use std::collections::HashMap;
use toml::{Table, Value};

/// Names of the rigid body's states, in the order of the crate. Those with a `$` no file can have.
pub(crate) const RIGID: [&str; 13] = ["x", "y", "z", "$w", "$x", "$y", "$z", "u", "v", "w", "p", "q", "r"];
/// Names of the body's parameters, in the order of the crate.
pub(crate) const BODY: [&str; 9] = ["mass", "I_xx", "I_yy", "I_zz", "I_xy", "I_xz", "I_yz", "g", "rho"];

/// The rigid body by rotation matrix and Cramer's rule: `$X` to `$Z` are forces, `$L` to `$N` moments. World
/// z is up, level z is down.
const RIGID_BODY: [(&str, &str); 43] = [
    ("$n", "$w*$w + $x*$x + $y*$y + $z*$z"),
    ("$11", "($w*$w + $x*$x - $y*$y - $z*$z)/$n"),
    ("$12", "2*($x*$y - $w*$z)/$n"),
    ("$13", "2*($x*$z + $w*$y)/$n"),
    ("$21", "2*($x*$y + $w*$z)/$n"),
    ("$22", "($w*$w - $x*$x + $y*$y - $z*$z)/$n"),
    ("$23", "2*($y*$z - $w*$x)/$n"),
    ("$31", "2*($x*$z - $w*$y)/$n"),
    ("$32", "2*($y*$z + $w*$x)/$n"),
    ("$33", "($w*$w - $x*$x - $y*$y + $z*$z)/$n"),
    ("phi", "atan2($32, $33)"),
    ("theta", "asin(-$31)"),
    ("psi", "atan2($21, $11)"),
    // Angular momentum, and the moment less what turning it takes.
    ("$Hx", "I_xx*p - I_xy*q - I_xz*r"),
    ("$Hy", "I_yy*q - I_xy*p - I_yz*r"),
    ("$Hz", "I_zz*r - I_xz*p - I_yz*q"),
    ("$A", "$L - (q*$Hz - r*$Hy)"),
    ("$B", "$M - (r*$Hx - p*$Hz)"),
    ("$C", "$N - (p*$Hy - q*$Hx)"),
    ("$det", "I_xx*I_yy*I_zz - 2*I_xy*I_xz*I_yz - I_xx*I_yz^2 - I_yy*I_xz^2 - I_zz*I_xy^2"),
    ("$pp", "$A*(I_yy*I_zz - I_yz^2) + $B*(I_xy*I_zz + I_xz*I_yz) + $C*(I_xy*I_yz + I_xz*I_yy)"),
    ("$qq", "$A*(I_xy*I_zz + I_xz*I_yz) + $B*(I_xx*I_zz - I_xz^2) + $C*(I_xx*I_yz + I_xy*I_xz)"),
    ("$rr", "$A*(I_xy*I_yz + I_xz*I_yy) + $B*(I_xx*I_yz + I_xy*I_xz) + $C*(I_xx*I_yy - I_xy^2)"),
    ("a_x", "$X/mass"),
    ("a_y", "$Y/mass"),
    ("a_z", "$Z/mass"),
    ("p_dot", "$pp/$det"),
    ("q_dot", "$qq/$det"),
    ("r_dot", "$rr/$det"),
    ("$short", "(1 - $n)/2"),
    ("$d x", "$11*u + $12*v + $13*w"),
    ("$d y", "-($21*u + $22*v + $23*w)"),
    ("$d z", "-($31*u + $32*v + $33*w)"),
    ("$d $w", "-(p*$x + q*$y + r*$z)/2 + $short*$w"),
    ("$d $x", "(p*$w + r*$y - q*$z)/2 + $short*$x"),
    ("$d $y", "(q*$w - r*$x + p*$z)/2 + $short*$y"),
    ("$d $z", "(r*$w + q*$x - p*$y)/2 + $short*$z"),
    ("$d u", "a_x + r*v - q*w + g*$31"),
    ("$d v", "a_y + p*w - r*u + g*$32"),
    ("$d w", "a_z + q*u - p*v + g*$33"),
    ("$d p", "p_dot"),
    ("$d q", "q_dot"),
    ("$d r", "r_dot"),
];

fn text_of(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Integer(n) => Some(n.to_string()),
        Value::Float(n) => Some(format!("{n:e}")),
        Value::Table(table) => table.get("value").and_then(text_of),
        _ => None,
    }
}

/// Expressions of a file by their names; those of parameters, trims and states under names with a `$`.
pub(crate) struct File {
    pub(crate) texts: HashMap<String, String>,
    pub(crate) curves: HashMap<String, Vec<(f64, f64)>>,
}

impl File {
    pub(crate) fn new(text: &str) -> Self {
        let table: Table = text.parse().unwrap();
        let mut texts: HashMap<String, String> =
            RIGID_BODY.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect();
        texts.insert("pi".to_owned(), format!("{:e}", std::f64::consts::PI));
        let section = |key: &str| table.get(key).and_then(Value::as_table).cloned().unwrap_or_default();
        let axes = ["x", "y", "z"].map(|axis| ("forces", axis)).into_iter();
        let axes = axes.chain(["x", "y", "z"].map(|axis| ("moments", axis)));
        for ((key, axis), name) in axes.zip(["$X", "$Y", "$Z", "$L", "$M", "$N"]) {
            let text = section(key).get(axis).and_then(text_of).unwrap_or("0".to_owned());
            texts.insert(name.to_owned(), text);
        }
        for (name, value) in section("definitions") {
            texts.insert(name, text_of(&value).unwrap());
        }
        let mut own = |section: Table, key: &str, lead: &str| {
            for (name, value) in section {
                let text = value.get(key).and_then(text_of).unwrap_or("0".to_owned());
                texts.insert(format!("{lead} {name}"), text);
            }
        };
        own(section("states"), "derivative", "$d");
        own(section("states"), "initial", "$initial");
        own(section("inputs"), "trim", "$trim");
        own(section("parameters"), "value", "$value");
        own(section("derived"), "value", "$derived");
        own(section("outputs"), "value", "$output");
        let numbers = |value: &Value| -> Vec<f64> {
            let number = |v: &Value| v.as_float().or(v.as_integer().map(|n| n as f64)).unwrap();
            value.as_array().unwrap().iter().map(number).collect()
        };
        let tables = table.get("table").and_then(Value::as_array).cloned().unwrap_or_default();
        let curve = |t: &Value| {
            let points = numbers(&t["x"]).into_iter().zip(numbers(&t["y"])).collect();
            (t["name"].as_str().unwrap().to_owned(), points)
        };
        let curves = tables.iter().map(curve).collect();
        Self { texts, curves }
    }
}
