"""Fuzz targets of cameras: calibration files of all formats, ray tables, camera files, CONF.

A calibration file comes from another program, a CONF line from a server: every fault is an error of
ours that names the field, never one of NumPy or of the standard library, and a camera that is
accepted computes a direction for a pixel.
"""

from __future__ import annotations

import atexit
import io
import math
import random
import re
import tempfile
import time
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.formats import FORMATS, OCAM_4, PINHOLE, find_format
from catoptra_protocol.calibration.model_fits import fit_ocam
from catoptra_protocol.calibration.ray_table import bytes_from_ray_table, make_ray_table
from catoptra_protocol.calibration.templates import fields_for_readers
from catoptra_protocol.camera_conf import (
    any_camera_from_pairs,
    pairs_from_omni_camera,
    pairs_from_perspective_camera,
)
from catoptra_protocol.errors import CatoptraError, ConfigError, RemoteProtocolError
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.usarsim.grammar import Pairs, parse_message
from catoptra_server.config.camera_file import (
    CameraFile,
    carry_camera,
    read_camera_file,
    read_camera_files,
)
from conformance.fuzz_target import FeedInput, FuzzTarget, check, mutate
from helpers.configs import CAMERAS

# A fit of a polynomial takes milliseconds, a ray table five, a camera's robot ten.
_FILE_PERIOD, _CAMERA_PERIOD, _TABLE_PERIOD = 40, 80, 100
# Of processor time; 0.05 s was the most of half a million files.
_MAX_FILE_S = 5.0
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
# Finite ones at the ends of what a double can be, and what is no number.
_ODD_NUMBERS = (
    *(b"0", b"-0.0", b"1", b"-1", b"0.5", b"2", b"1e-320", b"1e308", b"-1e308", b"1e155", b"1e-9"),
    *(b"nan", b"inf", b"-inf", b"9" * 400, b"1e999", b"null", b"true", b"[]", b"{}", b'""', b"~"),
    *(b"179.999", b"360", b"4096", b"65536", b"-90", b"0x10", b"1_0", b"[1,[2]]"),
)

# Sections of the lenses and mirrors that no bundled camera has, in files as below.
_FURTHER_SECTIONS = {
    "Enhanced": "Lens=enhanced_unified\nAlpha=0.6\nBeta=1.1\nFieldOfView=180",
    "FTheta": "Lens=f_theta\nK1=1.0\nK2=-0.02\nFieldOfView=180",
    "LensTable": "Lens=radial_table\nAngles=0,30,60,90\nRadii=0,0.5,1,1.4\nFieldOfView=170",
    "ProfileMirror": "Radii=0,10,20,30,40\nSags=5.0,5.8,8.2,12.2,17.8\nVertexDistance=200\n"
    "MetresPerUnit=0.001\nRimAngle=70",
    "RadialTableMirror": "Angles=0,30,60,90\nRadii=0,0.1,0.15,0.18\nVertexDistance=0.2\n"
    "RimAngle=90",
}
_XML = b"""<?xml version="1.0"?>
<opencv_storage><camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>102.9 0. 179.5 0. 102.9 179.5 0. 0. 1.</data></camera_matrix><xi>0.995</xi>
<distortion_coefficients type_id="opencv-matrix"><rows>1</rows><cols>4</cols><dt>d</dt>
<data>0.01 0.001 1e-4 -1e-4</data></distortion_coefficients></opencv_storage>
"""
_CAMERA_FILE = """[Camera]
ItemClass=Catoptra.{0}
Title="Title"
Source="Source"
Licence="Licence"
[Catoptra.{0}]
{1}
"""


def calibration_targets() -> list[FuzzTarget]:
    """The parsers."""
    folder = tempfile.TemporaryDirectory(prefix="fuzz")
    atexit.register(folder.cleanup)
    scratch = Path(folder.name)
    for name, lines in _FURTHER_SECTIONS.items():
        (scratch / f"{name}.ini").write_text(_CAMERA_FILE.format(name, lines))
    paths = sorted((*CAMERAS.glob("*.ini"), *scratch.glob("*.ini")))
    files = read_camera_files([str(path) for path in paths])
    cameras = {one.name: _read_camera(one, scratch) for one in files}
    texts = tuple(one.path.read_bytes() for one in files)
    table = bytes_from_ray_table(make_ray_table(cameras["equidistant_185"]), law="fuzz")
    feed_file = _make_file_feeder(scratch / "fuzzed")
    return [
        *(
            FuzzTarget(name, feed_file, seeds, mutate_numbers, _FILE_PERIOD)
            for name, seeds in _calibration_seeds(cameras).items()
        ),
        FuzzTarget(
            "camera file", _make_camera_feeder(scratch), texts, mutate_numbers, _CAMERA_PERIOD
        ),
        FuzzTarget("ray table", feed_file, (table,), mutate_table, _TABLE_PERIOD),
        _mask_target(scratch, cameras["stereographic_220"]),
        FuzzTarget("CONF of a camera", _feed_conf, _conf_seeds(cameras), mutate_numbers, 3),
    ]


