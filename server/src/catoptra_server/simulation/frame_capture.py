"""Captures of the frames that clients request: each of an instant of its own, or not drawn again.

Composing a frame needs robots, which belong to the simulation thread. A composition holds until a
tick or a command changes something; until then any thread captures further frames from there, each
of the instant of its exposure: a renderer draws several frames in a tick of 20 ms,
and each wake-up of the simulation for one cost 0.3 ms of processor time.

In real time a request for what has been drawn waits until something changes, and gets the last
frame once more with the next tick, under a new number: viewers count on frames that keep coming.

Between two ticks: robots move in ticks of 20 ms. In real time each frame shows the world a tick
before its exposure, where the path is known: a robot's mean motion in the last tick, followed back
from the present pose, begins exactly at the pose before. So frames of one tick differ, and no robot
is shown where it has not been, such as in a wall. Joints move with the tick. Under lockstep frames
show the tick.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.kernels.grey_levels import FRAME_NOISE_EFFECTS
from catoptra_server.frames.frame import (
    Carrier,
    Channel,
    FrameComposition,
    FrameRequest,
    FrameRequested,
    ImagePortChannel,
    ViewRequest,
)
from catoptra_server.frames.mailbox import TICK_S, CaptureScheduler, ChannelState
from catoptra_server.runtime.faults import log_fault
from catoptra_server.simulation.events import FAULT_REASON
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.world_description import integrate_poses

log = logging.getLogger(__name__)


def rewind(composition: FrameComposition, lag_s: float) -> FrameComposition:
    """The composition some seconds earlier within the tick; the same object where nothing moves."""
    if not lag_s:
        return composition
    reference, metadata = composition.reference, composition.metadata
    views = [view for view in (*composition.views, reference) if view]
    # Each body once, in however many views, and all at once.
    objects = list({one for view in views for one in _list_objects(view.camera_state)})
    carriers = list({view.carrier for view in views if view.carrier})
    motions = [(one.world_from_object, one.twist) for one in objects]
    motions += [(one.world_from_robot, one.twist) for one in carriers]
    poses = integrate_poses(motions, -lag_s)
    if all(pose is before for pose, (before, _) in zip(poses, motions, strict=True)):
        return composition
    moved = dict(zip(objects, map(DynamicObject.with_pose, objects, poses), strict=True))
    carried = dict(zip(carriers, poses[len(objects) :], strict=True))
    rewind_view = partial(_rewind_view, objects=moved, carriers=carried)
    carrier = next((view.carrier for view in views), None)
    if metadata.robot and carrier is not None:
        metadata = replace(metadata, world_from_robot=carried[carrier])
    return replace(
        composition,
        views=tuple(view and rewind_view(view) for view in composition.views),
        reference=reference and rewind_view(reference),
        metadata=metadata,
    )


def show_same(first: FrameComposition, second: FrameComposition) -> bool:
    """Whether frames of two compositions of one channel are the same picture."""
    return (
        first.layout == second.layout
        and first.is_turned == second.is_turned
        and len(first.views) == len(second.views)
        and all(map(_views_show_same, first.views, second.views))
        and _views_show_same(first.reference, second.reference)
    )


def _list_objects(state: CameraState) -> tuple[DynamicObject, ...]:
    return (*state.objects, state.ego_body) if state.ego_body else state.objects


def _rewind_view(
    view: ViewRequest,
    objects: Mapping[DynamicObject, DynamicObject],
    carriers: Mapping[Carrier, Pose],
) -> ViewRequest:
    state, carrier = view.camera_state, view.carrier
    pose = state.world_from_mirror
    # With the robot: the camera's own twist is the tangent of its path.
    if carrier is not None and carriers[carrier] is not carrier.world_from_robot:
        pose = carriers[carrier] @ carrier.robot_from_camera
    state = replace(
        state,
        world_from_mirror=pose,
        objects=tuple(objects[one] for one in state.objects),
        ego_body=state.ego_body and objects[state.ego_body],
    )
    return replace(view, camera_state=state)


def _views_show_same(first: ViewRequest | None, second: ViewRequest | None) -> bool:
    if first is None or second is None:
        return first is second
    # The flow of labels leads to another frame each time.
    if first.camera != second.camera or first.label_channels or second.label_channels:
        return False
    one, other = first.camera_state, second.camera_state
    settings = first.camera.effect_settings.settings
    has_noise = any(setting.effect.name in FRAME_NOISE_EFFECTS for setting in settings)
    return (
        _are_equal(one.world_from_mirror, other.world_from_mirror)
        and one.twist == other.twist
        and (not has_noise or one.noise_seed == other.noise_seed)
        and len(one.objects) == len(other.objects)
        and all(map(_objects_show_same, one.objects, other.objects))
        and _objects_show_same(one.ego_body, other.ego_body)
    )


def _objects_show_same(one: DynamicObject | None, other: DynamicObject | None) -> bool:
    if one is None or other is None or one is other:
        return one is other
    return (
        one.mesh is other.mesh
        and one.number == other.number
        and one.twist == other.twist
        and _are_equal(one.world_from_object, other.world_from_object)
    )


def _are_equal(one: Pose, other: Pose) -> bool:
    return one is other or (
        np.array_equal(one.translation, other.translation)
        and np.array_equal(one.rotation, other.rotation)
    )


class FrameCapture:
    """Channels with their compositions. For the simulation thread, unless a method says more."""

    def __init__(
        self,
        compose: Callable[[Channel], FrameComposition | None],
        *,
        render: Callable[[FrameRequest], object],
        reject: Callable[[Channel, str], None],
        is_realtime: bool,
        image_port_interval_s: float = 0.0,
        monotonic: Callable[[], float],
    ) -> None:
        """Create no channel yet.

        Args:
            compose: Composes the frame of a channel; None without such a robot or camera.
            render: Receives frame requests.
            reject: Receives channels without a frame, and the reason; an empty one where robot
                or camera does not exist.
            is_realtime: Whether channels keep their intervals, frames have instants, and nothing
                is drawn twice; without, each request has a frame of the tick.
            image_port_interval_s: Shortest simulation time between two frames of the image port.
            monotonic: Wall clock.
        """
        self._compose = compose
        self._render = render
        self._reject = reject
        self._is_realtime = is_realtime
        self._image_port_interval_s = image_port_interval_s
        self._monotonic = monotonic
        # Guards all below; held for no call of a function above.
        self._lock = threading.Lock()
        self._scheduler = CaptureScheduler()
        self._time_s = 0.0
        self._ticked_at_s = -math.inf
        self._compositions: dict[Channel, FrameComposition | None] = {}
        # Channels captured in this tick, and in the one before.
        self._captured: set[Channel] = set()
        self._captured_before: set[Channel] = set()
        self._composed_ahead: set[Channel] = set()

    def capture_at_once(self, request: FrameRequested) -> bool:
        """Capture a requested frame from its present composition; from any thread.

        Returns:
            False if the simulation thread has to compose the frame, and nothing was recorded. True
            also where a frame in rendering will do, or the channel has to wait for its frame or
            interval.
        """
        with self._lock:
            state = self._scheduler.find_state(request.channel)
            if state.sequence > request.newer_than:
                return True
            composition = self._compositions.get(request.channel)
            if composition is None and state.may_capture(self._time_s):
                return False
            state.is_requested = True
            frame = composition and self._start_frame(request.channel, state, composition)
        if frame:
            self._render(frame)
        return True

    def finish_frame(self, channel: Channel) -> FrameRequested | None:
        """Record that the captured frame of a channel is rendered; from any thread.

        Returns:
            The request that has waited for this frame, now to be served; None without one.
        """
        with self._lock:
            state = self._scheduler.finish_frame(channel)
            if state is None or not state.is_requested:
                return None
            return FrameRequested(state.sequence, channel)

    def request_frame(self, request: FrameRequested) -> None:
        """Record a request for `capture_due_channels`."""
        with self._lock:
            self._scheduler.request_frame(request.channel, request.newer_than)

    def begin_tick(self, time_s: float, at_s: float = -math.inf) -> None:
        """Forget all compositions: robots move until a simulation time.

        Args:
            time_s: The simulation time.
            at_s: That time on the wall clock, in real time.
        """
        with self._lock:
            self._time_s, self._ticked_at_s = time_s, at_s
            self._compositions.clear()
            # A channel with a frame in each of the last ticks will have one in this, too.
            self._composed_ahead = self._captured & self._captured_before
            self._captured, self._captured_before = set(), self._captured

    def invalidate(self) -> None:
        """Forget all compositions: something else than a tick changes robots."""
        with self._lock:
            self._compositions.clear()

    def capture_due_channels(self) -> None:
        """Capture the frames of all channels that are due, and compose those that soon will be."""
        with self._lock:
            due = self._scheduler.due_channels(self._time_s)
            ahead, self._composed_ahead = self._composed_ahead, set()
        for channel in due:
            self._capture(channel)
        for channel in ahead:
            self._find_composition(channel)

    def remove_robot(self, name: str) -> None:
        """Forget the channels of a robot that nobody waits for."""
        with self._lock:
            self._scheduler.remove_idle(name)

    def count_frames(self) -> int:
        """Count the captured frames of the present channels, for the log."""
        return self._scheduler.count_frames()

    def _capture(self, channel: Channel) -> None:
        composition = self._find_composition(channel)
        if composition is None:
            return
        with self._lock:
            frame = self._start_frame(channel, self._scheduler.find_state(channel), composition)
        if frame:
            self._render(frame)

    def _find_composition(self, channel: Channel) -> FrameComposition | None:
        """Composition of a channel, once as long as nothing moves; a rejection without one."""
        if channel in self._compositions:
            return self._compositions[channel]
        try:
            composition = self._compose(channel)
        # A request that does not suit the camera is no fault.
        except DomainError as error:
            self._remove(channel, str(error))
            return None
        except Exception:
            log_fault(log, "the frame of %s could not be composed", channel)
            self._remove(channel, FAULT_REASON)
            return None
        if composition is None:
            self._remove(channel, "")
            return None
        with self._lock:
            self._compositions[channel] = composition
        return composition

    def _remove(self, channel: Channel, reason: str) -> None:
        with self._lock:
            self._scheduler.remove(channel)
        self._reject(channel, reason)

    def _start_frame(
        self, channel: Channel, state: ChannelState, composition: FrameComposition
    ) -> FrameRequest | None:
        """Request of a frame that begins now; None if the channel is not due. Under the lock."""
        if not state.is_due(self._time_s):
            return None
        now_s, time_s, repeats = self._monotonic(), self._time_s, None
        interval_s = self._min_interval_s(channel, composition)
        if self._is_realtime:
            # Exposures at intervals keep to the ticks.
            lag_s = 0.0 if interval_s else max(0.0, self._ticked_at_s + TICK_S - now_s)
            time_s, composition = time_s - lag_s, rewind(composition, lag_s)
            if state.composition and show_same(state.composition, composition):
                if state.captured_s == self._time_s:
                    return None
                repeats = state.sequence
        self._captured.add(channel)
        sequence = state.start_frame(self._time_s, interval_s=interval_s)
        state.composition = composition
        return FrameRequest(channel, sequence, time_s, now_s, composition, repeats)

    def _min_interval_s(self, channel: Channel, composition: FrameComposition) -> float:
        if not self._is_realtime:
            return 0.0
        is_image_port = isinstance(channel, ImagePortChannel)
        interval_s = self._image_port_interval_s if is_image_port else 0.0
        return max(composition.min_interval_s, interval_s)
