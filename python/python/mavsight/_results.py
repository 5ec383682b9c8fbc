"""What a run found, as tables."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, Any, Iterator

import numpy as np

if TYPE_CHECKING:
    import pandas
    import polars

    from ._mavsight import Found, Motion

_FILES = {"poses": "pose.csv"}
"""Names of tables that are not those of their files without the ending."""


class Results:
    """What `mavsight.run` found in a session.

    Tables have the columns of the files that `mavsight run` writes, which docs/results.md explains: `poses`, `motion`,
    `parameters`, `markers`, `coefficients`, `body` and `notes`, as far as the flight gives them. Lengths are in metres, angles
    in radians, times in seconds. A pose or a motion that could not be measured is a row with its time alone.

    It unpacks into motion, parameters and notes:

    >>> motion, parameters, notes = mavsight.run("flight/session.toml")
    """

    session: str
    """Name of the session."""
    motion: Motion | None
    """Smoothed motion as arrays; None where the flight gives none."""
    parameters: list[tuple[str, str, float, float]]
    """Estimator, name, value and standard deviation of each parameter that is determined."""
    notes: list[str]
    """What could not be had, and why."""

    def __init__(self, found: Found) -> None:
        self.session = found.session
        self.motion = found.motion
        self.parameters = found.parameters
        self.notes = found.notes
        names = {file: name for name, file in _FILES.items()}
        self._tables = {names.get(file, file.removesuffix(".csv")): text for file, text in found.tables.items()}
        self._tables["notes"] = _written(["note"], [[note] for note in found.notes])

    def __iter__(self) -> Iterator[Any]:
        return iter((self.motion, self.parameters, self.notes))

    def __repr__(self) -> str:
        return f"<mavsight.Results of {self.session!r}: {', '.join(self.tables)}>"

    @property
    def tables(self) -> list[str]:
        """Names of the tables that there are."""
        return list(self._tables)

    def to_csv(self, table: str) -> str:
        """A table as text: what `mavsight run` writes into its file. KeyError for one that the flight does not give."""
        if table not in self._tables:
            raise KeyError(f"{self.session} has no table {table!r}; it has {', '.join(self.tables)}")
        return self._tables[table]

    def to_numpy(self, table: str = "motion") -> dict[str, np.ndarray]:
        """A table as one array a column: numbers, nan where there is none, or text."""
        header, *rows = csv.reader(io.StringIO(self.to_csv(table)))
        return {name: _array([row[k] for row in rows]) for k, name in enumerate(header)}

    def to_pandas(self, table: str = "motion") -> pandas.DataFrame:
        """A table as a pandas data frame."""
        import pandas

        return pandas.read_csv(io.StringIO(self.to_csv(table)))

    def to_polars(self, table: str = "motion") -> polars.DataFrame:
        """A table as a Polars data frame."""
        import polars

        return polars.read_csv(io.StringIO(self.to_csv(table)), infer_schema_length=None)


def _array(cells: list[str]) -> np.ndarray:
    try:
        return np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        return np.array(cells)


def _written(header: list[str], rows: list[list[str]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([header, *rows])
    return out.getvalue()
