"""One message of each kind of the ZeroMQ stream."""

from __future__ import annotations

import dataclasses

from catoptra_protocol.stream.messages import SCHEMA_VERSION
from catoptra_protocol.stream.replies import (
    CameraReply,
    CommandRecord,
    DifferenceRecord,
    EffectRecord,
    Error,
    FrameHeader,
    Heartbeat,
    LandmarkRecord,
    LandmarksReply,
    NoteRecord,
    Ok,
    PixelReply,
    PlanAlternative,
    PlanReply,
    Reply,
    RobotState,
    SensorReports,
    SetupReply,
    StartPoseRecord,
    StartPosesReply,
    StateReply,
    StatusReply,
    TickRecord,
)
from catoptra_protocol.stream.requests import (
    DriveRequest,
    FrameVariant,
    GetCameraRequest,
    GetFrameRequest,
    GetLandmarksRequest,
    GetPartsRequest,
    GetPixelRequest,
    GetReadingsRequest,
    GetSetupRequest,
    GetStartPosesRequest,
    GetStateRequest,
    GetStatusRequest,
    ImageEncoding,
    PublishRequest,
    Request,
    ResetRequest,
    SetAccuracyRequest,
    ShareControlRequest,
    SpawnRequest,
    StepRequest,
    Transform,
)

UPRIGHT_TRANSFORM = Transform((0.1, 0.0, -0.5), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
CAMERA_MODEL = {"Mirror": "parabolic", "MirrorHorizonRadius": "0.03", "Width": "6", "Height": "4"}
HEADER = FrameHeader(
    version=SCHEMA_VERSION,
    id=7,
    robot="Mine",
    class_name="USARBot.OmniP2AT",
    camera="Omni",
    sequence=42,
    time_s=1.25,
    world_from_robot=UPRIGHT_TRANSFORM,
    robot_from_mirror=UPRIGHT_TRANSFORM,
    camera_model=CAMERA_MODEL,
    plan="trace",
    error_bound_px=None,
    stage_ms={"trace": 12.5},
    encoding=ImageEncoding.RAW,
    width_px=6,
    height_px=4,
    age_s=0.03,
    missed_frames=2,
    dropped_frames=0,
    effects=(EffectRecord("ShotNoise", True, 9.4, 0.5, "few electrons", 2.5),),
    predicted_ms=11.5,
    target_met=False,
    more_accurate=PlanAlternative("trace, 4x4", 0.25, 30.0),
    faster=PlanAlternative("trace, 1x1", 0.5, 8.0),
)
HEADER_WITH_DIFFERENCE = dataclasses.replace(
    HEADER, difference=DifferenceRecord("exact, 4x4", 12, 0.75, 0.125)
)
LANDMARK = LandmarkRecord("a", "beacon", 1.0, 2.0, 0.1, 0.0, 0.2, 0.4, "cyan", "yellow")
ROBOT_STATE = RobotState(
    *(
        "Mine",
        "USARBot.OmniP2AT",
        UPRIGHT_TRANSFORM,
        UPRIGHT_TRANSFORM,
        (1.5, -1.5),
        True,
        0.13,
        0.47,
    )
)

SAMPLE_REQUESTS: list[Request] = [
    GetFrameRequest(
        *(1, "OmniP2AT", "", ImageEncoding.PNG),
        FrameVariant(
            *(0.5, 40.0, 256, 2, "trace", {"ShotNoise": "never"}),
            reference="exact",
            picture="flipped",
            world_from_robot=UPRIGHT_TRANSFORM,
        ),
    ),
    SpawnRequest(2, "USARBot.OmniP2AT", None, (1.0, 2.0, 3.0), None, (0.0, 0.0, 0.5)),
    DriveRequest(3, 1.0, None, True, "Shared"),
    StepRequest(4, 0.2),
    ResetRequest(5),
    GetReadingsRequest(6),
    GetCameraRequest(7, "Omni"),
    GetPartsRequest(17, "USARBot.P2AT"),
    GetLandmarksRequest(8),
    GetStartPosesRequest(9),
    GetStatusRequest(10),
    SetAccuracyRequest(11, "", 0.5, None),
    GetStateRequest(12, "Mine", 3),
    GetSetupRequest(16),
    GetPixelRequest(13, "Mine", "Omni", 320.5, 240.5),
    PublishRequest(14, "ekf", '{"pose":[1.0,2.0,0.5]}'),
    ShareControlRequest(15, True),
]
SAMPLE_REPLIES: list[Reply] = [
    HEADER_WITH_DIFFERENCE,
    Ok(1),
    Error(2, "no robot"),
    SensorReports(3, ("SEN {Time 1.0}",), (1.0, 2.0, 0.0), "Mine"),
    CameraReply(4, "USARBot.OmniP2AT", "Omni", CAMERA_MODEL, UPRIGHT_TRANSFORM, None),
    LandmarksReply(5, (LANDMARK,)),
    StartPosesReply(6, (StartPoseRecord("Centre", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),)),
    StatusReply(1, 7, "Catoptra 0.1.0", "field", ("USARBot.OmniP2AT",), "lockstep", 1, False, 0),
    Heartbeat(SCHEMA_VERSION),
    PlanReply(
        *(8, "Omni", 0.5, 0.0, "trace, 2^2 samples: the fastest within 0.5 px", True),
        *(0.375, {"outline_px": 0.375}, 12.5, None, PlanAlternative("trace", 0.25, 30.0), None),
    ),
    StateReply(
        *(9, 1.25, (ROBOT_STATE,), "Mine", ("SEN {Time 1.0}",)),
        (NoteRecord("ekf", 1.0, '{"pose":[1.0,2.0,0.5]}'),),
        (CommandRecord(4, 1.125, "DRIVE {Left 1.5}"),),
        (TickRecord(1.25, ROBOT_STATE.world_from_robot, (0.5, -0.5), ("SEN {Time 1.0}",)),),
    ),
    SetupReply(11, {"a.ini": "[A]"}, {"a.ini": "5e88", "b.glb": "9f86"}, {"seed": "3"}),
    PixelReply(10, 1.25, 1.5, -0.5, None, "", 0.375),
]
