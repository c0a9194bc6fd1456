"""Further mutations of the control port: signs, axes, units and rates of other sensors."""

from __future__ import annotations

import re

from conformance.line_mutations import (
    Connect,
    drop,
    freeze,
    of_commands,
    of_replies,
    of_replies_with_state,
    scale,
    substitute,
    where,
)
from conformance.mutation import Mutation

_ODOMETRY = r"SEN .*\{Type Odometry\}"
_TRUTH = r"SEN .*\{Type GroundTruth\}"
_SONAR = r"SEN .*\{Type Sonar\}"


def _swap_axes(line: str) -> str:
    return re.sub(r"\{Location ([^,]*),([^,]*),", r"{Location \2,\1,", line)


def _multiply_time(line: str) -> str:
    return re.sub(r"(?<=\{Time )[\d.]+", lambda found: f"{10.0 * float(found[0]):.4f}", line)


def _swap_encoders(line: str) -> str:
    names = {"ECLeft": "ECRight", "ECRight": "ECLeft"}
    return re.sub("ECLeft|ECRight", lambda found: names[found[0]], line)


def _mutation(name: str, connect: Connect, *noticed_by: str) -> Mutation:
    return Mutation(name, "control", connect, noticed_by)


FURTHER_CONTROL_MUTATIONS: tuple[Mutation, ...] = (
    _mutation(
        "odometry x's sign",
        of_replies(where(_ODOMETRY, scale("Pose", (-1.0, 1.0, 1.0)))),
        "drive_forward",
    ),
    _mutation(
        "odometry in millimetres",
        of_replies(where(_ODOMETRY, scale("Pose", (1000.0, 1000.0, 1.0)))),
        "drive_forward",
    ),
    _mutation(
        "GroundTruth yaw's sign",
        of_replies(where(_TRUTH, scale("Orientation", (1.0, 1.0, -1.0)))),
        "drive_pivot",
    ),
    _mutation(
        "GroundTruth x and y swapped", of_replies(where(_TRUTH, _swap_axes)), "drive_forward"
    ),
    _mutation(
        "INS frozen",
        of_replies_with_state(freeze(r"(?<=\{Name INS\} )\{Location .*")),
        "drive_curve",
    ),
    _mutation("scan frozen", of_replies_with_state(freeze(r"\{Range \d[^}]*\}")), "scan_distance"),
    _mutation(
        "scan Resolution in degrees",
        of_replies(where("SEN", scale("Resolution", (57.2958,)))),
        "scan_geometry",
    ),
    _mutation(
        "sonars in centimetres",
        of_replies(where(_SONAR, substitute(r"Range (\d+)\.(\d\d)(\d\d)", r"Range \1\2.\3"))),
        "sonar_ranges",
    ),
    _mutation(
        "encoders frozen",
        of_replies_with_state(freeze(r"(?<=\{Type Encoder\} ).*")),
        "drive_forward",
    ),
    _mutation(
        "encoders swapped",
        of_replies(where(r"SEN .*\{Type Encoder\}", _swap_encoders)),
        "drive_curve",
    ),
    _mutation(
        "WheelRadius in centimetres", of_replies(scale("WheelRadius", (100.0,))), "drive_forward"
    ),
    _mutation(
        "Location of INIT ignored",
        of_commands(where("INIT.*Rotation", scale("Location", (0.0,)))),
        "spawn_pose",
    ),
    _mutation(
        "standing ignored", of_commands(where(r"DRIVE \{Left 0\} \{Right 0\}", drop)), "drive_stop"
    ),
    _mutation("Time ten times faster", of_replies(_multiply_time), "clock"),
)
