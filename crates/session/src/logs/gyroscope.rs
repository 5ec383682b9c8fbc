//! The gyroscope of a log.

use super::{LogSection, read_log, units};
use crate::SessionError;
use mavsight_geometry::Vector3;
use mavsight_log::{Log, LogError, Role, Serves, Topic};

/// Samples of a gyroscope.
#[derive(Debug, Clone, PartialEq)]
pub struct LogGyroscope {
    /// Topic and instance that it is of.
    pub source: String,
    /// Times by the log's clock, increasing.
    pub times_ns: Vec<i64>,
    /// Rates about its axes.
    pub rates_rad_s: Vec<Vector3<f64>>,
}

/// Reads the gyroscope of a log, that of the highest rate where it has several; none where it has none.
///
/// Rows without a number are left out. Nothing is filtered or resampled.
///
/// # Errors
/// Those of [`read_log`]; a unit that is not said, or is none of a rate.
pub fn read_log_gyroscope(section: &LogSection) -> Result<Option<LogGyroscope>, SessionError> {
    let listed = read_log(&section.file, section.table_time(), &|_, _, _| false)?;
    let Some((name, instance, fields)) = fastest(&listed) else { return Ok(None) };
    let wanted = |topic: &str, of: u32, field: &str| {
        topic == name && of == instance && fields.iter().any(|own| own == field)
    };
    let log = read_log(&section.file, section.table_time(), &wanted)?;
    gyroscope_of(&log, &name, instance, &fields)
        .map(Some)
        .map_err(|detail| SessionError::value(&section.file, format!("gyroscope {name}"), detail))
}

/// Topic, instance and the fields of three axes.
fn fastest(log: &Log) -> Option<(String, u32, Vec<String>)> {
    let rate = |(topic, _): &(&Topic, &Serves)| topic.rate_hz.unwrap_or(0.0);
    let all = log.serving(Role::Gyroscope).filter(|(_, serves)| serves.fields.len() == 3);
    // Of equal ones the first.
    let best = all.reduce(|best, next| if rate(&next) > rate(&best) { next } else { best });
    best.map(|(topic, serves)| (topic.name.clone(), topic.instance, serves.fields.clone()))
}

fn gyroscope_of(log: &Log, name: &str, instance: u32, fields: &[String]) -> Result<LogGyroscope, String> {
    let axis = |field: &String| {
        let (stream, column) =
            log.column(Some(name), Some(instance), field).map_err(|why: LogError| why.to_string())?;
        let unit = column.unit.as_deref().ok_or("the log does not say the unit of its rates")?;
        let rate = units::in_si("rad/s").map(|(_, si)| si);
        let factor = units::in_si(unit).filter(|(_, si)| Some(*si) == rate).map(|(factor, _)| factor);
        let factor = factor.ok_or(format!("{unit} is no unit of rates: give a log in rad/s or deg/s"))?;
        Ok::<_, String>((stream, column, factor))
    };
    let axes = fields.iter().map(axis).collect::<Result<Vec<_>, _>>()?;
    let (mut times_ns, mut rates_rad_s) = (Vec::new(), Vec::new());
    let of_stream = axes.first().map_or(&[][..], |(stream, ..)| &stream.times_ns[..]);
    for (k, t_ns) in of_stream.iter().enumerate() {
        let rate = Vector3::from_fn(|axis, _| axes[axis].1.value(k) * axes[axis].2);
        if rate.iter().all(|x| x.is_finite()) {
            times_ns.push(*t_ns);
            rates_rad_s.push(rate);
        }
    }
    let source = if instance == 0 { name.to_owned() } else { format!("{name} {instance}") };
    Ok(LogGyroscope { source, times_ns, rates_rad_s })
}
