"""One view with and without the degradations of a real camera: the paper's Figure 11.

The paper shows a recorded image beside a simulated one. No recorded image exists here: the robot
p2at_omni_real, which simulates what the paper says that real cameras suffer from, stands for it.
"""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_process import can_start_server, run_server
from catoptra_client.training_frames import ROBOT_CLASS
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.experiment.experiment_setups import SIM

_DEGRADED_ROBOT_FILE = "p2at_omni_real.ini"
# Metres and radians: beside the first corner of the simulated drive.
_START = (1.6, -1.2, 2.6)
# A turn to the left at about a radian a second, as an operator drives: it shows as motion blur.
_WHEEL_SPEEDS_RAD_S = (-2.5, 2.5)
_DURATION_S = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class FrameComparison:
    """Two frames of one view."""

    degraded_rgb: UInt8Array
    """(h, w, 3) frame with the effects of a real camera."""

    clean_rgb: UInt8Array
    """(h, w, 3) frame of the simulated set-up."""


def capture_frame_comparison(config: ExperimentConfig) -> FrameComparison | None:
    """Capture both frames from servers that are started here; None where none is installed."""
    if not can_start_server():
        return None
    return FrameComparison(
        degraded_rgb=_capture_turning(config, _DEGRADED_ROBOT_FILE),
        clean_rgb=_capture_turning(config, SIM.robot_file),
    )


def _capture_turning(config: ExperimentConfig, robot_file: str) -> UInt8Array:
    """Frame of a robot that turns on the spot."""
    x_m, y_m, yaw_rad = _START
    with (
        run_server(
            config.robot_file(robot_file),
            config.field_world_file,
            seed=config.seed,
            log_file=config.output_folder / "server_frames.log",
            extra_arguments=config.server_arguments,
        ) as address,
        RobotClient.connect(address.host, address.control_port) as robot,
        # The first frame with all effects takes a second, and many on a busy machine.
        ImageClient.connect(address.host, address.image_port, config.timeout_s) as images,
    ):
        robot.spawn(
            ROBOT_CLASS, name="Run0", location_m=(x_m, y_m, 0.0), rotation_rad=(0.0, 0.0, yaw_rad)
        )
        robot.drive(*_WHEEL_SPEEDS_RAD_S)
        robot.step(_DURATION_S)
        return images.get_frame().rgb
