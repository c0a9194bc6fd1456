"""The experiment over real sockets and processes, and the addresses of running servers."""

from __future__ import annotations

import json
import socket
import threading
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from types import SimpleNamespace

import numpy as np
import pytest

from catoptra_client.control_connection import ServerAddress
from catoptra_client.localization import make_landmark_map
from catoptra_client.server_process import connect_stream, run_server
from catoptra_protocol.errors import CatoptraError, ConnectionLostError, DomainError
from catoptra_protocol.landmarks import read_landmarks
from catoptra_studies.experiment.experiment_results import write_experiment_results
from catoptra_studies.experiment.experiment_runner import (
    PUBLISHED_FILTER,
    ExperimentConfig,
    open_server,
    parse_server_address,
    run_setup,
    train_classifier,
)
from catoptra_studies.experiment.experiment_setups import PAPER_FILTER, REAL, SETUPS, SIM
from catoptra_studies.experiment.figure_source import CameraFigures, capture_frame_comparison
from catoptra_studies.experiment.localization_filter import replay_filter
from catoptra_studies.experiment.metrics import true_range_bearing
from client.scripted_server import ScriptedControlPeer, serve_script, wait_for_close
from helpers.server_process import DEADLINE_S

CONFIGS = Path(__file__).parents[3] / "configs"
LANDMARKS = {m.name: m for m in read_landmarks(CONFIGS / "landmarks/four_legged_2006.csv")}


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    return ExperimentConfig(
        config_folder=CONFIGS,
        output_folder=tmp_path_factory.mktemp("experiment"),
        setups=SETUPS,
        num_runs=1,
        seed=0,
        num_training_frames=12,
        server_arguments=("--renderer", "trace"),
    )


@pytest.fixture(scope="module")
def trained(config):
    return train_classifier(config)


@pytest.fixture(scope="module")
def results(config, trained):
    return [run_setup(config, setup, trained[0]) for setup in SETUPS]


def test_landmarks_are_detected_in_frames_received_over_tcp(trained):
    _, snapshot = trained
    assert snapshot.rgb.shape == (360, 360, 3)
    names = {detection.name for detection in snapshot.stages.detections}
    assert "magenta_over_yellow" in names


@pytest.mark.parametrize("number", [0, 1], ids=["sim", "real"])
def test_filter_stays_within_the_papers_bound_where_odometry_does_not(results, number):
    run = results[number].filter_runs[PAPER_FILTER.name][0]
    assert len(run.estimate_error_m) == 101
    assert run.odometry_error_m.max() > 1.0
    assert run.estimate_error_m.max() < 0.7  # the 95 % quantile over seeds is 0.65


def test_sim_and_real_measure_with_their_own_noise(results):
    sim, real = (result.drive_logs[0] for result in results)
    assert (sim.setup, real.setup) == (SIM.name, REAL.name)
    assert sum(len(step.measurements) for step in sim.steps) > 100
    assert sum(len(step.measurements) for step in real.steps) > 150


def test_the_same_run_gives_the_same_log(config, trained, results):
    again = run_setup(config, REAL, trained[0])
    assert again.drive_logs == results[1].drive_logs


def test_another_seed_gives_other_odometry_and_other_errors_by_hand(config, trained, results):
    (other,) = run_setup(replace(config, seed=1), REAL, trained[0]).drive_logs
    (log,) = results[1].drive_logs
    assert other.steps[-1].odometry != log.steps[-1].odometry
    # Errors and no measurements, which differ with the slip of the robot alone.
    errors = [
        [m.bearing_rad - true_range_bearing(log.steps[1], LANDMARKS[m.name])[1] for m in measured]
        for log, measured in ((log, log.steps[1].measurements) for log in (log, other))
    ]
    assert np.abs(np.subtract(*errors)).min() > 1e-6


class Watch:
    """A viewer that requests frames and states of a server until it is stopped."""

    def __init__(self, address: ServerAddress) -> None:
        self.num_frames, self.texts = 0, set[str]()
        self._stop = threading.Event()
        # Before the drive, which keeps the server from loading what its viewers need.
        self._viewer = connect_stream(address, timeout_s=DEADLINE_S)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join(DEADLINE_S)
        self._viewer.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            # Before and after the drive there is no robot.
            with suppress(CatoptraError):
                self.num_frames += len(self._viewer.get_frame(robot="Run0").rgb) > 0
                notes = self._viewer.get_state("Run0").notes
                self.texts |= {json.loads(note.text)["text"] for note in notes}


