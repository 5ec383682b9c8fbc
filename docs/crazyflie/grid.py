"""Thrust curve, motor lag and yaw of a Crazyflie by least squares on a grid of lags, beside the values of `mavsight identify`.

Usage: grid.py TABLE.csv FIT_FROM..TO[,FROM..TO] HELD_OUT_FROM..TO[,FROM..TO] [PARAMETERS.csv]

TABLE.csv has t_s, motor_1 to motor_4, acc_z_m_s2 and gyro_z_rad_s (`mavsight convert log10 table.csv --preset crazyflie --input ...`,
docs/logs.md), PARAMETERS.csv is that of `mavsight identify --out`. Needs numpy and scipy.

For each delay and time constant of a grid the motors follow their delayed commands with a first-order lag (Eschmann, Albani & Loianno
2024); specific force is linear in the coefficients of the thrust curve, and the change of the yaw rate in those of the torque, of the
rotors' gain of speed, of their drag and in a constant, as in crazyflie.toml and within its bounds. The delay and the time constant are
kept with which the product of the mean squares of both is least: the most likely ones if the noise of neither is known. Printed are root
mean square errors of one-step predictions on the part that was not fitted: specific force, and yaw acceleration over YAW_STEPS; of the
values of `mavsight identify` also by how much the mean squares are more than those of the grid, with the standard error of that over
seconds of the flight.
"""

import csv
import sys

import numpy
from scipy.optimize import lsq_linear, minimize
from scipy.signal import lfilter

# Commands are followed by steps of FINE_S; what is measured are means over FINE_STEPS of them.
FINE_S = 0.001
FINE_STEPS = 5
STEP_S = FINE_S * FINE_STEPS
MASS_KG = 0.027
# Command of hover.
HOVER = 0.6
SIGNS = numpy.array([1.0, -1.0, 1.0, -1.0])
# Yaw acceleration is the change of the yaw rate over this, as that of one sample is noise.
YAW_STEPS = 10


def means(fine):
    """Over FINE_STEPS."""
    whole = len(fine) // FINE_STEPS
    return fine[: whole * FINE_STEPS].reshape(whole, FINE_STEPS, *fine.shape[1:]).mean(axis=1)


def table(path):
    """Time, specific force and yaw rate as means over STEP_S, commands by FINE_S."""
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    names, values = rows[0], numpy.array([[float(x) for x in row] for row in rows[1:]])
    t_s = values[:, names.index("t_s")]
    fine_s = numpy.arange(t_s[0], t_s[-1], FINE_S)
    held = numpy.searchsorted(t_s, fine_s + 1e-9, side="right") - 1
    motors = numpy.stack([values[held, names.index(f"motor_{k}")] for k in range(1, 5)], axis=1)
    middle_s = fine_s + 0.5 * FINE_S
    force, rate = (
        means(numpy.interp(middle_s, t_s, values[:, names.index(name)])) for name in ("acc_z_m_s2", "gyro_z_rad_s")
    )
    return means(middle_s), motors, force, rate


def followed(motors, lags):
    """The delayed commands and the motors behind them, of each FINE_S."""
    delay_s, tau_s = lags
    steps = numpy.arange(len(motors)) - delay_s / FINE_S
    before = numpy.clip(numpy.floor(steps).astype(int), 0, len(motors) - 1)
    share = (steps - numpy.floor(steps))[:, None]
    delayed = (1.0 - share) * motors[before] + share * motors[numpy.minimum(before + 1, len(motors) - 1)]
    kept = numpy.exp(-FINE_S / tau_s)
    end = lfilter([1.0 - kept], [1.0, -kept], delayed, axis=0, zi=kept * delayed[:1])[0]
    start = numpy.vstack([delayed[:1], end[:-1]])
    return delayed, 0.5 * (start + end)


def features(data, lags):
    """What the specific force is linear in: the coefficients of the thrust curve."""
    m = followed(data[1], lags)[1]
    thrust = numpy.stack([numpy.ones(m.shape), m, m * m], axis=2).sum(axis=1)
    return -means(thrust) / MASS_KG


def yaw_change(rate):
    out = numpy.full(len(rate), numpy.nan)
    half = YAW_STEPS // 2
    out[half:-half] = (rate[YAW_STEPS:] - rate[:-YAW_STEPS]) / (YAW_STEPS * STEP_S)
    return out


def mean_over_change(x):
    # Half of the first and the last, as the change is from the middle of a step to the middle of another.
    weights = numpy.ones(YAW_STEPS + 1)
    weights[[0, -1]] = 0.5
    return numpy.convolve(x, weights / YAW_STEPS, mode="same")


def predicted(data, lags, curve, yaw):
    return features(data, lags) @ curve, of_yaw(data, lags) @ yaw


def of_yaw(data, lags):
    """What the yaw acceleration is linear in: torque, gain of the rotors' speed, their drag, a constant."""
    _, motors, _, rate = data
    delayed, m = (means(x) for x in followed(motors, lags))
    columns = [m @ SIGNS, (delayed - m) @ SIGNS / lags[1], -m.sum(axis=1) * rate, numpy.ones(len(rate))]
    return numpy.stack([mean_over_change(column) for column in columns], axis=1)


def fit(data, chosen):
    _, _, force, rate = data
    change = yaw_change(rate)
    known = chosen & numpy.isfinite(change)

    def solved(lags):
        curve, squares, _, _ = numpy.linalg.lstsq(features(data, lags)[chosen], force[chosen], rcond=None)
        bounds = ([0.0, 0.0, 0.0, -numpy.inf], numpy.inf)
        yaw = lsq_linear(of_yaw(data, lags)[known], change[known], bounds)
        return numpy.log(squares[0]) + numpy.log(yaw.cost), curve, yaw.x

    grid = [(delay_s, tau_s) for delay_s in numpy.arange(0.0, 0.03, 0.005) for tau_s in numpy.geomspace(0.01, 0.3, 15)]
    best = min(grid, key=lambda lags: solved(lags)[0])
    lags = minimize(lambda x: solved(x)[0], best, method="Nelder-Mead", bounds=[(0.0, 0.1), (0.005, 0.5)]).x
    return lags, *solved(lags)[1:]


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
        lags = (own.get("input_lag_s", 0.0), own["tau"])
        out[f"mavsight {name}"] = (lags, curve, numpy.array([own[k] for k in ("yaw", "spin", "yaw_drag", "yaw_0")]))
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
    for name, (lags, curve, yaw) in sets.items():
        of_force, of_yaw_change = squared_errors(data, (lags, curve, yaw), held_out)
        inertia = (curve[1] + 2 * HOVER * curve[2]) / yaw[0]
        print(
            f"{name:11} delay {1e3 * lags[0]:.1f} ms, tau {lags[1]:.4f} s, T_0 {curve[0]:+.4f}, T_1 {curve[1]:+.4f}, T_2 {curve[2]:+.4f} N, yaw inertia over "
            f"torque factor {inertia:.2e} kg m\n"
            f"            held out: specific force {numpy.sqrt(of_force[0].mean()):.3f} m/s2, yaw acceleration "
            f"{numpy.sqrt(of_yaw_change[0].mean()):.2f} rad/s2"
        )
        if name != "grid":
            print(f"            squares over the grid's: {compared(of_force, reference[0])}, {compared(of_yaw_change, reference[1])}")


if __name__ == "__main__":
    main()
