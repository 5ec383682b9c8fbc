"""The figures of the demo, held loosely: noise differs from machine to machine by rounding only."""
import json
import pathlib
import sys

out = pathlib.Path(sys.argv[1])
summary = json.loads((out / "summary.json").read_text())
truth = summary["truth"]
held = {
    "all frames measured": summary["poses"]["measured"] == summary["poses"]["frames"] == 300,
    "position within 1 mm": truth["motion_position_rms_mm"] < 1.0 and truth["poses_position_rms_mm"] < 1.2,
    "attitude within 0.15 degrees": max(truth["motion_attitude_rms_deg"]) < 0.15,
    "C_m,alpha_u within 10 %": abs(truth["tls_C_m_alpha_u_error_percent"]) < 10,
    "C_m,alpha_l within 10 %": abs(truth["tls_C_m_alpha_l_error_percent"]) < 10,
    "thrusts are not separated": summary["fit"]["C_m_rank"] == 5,
}
for name in ["rig.toml", "markers.csv", "pose.csv", "motion.csv", "coefficients.csv", "parameters.csv", "report.html"]:
    held[f"{name} is written"] = (out / name).is_file()
for name, good in held.items():
    print("ok  " if good else "FAIL", name)
sys.exit(not all(held.values()))
