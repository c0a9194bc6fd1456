"""The raster renderer: cube faces at the viewpoint, then the mirror, on an OpenGL device.

All of a renderer and of its views belongs to the thread that made the renderer: OpenGL contexts
are bound to threads. The server makes it in the simulation thread.
"""

from __future__ import annotations

import threading
from contextlib import ExitStack

import moderngl

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.effect import Effect
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.plan.render_plan import PerPixel, RenderPlan
from catoptra_server.render.raster.atlas import GUARD_TEXELS, Atlas, pack_atlas
from catoptra_server.render.raster.context import GlDevice, open_device
from catoptra_server.render.raster.effect_chain import EffectChain, LinearPicture
from catoptra_server.render.raster.faces import FacePass
from catoptra_server.render.raster.instants_pass import InstantsPass
from catoptra_server.render.raster.lens_cell import lens_cell
from catoptra_server.render.raster.mirror_pass import MirrorPass, law_places
from catoptra_server.render.raster.passes import ENCODED, LINEAR, AveragePass, Output
from catoptra_server.render.raster.polygon_places import polygon_places
from catoptra_server.render.raster.programs import Definitions, Programs
from catoptra_server.render.raster.range_pass import RangePass
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.render.raster.views import Developed, RasterOmniView, RasterView
from catoptra_server.render.renderer import Exposure, FaceCamera, View
from catoptra_server.render.summaries import SceneSummaries
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh


class RasterRenderer:
    """A scene on an OpenGL device: its own one, or one that was opened before to be looked at.

    Raises OpenGLMissingError where there is no OpenGL 3.3.
    """

    def __init__(self, scene: SceneMesh, world: World, *, device: GlDevice | None = None) -> None:
        self._device = device or open_device()
        self._thread = threading.get_ident()
        self._triangles = len(scene)
        self._summaries = SceneSummaries(scene, world)
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
        return f"raster: {self._device}, {self._triangles} triangles"

    def summary(self, exposure: Exposure, camera: OmniCamera) -> SceneSummary:
        """Return what an exposure can show at most."""
        return self._summaries.of(exposure, camera)

    def light_summary(self, exposure: Exposure) -> SceneSummary:
        """Return the brightest light that an exposure can show, and of the rest nothing."""
        return self._summaries.of_light()

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> RasterOmniView:
        """Return a view of the scene by an omnidirectional camera."""
        self._check_thread()
        with self._device.context as context, ExitStack() as undo:
            faces = self._faces_of(plan, undo)
            output = Output(context, camera.width_px, camera.height_px)
            undo.callback(output.close)
            places = self._places(camera, plan, faces.atlas, plan.samples)
            undo.callback(places.release)
            faces.draw(Exposure(Pose.from_rpy(self._scene.origin)))  # compiles what scenes need
            undo.pop_all()

        def plain() -> Developed:
            return Developed((faces, mirror(output.target, ENCODED)))

        def mirror(target: moderngl.Framebuffer, encoding: Definitions) -> MirrorPass:
            return MirrorPass(
                context,
                self._programs,
                faces,
                camera,
                places,
                plan.samples,
                target,
                encoding=encoding,
            )

        def linear(effects: tuple[Effect, ...], lasts: bool) -> Developed:
            ranges = self._ranges(camera, plan, faces, effects)
            chain = EffectChain(
                context, self._programs, effects, camera, output.target, ranges=ranges
            )
            first = lasting(chain.first) if lasts else (faces, mirror(chain.first, LINEAR))
            between = (ranges,) if ranges is not None else ()
            return Developed((*first, *between, *chain.passes), chain)

        def lasting(target: moderngl.Framebuffer) -> tuple[InstantsPass]:
            sharp = LinearPicture(context, camera.width_px, camera.height_px)
            steps = (faces, mirror(sharp.target, LINEAR))
            return (InstantsPass(context, self._programs, camera, steps, sharp, target),)

        return RasterOmniView(
            self._device, faces, places, output, plain=plain, linear=linear, thread=self._thread
        )

    def _ranges(
        self,
        camera: OmniCamera,
        plan: RenderPlan,
        faces: FacePass[Atlas],
        effects: tuple[Effect, ...],
    ) -> RangePass | None:
        """Return the pass that finds how far pixels see, if some effect uses it."""
        if not any(effect.uses_range for effect in effects):
            return None
        places = self._places(camera, plan, faces.atlas, 1)
        return RangePass(
            self._device.context, self._programs, self._scene, faces.atlas, camera, places
        )

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

    def _places(
        self, camera: OmniCamera, plan: RenderPlan, atlas: Atlas, samples: int
    ) -> moderngl.Texture:
        """Return where samples^2 of each pixel look in the atlas."""
        context = self._device.context
        if isinstance(plan.surface, PerPixel):
            return law_places(context, camera, atlas, samples)
        return polygon_places(context, self._programs, camera, plan.surface, samples, atlas)

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
