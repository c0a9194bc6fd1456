"""Commands and setup that a viewer gets repeat a drive on another server."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from catoptra_protocol.stream.replies import CommandRecord, StateReply
from helpers.configs import FIELD
from helpers.control_lines import connect_control_lines
from helpers.server_process import RunningServer, start_server

LOCKSTEP = ("--clock", "lockstep", "--seed", "7")


def drive(server: RunningServer) -> StateReply:
    """State after a drive with commands of two clients, at times between whole ticks, too."""
    with server.connect_stream() as owner, server.connect_stream() as other:
        owner.step(0.13)
        owner.spawn("OmniP2AT", location_m=(0.1, 0.2, 0.0), name="Mine")
        owner.step(0.05)
        owner.drive(2.0 / 3.0, 1.0)
        owner.step(0.4)
        owner.share_control()
        other.drive(-1.0, 0.7, robot="Mine")
        owner.step(0.31)
        setup = other.get_setup()
        digests = {name: hashlib.sha256(one.encode()) for name, one in setup.files.items()}
        assert {name: one.hexdigest() for name, one in digests.items()} == setup.digests
        assert setup.files[FIELD.name] == FIELD.read_text()
        assert (setup.options["seed"], setup.options["world"]) == ("7", FIELD.name)
        state = other.get_state("Mine", commands_after=0)
        newer = other.get_state("Mine", commands_after=state.commands[0].number)
        assert newer.commands == state.commands[1:]
        assert not other.get_state("Mine").commands
        return state


def repeat(server: RunningServer, commands: tuple[CommandRecord, ...], end_s: float) -> StateReply:
    """State at a time after commands at their instants, over the control port."""
    time_s = 0.0
    with connect_control_lines(server.control_port) as control, server.connect_stream() as viewer:
        control.send("STEPPER")
        for command in (*commands, CommandRecord(0, end_s, "")):
            if command.time_s > time_s:
                control.step(command.time_s - time_s)
            # The owner's steps read all sensors: here the step above did.
            if not command.line.startswith("STEP"):
                control.send(command.line)
            time_s = command.time_s
        return viewer.get_state("Mine", commands_after=0)


def test_commands_at_their_instants_repeat_a_drive(tmp_path: Path) -> None:
    (tmp_path / "first").mkdir()
    with start_server(tmp_path / "first", *LOCKSTEP) as server:
        state = drive(server)
    words = [(one.line.split()[0], one.time_s) for one in state.commands]
    read = [("STEP", time_s) for time_s in (0.18, 0.58, 0.89)]
    drives = [("INIT", 0.13), ("DRIVE", 0.18), ("DRIVE", 0.58)]
    assert words == [drives[0], read[0], drives[1], read[1], drives[2], read[2]]
    (tmp_path / "second").mkdir()
    with start_server(tmp_path / "second", *LOCKSTEP) as server:
        again = repeat(server, state.commands, state.time_s)
    assert again.commands == state.commands
    assert again.reports == state.reports
    assert again.robots[0].world_from_robot == state.robots[0].world_from_robot


def test_ticks_that_a_slow_viewer_gets_have_every_pose_and_reading(tmp_path: Path) -> None:
    with start_server(tmp_path, *LOCKSTEP) as server, server.connect_stream() as owner:
        owner.spawn("OmniP2AT", location_m=(0.1, 0.2, 0.0), name="Mine")
        with server.connect_stream() as viewer:
            before = viewer.get_state("Mine", ticks_after=0.0)
            assert not before.ticks
            owner.drive(1.0, 2.0)
            owner.step(1.6)
            state = viewer.get_state("Mine", ticks_after=before.time_s)
            owner.step(0.1)
            ended = viewer.get_state("Mine", ticks_after=state.ticks[-1].time_s)
            assert not viewer.get_state("Mine").ticks
    assert len(state.ticks) == 64
    ticks = (*state.ticks, *ended.ticks)
    times_s = [before.time_s + 0.02 * number for number in range(1, 86)]
    np.testing.assert_allclose([one.time_s for one in ticks], times_s, atol=1e-9)
    pose, turned = ended.robots[0].world_from_robot, ticks[0].world_from_robot
    assert pose == ticks[-1].world_from_robot != turned
    assert ticks[-1].wheel_speeds_rad_s == (1.0, 2.0)
    # Those that a step read, too.
    read = [line for one in ticks for line in one.reports]
    assert set(ended.reports) <= set(read)
    assert sum("{Type Odometry}" in line for line in read) > 8
