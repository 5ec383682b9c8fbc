"""Videos of a small aircraft in, its motion and flight-dynamics parameters out.

>>> results = mavsight.run("flight/session.toml")       # what `mavsight run` finds; nothing is written
>>> motion = results.to_pandas("motion")                # or to_polars, to_numpy; poses, parameters, markers, notes
>>> mavsight.plot.overview(results)                     # needs matplotlib
>>> motion = mavsight.smooth(t_s, pose, std)            # arrays of n times, n x 6 poses and their standard deviations
>>> campaign = mavsight.Campaign("campaign.toml")
>>> combination, estimates, stds = campaign.estimates(0, 100)
"""

from __future__ import annotations

import os
from typing import Any, Iterable

from . import plot
from ._mavsight import Campaign, Motion, smooth
from ._mavsight import command as _command
from ._mavsight import run as _run
from ._results import Results

__all__ = ["Campaign", "Motion", "Results", "command", "plot", "run", "run_on", "run_sessions_on", "smooth"]

_planned: dict[str, Campaign] = {}


def run(
    session: str | os.PathLike[str],
    equation_error_only: bool = False,
    lag_s: float | None = None,
    hold_out_s: tuple[float, float] | None = None,
    search: bool = False,
) -> Results:
    """Carries a recorded session through all stages, as `mavsight run` does, and writes nothing.

    equation_error_only leaves out output error, which takes longest. lag_s is added to the inputs' times; it is estimated where
    it is left out. hold_out_s is a part of the flight that no fit uses, for validation. search tries, by output error, the terms
    that the flight model marks as candidates.

    ValueError for a session that is wrong, RuntimeError for one that cannot be worked out.
    """
    return Results(_run(os.fspath(session), equation_error_only, lag_s, hold_out_s, search))


def command(*words: str | os.PathLike[str]) -> int:
    """Does what the command `mavsight` does with such words, and gives its exit status: 0 is success.

    >>> mavsight.command("overlay", "session.toml", "--out", "flight.mp4")
    """
    return _command(["mavsight", *[os.fspath(word) for word in words]])


def run_sessions_on(client: Any, sessions: Iterable[str | os.PathLike[str]], **options: Any) -> list[Results]:
    """Results of many sessions, each run by a worker of a Dask client with the options of `run`, in their order.

    Every worker must find the sessions, and what they name, under the same paths.
    """
    futures = [client.submit(run, os.fspath(session), pure=False, **options) for session in sessions]
    return client.gather(futures)


def _rows(path: str, start: int, stop: int) -> str:
    """Rows of some flights; a worker plans a campaign once."""
    if path not in _planned:
        _planned[path] = Campaign(path)
    return _planned[path].rows(start, stop)


def run_on(client: Any, path: str | os.PathLike[str], batch: int = 500) -> str:
    """The whole table of a campaign, flown by the workers of a Dask client.

    Every worker must find the campaign file, and what it names, under the same path. The table is, byte for byte, that of
    `mavsight campaign`, whatever the number of workers: each flight draws from its own number.
    """
    path = str(path)
    campaign = Campaign(path)
    starts = range(0, len(campaign), batch)
    futures = [client.submit(_rows, path, k, k + batch, pure=False) for k in starts]
    return campaign.header + "".join(client.gather(futures))
