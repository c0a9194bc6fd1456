"""The raster renderer: cube faces at the viewpoint, then the mirror, on an OpenGL device.

A renderer and its views belong to the thread that created the renderer: OpenGL contexts are bound
to threads. The server creates its renderer in the render thread.
"""

from __future__ import annotations

import threading
from contextlib import ExitStack

import moderngl

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.image_changer import ImageChanger, NumpyImageChanger
from catoptra_server.render.projection.atlas import GUARD_TEXELS, Atlas, pack_atlas
from catoptra_server.render.projection.frustum import LensProjection, make_lens_projection
from catoptra_server.render.raster.device import (
    Definitions,
    GlDevice,
    ShaderPrograms,
    fit_spacing,
    open_device,
)
from catoptra_server.render.raster.face_pass import FacePass
from catoptra_server.render.raster.mirror_pass import MirrorPass, make_lookup_map
from catoptra_server.render.raster.passes import AveragePass, OutputImage, Pass
from catoptra_server.render.raster.range_pass import RangePass
from catoptra_server.render.raster.raster_views import (
    RasterView,
    ViewPasses,
    make_identity_map,
)
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.render.renderer import FaceCamera, RenderPlan
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import Light, World

# Beyond all worlds, with all of them in view.
_FAR_M = 1e6


