"""The figures of paper-flight: the bars of what a run on it must show. Takes the results, and the recording's folder."""
import csv
import json
import math
import pathlib
import sys

folder = pathlib.Path(sys.argv[1])
summary = json.loads((folder / "summary.json").read_text())
truth, fit = summary["truth"], summary["fit"]
centre = lambda name, x: 1e3 * math.dist(summary["cameras"][f"{name}_centre_m"], (x, -4.5, 1.5))
held = {
    "300 of 300 frames": summary["poses"]["measured"] == 300,
    f"position {truth['poses_position_rms_mm']:.3f} mm within 2": truth["poses_position_rms_mm"] < 2,
    f"attitude {max(truth['poses_attitude_rms_deg']):.3f} degrees within 0.3": max(truth["poses_attitude_rms_deg"]) < 0.3,
    f"camera 1 centre {centre('cam1', 4.5):.2f} mm within 8": centre("cam1", 4.5) < 8,
    f"camera 2 centre {centre('cam2', -4.5):.2f} mm within 8": centre("cam2", -4.5) < 8,
    f"C_X residual {fit['C_X_max_residual']:.2e}": fit["C_X_max_residual"] < 0.0009,
    f"C_Z residual {fit['C_Z_max_residual']:.2e}": fit["C_Z_max_residual"] < 0.00055,
    f"C_m residual {fit['C_m_max_residual']:.2e}": fit["C_m_max_residual"] < 0.0005,
    f"C_X R2 {fit['C_X_r2']:.3f}": fit["C_X_r2"] >= 0.7,
    f"C_m R2 {fit['C_m_r2']:.3f}": fit["C_m_r2"] >= 0.9,
}

# The inputs have the clock of the films. Four standard deviations: one time in ten thousand.
truth_parameters = json.loads((pathlib.Path(sys.argv[2]) / "truth_parameters.json").read_text())["constant_speed_truth"]
constants = {(c, f"alpha_{disc}"): truth_parameters[f"{c.replace('_', '')}_alpha_{disc}"] for c in ["C_X", "C_m"] for disc in "ul"}
constants["", "input_lag_s"] = 0.0
with (folder / "parameters.csv").open(newline="") as table:
    rows = [(row["estimator"], row["output"], row["parameter"], row["value"], row["std"]) for row in csv.DictReader(table)]
for estimator in ["oe", "fe", "image"]:
    for (output, parameter), true in constants.items():
        found = [(float(value), float(std)) for *names, value, std in rows if names == [estimator, output, parameter] and value]
        off = [(value - true) / std for value, std in found]
        held[f"{estimator} {output} {parameter} off by {off} standard deviations"] = len(off) == 1 and abs(off[0]) < 4
for name, good in held.items():
    print("ok  " if good else "FAIL", name)
sys.exit(not all(held.values()))
