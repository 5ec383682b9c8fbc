"""A circle with known velocity and rates, seen with noise and a gap."""

import numpy as np
import pytest

import mavsight


def circle():
    t = np.arange(0, 8, 1 / 30)
    heading = -0.5 * t
    pose = np.zeros((len(t), 6))
    # Body axes are forward, right, down: it flies along its nose at 0.6 m/s, turning left.
    pose[:, 0] = 1.2 * np.cos(0.5 * t)
    pose[:, 1] = 1.2 * np.sin(0.5 * t)
    pose[:, 2] = 1.5
    pose[:, 5] = heading
    return t, pose


def test_velocity_and_rates_of_a_circle_lie_in_their_intervals():
    t, pose = circle()
    std = np.tile([5e-4] * 3 + [1e-3] * 3, (len(t), 1))
    seen = pose + std * np.random.default_rng(3).standard_normal(pose.shape)
    seen[100:110] = np.nan
    motion = mavsight.smooth(t, seen, std)
    assert len(motion) == len(t) and motion.state.shape == motion.std.shape == (len(t), 18)
    assert motion.columns[6:9] == ["u_m_s", "v_m_s", "w_m_s"]
    speed = np.linalg.norm(motion.state[:, 6:9], axis=1)
    assert np.abs(speed[20:-20] - 0.6).max() < 0.01
    yaw_rate = motion.state[20:-20, 11]
    assert np.abs(np.abs(yaw_rate) - 0.5).max() < 0.03
    misses = (motion.state[:, :3] - pose[:, :3]) / motion.std[:, :3]
    assert np.mean(misses[20:-20] ** 2) < 2
    assert motion.std[105, 0] > motion.std[60, 0]
    assert all(f > 0 for f in motion.bandwidth_hz)


def test_what_is_wrong_is_said():
    t, pose = circle()
    std = np.full(pose.shape, 1e-3)
    with pytest.raises(ValueError, match="shape"):
        mavsight.smooth(t, pose[:-1], std)
    with pytest.raises(ValueError, match="row 7"):
        std[7, 2] = 0
        mavsight.smooth(t, pose, std)
    with pytest.raises(ValueError):
        mavsight.smooth(t[:2], pose[:2], np.full((2, 6), 1e-3))
    with pytest.raises(ValueError, match="time"):
        mavsight.smooth(t[::-1].copy(), pose, np.full(pose.shape, 1e-3))
