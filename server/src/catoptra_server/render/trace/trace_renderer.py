"""The trace renderer: one ray a sample, traced and shaded by an engine.

The native kernel where it can run, else its float64 reference in NumPy: `engine_choice`.
"""

from __future__ import annotations

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.render.trace.engine_choice import EngineName, EngineRequest, create_engine
from catoptra_server.render.trace.omni_view import TraceOmniView
from catoptra_server.render.trace.ray_table import (
    RayTable,
    face_ray_table,
    lens_ray_table,
    omni_ray_table,
)
from catoptra_server.render.trace.trace_engine import TracedRays
from catoptra_server.runtime.memory import count_processors
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import Light, World


class TraceRenderer:
    """A scene in an engine."""

    def __init__(
        self,
        scene: SceneMesh,
        world: World,
        *,
        threads: int = 0,
        scene_lights: tuple[Light, ...] | None = None,
        engine: EngineRequest = "auto",
        instruction_set: str = "auto",
    ) -> None:
        """Commit a scene.

        Args:
            scene: Triangles of the static scene.
            world: Lights and background.
            threads: Threads of the engine; 0 for one per processor that this process may use.
            scene_lights: Lights that change the static scene visibly; None for all of the world.
            engine: Engine; "auto" for the kernel where it can run.
            instruction_set: Instruction set of the kernel; "auto" for the processor's best.

        Raises:
            KernelUnavailableError: The kernel was requested and cannot run.
        """
        self.engine_name: EngineName
        """Engine that traces."""
        self.engine_name, self._engine = create_engine(
            engine,
            scene,
            world,
            threads=threads or count_processors(),
            scene_lights=world.lights if scene_lights is None else scene_lights,
            instruction_set=instruction_set,
        )
        self._triangles = len(scene)

    def describe(self) -> str:
        """One-line description for logs: engine, threads and scene size."""
        return f"trace: {self._engine.description}, {self._triangles} triangles"

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> TraceOmniView:
        """Prepare a view of an omnidirectional camera."""
        return self._make_view(camera, omni_ray_table(camera, plan))

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> TraceOmniView:
        """Prepare a view of a perspective camera; samples: along a side of each pixel."""
        return self._make_view(camera, lens_ray_table(camera, samples))

    def prepare_face(self, camera: FaceCamera, samples: int) -> TraceOmniView:
        """Prepare a view of one virtual camera of the cube; samples: along a side of each pixel."""
        return self._make_view(camera.perspective_camera, face_ray_table(camera, samples))

    def prepare_rays(self, table: RayTable) -> TracedRays:
        """Prepare rays whose hits are wanted, instead of an image."""
        return self._engine.prepare(table)

    def _make_view(self, camera: RadialCamera, table: RayTable) -> TraceOmniView:
        """View of a camera's rays."""
        return TraceOmniView(camera, self._engine.prepare(table), self._engine.image_changer)

    def close(self) -> None:
        """Free the engine."""
        self._engine.close()
