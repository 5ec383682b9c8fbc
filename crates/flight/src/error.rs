//! What is refused of vehicles and inputs, and what to do about it.

use mavsight_geometry::GeometryError;
use mavsight_model::ModelError;
use thiserror::Error;

/// A vehicle or an input that is not valid.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum FlightError {
    /// A constant that must be positive.
    #[error("{key} is {value}, but must be a finite number above zero: correct the vehicle file")]
    NotPositive {
        /// Key in the vehicle file.
        key: String,
        /// Its value.
        value: f64,
    },
    /// A ball whose diameter is in another unit.
    #[error(
        "marker {marker} has a diameter of {diameter_m} m: give all lengths of the vehicle file in metres"
    )]
    BallTooLarge {
        /// Name of the marker.
        marker: String,
        /// Its diameter.
        diameter_m: f64,
    },
    /// A value of the model outside its bounds.
    #[error("{key} is {value}, but must be a number from {min} to {max}: correct the vehicle file")]
    OutOfBounds {
        /// Key in the vehicle file.
        key: String,
        /// Its value.
        value: f64,
        /// Least value.
        min: f64,
        /// Largest value.
        max: f64,
    },
    /// A value of a parameter that the model does not have.
    #[error("[{section}] gives {name}, but the model {model} has no such parameter; the nearest are: {}", near.join(", "))]
    UnknownParameter {
        /// Section of the vehicle file.
        section: String,
        /// Name.
        name: String,
        /// Name of the model.
        model: String,
        /// The nearest parameters.
        near: Vec<String>,
    },
    /// A value among the model's parameters that has a key of its own.
    #[error(
        "[parameters] gives {name}, which the vehicle file has as {key}: give it there, and remove it here"
    )]
    OfTheBody {
        /// Name.
        name: String,
        /// Key in the vehicle file.
        key: &'static str,
    },
    /// A flight model that cannot be read.
    #[error(
        "the vehicle's model {name:?} cannot be read ({detail}): name a file beside the vehicle file, or one of the shelf: {shelf}"
    )]
    Model {
        /// Name in the vehicle file.
        name: String,
        /// What is wrong.
        detail: String,
        /// Models of the shelf.
        shelf: String,
    },
    /// A flight model that is wrong.
    #[error(transparent)]
    ModelFile(#[from] ModelError),
    /// A vehicle file of two schemas.
    #[error(
        "the vehicle file has a [rotor] (schema 1) and names a `model` (schema 2): write the rotor's values as [parameters] of the model, or remove `model`"
    )]
    TwoSchemas,
    /// A product of inertia that no body has.
    #[error(
        "{key} is {value}, but must lie within ±{limit:.3e}, the root of the two moments: correct the vehicle file"
    )]
    InertiaProduct {
        /// Key in the vehicle file.
        key: String,
        /// Its value.
        value: f64,
        /// The limit.
        limit: f64,
    },
    /// Moments of inertia that no body has.
    #[error(
        "inertia_kg_m2 is [{}, {}, {}], but no moment of a body is above the sum of the other two: correct the vehicle file",
        .0[0], .0[1], .0[2]
    )]
    Inertia([f64; 3]),
    /// Markers that show no attitude.
    #[error("{0}; the vehicle file has them so: correct position_m, in metres")]
    MarkerPlaces(GeometryError),
    /// A constant that must be a number.
    #[error("{key} is {value}, but must be a finite number: correct the vehicle file")]
    NotFinite {
        /// Key in the vehicle file.
        key: String,
        /// Its value.
        value: f64,
    },
    /// A pose needs three markers.
    #[error(
        "the vehicle has {0} markers, but at least 3 that are not on one line are needed: add [[marker]] sections"
    )]
    TooFewMarkers(usize),
    /// Two markers share a name.
    #[error("markers {first} and {second} are both named {name}: give each its own name")]
    DuplicateMarker {
        /// The first of them, counted from 1.
        first: usize,
        /// The second.
        second: usize,
        /// The shared name.
        name: String,
    },
    /// A marker's name that tables cannot list.
    #[error(
        "a marker is named {0:?}: tables list markers with spaces between, write it without, such as \"left_red\""
    )]
    MarkerName(String),
    /// A colour that is not written as one.
    #[error("unknown colour {0:?}: write it as \"#rrggbb\", for instance \"#db1212\"")]
    UnknownColor(String),
    /// Inputs need two rows to cover a time.
    #[error("the inputs have {0} samples, but at least 2 are needed")]
    TooFewInputs(usize),
    /// A value that is not a number.
    #[error("input row {row}: {column} is not a finite number: correct or remove the row")]
    InputNotFinite {
        /// Row, counted from 1 below the header.
        row: usize,
        /// Column.
        column: String,
    },
    /// Two columns of the inputs share a name.
    #[error("two columns of the inputs are named {0}: give each its own name")]
    DuplicateInput(String),
    /// Values that do not fill the rows.
    #[error(
        "the inputs have {values} values, but {rows} rows of {columns} columns: there must be one for each"
    )]
    InputTable {
        /// Times.
        rows: usize,
        /// Names.
        columns: usize,
        /// Values.
        values: usize,
    },
    /// A column that is needed and not there.
    #[error("the inputs have no column {name}{}", rename(.name, .nearest))]
    MissingInput {
        /// The column.
        name: String,
        /// The columns with the nearest names.
        nearest: Vec<String>,
    },
    /// Times must increase.
    #[error(
        "input row {row}: time {t_s} s does not come after the {before_s} s of the row before: sort the rows and remove repeats"
    )]
    TimeNotIncreasing {
        /// Row, counted from 1 below the header.
        row: usize,
        /// Its time.
        t_s: f64,
        /// The time before.
        before_s: f64,
    },
    /// Two columns of the sensors share a name.
    #[error("two columns of the sensors are named {0}: give each its own name")]
    DuplicateSensor(String),
    /// Samples that do not fill the rows.
    #[error(
        "the sensors have {values} values, but {rows} rows of {columns} columns: there must be one for each"
    )]
    SensorTable {
        /// Times.
        rows: usize,
        /// Names.
        columns: usize,
        /// Values.
        values: usize,
    },
    /// Samples of sensors that no model describes.
    #[error(
        "the flight model {0} has no [outputs], which say what sensors show: add them to its file, or give no sensors"
    )]
    NoSensors(String),
    /// A column of a sensor that is not there.
    #[error("the sensors have no column {name}{}", rename(.name, .nearest))]
    MissingSensor {
        /// The column.
        name: String,
        /// The columns with the nearest names.
        nearest: Vec<String>,
    },
    /// Times of the sensors must increase.
    #[error(
        "sensor row {row}: time {t_s} s does not come after the {before_s} s of the row before: sort the rows and remove repeats"
    )]
    SensorTime {
        /// Row, counted from 1 below the header.
        row: usize,
        /// Its time.
        t_s: f64,
        /// The time before.
        before_s: f64,
    },
    /// Inputs that end before the flight does.
    #[error(
        "the inputs cover {start_s:.3} to {end_s:.3} s, but the flight needs {t_s:.3} s: record the inputs over the whole flight, or give --lag where their clock is another"
    )]
    InputsDoNotCover {
        /// Time asked for.
        t_s: f64,
        /// First input.
        start_s: f64,
        /// Last input.
        end_s: f64,
    },
}

fn rename(name: &str, nearest: &[String]) -> String {
    match nearest {
        [] => "; there are none: add it".to_owned(),
        some => format!("; the nearest are {}: add it, or rename one to {name}", some.join(", ")),
    }
}
