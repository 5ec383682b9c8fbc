"""Plots of what a run found; they need matplotlib.

Bands and bars are 95 % intervals. Each function draws into given axes, or into new ones, and returns them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Sequence

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ._results import Results

# Okabe and Ito: colours that eyes of all kinds distinguish.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
_SIGMAS = 1.96


def _axes(ax: Axes | None, **options: Any) -> Any:
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.figure(layout="constrained").add_subplot(**options)


def series(results: Results, columns: Sequence[str], ax: Axes | None = None, scale: float = 1.0, unit: str = "") -> Axes:
    """Columns of the motion over time with their bands, times a scale, which changes the unit.

    ValueError for a flight that gives no motion.
    """
    motion = _motion(results)
    ax = _axes(ax)
    for column, colour in zip(columns, _COLOURS * len(columns)):
        k = motion.columns.index(column)
        value, half = scale * motion.state[:, k], _SIGMAS * scale * motion.std[:, k]
        ax.plot(motion.t_s, value, color=colour, label=column.split("_")[0] if unit else column)
        ax.fill_between(motion.t_s, value - half, value + half, color=colour, alpha=0.25, linewidth=0)
    ax.set_xlabel("time, s")
    ax.set_ylabel(unit)
    ax.legend()
    return ax


def angles(results: Results, ax: Axes | None = None) -> Axes:
    """Roll, pitch and yaw in degrees."""
    return series(results, ["phi_rad", "theta_rad", "psi_rad"], ax, np.degrees(1.0), "angle, °")


def velocity(results: Results, ax: Axes | None = None) -> Axes:
    """Velocity along the body's axes in m/s."""
    return series(results, ["u_m_s", "v_m_s", "w_m_s"], ax, 1.0, "velocity in body axes, m/s")


def path(results: Results, ax: Axes | None = None) -> Axes:
    """The path in space, lengths in metres, with its start marked."""
    motion = _motion(results)
    ax = space = _axes(ax, projection="3d")
    x, y, z = motion.state[:, :3].T
    ax.plot(x, y, z, color=_COLOURS[0], label="path")
    ax.plot(x[:1], y[:1], z[:1], "o", color=_COLOURS[1], label="start")
    ax.set_xlabel("X, m")
    ax.set_ylabel("Y, m")
    space.set_zlabel("Z, m")
    ax.set_aspect("equal")
    ax.legend()
    return ax


def parameters(results: Results, estimator: str | None = None, ax: Axes | None = None) -> Axes:
    """Parameters of an estimator, each of its own size: values over themselves, so that intervals can be compared.

    The estimator is by default that of the last parameter. ValueError where it has no parameters.
    """
    if estimator is None and results.parameters:
        estimator = results.parameters[-1][0]
    found = [(name, value, std) for by, name, value, std in results.parameters if by == estimator and value != 0]
    if not found:
        raise ValueError(f"{results.session} has no parameters by {estimator}")
    names, values, stds = zip(*found)
    ax = _axes(ax)
    half = _SIGMAS * 100 * np.array(stds) / np.abs(values)
    ax.errorbar(np.zeros(len(names)), range(len(names)), xerr=half, fmt="o", color=_COLOURS[0], capsize=3)
    ax.axvline(0, color="0.6", linewidth=0.8)
    ax.set_yticks(range(len(names)), [f"{name} = {value:.3g}" for name, value in zip(names, values)])
    ax.invert_yaxis()
    ax.set_xlabel("95 % interval, % of the value")
    ax.set_title(str(estimator))
    return ax


def overview(results: Results) -> Figure:
    """Path, angles, velocity and parameters in one figure; what the flight does not give is left out."""
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(11, 8), layout="constrained")
    figure.suptitle(results.session)
    if results.motion is not None:
        path(results, figure.add_subplot(2, 2, 1, projection="3d"))
        angles(results, figure.add_subplot(2, 2, 2))
        velocity(results, figure.add_subplot(2, 2, 3))
    if results.parameters:
        parameters(results, ax=figure.add_subplot(2, 2, 4))
    return figure


def _motion(results: Results) -> Any:
    if results.motion is None:
        raise ValueError(f"{results.session} gives no motion: {'; '.join(results.notes)}")
    return results.motion
