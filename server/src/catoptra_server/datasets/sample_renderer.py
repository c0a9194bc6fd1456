"""Samples drawn by the functions of served frames, with one thread and without measured costs.

Renderers stay warm: one for each world and brightness, those used last, and one for the labels of
each world. Nothing here depends on time or on the samples before: any process draws the same bytes.
A brightness is a factor of all lights; luminous surfaces stay unchanged.
"""

from __future__ import annotations

import gc
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial
from typing import Any

from catoptra_protocol.labels import GroundTruth
from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.randomise import ScenePainter
from catoptra_server.datasets.sample import (
    NEEDED_CHANNELS,
    RenderedSample,
    SampleAnnotator,
    SampleDescription,
    describe_sample_metadata,
    wants_annotations,
)
from catoptra_server.effects import ANY_GAINS
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.labels import LabelledImage
from catoptra_server.frames.labels.label_renderer import LabelRenderer
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import RenderedView, ViewCache
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.trace_engine import LabelRequest
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import (
    DirectionalLight,
    HemisphereLight,
    Light,
    PointLight,
    Rgb,
    World,
)

# A renderer of a shipped world takes 8 ms to make, and a view of 640 x 640 px 60 ms. Samples go
# through all cameras of a world before the next world, at changing levels of brightness.
_MIN_RENDERERS = 4
# Each keeps rays of up to 256 MiB: with six worlds a worker took 2.1 GB.
_MAX_LABEL_WORLDS = 2
_MAX_VIEW_BYTES = 64 * 2**20
_NOTHING = GroundTruth({})


