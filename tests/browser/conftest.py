"""Fixtures of the browser tests: one Chromium a run, one table of measured requirements.

`make browser-test` names this folder on the command line. `make test` names `tests`, and collects
nothing here that needs a browser.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from browser.chromium import INSTALL_HINT, Browser, is_installed, start_browser
from browser.live_server import (
    LiveServer,
    OwnedServer,
    start_live_server,
    write_full_robot,
    write_plain_robot,
)
from browser.measured_requirements import MeasuredRequirements
from browser.stream_probe import connect_probe
from helpers.configs import REPOSITORY

OUTPUT = REPOSITORY / "out/browser"
_FOLDER = Path(__file__).parent
# Reads files only.
_WITHOUT_BROWSER = "test_static_files.py"
_REQUIREMENTS = pytest.StashKey[MeasuredRequirements]()
_VERSION = pytest.StashKey[str]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the browser tests; they exist where this folder is named."""
    parser.addoption("--browser", default="chromium", help="executable of Chromium")
    parser.addoption("--soak-seconds", type=float, default=60.0, help="length of the memory test")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Ignore the tests that need a browser unless the command line names this folder."""
    named = (config.invocation_params.dir / arg.partition("::")[0] for arg in config.args)
    if any(path.resolve().is_relative_to(_FOLDER) for path in named):
        return None
    is_browser_test = collection_path.parent == _FOLDER and collection_path.suffix == ".py"
    return (is_browser_test and collection_path.name != _WITHOUT_BROWSER) or None


def pytest_configure(config: pytest.Config) -> None:
    """Begin with an empty table."""
    config.stash[_REQUIREMENTS] = MeasuredRequirements()


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Print the table, and write it to out/browser/report.txt."""
    if _VERSION in config.stash:
        text = config.stash[_REQUIREMENTS].write(OUTPUT / "report.txt", config.stash[_VERSION])
        terminalreporter.write("\n" + text)


@pytest.fixture(scope="session")
def requirements(pytestconfig: pytest.Config) -> MeasuredRequirements:
    """The table of this run."""
    return pytestconfig.stash[_REQUIREMENTS]


@pytest.fixture(scope="session")
def executable(pytestconfig: pytest.Config) -> str:
    """Chromium's executable; without it the whole run ends as failed."""
    name = str(pytestconfig.getoption("--browser"))
    if not is_installed(name):
        pytest.exit(INSTALL_HINT.format(browser=name), returncode=1)
    return name


@pytest.fixture(scope="session")
def browser(executable: str, pytestconfig: pytest.Config) -> Iterator[Browser]:
    """A browser for all tests that do not kill it."""
    with start_browser(executable) as running:
        pytestconfig.stash[_VERSION] = running.version
        yield running


@pytest.fixture(scope="session")
def output() -> Path:
    """Folder of report, screenshots and axe-core."""
    OUTPUT.mkdir(parents=True, exist_ok=True)
    return OUTPUT


@pytest.fixture(scope="session")
def empty_live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    """A server without robots."""
    folder = tmp_path_factory.mktemp("empty_live")
    with start_live_server(folder, write_plain_robot(folder)) as server:
        yield server


@pytest.fixture(scope="session")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    """A server with 20 frames a second of 640 x 640 px, and one robot that stands still."""
    folder = tmp_path_factory.mktemp("live")
    with (
        start_live_server(folder, write_plain_robot(folder)) as server,
        connect_probe(server.server.stream_port) as owner,
    ):
        owner.spawn("Standing", 1.5, 1.0)
        yield server


@pytest.fixture(scope="session")
def full_live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OwnedServer]:
    """A server with a robot that has all sensors, two cameras and all image effects."""
    folder = tmp_path_factory.mktemp("full_live")
    with (
        start_live_server(folder, write_full_robot(folder)) as server,
        connect_probe(server.server.stream_port) as owner,
    ):
        owner.spawn("Full", 0.8, -0.6)
        yield OwnedServer(server, owner)
