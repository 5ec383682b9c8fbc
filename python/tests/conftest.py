"""One virtual flight for all tests, simulated and filmed by the package's own command."""

import pytest

import mavsight


@pytest.fixture(scope="session")
def flight(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flight")
    assert mavsight.command("simulate", "--out", folder) == 0
    assert mavsight.command("film", folder, "--out", folder) == 0
    return folder


@pytest.fixture(scope="session")
def results(flight):
    return mavsight.run(flight / "session.toml", equation_error_only=True)
