"""Thrust curve, motor lag and yaw of a Crazyflie by least squares on a grid of lags, beside the values of `mavsight identify`.

Usage: grid.py TABLE.csv FIT_FROM..TO[,FROM..TO] HELD_OUT_FROM..TO[,FROM..TO] [PARAMETERS.csv]

TABLE.csv has t_s, motor_1 to motor_4, acc_z_m_s2 and gyro_z_rad_s (`mavsight convert log10 table.csv --preset crazyflie --input ...`,
docs/logs.md), PARAMETERS.csv is that of `mavsight identify --out`. Needs numpy and scipy.

For each time constant of a grid the motors follow their commands with a first-order lag; specific force is linear in the coefficients
of the thrust curve, and the change of the yaw rate in those of the torque, of the rotors' gain of speed, of the yaw rate and in a
constant, as in crazyflie.toml. The time constant with the smallest residuals of the specific force is kept (Eschmann, Albani & Loianno
2024). Printed are root mean square errors of one-step predictions on the part that was not fitted: specific force, and yaw
acceleration over YAW_STEPS; of the values of `mavsight identify` also by how much the mean squares are more than those of the grid, with
the standard error of that over seconds of the flight.
"""

import csv
import sys

import numpy
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

STEP_S = 0.005
MASS_KG = 0.027
# Command of hover.
HOVER = 0.6
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
    return -thrust.sum(axis=1) / MASS_KG, of_yaw(data, tau_s) @ yaw


def of_yaw(data, tau_s):
    """What the yaw acceleration is linear in: torque, gain of the rotors' speed, drag, a constant."""
    _, motors, _, rate = data
    m = lagged(motors, tau_s)
    columns = [m @ SIGNS, (motors - m) @ SIGNS / tau_s, -rate, numpy.ones(len(rate))]
    return numpy.stack([mean_over_change(column) for column in columns], axis=1)


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
    yaw, *_ = numpy.linalg.lstsq(of_yaw(data, tau_s)[known], change[known], rcond=None)
    return tau_s, curve, yaw


def squared_errors(data, values, chosen):
    """Of specific force and yaw acceleration, with the second of the flight that each is of."""
    t_s, _, force, rate = data
    of_force, of_change = predicted(data, *values)
    change = yaw_change(rate)
    known = chosen & numpy.isfinite(change)
    seconds = numpy.floor(t_s).astype(int)
    return [
        ((of_force[chosen] - force[chosen]) ** 2, seconds[chosen]),
        ((of_change[known] - change[known]) ** 2, seconds[known]),
    ]


def compared(own, other):
    """By how much the mean of squares is more than another's, of that, and its standard error from the means of seconds."""
    more, seconds = own[0] - other[0], own[1]
    blocks = numpy.array([more[seconds == s].sum() for s in numpy.unique(seconds)])
    error = numpy.std(blocks, ddof=1) * numpy.sqrt(len(blocks)) / len(more)
    return f"{100 * more.mean() / other[0].mean():+.1f} ± {100 * error / other[0].mean():.1f} %"


def parameters(path):
    """The values of each estimator."""
    with open(path, newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["value"]]
    out = {}
    for name in sorted({row["estimator"] for row in rows}):
        own = {row["parameter"]: float(row["value"]) for row in rows if row["estimator"] == name}
        curve = numpy.array([own[f"T_{k}"] for k in range(3)])
        out[f"mavsight {name}"] = (own["tau"], curve, numpy.array([own[k] for k in ("yaw", "spin", "yaw_drag", "yaw_0")]))
    return out


def parts(t_s, text):
    chosen = numpy.zeros(len(t_s), bool)
    for part in text.split(","):
        from_s, to_s = (float(x) for x in part.split(".."))
        chosen |= (t_s >= from_s) & (t_s <= to_s)
    return chosen


def main():
    data = table(sys.argv[1])
    fitted, held_out = [parts(data[0], text) for text in sys.argv[2:4]]
    sets = {"grid": fit(data, fitted)}
    if len(sys.argv) > 4:
        sets |= parameters(sys.argv[4])
    reference = squared_errors(data, sets["grid"], held_out)
    for name, (tau_s, curve, yaw) in sets.items():
        of_force, of_yaw_change = squared_errors(data, (tau_s, curve, yaw), held_out)
        inertia = (curve[1] + 2 * HOVER * curve[2]) / yaw[0]
        print(
            f"{name:11} tau {tau_s:.4f} s, T_0 {curve[0]:+.4f}, T_1 {curve[1]:+.4f}, T_2 {curve[2]:+.4f} N, yaw inertia over "
            f"torque factor {inertia:.2e} kg m\n"
            f"            held out: specific force {numpy.sqrt(of_force[0].mean()):.3f} m/s2, yaw acceleration "
            f"{numpy.sqrt(of_yaw_change[0].mean()):.2f} rad/s2"
        )
        if name != "grid":
            print(f"            squares over the grid's: {compared(of_force, reference[0])}, {compared(of_yaw_change, reference[1])}")


if __name__ == "__main__":
    main()
