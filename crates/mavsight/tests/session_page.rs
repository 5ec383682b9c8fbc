//! `docs/session.md` and `docs/models.md` have every key of every input file, and no other.
//!
//! Each file's example is read by the program's own types. Then a key that is not known is put into each of
//! its tables: the parser's answer lists all keys that it knows there, which must be those of the page. In
//! the same way a word that is not known in place of a text lists all words that it may be.

use assert_cmd::Command;
use mavsight_flight::Vehicle;
use mavsight_identify::{EquationFile, OutputEquations};
use mavsight_plan::Room;
use mavsight_score::CampaignFile;
use mavsight_session::tables::{read_control_pixels, read_control_points, read_inputs, read_sensors};
use mavsight_session::{SessionFile, read_rig, write_control_points, write_inputs};
use mavsight_simulator::{Scenario, Staging};
use serde::de::DeserializeOwned;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

type Keys = BTreeSet<String>;

/// What the page says of one file.
#[derive(Default)]
struct Page {
    /// Keys by the dotted path of their section; the empty path is the top level.
    keys: BTreeMap<String, Keys>,
    /// The row of each key, by path and key.
    rows: BTreeMap<String, String>,
    example: String,
}

fn pages() -> BTreeMap<String, Page> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/session.md");
    let text = std::fs::read_to_string(path).expect("the page");
    let mut pages: BTreeMap<String, Page> = BTreeMap::new();
    let (mut file, mut section, mut in_example) = (String::new(), String::new(), false);
    for line in text.lines() {
        if let Some(name) = line.strip_prefix("## ") {
            (file, section) = (name.to_owned(), String::new());
            pages.insert(file.clone(), Page::default());
        } else if let Some(name) = line.strip_prefix("### ") {
            section =
                if name.starts_with('`') { name.trim_matches(['`', '[', ']']).into() } else { "".into() };
        }
        let Some(page) = pages.get_mut(&file) else { continue };
        if line.starts_with("```") {
            in_example = line.len() > 3;
        } else if in_example {
            page.example += &format!("{line}\n");
        } else if let Some((key, rest)) = line.strip_prefix("| `").and_then(|row| row.split_once("` |")) {
            assert!(page.keys.entry(section.clone()).or_default().insert(key.into()), "{key} is there twice");
            page.rows.insert(dotted(&section, key), rest.into());
        }
    }
    pages
}

fn dotted(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// Applies a change to each table of a document in turn, and hands its path and the changed document on.
fn in_each_table(
    document: &Value,
    change: &dyn Fn(&mut Table) -> Vec<String>,
    each: &mut dyn FnMut(&str, &str, Table),
) {
    fn walk(node: &Value, path: &str, steps: &mut Vec<Step>, found: &mut Vec<(String, Vec<Step>)>) {
        match node {
            Value::Table(table) => {
                found.push((path.to_owned(), steps.clone()));
                for (key, value) in table {
                    steps.push(Step::Key(key.clone()));
                    walk(value, &dotted(path, key), steps, found);
                    steps.pop();
                }
            }
            Value::Array(items) => {
                for (k, item) in items.iter().enumerate() {
                    steps.push(Step::Item(k));
                    walk(item, path, steps, found);
                    steps.pop();
                }
            }
            _ => {}
        }
    }
    let mut found = Vec::new();
    walk(document, "", &mut Vec::new(), &mut found);
    for (path, steps) in found {
        let mut probe = document.clone();
        for changed in change(at(&mut probe, &steps)) {
            let mut one = document.clone();
            let table = at(&mut one, &steps);
            table.insert(changed.clone(), Value::String("zz_unknown".into()));
            let Value::Table(whole) = one else { unreachable!("documents are tables") };
            each(&path, &changed, whole);
        }
    }
}

#[derive(Clone)]
enum Step {
    Key(String),
    Item(usize),
}

fn at<'a>(document: &'a mut Value, steps: &[Step]) -> &'a mut Table {
    let node = steps.iter().fold(document, |node, step| match step {
        Step::Key(key) => node.get_mut(key).expect("the key"),
        Step::Item(k) => node.get_mut(*k).expect("the item"),
    });
    node.as_table_mut().expect("a table")
}

