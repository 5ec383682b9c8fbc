//! Models that come with the program.

use crate::model::Model;

/// Names and texts of the models that come with the program.
pub const SHELF: [(&str, &str); 10] = [
    ("coaxial", include_str!("../shelf/coaxial.toml")),
    ("coaxial-lag", include_str!("../shelf/coaxial-lag.toml")),
    ("quadrotor", include_str!("../shelf/quadrotor.toml")),
    ("helicopter", include_str!("../shelf/helicopter.toml")),
    ("fixed-wing-longitudinal", include_str!("../shelf/fixed-wing-longitudinal.toml")),
    ("fixed-wing-lateral", include_str!("../shelf/fixed-wing-lateral.toml")),
    ("thrown-body", include_str!("../shelf/thrown-body.toml")),
    ("hfb320", include_str!("../shelf/hfb320.toml")),
    ("attas-lateral", include_str!("../shelf/attas-lateral.toml")),
    ("unstable-short-period", include_str!("../shelf/unstable-short-period.toml")),
];

/// A body without forces and moments of the air: what an aircraft is whose file names no model.
const RIGID_BODY: &str = "schema = 2\nname = \"rigid body\"\n[forces]\nx = 0\n";

impl Model {
    /// A model that comes with the program, by its name; none where there is no such model.
    pub fn shelf(name: &str) -> Option<Self> {
        let (name, text) = SHELF.iter().find(|(known, _)| *known == name)?;
        Self::parse(&format!("{name}.toml"), text).ok()
    }

    /// A body on which gravity acts alone.
    pub fn rigid_body() -> Self {
        Self::parse("rigid-body.toml", RIGID_BODY).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_model_of_the_shelf_is_read() {
        for (name, text) in SHELF {
            if let Err(error) = Model::parse(name, text) {
                panic!("{error}");
            }
        }
        assert_eq!(Model::rigid_body().state_count(), 13);
        assert_eq!(Model::rigid_body().nodes.rates.len(), 13);
    }
}
