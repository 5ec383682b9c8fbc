//! What the tests of several outlets use.

use crate::{Body, Fix, MarkerView, Measured, Moving};
use mavsight_geometry::{EulerAngles, Isometry3, Matrix6, Vector3, world_from_body};
use mavsight_random::Random;

pub(crate) fn measured(world_from_body: Isometry3<f64>, covariance: Matrix6<f64>) -> Measured {
    Measured { world_from_body, covariance, moving: None, markers: 4, residual_px: Some(0.1) }
}

/// The attitude of the published check value at (1.5, 2.25, 0.75), moving.
pub(crate) fn fix() -> Fix {
    let angles = EulerAngles {
        phi_rad: (-5f64).to_radians(),
        theta_rad: 10f64.to_radians(),
        psi_rad: 30f64.to_radians(),
    };
    let pose = world_from_body(Vector3::new(1.5, 2.25, 0.75), angles);
    let moving = Moving {
        velocity_in_body_m_s: Vector3::new(0.5, -0.25, 0.125),
        rates_rad_s: Vector3::new(0.01, -0.02, 0.03),
        covariance: Matrix6::identity() * 4e-4,
    };
    Fix {
        sequence: 41,
        captured_ns: 1_700_000_000_123_456_789,
        received_ns: 1_700_000_000_133_456_789,
        measured: Some(Measured { moving: Some(moving), ..measured(pose, Matrix6::identity() * 1e-6) }),
        resets: 3,
    }
}

pub(crate) fn body() -> Body {
    let marker = |name: &str, in_body_m| MarkerView {
        name: name.into(),
        rgb: [200, 20, 20],
        in_body_m,
        diameter_m: 0.05,
    };
    Body::new(
        "cf231",
        vec![
            marker("a", [0.1, 0.2, 0.3]),
            marker("b", [-0.1, 0.2, 0.0]),
            marker("c", [0.0, 0.0, 0.1]),
            marker("d", [0.0, 0.1, 0.1]),
        ],
    )
}

/// Bytes from hexadecimal digits; blanks are left out.
pub(crate) fn bytes(hex: &str) -> Vec<u8> {
    let digits: Vec<u8> =
        hex.bytes().filter_map(|c| (c as char).to_digit(16).and_then(|d| u8::try_from(d).ok())).collect();
    digits.chunks(2).map(|pair| pair[0] * 16 + pair[1]).collect()
}

/// Packets of noise, always the same: of every length up to 400, half of them beginning as `head` does.
pub(crate) fn noise(head: &[u8]) -> impl Iterator<Item = Vec<u8>> {
    let mut random = Random::new(0, 0);
    (0..4000_usize).map(move |k| {
        let mut packet: Vec<u8> = (0..k % 400).map(|_| random.next_u64().to_le_bytes()[0]).collect();
        if k % 2 == 0 {
            packet.iter_mut().zip(head).for_each(|(byte, head)| *byte = *head);
        }
        packet
    })
}