def mutate_numbers(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """A text with one or two of its numbers replaced; one in four with other changes."""
    if rng.random() < 0.25:
        return mutate(rng, seeds)
    data = rng.choice(seeds)
    for _ in range(rng.randrange(1, 3)):
        found = rng.choice([*_NUMBER.finditer(data)] or [None])
        if found is not None:
            data = data[: found.start()] + rng.choice(_ODD_NUMBERS) + data[found.end() :]
    return data


def mutate_mask(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Picture with a rectangle of another value; one in four with other changes."""
    if rng.random() < 0.25:
        return mutate(rng, seeds)
    picture = cv2.imdecode(np.frombuffer(rng.choice(seeds), np.uint8), cv2.IMREAD_GRAYSCALE)
    top, left, height, width = (rng.randrange(1, len(picture)) for _ in range(4))
    picture[top : top + height, left : left + width] = rng.randrange(256)
    return cv2.imencode(".png", picture)[1].tobytes()


def mutate_table(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Ray table of which one array is missing or changed, its checksum right; or other changes."""
    if rng.random() < 0.25:
        return mutate(rng, seeds)
    with zipfile.ZipFile(io.BytesIO(rng.choice(seeds))) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    changed = rng.choice([*members])
    data = members.pop(changed)
    if rng.random() < 0.75:
        # Mostly the header: its length is 128 bytes.
        kept = rng.choice((128, len(data)))
        members[changed] = mutate(rng, [data[:kept]]) + data[kept:]
    table = io.BytesIO()
    with zipfile.ZipFile(table, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return table.getvalue()


def _read_camera(file: CameraFile, folder: Path) -> OmniCamera:
    return carry_camera(file, folder / "robot.ini", size_px=64).camera


def _calibration_seeds(cameras: dict[str, OmniCamera]) -> dict[str, tuple[bytes, ...]]:
    """Files of each program: of a mirror and of a lens, however well the model fits."""
    described = [
        replace(cameras[name], picture=Picture.FLIPPED) for name in ("paper", "stereographic_220")
    ]
    seeds: dict[str, list[bytes]] = {}
    for each in FORMATS:
        # A flat image has a narrow part, OCam's inverse of few terms no more than a mirror's.
        rim_rad = 1.0 if each.model in (PINHOLE, OCAM_4) else math.pi
        for camera in described:
            narrowed = replace(camera, rim_rad=min(camera.rim_rad, rim_rad))
            # Without what is for the programs alone, half of the text.
            read = replace(each, template=fields_for_readers(each.template))
            text = read.write(read.simplify(read.model.fit(narrowed)), "cam0")
            seeds.setdefault(each.program, []).append(text.encode())
    seeds["cv2.omnidir"].append(_XML)
    return {name: tuple(texts) for name, texts in seeds.items()}


def _conf_seeds(cameras: dict[str, OmniCamera]) -> tuple[bytes, ...]:
    """A CONF line of every camera, and of an ordinary one."""
    described: list[Pairs] = [pairs_from_omni_camera(one, 1.0) for one in cameras.values()]
    described.append(pairs_from_perspective_camera(PerspectiveCamera(64, 48, 1.0)))
    return tuple(
        ("CONF {Type Camera}" + "".join(f" {{{name} {value}}}" for name, value in pairs)).encode()
        for pairs in described
    )


def _make_file_feeder(file: Path) -> FeedInput:
    def feed(data: bytes) -> bool:
        file.write_bytes(data)
        begin_s = time.process_time()
        accepted = _look_through(lambda: camera_from_file(file, size_px=(64, 48)), ConfigError)
        check(time.process_time() - begin_s < _MAX_FILE_S, "a file takes seconds")
        return accepted

    return feed


def _mask_target(folder: Path, camera: OmniCamera) -> FuzzTarget:
    """Pictures as the mask of a camera of SVO."""
    shown = np.hypot(*(np.indices((64, 64)) - 31.5)) < 25.0
    seed = cv2.imencode(".png", shown.astype(np.uint8))[1].tobytes()
    file, model = folder / "masked.yaml", fit_ocam(camera, degree=4)
    text = find_format("svo_omni").write(model, "cam0")
    file.write_text(re.sub("( *)line-delay", r"\1mask: masked.png\n\1line-delay", text))

    def feed(data: bytes) -> bool:
        file.with_suffix(".png").write_bytes(data)
        return _look_through(lambda: camera_from_file(file), ConfigError)

    assert feed(seed)
    return FuzzTarget("mask of a camera", feed, (seed,), mutate_mask, _TABLE_PERIOD)


def _make_camera_feeder(folder: Path) -> FeedInput:
    file = folder / "camera.ini"

    def feed(data: bytes) -> bool:
        file.write_bytes(data)
        return _look_through(lambda: _read_camera(read_camera_file(file), folder), CatoptraError)

    return feed


def _feed_conf(data: bytes) -> bool:
    pairs = parse_message(data.decode("latin-1")).pairs
    return _look_through(lambda: any_camera_from_pairs(pairs), RemoteProtocolError)


def _look_through(make: Callable[[], object], error: type[Exception]) -> bool:
    """Whether a camera is accepted; then two of its pixels have directions, or none."""
    try:
        camera = make()
    except error:
        return False
    # Of a strange camera a pixel may have no direction, but no exception.
    if isinstance(camera, OmniCamera):
        with np.errstate(all="ignore"):
            direction_from_pixel(camera, np.array([camera.centre_px, (0.5, 0.5)]))
    return True
