"""A recorded session, as the command line runs it."""

import os
import pathlib

import pytest

import mavsight

DATA = pathlib.Path(os.environ.get("MAVSIGHT_DATA", pathlib.Path(__file__).parents[3] / "shared" / "data"))


def test_paper_flight_gives_motion_and_parameters():
    session = DATA / "paper-flight" / "session.toml"
    if not session.is_file():
        pytest.skip(f"no recordings at {DATA}")
    motion, parameters, notes = mavsight.run(session, equation_error_only=True)
    assert len(motion) == 300 and motion.std[150, :3].max() < 2e-3
    assert any(name == "C_m,alpha_l" and std < 0.1 * abs(value) for _, name, value, std in parameters)
    assert all(isinstance(note, str) for note in notes)


def test_a_session_that_is_not_there_is_named():
    with pytest.raises(ValueError, match="nowhere.toml"):
        mavsight.run("nowhere.toml")
