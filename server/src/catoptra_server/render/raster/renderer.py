"""The raster renderer: cube faces at the viewpoint, then the mirror, on an OpenGL device.

All of a renderer and of its views belongs to the thread that made the renderer: OpenGL contexts
are bound to threads. The server makes it in the simulation thread.
"""

from __future__ import annotations

import threading
from contextlib import ExitStack
from functools import cached_property

import moderngl

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.effect import Effect
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.plan.render_plan import PerPixel, RenderPlan
from catoptra_server.render.brightness import summarise
from catoptra_server.render.raster.atlas import GUARD_TEXELS, Atlas, pack_atlas
from catoptra_server.render.raster.context import GlDevice, open_device
from catoptra_server.render.raster.effect_chain import EffectChain
from catoptra_server.render.raster.faces import FacePass
from catoptra_server.render.raster.lens_cell import lens_cell
from catoptra_server.render.raster.mirror_pass import MirrorPass, law_places
from catoptra_server.render.raster.passes import ENCODED, LINEAR, AveragePass, Output, Pass
from catoptra_server.render.raster.polygon_places import polygon_places
from catoptra_server.render.raster.programs import Definitions, Programs
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.render.raster.views import RasterEffectView, RasterView
from catoptra_server.render.renderer import Exposure, FaceCamera, View
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh


class RasterRenderer:
    """A scene on an OpenGL device: its own one, or one that was opened before to be looked at.

    Raises OpenGLMissingError where there is no OpenGL 3.3.
    """

    def __init__(self, scene: SceneMesh, world: World, *, device: GlDevice | None = None) -> None:
        self._device = device or open_device()
        self._thread = threading.get_ident()
        self._mesh = scene
        self._world = world
        with self._device.context as context:
            self._programs = Programs(context)
            self._scene = SceneBuffers(context, self._programs, scene, world)

    @property
    def programs_built(self) -> tuple[str, ...]:
        """Return the names of the shader programs that were built so far."""
        return self._programs.built

    @property
    def body_bytes(self) -> int:
        """Return the size of the buffer for what moves: 0 as long as no body was seen."""
        return self._scene.bodies.bytes_held

    def describe(self) -> str:
        """Return what draws, for logs."""
        return f"raster: {self._device}, {len(self._mesh)} triangles"

    @cached_property
    def summary(self) -> SceneSummary:
        """Return what the scene can show at most."""
        return summarise(self._mesh, self._world)

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> RasterView:
        """Return a view of the scene by an omnidirectional camera."""
        self._check_thread()
        with self._device.context as context, ExitStack() as undo:
            faces = self._faces_of(plan, undo)
            output = Output(context, camera.width_px, camera.height_px)
            undo.callback(output.close)
            mirror = self._mirror_passes(camera, plan, faces, output.target, ENCODED)
            undo.pop_all()
        view = RasterView(self._device, faces, mirror, output, self._thread)
        self._warm(view)
        return view

    def prepare_with_effects(
        self, camera: OmniCamera, plan: RenderPlan, effects: tuple[Effect, ...]
    ) -> RasterEffectView:
        """Return a view whose picture stays in linear light until all effects have changed it."""
        self._check_thread()
        with self._device.context as context, ExitStack() as undo:
            faces = self._faces_of(plan, undo)
            output = Output(context, camera.width_px, camera.height_px)
            undo.callback(output.close)
            chain = EffectChain(context, self._programs, effects, camera, output.target)
            undo.callback(chain.close)
            mirror = self._mirror_passes(camera, plan, faces, chain.first, LINEAR)
            undo.pop_all()
        passes = (*mirror, *chain.passes)
        view = RasterView(self._device, faces, passes, output, self._thread)
        whole = RasterEffectView(self._device, view, chain)
        self._warm(whole)
        return whole

    def _faces_of(self, plan: RenderPlan, undo: ExitStack) -> FacePass[Atlas]:
        atlas = pack_atlas(plan.face_parts, guard=GUARD_TEXELS, max_texels=self._max_texels)
        faces = FacePass(self._device.context, self._scene, atlas, plan.face_samples)
        undo.callback(faces.close)
        return faces

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> RasterView:
        """Return a view of the scene by an ordinary camera, samples^2 a pixel."""
        return self._lens_view(camera, samples)

    def prepare_face(self, camera: FaceCamera, samples: int) -> RasterView:
        """Return a view of the scene by one virtual camera of the cube, samples^2 a pixel."""
        return self._lens_view(camera.lens, samples, camera.mirror_from_camera)

    def _lens_view(
        self, camera: PerspectiveCamera, samples: int, turn: Floats | None = None
    ) -> RasterView:
        self._check_thread()
        cell = lens_cell(camera, samples, turn, max_texels=self._max_texels)
        known = self.programs_built
        with self._device.context as context:
            faces = FacePass(context, self._scene, cell, 1)
            output = Output(context, camera.width_px, camera.height_px)
            average = AveragePass(context, self._programs, faces.texture, samples, output.target)
        view = RasterView(self._device, faces, (average,), output, self._thread)
        if self.programs_built != known:  # a camera that zooms has nothing left to compile
            self._warm(view)
        return view

    @property
    def _max_texels(self) -> int:
        return int(self._device.context.info["GL_MAX_TEXTURE_SIZE"])

    def _mirror_passes(
        self,
        camera: OmniCamera,
        plan: RenderPlan,
        faces: FacePass[Atlas],
        target: moderngl.Framebuffer,
        encoding: Definitions,
    ) -> tuple[Pass, ...]:
        context, samples, surface = self._device.context, plan.samples, plan.surface
        if isinstance(surface, PerPixel):
            places = law_places(context, camera, faces.atlas, samples)
        else:
            places = polygon_places(context, self._programs, camera, surface, samples, faces.atlas)
        return (
            MirrorPass(
                context, self._programs, faces, camera, places, samples, target, encoding=encoding
            ),
        )

    def _warm(self, view: View) -> None:
        """Draw once for nothing: drivers compile a program's machine code at its first draw."""
        view.draw(Exposure(Pose.from_rpy(self._scene.origin)))

    def _check_thread(self) -> None:
        assert threading.get_ident() == self._thread, (
            "a renderer belongs to the thread it was made in"
        )

    def close(self) -> None:
        """Free the device. Views are closed before."""
        self._check_thread()
        with self._device.context:
            self._scene.close()
        self._device.close()
