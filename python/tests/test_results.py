"""From a film to tables: against the command's files, and against the flight's truth."""

import csv
import json
import os
import pathlib
import pickle
import subprocess
import sys

import numpy as np
import pytest

import mavsight

NOTEBOOK = pathlib.Path(__file__).parents[1] / "notebooks" / "film_to_table.ipynb"


def truth_of(flight):
    with open(flight / "truth.csv") as file:
        header, *rows = csv.reader(line for line in file if not line.startswith("#"))
    return {name: np.array([float(row[k]) for row in rows]) for k, name in enumerate(header)}


def test_the_tables_are_the_command_s_files_and_hold_the_truth(flight, results, tmp_path):
    out = tmp_path / "results"
    words = ["run", flight / "session.toml", "--out", out, "--equation-error-only"]
    assert mavsight.command(*words) == 0
    for table, file in [("poses", "pose"), ("motion", "motion"), ("markers", "markers"), ("parameters", "parameters")]:
        assert results.to_csv(table) == (out / f"{file}.csv").read_text(), table
    poses, truth = results.to_numpy("poses"), truth_of(flight)
    assert np.allclose(poses["t_s"], truth["t_s"])
    misses = (poses["x_m"] - truth["x_m"]) / poses["x_std_m"]
    assert np.nanmean(np.abs(misses) < 1.96) > 0.85


def test_five_lines_from_a_film_to_a_data_frame(flight):
    pytest.importorskip("pandas")
    program = f"""
import mavsight
results = mavsight.run({str(flight / "session.toml")!r}, equation_error_only=True)
motion = results.to_pandas("motion")
print(motion[["t_s", "z_m", "theta_rad"]].describe())
print(results.to_pandas("parameters"))
""".strip()
    assert len(program.splitlines()) == 5
    shown = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout
    assert "theta_rad" in shown and "estimator" in shown


def test_data_frames_have_the_columns_of_the_arrays(results):
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    for table in results.tables:
        arrays, frame, other = results.to_numpy(table), results.to_pandas(table), results.to_polars(table)
        assert isinstance(frame, pandas.DataFrame) and isinstance(other, polars.DataFrame)
        assert list(arrays) == list(frame.columns) == other.columns
    z = results.to_numpy("motion")["z_m"]
    assert np.array_equal(z, results.to_pandas("motion")["z_m"]) and np.array_equal(z, results.to_polars("motion")["z_m"])
    with pytest.raises(KeyError, match="no table 'speed'"):
        results.to_pandas("speed")


def test_results_unpack_and_travel(results):
    motion, parameters, notes = results
    again = pickle.loads(pickle.dumps(results))
    assert np.array_equal(again.motion.state, motion.state) and np.array_equal(again.motion.std, motion.std)
    assert (again.parameters, again.notes, again.tables) == (parameters, notes, results.tables)
    with pytest.raises(ValueError, match="shape"):
        mavsight.Motion(motion.t_s, motion.state[1:], motion.std, motion.bandwidth_hz)


def test_workers_run_sessions(flight, results):
    distributed = pytest.importorskip("dask.distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:
        found = mavsight.run_sessions_on(client, [flight / "session.toml"] * 2, equation_error_only=True)
    assert [each.to_csv("motion") for each in found] == [results.to_csv("motion")] * 2


def test_plots_are_drawn(results):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    figure = mavsight.plot.overview(results)
    assert len(figure.axes) == 4
    figure.canvas.draw()
    band = mavsight.plot.angles(results).collections[0].get_paths()[0].vertices[:, 1]
    roll, half = np.degrees(results.motion.state[:, 3]), 1.96 * np.degrees(results.motion.std[:, 3])
    assert np.isclose(band.max() - band.min(), (roll + half).max() - (roll - half).min(), rtol=0.01)
    with pytest.raises(ValueError, match="no parameters"):
        mavsight.plot.parameters(results, "nobody")


def test_the_wheel_brings_the_command(tmp_path):
    program = pathlib.Path(sys.executable).with_name("mavsight")
    if not program.exists():
        pytest.skip("the package is not installed into this environment")
    said = subprocess.run([program, "--version"], check=True, capture_output=True, text=True).stdout
    assert said.startswith("mavsight ")
    refused = subprocess.run([program, "run", tmp_path / "none.toml", "--out", tmp_path / "out"], capture_output=True, text=True)
    assert refused.returncode == 2 and "none.toml" in refused.stderr and "Traceback" not in refused.stderr


def test_the_notebook_runs(tmp_path):
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = json.dumps([cell.get("outputs") for cell in notebook.cells])
    assert "text/html" in outputs and "image/png" in outputs
