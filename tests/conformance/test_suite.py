"""The suite passes our own server and correct variants of it, whatever row fails or raises."""

from __future__ import annotations

import dataclasses
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from catoptra_protocol.errors import RemoteProtocolError
from conformance import stream_player, tcp_player
from conformance.check import Check, CheckFailed, CheckSkipped, ServerUnderTest
from conformance.conversation_file import Address, read_conversation
from conformance.mutation import ConnectionMutation
from conformance.mutation_play import make_unmutated
from conformance.mutation_proxy import run_mutation_proxy
from conformance.parallel_play import ParallelPlayer, parallel_rows, places_of, run_parallel_player
from conformance.server_setup import server_under_test
from conformance.suite import (
    CHECKS,
    CONVERSATIONS,
    PLAYERS,
    STEP_KEYS,
    Outcome,
    RowResult,
    applicable_checks,
    check_from_conversation,
    play_check,
    play_checks,
    read_conversations,
)
from helpers.cell_world import CELL_POSES, write_cell_world, write_sensor_robot
from helpers.configs import ROBOTS, WORLDS
from helpers.server_process import start_server

ALL_CONVERSATIONS = read_conversations()
CHECKS_BY_NAME = {check.name: check for check in CHECKS}
# Two rooms and a corridor, whose robots do not see each other.
CORRIDOR_POSES = ("{Start WestEnd}", "{Location 3.1,-3.2,0}", "{Location -1.2,-2.3,0}")
SERVER = ServerUnderTest({"control": ("127.0.0.1", 0)}, "Class", "{Start S}", "ut2004", False)


def describe_failures(results: list[RowResult]) -> list[str]:
    """Failed rows and reasons."""
    return [f"{one.check.name}: {one.reason}" for one in results if one.outcome is Outcome.FAILED]


def skipped_rows(results: list[RowResult]) -> list[str]:
    """Names of skipped rows."""
    return [one.check.name for one in results if one.outcome is Outcome.SKIPPED]


def play_port(server: ServerUnderTest, port: str) -> list[RowResult]:
    """Results of the rows of a port."""
    checks = [check for check in applicable_checks(server) if check.port == port]
    return list(play_checks(checks, server))


def play_control_rows(player: ParallelPlayer, server: ServerUnderTest) -> list[RowResult]:
    """Results of the rows of the control port."""
    names = parallel_rows(server, "control")
    return player.play(make_unmutated("control"), names)


def test_our_server_when_it_speaks_udk_and_sends_legacy_images_passes(tmp_path: Path) -> None:
    # Sonars and encoders have a line each.
    robot, world = write_sensor_robot(tmp_path), write_cell_world(tmp_path)
    options = ("--dialect", "udk", "--image-type", "RAW", "--legacy-images")
    with start_server(tmp_path, *options, robot=robot, world=world) as running:
        server = server_under_test(
            running, spawn_pose=CELL_POSES[0], dialect="udk", legacy_images=True
        )
        assert describe_failures(play_port(server, "image")) == []
        with run_parallel_player(places_of(server, CELL_POSES)) as player:
            results = play_control_rows(player, server)
    assert describe_failures(results) == []
    assert skipped_rows(results) == []


@pytest.fixture(scope="module")
def corridor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerUnderTest]:
    """A server of another world and class."""
    folder = tmp_path_factory.mktemp("corridor")
    robot = write_sensor_robot(folder, "omni_p2dx")
    with start_server(folder, robot=robot, world=WORLDS / "corridor.ini") as running:
        yield server_under_test(running, robot_class="OmniP2DX", spawn_pose=CORRIDOR_POSES[0])


def test_our_server_with_another_class_in_another_world_passes(corridor: ServerUnderTest) -> None:
    with run_parallel_player(places_of(corridor, CORRIDOR_POSES)) as player:
        results = play_control_rows(player, corridor)
    assert describe_failures(results) == []
    assert skipped_rows(results) == []


def test_our_server_with_ports_in_another_order_passes(corridor: ServerUnderTest) -> None:
    with ExitStack() as stack:

        def enter_proxy(port: str) -> Address:
            proxy = run_mutation_proxy(port, corridor.addresses[port], ConnectionMutation)
            return stack.enter_context(proxy)

        control, image = enter_proxy("control"), enter_proxy("image")
        while image[1] > control[1]:
            image = enter_proxy("image")
        server = dataclasses.replace(corridor, addresses={"image": image, "control": control})
        # A conversation, a check of both ports, and one of the control port.
        rows = [CHECKS_BY_NAME["image_turn"], CHECKS_BY_NAME["spawn_pose"]]
        rows += [row for row in applicable_checks(server) if row.name == "image_full_frame"]
        results = list(play_checks(rows, server))
    assert describe_failures(results) == []
    assert {one.outcome for one in results} == {Outcome.PASSED}