class RasterRenderer:
    """A scene on an OpenGL device."""

    def __init__(
        self,
        scene: SceneMesh,
        world: World,
        *,
        device: GlDevice | None = None,
        scene_lights: tuple[Light, ...] | None = None,
        image_changer: ImageChanger | None = None,
    ) -> None:
        """Upload a scene.

        Args:
            scene: Triangles of the static scene.
            world: Lights and background.
            device: Device that is already open; None opens a new one.
            scene_lights: Lights that change the static scene visibly; None for all of the world.
            image_changer: Applies image effects to images that are read back, closed with the
                renderer; None: NumPy.

        Raises:
            OpenGLMissingError: There is no OpenGL 3.3.
        """
        self._device = device or open_device()
        self._thread = threading.get_ident()
        self._triangles = len(scene)
        self._lights = world.lights
        self._image_changer = image_changer or NumpyImageChanger()
        with self._device.context as context:
            self._programs = ShaderPrograms(context)
            self._scene = SceneBuffers(
                context, self._programs, scene, world, scene_lights=scene_lights
            )

    @property
    def program_names(self) -> tuple[str, ...]:
        """Names of the shader programs compiled so far."""
        return self._programs.names

    @property
    def object_buffer_bytes(self) -> int:
        """Size of the vertex buffer of dynamic objects: 0 until the first object."""
        return self._scene.plain.dynamic_objects.buffer_bytes

    def describe(self) -> str:
        """One-line description for logs: device, scene size and what applies image effects."""
        effects = f"image effects by {self._image_changer.description}"
        return f"raster: {self._device}, {self._triangles} triangles, {effects}"

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> RasterView:
        """Prepare a view of an omnidirectional camera.

        Face pass and lookup map are built here; later passes when a frame first needs
        each, since effects and shutter may differ from frame to frame.
        """
        self._check_thread()
        with self._device.context as context, ExitStack() as undo:
            # Resources built so far are freed if a later one does not fit the device.
            faces = self._make_face_pass(camera, plan, undo)
            output = OutputImage(context, camera.width_px, camera.height_px)
            undo.callback(output.close)
            lookup_map = make_lookup_map(
                context, self._programs, camera, plan.surface, faces.atlas, plan.samples
            )
            undo.callback(lookup_map.release)
            # Now: the first frame must not wait for the driver.
            faces.compile()
            # All built: from here on the view frees these resources.
            undo.pop_all()

        def make_mirror_pass(target: moderngl.Framebuffer, encoding: Definitions) -> Pass:
            return MirrorPass(
                context,
                self._programs,
                faces,
                camera,
                lookup_map,
                plan.samples,
                target,
                encoding=encoding,
            )

        def make_range_pass() -> RangePass:
            # One sample a pixel, at the pixel's centre: effects use the range of the centre.
            centres = make_lookup_map(context, self._programs, camera, plan.surface, faces.atlas, 1)
            return RangePass(context, self._programs, self._scene, faces.atlas, camera, centres)

        passes = ViewPasses(
            context,
            self._programs,
            camera,
            faces,
            output,
            make_mirror_pass,
            make_range_pass,
            self._lights,
            lookup_map,
        )
        return self._make_view(passes)

    def _make_face_pass(
        self, camera: OmniCamera, plan: RenderPlan, undo: ExitStack
    ) -> FacePass[Atlas]:
        """Face pass of a plan, registered for closing."""
        atlas = pack_atlas(
            plan.face_regions, guard_texels=GUARD_TEXELS, max_texels=self._max_texels
        )
        spacing = fit_spacing(camera, plan.samples)
        faces = FacePass(self._device.context, self._scene, atlas, plan.face_samples, spacing)
        undo.callback(faces.close)
        return faces

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> RasterView:
        """Prepare a view of a perspective camera; samples: along a side of each pixel."""
        return self._make_lens_view(camera, samples)

    def prepare_face(self, camera: FaceCamera, samples: int) -> RasterView:
        """Prepare a view of one virtual camera of the cube; samples: along a side of each pixel."""
        return self._make_lens_view(camera.perspective_camera, samples, camera.mirror_from_camera)

    def _make_lens_view(
        self, camera: PerspectiveCamera, samples: int, mirror_from_camera: Floats | None = None
    ) -> RasterView:
        """View of a perspective camera whose frame is rotated in the mirror frame."""
        self._check_thread()
        cell = make_lens_projection(
            camera, samples, mirror_from_camera, max_texels=self._max_texels
        )
        names_before = self.program_names
        with self._device.context as context:
            # One sample a texel: the image has samples x samples texels a pixel already, at
            # trace's positions.
            faces = FacePass(context, self._scene, cell, 1)
            output = OutputImage(context, camera.width_px, camera.height_px)

        def make_average(target: moderngl.Framebuffer, encoding: Definitions) -> Pass:
            return AveragePass(
                context, self._programs, faces.texture, samples, target, encoding=encoding
            )

        def make_range_pass() -> RangePass:
            # One sample a pixel, at the pixel's centre: effects use the range of the centre.
            centres = LensProjection(camera, 1, cell.mirror_from_camera)
            identity = make_identity_map(context, camera)
            return RangePass(context, self._programs, self._scene, centres, camera, identity)

        passes = ViewPasses(
            context,
            self._programs,
            camera,
            faces,
            output,
            make_average,
            make_range_pass,
            self._lights,
        )
        view = self._make_view(passes)
        view.prepare_plain()
        # A zoom of a camera leaves nothing to compile. Else one discarded frame: drivers finish
        # compiling at a program's first draw call. From far away: it needs no image's finer levels.
        if self.program_names != names_before:
            far = self._scene.origin - _FAR_M * cell.mirror_from_camera[:, 0]
            view.render(CameraState(Pose.from_rpy(far)))
        return view

    def _make_view(self, passes: ViewPasses) -> RasterView:
        return RasterView(self._device, passes, self._image_changer, thread=self._thread)

    @property
    def _max_texels(self) -> int:
        """Largest side of a texture on this device."""
        return int(self._device.context.info["GL_MAX_TEXTURE_SIZE"])

    def _check_thread(self) -> None:
        """Reject calls from any thread but the renderer's own."""
        assert threading.get_ident() == self._thread, (
            "a renderer belongs to the thread that created it"
        )

    def close(self) -> None:
        """Free the device; views must be closed before."""
        self._check_thread()
        with self._device.context:
            self._scene.close()
        self._image_changer.close()
        self._device.close()
