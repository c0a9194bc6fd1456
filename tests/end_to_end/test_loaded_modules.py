"""No request loads a module: a server without a free file descriptor could load none.

One server of each renderer receives every command of the control port, every request of the stream
and every form of request of the image port, with all sensors and all effects.

Before the first frame a server loads what its files name, and no module more.
"""

from __future__ import annotations

import json
import socket
import struct
from pathlib import Path

import aiohttp
import pytest

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.replies import Error
from catoptra_protocol.stream.requests import (
    REQUESTS,
    DriveRequest,
    FrameVariant,
    GetPixelRequest,
    GetStateRequest,
    ImageEncoding,
    SpawnRequest,
)
from catoptra_protocol.usarsim.commands import COMMAND_PARSERS
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.effects import EFFECT_TYPES
from helpers.configs import OMNI_ROBOT, ROBOTS, Edit, write_edited_copy
from helpers.control_lines import connect_control_lines
from helpers.live_page import PageClient, read_page_link
from helpers.loopback import run_scenario
from helpers.opengl import device_or_skip
from helpers.server_process import DEADLINE_S, RunningServer, start_server

CLASS = "USARBot.OmniP2AT"
OMNI = "OmniCamPillar_Link4"
# Python, NumPy, asyncio and Pillow have two thirds of them, threads that decode textures five.
MAX_MODULES = 450
COMMANDS = {
    "INIT": ["INIT {ClassName NoSuchClass}", f"INIT {{ClassName {CLASS}}} {{Start Centre}}"],
    "DRIVE": ["DRIVE {Left 1.0} {Right 1.0}", "DRIVE {Name CameraPan} {Order 0} {Value 0.5}"],
    "MULTIDRIVE": ["MULTIDRIVE {CameraPan 0,0.1} {CameraTilt 0,0.1}"],
    "MISPKG": ["MISPKG {Name CameraPanTilt} {Link 1} {Order 0} {Value 0.2}"],
    "ACT": ["ACT {Name CameraPanTilt} {Link 1} {Order 0} {Value 0.3}"],
    "SET": [
        "SET {Type Odometry} {Name Odometry} {Opcode RESET}",
        "SET {Type INS} {Name INS} {Opcode POSE} {Params 1,2,0,0,0,0}",
        "SET {Type RangeScanner} {Name Scanner1} {Opcode SCAN}",
        "SET {Type RFID} {Name RFID} {Opcode Read} {Params 1}",
        "SET {Type Camera} {Name OmniCamPillar_Link4} {Opcode MaxError} {Params 1.0}",
        "SET {Type Camera} {Name Camera} {Opcode FOV} {Params 0.5}",
        "SET {Type Camera} {Robot R} {Client 127.0.0.1}",
        "SET {Type Viewports} {Config SingleView} {Viewport1 OmniCamPillar_Link4}",
    ],
    "STEPPER": ["STEPPER"],
    "TRACE": ["TRACE {On true} {Interval 0.1} {Color Red}"],
    "GETCONF": ["GETCONF {Type Camera}", "GETCONF {Type Robot}", "GETCONF {Type RangeScanner}"],
    "GETGEO": ["GETGEO {Type Robot}", "GETGEO {Type RangeScanner}", "GETGEO {Type Camera}"],
    "GETSTARTPOSES": ["GETSTARTPOSES"],
    "NOTE": ["NOTE {Name n} {Data eyJ0ZXh0IjoieCJ9}", "NOTE {Name n} {Data ?}"],
    "SHARE": ["SHARE {Control True}"],
    "STEP": ["STEP {Time 0.5}"],
}
# Those that `call_all_requests` sends.
STREAM_REQUESTS = {
    *("get_frame", "spawn", "drive", "step", "reset", "get_readings", "get_camera", "get_parts"),
    *("get_landmarks", "get_start_poses", "get_status", "set_accuracy"),
    *("get_state", "get_setup", "get_pixel", "publish", "share_control"),
}


PAGE_ADDRESSES = (
    *("/", "/static/main.js", "/api/server.json", "/missing"),
    f"/api/floor_plan.json?class={CLASS}",
    f"/api/camera_table.json?class={CLASS}&camera={OMNI}",
)


def write_robots(folder: Path) -> dict[str, Path]:
    """Write robots with all effects always on: one with all sensors, one without any rays."""
    effects = "\n".join(f"{name}=always" for name in EFFECT_TYPES)
    plain = write_edited_copy(
        OMNI_ROBOT,
        folder,
        Edit("ResolutionX=360", "ResolutionX=64"),
        Edit("ResolutionY=360", "ResolutionY=64"),
        Edit("Samples=2", f"Samples=2\n{effects}"),
    )
    return {"full": write_edited_copy(ROBOTS / "p2at_omni_full.ini", folder), "plain": plain}


def send_all_commands(server: RunningServer) -> None:
    with connect_control_lines(server.control_port) as control:
        control.send("garbage", *(line for lines in COMMANDS.values() for line in lines))
        # The reply to the last command, STEP, follows those of all others.
        while "{Type Step}" not in control.read_line():
            pass


def request_all_images(server: RunningServer) -> None:
    with server.connect_images() as images:
        assert images.get_frame().rgb.any()
    with socket.create_connection(("127.0.0.1", server.image_port), DEADLINE_S) as viewer:
        viewer.sendall(b"U" + struct.pack(">4I", 1, 1, 10, 10))
        assert viewer.recv(1)


