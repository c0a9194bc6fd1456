"""The two threads behind the ports: one owns the clock and the robots, one the renderers.

Mailboxes and event queues connect both with the asyncio loop, which owns all sockets.
"""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.server_file import ServerSettings, resolve_settings
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.frame_plan import ErrorBoundTable
from catoptra_server.frames.image_port import mounted_camera_state
from catoptra_server.frames.mailbox import Mailboxes
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.costs import CostCache, default_cache_folder
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.plan.renderers import RendererPool, choose_renderer
from catoptra_server.frames.render_thread import RenderThread
from catoptra_server.frames.views import ViewCache
from catoptra_server.options import Options
from catoptra_server.runtime.worker_thread import WorkerThread, lower_thread_priority
from catoptra_server.simulation import ClockMode, Fleet, Simulation, SimulationEvent, StopRequested
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.startup import StartupConfig, create_ray_caster
from catoptra_server.world.camera_state import CameraState

log = logging.getLogger(__name__)

# Start poses at which candidate plans are timed; their frames stand for all frames of the world.
_MAX_CALIBRATION_STATES = 4
# Rendering uses all processors at times; the threads of reports and sockets, which mostly wait,
# come first. Under all attacks of tests/load at once 4 to 12 % of the reports were over 20 % late
# without.
RENDER_NICENESS = 5


class ServerThreads:
    """Simulation and rendering, a thread each, and the mailboxes between these and the sockets."""

    def __init__(
        self, startup: StartupConfig, options: Options, *, on_failure: Callable[[], None]
    ) -> None:
        self.startup = startup
        self.options = options
        self.settings: ServerSettings = resolve_settings(
            startup.server_options, options.server_options
        )
        # Render plan of each class's omnidirectional camera, as text; filled by the render thread.
        self.plans: dict[tuple[str, str], str] = {}
        self.error_bounds = ErrorBoundTable()
        is_realtime = options.clock is ClockMode.REALTIME
        # Prefetching renders the next frame before a viewer requests one. Not under lockstep, where
        # frames follow from commands alone, so that the same commands give the same bytes.
        self.mailboxes = Mailboxes(self._post, prefetch=is_realtime)
        self.render_thread = render_thread = RenderThread(
            self.mailboxes, is_lockstep=not is_realtime
        )
        self.simulation = Simulation(
            self._create_fleet(),
            clock=options.clock,
            render=render_thread.submit if is_realtime else render_thread.submit_and_wait,
            reject=self.mailboxes.fail,
            frame_skip=self.settings.frame_skip,
        )
        self._workers = (
            WorkerThread(
                "rendering",
                self._render,
                stop=render_thread.stop,
                on_failure=on_failure,
            ),
            WorkerThread(
                "simulation",
                self.simulation.run,
                stop=partial(self._post, StopRequested()),
                on_failure=on_failure,
            ),
        )

    def _post(self, event: SimulationEvent) -> None:
        self.simulation.post(event)

    @asynccontextmanager
    async def run(self) -> AsyncIterator[None]:
        """Run both threads for the length of a block.

        The simulation ends first: under lockstep its thread waits for frames of the other one.
        """
        async with AsyncExitStack() as started:
            for worker in self._workers:
                await worker.start()
                started.push_async_callback(worker.stop)
            yield

    def _render(self, on_ready: Callable[[], None]) -> None:
        """Main function of the render thread."""
        # Threads that this one starts, such as those of the trace renderer, have its priority.
        lower_thread_priority(RENDER_NICENESS)
        self.render_thread.run(self._create_view_cache, on_ready)

    def _create_view_cache(self) -> ViewCache | None:
        """Views of the server's cameras, those of each class's omnidirectional camera prepared.

        Runs in the render thread, which owns the OpenGL context. None without any camera.
        """
        startup, options = self.startup, self.options
        if not any(robot.omni_cameras or robot.perspective_cameras for robot in startup.robots):
            log.info("no robot has a camera: no renderer is started")
            return None
        omnis = {
            (robot.class_name, omni.name): omni
            for robot in startup.robots
            for omni in robot.omni_cameras
        }
        is_realtime = options.clock is ClockMode.REALTIME
        choice = choose_renderer(
            options.renderer,
            startup.scene,
            startup.world,
            threads=options.threads,
            instruction_set=options.instruction_set,
            is_reproducible=not is_realtime,
        )
        log.info("%s", choice.renderer.describe())
        views = ViewCache(
            RenderPlanner(
                RendererPool(choice, may_replace=is_realtime),
                CostCache(default_cache_folder(), startup.scene),
            ),
            SceneSummarizer(startup.scene, startup.world),
            calibration_states=_make_calibration_states(startup),
            error_bounds=self.error_bounds,
        )
        # Prepared at start: calibration takes seconds, in which the first viewer would wait.
        for key, omni in omnis.items():
            spec = OmniCameraSpec(omni.camera, omni.render_settings, omni.effects)
            self.plans[key] = views.prepare(spec)
        return views

    def _create_fleet(self) -> Fleet:
        startup = self.startup
        return Fleet(
            startup.robots,
            startup.world,
            startup.scene,
            seed=self.options.seed,
            ray_caster=create_ray_caster(startup),
            multi_view=self.settings.multi_view,
            error_bound_of=self.error_bounds.get,
        )


def _make_calibration_states(startup: StartupConfig) -> tuple[CameraState, ...]:
    """Camera states for calibration: upright at the world's start poses, or at the origin.

    The height is that of the first robot with an omnidirectional camera.
    """
    heights_m = [r.viewpoint_height_m(omni) for r in startup.robots for omni in r.omni_cameras]
    height_m = next(iter(heights_m), 0.0)
    starts = [
        (s.location_m, s.rotation_rad) for s in startup.world.starts[:_MAX_CALIBRATION_STATES]
    ]
    return tuple(
        mounted_camera_state(PlanarPose(x, y, yaw).at_height(height_m), Pose.identity())
        for (x, y, _), (_, _, yaw) in starts or [((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]
    )
