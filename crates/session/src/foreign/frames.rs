//! World and body axes of other programs.

use mavsight_geometry::{Isometry3, UnitQuaternion, Vector3, world_from_level};

/// Axes of a trajectory in another program.
///
/// North and east are those of the level frame N (x_N north, y_N east): world X is north, world Y west.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AxesOf {
    /// This program: world with Z up, body forward-right-down.
    #[default]
    World,
    /// The same world, body forward-left-up.
    WorldFlu,
    /// PX4 and MAVLink: north-east-down, body forward-right-down.
    Ned,
    /// ROS (REP-103): east-north-up, body forward-left-up.
    Enu,
}

impl AxesOf {
    fn world(self) -> UnitQuaternion<f64> {
        match self {
            Self::World | Self::WorldFlu => UnitQuaternion::identity(),
            Self::Ned => world_from_level().inverse(),
            Self::Enu => UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2),
        }
    }

    /// The half turn about x between forward-right-down and forward-left-up, or none.
    fn body(self) -> UnitQuaternion<f64> {
        match self {
            Self::World | Self::Ned => UnitQuaternion::identity(),
            Self::WorldFlu | Self::Enu => world_from_level(),
        }
    }

    /// A pose of ours in these axes.
    pub fn from_ours(self, world_from_body: &Isometry3<f64>) -> Isometry3<f64> {
        let turned = self.world() * world_from_body;
        Isometry3::from_parts(turned.translation, turned.rotation * self.body())
    }

    /// A pose in these axes as ours.
    pub fn to_ours(self, theirs: &Isometry3<f64>) -> Isometry3<f64> {
        let turned = self.world().inverse() * theirs;
        Isometry3::from_parts(turned.translation, turned.rotation * self.body().inverse())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{EulerAngles, world_from_body};

    /// Yaw 30°, pitch 10°, roll -5°: quaternions w, x, y, z as PX4 and MAVROS give them.
    #[test]
    fn the_check_value_of_px4_and_ros() {
        let attitude = EulerAngles {
            phi_rad: -5f64.to_radians(),
            theta_rad: 10f64.to_radians(),
            psi_rad: 30f64.to_radians(),
        };
        let pose = world_from_body(Vector3::new(1.0, 2.0, 3.0), attitude);
        let want = [
            (AxesOf::Ned, [0.9604, -0.0645, 0.0729, 0.2613], [1.0, -2.0, -3.0]),
            (AxesOf::Enu, [0.8638, 0.0059, -0.0971, 0.4943], [-2.0, 1.0, 3.0]),
        ];
        for (axes, q, position) in want {
            let got = axes.from_ours(&pose);
            let sign = got.rotation.w.signum();
            let [x, y, z, w]: [f64; 4] = got.rotation.coords.into();
            for (a, b) in [w, x, y, z].iter().zip(q) {
                assert!((a * sign - b).abs() < 6e-5, "{axes:?}: {got} but {q:?}");
            }
            assert!((got.translation.vector - Vector3::from(position)).norm() < 1e-12, "{axes:?}");
        }
        for axes in [AxesOf::World, AxesOf::WorldFlu, AxesOf::Ned, AxesOf::Enu] {
            let back = axes.to_ours(&axes.from_ours(&pose));
            assert!((back.to_homogeneous() - pose.to_homogeneous()).norm() < 1e-12, "{axes:?}");
        }
    }
}