/// The words in backticks after "expected".
fn expected(answer: &str) -> Keys {
    let list = answer.split_once("expected").map_or("", |(_, list)| list);
    list.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// Compares a file's part of the page with a parser that says what is wrong with a text.
fn compare(file: &str, page: &Page, parse: &dyn Fn(&str) -> Result<(), String>) {
    assert_eq!(parse(&page.example), Ok(()), "{file}: its example");
    let document = Value::Table(page.example.parse().expect("TOML"));
    let mut known: BTreeMap<String, Keys> = BTreeMap::new();
    in_each_table(&document, &|_| vec!["zz_unknown".into()], &mut |path, _, table| {
        // A map of free keys has none of its own.
        let Err(answer) = parse(&table.to_string()) else { return };
        if answer.contains("unknown field") {
            known.entry(path.to_owned()).or_default().extend(expected(&answer));
        }
    });
    in_each_table(&document, &|table| table.keys().cloned().collect(), &mut |path, key, table| {
        if let Some(keys) = known.get_mut(path) {
            keys.insert(key.to_owned());
        }
        let Err(answer) = parse(&table.to_string()) else { return };
        if answer.contains("unknown variant") {
            let row = &page.rows[&dotted(path, key)];
            for word in expected(&answer) {
                assert!(row.contains(&format!("`{word}`")), "{file}, {path}, {key}: the page lacks {word:?}");
            }
        }
    });
    assert_eq!(page.keys, known, "{file}: left the page, right the parser");
    let mut shown: BTreeMap<String, Keys> = BTreeMap::new();
    in_each_table(&document, &|table| table.keys().cloned().collect(), &mut |path, key, _| {
        shown.entry(path.to_owned()).or_default().insert(key.to_owned());
    });
    for (path, keys) in &page.keys {
        // A section that is described as a file of its own is empty here.
        assert_eq!(shown.get(path), Some(keys), "{file}, [{path}]: left its example, right its table");
    }
}

fn by_type<T: DeserializeOwned>(text: &str) -> Result<(), String> {
    toml::from_str::<T>(text).map(drop).map_err(|e| e.message().to_owned())
}

#[test]
fn the_page_has_every_key_and_word_of_the_parsers() {
    let pages = pages();
    compare("session.toml", &pages["session.toml"], &by_type::<SessionFile>);
    // What schema 1 had is described in words.
    let vehicle = |text: &str| by_type::<Vehicle>(text).map_err(|e| e.replace(", `rotor`, `assumption`", ""));
    compare("vehicle.toml", &pages["vehicle.toml"], &vehicle);
    compare("model.toml", &pages["model.toml"], &by_type::<OutputEquations>);
    compare("staging.toml", &pages["staging.toml"], &by_type::<Staging>);
    compare("room.toml", &pages["room.toml"], &by_type::<Room>);
    compare("campaign.toml", &pages["campaign.toml"], &by_type::<CampaignFile>);
    // `[staging]` has a section of its own on the page: its keys are compared there.
    let scenario = &pages["scenario.toml"];
    let staged = |text: &str| {
        by_type::<Scenario>(text).map_err(|e| if e.contains("`decoy`") { "elsewhere".into() } else { e })
    };
    compare("scenario.toml", scenario, &staged);
    let folder = tempfile::tempdir().expect("a folder");
    compare("rig.toml", &pages["rig.toml"], &|text| {
        read_rig(&put(folder.path(), "rig.toml", text)).map(drop).map_err(|e| e.to_string())
    });
    assert_eq!(pages.len(), 13, "a file without a comparison: {:?}", pages.keys());
}

/// Sections and keys of the table of flight models, one row for several, and its example.
fn page_of_models() -> Page {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/models.md");
    let text = std::fs::read_to_string(path).expect("the page");
    let part = text.split_once("## Every key").expect("the part").1;
    let quoted = |cell: &str| -> Vec<String> {
        cell.split('`').skip(1).step_by(2).map(|word| word.trim_matches(['[', ']']).to_owned()).collect()
    };
    let mut page = Page::default();
    for line in part.lines().filter(|line| line.starts_with("| `[") || line.starts_with("| top")) {
        let cells: Vec<&str> = line.split(" | ").collect();
        let sections = if cells[0] == "| top" { vec![String::new()] } else { quoted(cells[0]) };
        for section in sections {
            for key in quoted(cells[1]) {
                let is_new = page.keys.entry(section.clone()).or_default().insert(key.clone());
                assert!(is_new, "{key} of [{section}] is there twice");
            }
        }
    }
    page.example = part.split("```").nth(1).expect("an example").trim_start_matches("toml").to_owned();
    page
}

/// Entries have names of the user's: `[inputs]` stands for all of them on the page.
#[test]
fn the_page_of_models_has_every_key_of_a_flight_model() {
    let page = page_of_models();
    let parse = |text: &str| EquationFile::parse("model.toml", text).map(drop).map_err(|e| e.to_string());
    assert_eq!(parse(&page.example), Ok(()), "its example");
    let document = Value::Table(page.example.parse().expect("TOML"));
    let section = |path: &str| match path.split('.').collect::<Vec<&str>>().as_slice() {
        [first, .., "free"] => format!("{first}.free"),
        [first, ..] => (*first).to_owned(),
        [] => String::new(),
    };
    let (mut known, mut shown) = (BTreeMap::<String, Keys>::new(), BTreeMap::<String, Keys>::new());
    in_each_table(&document, &|_| vec!["zz_unknown".into()], &mut |path, _, table| {
        let answer = parse(&table.to_string()).expect_err("an unknown key");
        let list = answer.split_once("; keys are ").or(answer.split_once(": did you mean "));
        // The keys of `fixed` are the equation's regressors.
        let Some((_, list)) = list.filter(|_| !path.ends_with(".fixed")) else { return };
        let keys = list.trim_end_matches('?').split(", ").map(str::to_owned);
        known.entry(section(path)).or_default().extend(keys);
    });
    in_each_table(&document, &|table| table.keys().cloned().collect(), &mut |path, key, _| {
        shown.entry(section(path)).or_default().insert(key.to_owned());
    });
    assert_eq!(page.keys, known, "left the page, right the parser");
    for (path, keys) in &page.keys {
        let missing: Vec<_> = keys.difference(&shown[path]).collect();
        assert!(missing.is_empty(), "the example of [{path}] lacks {missing:?}");
    }
}

fn put(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("written");
    path
}

/// The cameras of a film are known to the program alone.
#[test]
fn the_page_has_every_key_of_the_cameras_of_a_film() {
    let folder = tempfile::tempdir().expect("a folder");
    let program = || Command::new(env!("CARGO_BIN_EXE_mavsight"));
    let flight = folder.path().join("flight");
    program().arg("simulate").arg("--out").arg(&flight).assert().success();
    let page = &pages()["cameras.toml"];
    let film = |text: &str| {
        let cameras = put(folder.path(), "cameras.toml", text);
        let out = folder.path().join("film");
        let run =
            program().arg("film").arg(&flight).arg("--cameras").arg(cameras).arg("--out").arg(out).output();
        String::from_utf8(run.expect("it runs").stderr).expect("text")
    };
    for (path, unknown) in [
        ("", "zz_unknown = 1\n".to_owned() + &page.example),
        ("camera", page.example.clone() + "zz_unknown = 1\n"),
    ] {
        let answer = film(&unknown);
        assert!(answer.contains("unknown field"), "{answer}");
        assert_eq!(page.keys[path], expected(&answer), "[{path}]: left the page, right the program");
    }
}

/// Headers of tables: what is read, and what is written, is what the page has.
#[test]
fn the_page_has_every_column_of_the_tables() {
    let folder = tempfile::tempdir().expect("a folder");
    let pages = pages();
    let columns = |text: &str| -> Keys {
        text.lines().next().expect("a header").split(',').map(str::to_owned).collect()
    };
    let written = |name: &str| columns(&std::fs::read_to_string(folder.path().join(name)).expect("a table"));
    let file = |name: &str| (&pages[name], put(folder.path(), name, &pages[name].example));

    let (page, path) = file("control_points.csv");
    let points = read_control_points(&path).expect("control points");
    assert_eq!(columns(&page.example), page.keys[""]);
    write_control_points(&folder.path().join("points.csv"), &points).expect("written");
    assert_eq!(written("points.csv"), page.keys[""]);

    let (page, path) = file("control_pixels.csv");
    assert_eq!(read_control_pixels(&path, &["cam1", "cam2"], &["p1"]).expect("control pixels").len(), 2);
    assert_eq!(columns(&page.example), page.keys[""]);

    let (page, path) = file("inputs.csv");
    let inputs = read_inputs(&path, &Vehicle::paper()).expect("inputs");
    write_inputs(&folder.path().join("own.csv"), &inputs).expect("written");
    assert_eq!(written("own.csv"), columns(&page.example));
    assert!(page.keys[""].is_subset(&written("own.csv")));

    let (page, path) = file("sensors.csv");
    let model = "schema = 2\nname = \"sensed\"\n[inputs]\nomega = { unit = \"rad/s\" }\n[forces]\nz = 0\n[outputs]\n\
        z = { column = \"acc_z_m_s2\", value = \"a_z\", std = 1 }\nesc = { column = \"esc_1_rad_s\", value = \"omega\", std = 1 }\n";
    let EquationFile::Model(model) = EquationFile::parse("sensed.toml", model).expect("a model") else {
        panic!("a flight model")
    };
    let sensors = read_sensors(&path, &model).expect("sensors");
    assert_eq!((sensors.times_ns()[1], sensors.row(2)), (5_000_000, &[-9.81, 495.6][..]));
    assert!(sensors.row(1)[1].is_nan(), "a cell that is empty");
    assert_eq!(columns(&page.example), page.keys[""]);
}
