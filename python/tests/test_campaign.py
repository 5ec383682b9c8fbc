"""The package against itself: arrays and text say the same, one worker and two give one table."""

import os
import pathlib
import shutil
import time

import numpy as np
import pytest

import mavsight

ROOM = pathlib.Path(__file__).parents[2] / "crates" / "plan" / "example"

CAMPAIGN = """
schema = 1
flights = {flights}
[[rig]]
name = "right angle"
room = "room.toml"
camera = [
    {{ type = "camcorder", centre_m = [4.5, -4.5, 1.5] }},
    {{ type = "camcorder", centre_m = [-4.5, -4.5, 1.5] }},
]
[[noise]]
name = "fine"
centre_std_px = 0.05
[[manoeuvre]]
name = "doublet"
scenario = "doublet.toml"
"""

DOUBLET = """
duration_s = 5.0
frame_rate_hz = 30.0
input_rate_hz = 100.0
position_m = [0.0, 0.0, 1.5]
heading_deg = 22.5
[[maneuver]]
kind = "doublet"
channel = "delta_lon"
start_s = 0.5
pulse_s = 0.5
amplitude = -4.0
"""


def written(folder, flights):
    for name in ("room.toml", "control_points.csv"):
        shutil.copy(ROOM / name, folder / name)
    (folder / "doublet.toml").write_text(DOUBLET)
    file = folder / "campaign.toml"
    file.write_text(CAMPAIGN.format(flights=flights))
    return file


def test_arrays_and_rows_say_the_same(tmp_path):
    campaign = mavsight.Campaign(written(tmp_path, 40))
    assert len(campaign) == 40
    combination, estimates, stds = campaign.estimates(10, 20)
    names = campaign.parameters(0)
    assert combination.tolist() == [0] * 10
    assert estimates.shape == stds.shape == (10, len(names))
    rows = [line.split(",") for line in campaign.rows(10, 20).splitlines()]
    assert np.allclose([float(r[6]) for r in rows], estimates.ravel(), rtol=1e-15, atol=0)
    assert campaign.combination(0) == ("right angle", "fine", "doublet")
    truth = np.array([value for _, value in names])
    assert np.mean(((estimates - truth) / stds) ** 2) < 2


def test_what_is_wrong_is_said(tmp_path):
    with pytest.raises(ValueError, match="no such file"):
        mavsight.Campaign(tmp_path / "none.toml")
    with pytest.raises(ValueError, match="flights"):
        mavsight.Campaign(written(tmp_path, 0))
    with pytest.raises(ValueError, match="no combination"):
        mavsight.Campaign(written(tmp_path, 1)).combination(1)


def test_two_workers_give_the_table_of_one_in_little_more_than_half_the_time(tmp_path):
    distributed = pytest.importorskip("dask.distributed")
    file = written(tmp_path, int(os.environ.get("MAVSIGHT_DASK_FLIGHTS", "3000")))
    tables, seconds = [], []
    for workers in (1, 2):
        with distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=None
        ) as cluster, distributed.Client(cluster) as client:
            client.run(mavsight._rows, str(file), 0, 1)
            begin = time.perf_counter()
            tables.append(mavsight.run_on(client, file, batch=100))
            seconds.append(time.perf_counter() - begin)
    assert tables[0] == tables[1]
    assert tables[0] == mavsight.Campaign(file).header + mavsight.Campaign(file).rows(0, 10**9)
    ratio = seconds[0] / seconds[1]
    print(f"one worker {seconds[0]:.2f} s, two {seconds[1]:.2f} s: {ratio:.2f} times as fast")
    if (os.cpu_count() or 1) >= 2 and os.environ.get("MAVSIGHT_DASK_SPEED"):
        assert ratio >= 1.7