class SampleRenderer:
    """Renderers of a recipe's worlds, for one process, freed by `close`."""

    def __init__(self, stage: DatasetStage) -> None:
        self._stage = stage
        self._views: dict[tuple[float, ...], ViewCache] = {}  # the last used at the end
        self._labels: dict[int, tuple[LabelRenderer, TraceRenderer]] = {}  # likewise
        self._annotator = SampleAnnotator()
        self._find_painter = cache(self._make_painter)

    def render_sample(self, description: SampleDescription) -> RenderedSample:
        """Render a sample.

        Raises:
            ViewFailedError: The renderer cannot draw the sample.
            RendererUnavailableError: The renderer cannot run on this machine.
        """
        factors = description.brightness, description.group_brightness
        if self._stage.recipe.randomisation is None:
            views = self._find_views(description.place.world, *factors)
        else:
            views = self._paint_views(description)
        channels = self._needed_channels()
        view = views.render(ViewRequest(description.spec, description.state, tuple(channels)))
        truth, annotations = self._render_labels(description, view, channels)
        world = self._stage.world(description.place.world)
        metadata = describe_sample_metadata(description, view, world)
        return RenderedSample(
            key=description.key,
            rgb=view.image.rgb,
            channels={name: truth.channels[name] for name in self._stage.recipe.channels},
            metadata=metadata if annotations is None else {**metadata, "objects": annotations},
            objects=truth.objects,
        )

    def _render_labels(
        self, description: SampleDescription, view: RenderedView, channels: frozenset[str]
    ) -> tuple[GroundTruth, list[dict[str, Any]] | None]:
        """Ground truth of the picture, and annotations where the recipe wants any."""
        # Nothing is computed for a recipe of pictures alone.
        if not channels:
            return _NOTHING, None
        labels, image = self._find_labels(description.place.world), view.frame_plan.labelled_image
        after = description.next_state
        if after is not None and after.ego_body is not None and image.camera_state.objects:
            # As `effects/scene/self_view.py` shows the robot itself: the robot's pixels have a
            # flow, too.
            after = replace(after, objects=(*after.objects, after.ego_body))
        truth = labels.render(image, channels, after, view.labels)
        if not wants_annotations(self._stage.recipe):
            return truth, None
        return truth, self._annotator.annotate(description, image, truth, labels)

    def _needed_channels(self) -> frozenset[str]:
        recipe = self._stage.recipe
        return frozenset(recipe.channels) | (
            NEEDED_CHANNELS if wants_annotations(recipe) else frozenset()
        )

    def _paint_views(self, description: SampleDescription) -> ViewCache:
        """Views of a world in the looks and light of a sample."""
        number, groups = description.place.world, description.group_brightness
        views = self._find_views(number, 1.0, groups)
        scene, world = self._find_painter(number, **groups)
        lights = list(_scale_lights(world, description.brightness, groups).lights)
        if (sun := description.sun) is not None:
            lights = [*(one for one in lights if not isinstance(one, DirectionalLight)), sun]
        sky = _scale_lights(world, description.brightness, groups).object_sky
        lit = replace(world, lights=(*lights, *description.lamps), object_sky=sky)
        views.repaint(scene.paint(description.place.index), lit)
        return views

    def _make_painter(self, number: int, **groups: float) -> tuple[ScenePainter, World]:
        """Looks of a world, and its light but for brightness."""
        scene, world = self._mix_world(number, groups)
        return ScenePainter(self._stage.recipe, scene), world

    def _mix_world(self, number: int, groups: Mapping[str, float]) -> tuple[SceneMesh, World]:
        staged = self._stage.world(number)
        if staged.mix is not None and groups:
            return staged.mix(groups)
        return staged.scene, staged.world

    def _find_labels(self, world: int) -> LabelRenderer:
        """Labels of a world, by separate rays, whatever the lights."""
        found = self._labels.pop(world, None) or self._make_labels(world)
        self._labels[world] = found
        while len(self._labels) > _MAX_LABEL_WORLDS:
            _close_labels(*self._labels.pop(next(iter(self._labels))))
        return found[0]

    def _make_labels(self, world: int) -> tuple[LabelRenderer, TraceRenderer]:
        staged = self._stage.world(world)
        # The first world stays. Collections, which the lists of records call for, looked at all of
        # its objects, for 3 ms a sample.
        if not gc.get_freeze_count():
            gc.freeze()
        renderer = TraceRenderer(staged.scene, staged.world, threads=1)
        recipe = self._stage.recipe
        others = () if recipe.randomisation is None else recipe.randomisation.classes
        return LabelRenderer(renderer, staged.scene, recipe.class_numbers, others), renderer

    def _find_views(self, world: int, brightness: float, groups: Mapping[str, float]) -> ViewCache:
        key = (world, brightness, *groups.values())
        views = self._views.pop(key, None) or self._make_views(world, brightness, groups)
        self._views[key] = views
        # At least the levels of one world, which alternate.
        while len(self._views) > max(_MIN_RENDERERS, self._stage.recipe.brightness.levels):
            self._views.pop(next(iter(self._views))).close()
        return views

    def _make_views(self, number: int, brightness: float, groups: Mapping[str, float]) -> ViewCache:
        recipe = self._stage.recipe
        if recipe.randomisation is None:
            scene, world = self._mix_world(number, groups)
        else:
            painter, world = self._find_painter(number, **groups)
            scene = painter.scene
        world = _scale_lights(world, brightness, groups)
        choice = choose_renderer(
            recipe.renderer,
            scene,
            world,
            threads=1,
            is_reproducible=True,
            # Samples draw exposures of their own.
            gains=ANY_GAINS,
        )
        return ViewCache(
            RenderPlanner(RendererPool(choice, may_replace=False)),
            SceneSummarizer(scene, world),
            max_bytes=_MAX_VIEW_BYTES,
            request_labels=partial(self._request_labels, number),
        )

    def _request_labels(
        self, world: int, image: LabelledImage, channels: tuple[str, ...]
    ) -> LabelRequest | None:
        return self._find_labels(world).request(image, channels)

    def close(self) -> None:
        """Free all renderers."""
        for labels in self._labels.values():
            _close_labels(*labels)
        for views in self._views.values():
            views.close()
        self._labels.clear()
        self._views.clear()


def _close_labels(labels: LabelRenderer, renderer: TraceRenderer) -> None:
    """Free the labels of a world, then the renderer of their rays."""
    labels.close()
    renderer.close()


def _scale_lights(world: World, factor: float, groups: Mapping[str, float]) -> World:
    """World whose lights are brighter by a factor and those of groups by one more; luminous
    surfaces stay as they are.

    Baked light has the factors of groups; the one of all is all that its lamps differ by.
    """
    sky = None if world.object_sky is None else _scale_hemisphere(world.object_sky, factor)
    probes = world.probes and replace(world.probes, faces=factor * world.probes.faces)
    lights = tuple(_scale_light(light, factor, groups) for light in world.lights)
    return replace(world, lights=lights, object_sky=sky, probes=probes)


def _scale_hemisphere(light: HemisphereLight, factor: float) -> HemisphereLight:
    return HemisphereLight(
        _scale(light.up_irradiance, factor), _scale(light.down_irradiance, factor)
    )


def _scale_light(light: Light, factor: float, groups: Mapping[str, float]) -> Light:
    if isinstance(light, HemisphereLight):
        return _scale_hemisphere(light, factor)
    factor *= groups.get(light.group, 1.0)
    match light:
        case DirectionalLight():
            return replace(light, irradiance=_scale(light.irradiance, factor))
        case PointLight():
            return replace(light, intensity=_scale(light.intensity, factor))


def _scale(colour: Rgb, factor: float) -> Rgb:
    red, green, blue = colour
    return factor * red, factor * green, factor * blue