def test_rows_when_the_robot_lacks_their_part_are_skipped_with_a_reason(tmp_path: Path) -> None:
    with start_server(tmp_path, robot=ROBOTS / "kenaf.ini") as running:
        server = server_under_test(running, robot_class="Kenaf", spawn_pose="{Start Centre}")
        names = {one.name for one in ALL_CONVERSATIONS if one.needed_part == "Camera"}
        checks = [check for check in applicable_checks(server) if check.name in names]
        results = list(play_checks(checks, server))
    assert {one.check.name for one in results} == names
    assert {(one.outcome, one.reason) for one in results} == {
        (Outcome.SKIPPED, "Kenaf has no Camera")
    }


@pytest.mark.parametrize(
    ("error", "outcome", "reason"),
    [
        (CheckFailed("theta shrinks"), Outcome.FAILED, "theta shrinks"),
        (CheckSkipped("no scanner"), Outcome.SKIPPED, "no scanner"),
        (RemoteProtocolError("STA: no Time"), Outcome.FAILED, "STA: no Time"),
        (ConnectionResetError("reset"), Outcome.FAILED, "the connection broke: reset"),
        (
            ZeroDivisionError("by zero"),
            Outcome.FAILED,
            "a reply that the check cannot read: ZeroDivisionError: by zero",
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_check_when_it_raises_has_a_result(error: Exception, outcome: Outcome, reason: str) -> None:
    check = make_check(error)
    assert play_check(check, SERVER) == RowResult(check, outcome, reason)
    if outcome is Outcome.FAILED:
        optional = dataclasses.replace(check, is_required=False)
        assert play_check(optional, SERVER).outcome is Outcome.NOT_REQUIRED


def make_check(error: Exception) -> Check:
    """A check that raises."""

    def run(server: ServerUnderTest) -> None:
        raise error

    return Check("row", "control", "", run)


def test_checks_when_no_robot_spawns_are_not_played() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        gone = listener.getsockname()
    server = dataclasses.replace(SERVER, addresses={"control": gone})
    checks = [make_check(ZeroDivisionError()), CHECKS_BY_NAME["spawn"]]
    reasons = [result.reason for result in play_checks(checks, server)]
    assert reasons[0] == "not played: no robot spawns"
    assert "refused" in reasons[1]


def test_conversations_when_read_use_every_kind_of_step() -> None:
    keys = {key for one in ALL_CONVERSATIONS for step in one.steps for key in step}
    assert keys >= {*tcp_player.STEP_HANDLERS, *stream_player.STEP_HANDLERS}
    assert {one.port for one in ALL_CONVERSATIONS} == {*PLAYERS} - {"page"}
    assert len(ALL_CONVERSATIONS) == len(list(CONVERSATIONS.iterdir()))


def test_rows_when_listed_have_names_of_their_own() -> None:
    names = [check.name for check in (*CHECKS, *map(check_from_conversation, ALL_CONVERSATIONS))]
    assert len(names) == len(set(names))


def test_rows_when_for_one_kind_of_server_are_left_out_for_others() -> None:
    addresses = dict.fromkeys(PLAYERS, ("127.0.0.1", 0))
    usual = dataclasses.replace(SERVER, addresses=addresses)
    udk = dataclasses.replace(usual, dialect="udk", legacy_images=True)
    usual_names, udk_names = ({row.name for row in applicable_checks(x)} for x in (usual, udk))
    assert {"udk_pose", "image_legacy_first", "greeting", "stream_clients"} <= udk_names
    assert {"set_unknown", "image_full_frame", "greeting", "stream_clients"} <= usual_names
    assert not {"set_unknown", "image_full_frame"} & udk_names
    assert not {"udk_pose", "image_legacy_first"} & usual_names
    assert {row.port for row in applicable_checks(SERVER)} == {"control"}


def test_conversation_when_it_has_an_unknown_key_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "wrong.json"
    path.write_text('{"description": "", "port": "control", "steps": [{"expcet": []}]}')
    with pytest.raises(ValueError, match="expcet"):
        read_conversation(path, STEP_KEYS)
