"""What is put into a scene, or taken account of, because a camera's effects ask for it."""

from __future__ import annotations

from dataclasses import replace

from catoptra_server.effects.capture import Capture
from catoptra_server.effects.effect import Criterion
from catoptra_server.render.renderer import Exposure
from catoptra_server.scene.bodies import Body
from catoptra_server.scene.motion import AT_REST, Twist


def staged(exposure: Exposure, effects: tuple[Criterion, ...]) -> Exposure:
    """Return the exposure of a scene that effects have changed."""
    names = {effect.name for effect in effects}
    if "OwnBody" in names and exposure.own_body is not None:
        exposure = replace(exposure, bodies=(*exposure.bodies, exposure.own_body))
    return replace(exposure, has_shadows=True) if "Shadows" in names else exposure


def captured(exposure: Exposure) -> Capture:
    """Return an exposure as effects know it, without its geometry."""
    motion = tuple(_seen(exposure, body) for body in (None, *exposure.bodies))
    return Capture(exposure.key, motion)


def scene_motion(exposure: Exposure) -> Twist:
    """Return the motion of the scene as the camera sees it: the first of what is captured.

    In plain numbers, which take a tenth of the time of arrays of three: it is asked every frame.
    """
    if exposure.twist is AT_REST:
        return AT_REST
    axes = exposure.world_from_mirror.rotation.T.tolist()
    linear, angular = (
        tuple(-(a * x + b * y + c * z) for a, b, c in axes)
        for x, y, z in (exposure.twist.linear_m_s, exposure.twist.angular_rad_s)
    )
    return Twist(linear, angular)


def _seen(exposure: Exposure, body: Body | None) -> Twist:
    """Return a body's motion as the camera sees it, or that of the scene."""
    mirror = exposure.world_from_mirror
    own = exposure.twist
    theirs = AT_REST
    if body is not None:
        theirs = body.twist.at(mirror.translation - body.world_from_body.translation)
    return theirs.minus(own).turned(mirror.rotation.T)