def call_all_requests(client: StreamClient, cameras: tuple[str, ...]) -> None:
    client.get_status()
    assert client.get_landmarks()
    assert client.get_start_poses()
    with pytest.raises(CatoptraError):
        client.spawn("NoSuchClass", start_pose="Centre")
    client.spawn(CLASS, name="R", start_pose="Centre")
    client.drive(2.0, 1.0)
    client.step(0.4)
    client.get_readings()
    client.get_camera()
    client.get_landmark_projections()
    client.publish("n", {"pose": [0.0, 0.0, 0.0], "text": "x"})
    client.share_control()
    client.get_state("R", commands_after=0, ticks_after=0.0)
    client.get_setup()
    client.get_pixel(30.0, 30.0, robot="R", camera=OMNI)
    client.get_frame(robot="R", camera=OMNI, variant=FrameVariant(polygons=16, reference="exact"))
    client.get_frame(robot="R", camera=OMNI, channels=("range",))
    for camera in cameras:
        client.get_landmark_projections("R", camera)
        for encoding in ImageEncoding:
            client.get_frame(encoding=encoding, robot="R", camera=camera)
    for max_error_px, budget_ms in ((None, None), (0.5, None), (0.0, 5.0)):
        client.set_accuracy(max_error_px=max_error_px, budget_ms=budget_ms)
        client.get_frame(robot="R", camera=OMNI)
    client.reset()


@pytest.mark.parametrize(
    ("renderer", "robot", "image_type"),
    [("trace", "full", "RAW"), ("raster", "plain", "GOOD"), ("auto", "full", "BAD")],
)
def test_server_that_serves_the_stream_loads_no_further_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, renderer: str, robot: str, image_type: str
) -> None:
    if renderer == "raster":
        device_or_skip().close()
    assert {*COMMANDS} == {*COMMAND_PARSERS}
    assert STREAM_REQUESTS == {*REQUESTS}
    assert image_type in ImageType.__members__
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    report = tmp_path / "modules.json"
    arguments = ("--clock", "lockstep", "--renderer", renderer, "--image-type", image_type)
    path = write_robots(tmp_path)[robot]
    with start_server(tmp_path, *arguments, robot=path, report_modules=report) as server:
        with server.connect_stream() as client:
            # Its reply follows the last deferred module.
            client.get_status()
            call_all_requests(client, ("Camera", OMNI) if robot == "full" else (OMNI,))
        with connect_control_lines(server.control_port) as control:
            control.send(f"INIT {{ClassName {CLASS}}} {{Start Centre}}", "STEP {Time 0.1}")
            control.read_until("RES")
            request_all_images(server)
        send_all_commands(server)
        assert server.terminate() == 0
        assert "Traceback" not in server.log.read_text()
    assert json.loads(report.read_text()) == []


async def use_page(link: str) -> None:
    async with aiohttp.ClientSession() as http:
        for path in PAGE_ADDRESSES:
            async with http.get(f"{link}{path}") as response:
                assert response.status == (404 if path == "/missing" else 200)
        async with http.ws_connect(f"{link}/socket", origin=link) as websocket:
            page = PageClient(websocket)
            for malformed in ("", "{}", '{"kind": "fly", "id": 3}'):
                await websocket.send_str(malformed)
                assert isinstance((await page.receive())[0], Error)
            await page.request(SpawnRequest(1, CLASS, "R", None, "Centre"))
            await page.request(DriveRequest(2, 1.0, 1.0, False))
            await page.request(GetStateRequest(3, ""))
            await page.request(GetPixelRequest(4, "R", OMNI, 30.0, 30.0))
            for encoding in ImageEncoding:
                await page.get_frame(encoding)
            await websocket.send_str("x" * 20000)
            assert (await websocket.receive()).type is aiohttp.WSMsgType.CLOSE


def test_server_that_serves_the_page_loads_no_further_module(tmp_path: Path) -> None:
    report = tmp_path / "modules.json"
    path = write_robots(tmp_path)["full"]
    options = ("--view", "0", "--renderer", "trace")
    with start_server(tmp_path, *options, robot=path, report_modules=report) as server:
        link = read_page_link(server)
        with server.connect_stream() as client:
            client.get_status()
        run_scenario(use_page(link))
        assert server.terminate() == 0
        assert "Traceback" not in server.log.read_text()
    assert json.loads(report.read_text()) == []


def test_first_frame_of_the_field_loads_what_its_files_name(tmp_path: Path) -> None:
    report = tmp_path / "modules.json"
    with start_server(
        tmp_path, "--image-type", "RAW", robot=OMNI_ROBOT, report_first_frame=report
    ) as server:
        with server.connect_robot() as robot, server.connect_images() as images:
            robot.spawn(CLASS, start_pose="Centre")
            assert images.get_frame().rgb.any()
        # Its first client ends the wait for the first frame.
        with server.connect_stream() as client:
            client.get_status()
        loaded = set(json.loads(report.read_text()))
    unnamed = (
        *("catoptra_protocol.calibration", "catoptra_protocol.optics.lenses.equidistant"),
        *("catoptra_protocol.optics.mirrors.conical", "catoptra_server.effects.sensor"),
        *("catoptra_server.effects.scene.fog", "catoptra_server.simulation.sensors.sonar"),
        *("catoptra_server.render.raster", "catoptra_server.serve.stream", "zmq", "cv2"),
        *("catoptra_server.serve.web", "aiohttp"),
    )
    assert [name for name in unnamed if name in loaded] == []
    assert len(loaded) <= MAX_MODULES
