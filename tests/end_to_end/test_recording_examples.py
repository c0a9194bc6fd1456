"""The examples of recordings and of the live bridge, each as a program of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from asyncio import timeout
from pathlib import Path
from typing import Any

import pytest
from aiohttp import ClientSession
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from catoptra_client.frame import rgb_from_image_bytes
from catoptra_client.recording.recorder import Recorder, RecordingPlan
from helpers.bags import read_bag
from helpers.configs import REPOSITORY
from helpers.server_process import DEADLINE_S, start_server

EXAMPLES = REPOSITORY / "examples"
CAMERA = "OmniCamPillar_Link4"


def test_reader_without_catoptra_prints_the_recorded_drive(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with start_server(tmp_path) as server, server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", location_m=(0.5, 1.0, 0.0), name="R")
        client.drive(2.0, 2.0)
        Recorder(path, RecordingPlan("R", None), stream_port=server.stream_port).record(1.0)
    program = EXAMPLES / "read_recording.py"
    # Isolated: nothing of the repository is on its path but what is installed.
    command = [sys.executable, "-I", "-c", HIDDEN.format(program=str(program)), str(path)]
    read = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    assert read.returncode == 0, read.stderr
    topics = read_bag(path)
    assert len(read.stdout.splitlines()) == len(topics["/ground_truth"])
    stamp_ns, message = topics["/ground_truth"][-1]
    at = message.pose.pose.position
    last = f"{1e-9 * stamp_ns:.2f} s: x {at.x:.3f} m, y {at.y:.3f} m"
    assert read.stdout.splitlines()[-1] == last
    assert at.y == pytest.approx(-1.0, abs=0.01)  # left is positive in ROS
    lines = program.read_text(encoding="utf-8").partition('"""\n\n')[2].splitlines()
    assert sum(map(bool, lines)) == 8


HIDDEN = """
import runpy, sys
sys.modules["catoptra_client"] = sys.modules["catoptra_protocol"] = None
runpy.run_path({program!r}, run_name="__main__")
"""


async def test_bridge_shows_pictures_and_latched_transforms_to_a_late_viewer(
    tmp_path: Path,
) -> None:
    pytest.importorskip("foxglove", reason="needs foxglove-sdk, of the tools of development")
    with start_server(tmp_path) as server, server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", location_m=(0.5, 1.0, 0.0), name="R")
        command = [sys.executable, EXAMPLES / "foxglove_bridge.py", str(server.stream_port), "0"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as bridge:
            assert bridge.stdout is not None, "stdout is a pipe"
            address = bridge.stdout.readline().strip()
            try:
                heard = await view(address, "/tf_static", f"/{CAMERA}/image/compressed")
            finally:
                bridge.terminate()
    children = {one.child_frame_id for one in heard["/tf_static"][-1].transforms}
    assert f"{CAMERA}_optical_frame" in children
    pictures = heard[f"/{CAMERA}/image/compressed"]
    assert rgb_from_image_bytes(bytes(pictures[-1].data)).shape == (64, 64, 3)


async def view(address: str, *topics: str) -> dict[str, list[Any]]:
    """Messages of topics as Foxglove's viewer gets them, until the last topic has 30."""
    heard: dict[str, list[Any]] = {topic: [] for topic in topics}
    decoders: dict[int, tuple[str, Any]] = {}
    async with (
        timeout(DEADLINE_S),
        ClientSession() as session,
        session.ws_connect(address, protocols=["foxglove.sdk.v1"]) as socket,
    ):
        async for message in socket:
            if isinstance(message.data, bytes):
                # An opcode, the subscription, and a stamp are before each message.
                topic, decode = decoders[int.from_bytes(message.data[1:5], "little")]
                heard[topic].append(decode(message.data[13:]))
                if len(heard[topics[-1]]) == 30:
                    break
                continue
            for channel in json.loads(message.data).get("channels", ()):
                if channel["topic"] in topics:
                    about = channel["schema"].encode(), channel["schemaEncoding"]
                    schema = Schema(1, *about, channel["schemaName"])
                    decode = DecoderFactory().decoder_for("cdr", schema)
                    decoders[channel["id"]] = channel["topic"], decode
            # Again with each text: a channel is rejected while the server is still making it known.
            missing = [id_ for id_, (topic, _) in decoders.items() if not heard[topic]]
            subscriptions = [{"id": id_, "channelId": id_} for id_ in missing]
            await socket.send_json({"op": "subscribe", "subscriptions": subscriptions})
    return heard
