"""One message of each kind of the modern stream."""

from __future__ import annotations

from catoptra_protocol.wire.stream import SCHEMA_VERSION
from catoptra_protocol.wire.stream_answers import (
    Answer,
    CameraIs,
    Done,
    EffectRecord,
    FrameHeader,
    LandmarkRecord,
    LandmarksAre,
    Placement,
    PlanIs,
    PlanStep,
    Pulse,
    Refused,
    Reported,
    StartRecord,
    StartsAre,
    StatusIs,
)
from catoptra_protocol.wire.stream_requests import (
    AskCamera,
    AskDrive,
    AskFrame,
    AskLandmarks,
    AskPlan,
    AskReadings,
    AskReset,
    AskSpawn,
    AskStarts,
    AskStatus,
    AskStep,
    Encoding,
    Request,
)

UPRIGHT = Placement((0.1, 0.0, -0.5), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
LAW = {"Mirror": "parabolic", "MirrorHorizonRadius": "0.03", "Width": "6", "Height": "4"}
HEADER = FrameHeader(
    version=SCHEMA_VERSION,
    id=7,
    robot="Mine",
    class_name="USARBot.OmniP2AT",
    camera="Omni",
    sequence=42,
    time_s=1.25,
    world_from_robot=UPRIGHT,
    robot_from_mirror=UPRIGHT,
    camera_law=LAW,
    plan="trace",
    error_bound_px=None,
    stage_ms={"trace": 12.5},
    encoding=Encoding.RAW,
    width_px=6,
    height_px=4,
    age_s=0.03,
    missed=2,
    dropped=0,
    effects=(EffectRecord("ShotNoise", True, 9.4, 0.5, "grey levels", "few electrons", 2.5),),
)
LANDMARK = LandmarkRecord("a", "beacon", 1.0, 2.0, 0.1, 0.0, 0.2, 0.4, "cyan", "yellow")

SAMPLE_REQUESTS: list[Request] = [
    AskFrame(1, "OmniP2AT", "", Encoding.PNG),
    AskSpawn(2, "USARBot.OmniP2AT", None, (1.0, 2.0, 3.0), (0.0, 0.0, 0.5), None),
    AskDrive(3, 1.0, None, True),
    AskStep(4, 0.2),
    AskReset(5),
    AskReadings(6),
    AskCamera(7, "Omni"),
    AskLandmarks(8),
    AskStarts(9),
    AskStatus(10),
    AskPlan(11, "", 0.5, None),
]
SAMPLE_ANSWERS: list[Answer] = [
    HEADER,
    Done(1),
    Refused(2, "no robot"),
    Reported(3, ("SEN {Time 1.0}",)),
    CameraIs(4, "USARBot.OmniP2AT", "Omni", LAW, UPRIGHT, None),
    LandmarksAre(5, (LANDMARK,)),
    StartsAre(6, (StartRecord("Centre", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),)),
    StatusIs(1, 7, "Catoptra 0.1.0", "field", ("USARBot.OmniP2AT",), "lockstep", 1, False, 0),
    Pulse(SCHEMA_VERSION),
    PlanIs(
        *(8, "Omni", 0.5, 0.0, "trace, 2^2 samples: the cheapest within 0.5 px", True),
        *(0.375, {"outline_px": 0.375}, 12.5, None, PlanStep("trace", 0.25, 30.0), None),
    ),
]
