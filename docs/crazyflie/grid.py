"""Thrust curve, motor lag and yaw of a Crazyflie by least squares on a grid of lags, beside the values of `mavsight identify`.

Usage: grid.py TABLE.csv FIT_FROM..TO HELD_OUT_FROM..TO [PARAMETERS.csv]

TABLE.csv has t_s, motor_1 to motor_4, acc_z_m_s2 and gyro_z_rad_s (`mavsight convert log10 table.csv --preset crazyflie --input ...`,
docs/logs.md), PARAMETERS.csv is that of `mavsight identify --out`. Needs numpy and scipy.

For each time constant of a grid the motors follow their commands with a first-order lag; specific force is linear in the
coefficients of the thrust curve, and the change of the yaw rate in torque factor over inertia and a constant. The time constant with the smallest
residuals is kept (Eschmann, Albani & Loianno 2024). Printed are root mean square errors of one-step predictions on the part that
was not fitted: specific force, and yaw acceleration from one sample to the next, for both sets of values.
"""

import csv
import sys

import numpy
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

STEP_S = 0.005
MASS_KG = 0.027
SIGNS = numpy.array([1.0, -1.0, 1.0, -1.0])
# Yaw acceleration is the change of the yaw rate over this, as that of one sample is noise.
YAW_STEPS = 10


def table(path):
    """Means over STEP_S of all columns."""
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    names, values = rows[0], numpy.array([[float(x) for x in row] for row in rows[1:]])
    t_s = values[:, names.index("t_s")]
    bins = numpy.floor((t_s - t_s[0]) / STEP_S).astype(int)
    count = numpy.bincount(bins)
    steps = numpy.arange(len(count))
    seen = count > 0

    def filled(k):
        mean = numpy.bincount(bins, values[:, k])[seen] / count[seen]
        return numpy.interp(steps, steps[seen], mean)

    mean = {name: filled(k) for k, name in enumerate(names)}
    motors = numpy.stack([mean[f"motor_{k}"] for k in range(1, 5)], axis=1)
    return mean["t_s"], motors, mean["acc_z_m_s2"], mean["gyro_z_rad_s"]


def lagged(motors, tau_s):
    """The motors behind their commands, at the middle of each step."""
    kept = numpy.exp(-STEP_S / tau_s)
    end = lfilter([1.0 - kept], [1.0, -kept], motors, axis=0, zi=kept * motors[:1])[0]
    before = numpy.vstack([motors[:1], end[:-1]])
    half = numpy.exp(-0.5 * STEP_S / tau_s)
    return motors + (before - motors) * half


def features(motors, tau_s):
    m = lagged(motors, tau_s)
    return numpy.stack([numpy.ones_like(m), m, m * m], axis=2)


def yaw_change(rate):
    out = numpy.full(len(rate), numpy.nan)
    half = YAW_STEPS // 2
    out[half:-half] = (rate[YAW_STEPS:] - rate[:-YAW_STEPS]) / (YAW_STEPS * STEP_S)
    return out


def mean_over_change(x):
    return numpy.convolve(x, numpy.ones(YAW_STEPS) / YAW_STEPS, mode="same")


def predicted(data, tau_s, curve, yaw):
    _, motors, _, _ = data
    thrust = features(motors, tau_s) @ curve
    return -thrust.sum(axis=1) / MASS_KG, of_yaw(motors, tau_s, curve) @ yaw


def of_yaw(motors, tau_s, curve):
    """What the yaw acceleration is linear in."""
    thrust = features(motors, tau_s) @ curve
    return numpy.stack([mean_over_change(thrust @ SIGNS), numpy.ones(len(motors))], axis=1)


def fit(data, chosen):
    _, motors, force, rate = data
    change = yaw_change(rate)

    def solved(tau_s):
        all_features = features(motors, tau_s)
        curve, squares, _, _ = numpy.linalg.lstsq(
            -all_features.sum(axis=1)[chosen] / MASS_KG, force[chosen], rcond=None
        )
        return curve, float(squares[0])

    grid = numpy.geomspace(0.005, 0.3, 60)
    best = min(grid, key=lambda tau_s: solved(tau_s)[1])
    tau_s = minimize_scalar(lambda t: solved(t)[1], bounds=(0.8 * best, 1.25 * best), method="bounded").x
    curve, _ = solved(tau_s)
    known = chosen & numpy.isfinite(change)
    yaw, *_ = numpy.linalg.lstsq(of_yaw(motors, tau_s, curve)[known], change[known], rcond=None)
    return tau_s, curve, yaw


def errors(data, values, chosen):
    _, _, force, rate = data
    of_force, of_change = predicted(data, *values)
    change = yaw_change(rate)
    known = chosen & numpy.isfinite(change)
    rms = [numpy.sqrt(numpy.mean((a - b) ** 2)) for a, b in ((of_force[chosen], force[chosen]), (of_change[known], change[known]))]
    return rms


def parameters(path):
    with open(path, newline="") as file:
        rows = {row["parameter"]: float(row["value"]) for row in csv.DictReader(file) if row["estimator"] == "oe" and row["value"]}
    return rows["tau"], numpy.array([rows[f"T_{k}"] for k in range(3)]), numpy.array([rows["yaw"], rows["yaw_0"]])


def main():
    data = table(sys.argv[1])
    parts = [tuple(float(x) for x in text.split("..")) for text in sys.argv[2:4]]
    fitted, held_out = [(data[0] >= from_s) & (data[0] <= to_s) for from_s, to_s in parts]
    sets = {"grid": fit(data, fitted)}
    if len(sys.argv) > 4:
        sets["mavsight"] = parameters(sys.argv[4])
    for name, values in sets.items():
        tau_s, curve, yaw = values
        force, change = errors(data, values, held_out)
        print(
            f"{name:9} tau {tau_s:.4f} s, T_0 {curve[0]:+.4f}, T_1 {curve[1]:+.4f}, T_2 {curve[2]:+.4f} N, "
            f"1/yaw {1.0 / yaw[0]:+.3e} kg m; held out: specific force {force:.3f} m/s2, yaw acceleration {change:.2f} rad/s2"
        )


if __name__ == "__main__":
    main()