def test_a_watched_run_gives_the_same_log_and_shows_its_filter(config, trained, results):
    links = SimpleQueue[str]()
    robot = config.find_file("robots", SIM.robot_file)
    log_file = config.output_folder / "watched.log"
    with run_server(
        robot, config.field_world_file, seed=0, log_file=log_file, on_page=links.put
    ) as address:
        assert links.get(timeout=DEADLINE_S).startswith("http://127.0.0.1:")
        watch = Watch(address)
        try:
            watched = replace(config, remote_servers={SIM.name: address})
            again = run_setup(watched, SIM, trained[0])
        finally:
            watch.stop()
    assert again.drive_logs == results[0].drive_logs
    assert watch.num_frames > 20
    assert len(watch.texts) > 20
    assert all("from the truth" in text for text in watch.texts)


def test_published_filter_equals_its_replay(results):
    (log,), (published,) = results[0].drive_logs, results[0].filter_runs[PUBLISHED_FILTER.name]
    landmark_map = make_landmark_map(read_landmarks(CONFIGS / "landmarks/four_legged_2006.csv"))
    replayed = replay_filter(log, SIM, PUBLISHED_FILTER, landmark_map)
    assert np.array_equal(published.estimate, replayed.estimate)
    assert np.array_equal(published.num_accepted, replayed.num_accepted)


def test_report_and_summary_are_written(config, trained, results):
    report, claims = write_experiment_results(
        config,
        results,
        CameraFigures(),
        snapshot=trained[1],
        comparison=capture_frame_comparison(config),
        timing_s={"all": 1.0},
        subtitle="a test",
    )
    document = json.loads((config.output_folder / "summary.json").read_text())
    assert set(document["setups"]) == {"sim", "real"}
    assert len(document["claims"]) == len(claims) == 9
    assert "overview.png" in {path.name for path in config.output_folder.iterdir()}
    assert report.stat().st_size > 200_000  # five figures are inside


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("sim=there", ServerAddress("there", 3000, 5003)),
        ("sim=127.0.0.1:3100", ServerAddress("127.0.0.1", 3100, 5003)),
        ("sim=there:3100:5100", ServerAddress("there", 3100, 5100)),
    ],
)
def test_address_when_valid_is_parsed(text: str, address: ServerAddress) -> None:
    assert parse_server_address(text) == ("sim", address)


@pytest.mark.parametrize("text", ["there", "sim=", "sim=there:", "sim=there:x", "=there"])
def test_address_when_invalid_is_rejected_with_an_example(text: str) -> None:
    with pytest.raises(DomainError, match="sim=localhost"):
        parse_server_address(text)


@pytest.fixture
def remote(config, monkeypatch):
    """Open the simulated set-up's server at an address, by a clock that pauses move."""
    now, pauses = [0.0], []

    def sleep(time_s: float) -> None:
        pauses.append(time_s)
        now[0] += time_s

    clock = SimpleNamespace(monotonic=lambda: now[0], sleep=sleep)
    monkeypatch.setattr("catoptra_studies.experiment.experiment_runner.time", clock)

    def open_remote(address: ServerAddress) -> ServerAddress:
        there = replace(config, remote_servers={SIM.name: address}, timeout_s=1.0)
        with open_server(there, SIM) as opened:
            return opened

    return open_remote, pauses


def test_server_when_it_greets_is_used(remote) -> None:
    def greet(connection: socket.socket) -> None:
        ScriptedControlPeer(connection)
        wait_for_close(connection)

    open_remote, pauses = remote
    with serve_script(greet) as port:
        address = ServerAddress("127.0.0.1", port, 5003)
        assert open_remote(address) == address
    assert pauses == []


def test_server_when_it_never_answers_times_out(remote) -> None:
    open_remote, pauses = remote
    # The port is bound and not listening: it rejects connections.
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        address = ServerAddress("127.0.0.1", held.getsockname()[1], 5003)
        with pytest.raises(ConnectionLostError, match="no control server at 127"):
            open_remote(address)
    assert 1.0 <= sum(pauses) < 1.5
