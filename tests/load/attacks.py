"""Table of all attacks, with the server that each one is shown on alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from load import control_attacks, image_attacks, stream_attacks
from load.attack_tools import AttackedPorts


@dataclass(frozen=True, slots=True)
class Attack:
    """One attack."""

    run: Callable[[AttackedPorts], None]
    """Attacks until the server ends the connection, or for ever."""
    robot: str = "p2at_omni"
    """Robot file of the server that the attack is shown on alone."""
    arguments: tuple[str, ...] = ()
    """Further arguments of that server."""
    is_planned: bool = False
    """Whether the first request has the server plan, for seconds in which it draws nothing."""
    max_descriptors: int = 0
    """Limit of that server's descriptors; 0: the limit of this process."""


# The class P2AT has the range scanner of flood_scans.
SOAK_ARGUMENTS = ("--robot", "p2at")
_ATTACKS = (
    Attack(control_attacks.flood_scans, arguments=SOAK_ARGUMENTS),
    Attack(control_attacks.flood_failed_scans),
    Attack(control_attacks.flood_drives),
    Attack(control_attacks.flood_multidrives),
    Attack(control_attacks.flood_steps, arguments=("--clock", "lockstep")),
    Attack(control_attacks.churn_spawns),
    Attack(control_attacks.stack_robots),
    Attack(control_attacks.spawn_far_away, robot="p2at_omni_real"),
    Attack(control_attacks.query_unread),
    Attack(control_attacks.send_malformed_lines),
    Attack(control_attacks.send_unterminated_lines),
    Attack(control_attacks.close_halfway),
    Attack(image_attacks.idle_on_images, max_descriptors=300),
    Attack(image_attacks.hold_half_requests),
    Attack(image_attacks.request_unread_frames),
    Attack(image_attacks.leave_while_waiting),
    Attack(image_attacks.storm_connections),
    Attack(image_attacks.send_garbage),
    Attack(image_attacks.post_as_a_page),
    Attack(stream_attacks.flood_landmark_requests),
    Attack(stream_attacks.flood_plan_requests),
    Attack(stream_attacks.change_max_error),
    Attack(stream_attacks.request_unknown_cameras),
    Attack(stream_attacks.spell_one_camera),
    Attack(stream_attacks.request_expensive_labels, is_planned=True),
    Attack(stream_attacks.hold_variants_unread, is_planned=True),
    Attack(stream_attacks.request_in_bursts),
    Attack(stream_attacks.request_unread_stream_frames),
    Attack(stream_attacks.reuse_identity),
    Attack(stream_attacks.hold_unterminated_message),
)
ATTACKS = {attack.run.__name__: attack for attack in _ATTACKS}
# Under lockstep all work is done in the order of arrival, so that equal commands give equal bytes:
# only the floods of steps can be held back there without a change of the result.
LOCKSTEP_ATTACKS = (control_attacks.flood_steps.__name__,)
