"""Rule for the frame times of the renderers: rates fitted once, on one machine.

The rule knows what of scene, camera and samples costs time, and nothing of the machine that runs
it: lockstep, data sets and studies follow the rule alone, so that their bytes depend on no machine.
In real time the rule chooses the renderer of the first frames, and `renderer_preferences` corrects
the choice by measured frames. With an accuracy target `cost_model` has rates of this very scene.

Rates: tests/measurements/renderer_comparison.py on two cores with AVX2. They predict the frames
that they were fitted to within a factor of 2.2, and pick the faster renderer in 46 of 48 cases;
in the other two it is faster by a fifth at most.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.effect import NO_EFFECT_SETTINGS, EffectSettings
from catoptra_server.planning.effect_rates import (
    RenderEngine,
    find_possible_effects,
    predict_effects_ms,
)
from catoptra_server.planning.explicit_plan import requested_samples
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.world_description import Light, PointLight

# Quantities in millions, as in `cost_model`.
_PER_MILLION = 1e-6


# Milliseconds of one unit of each quantity of `rule_features`.
_RATES: Mapping[RenderEngine, tuple[float, ...]] = {
    RenderEngine.KERNEL: (1.10, 1.66, 1.78, 24.6, 1.76, 12.4),
    RenderEngine.REFERENCE: (2.21, 0.0, 290.0, 0.0, 128.0, 64.5),
    RenderEngine.SOFTWARE_OPENGL: (2.05, 121.0, 28.3, 5.63, 27.6, 19.4),
}


@dataclass(frozen=True, slots=True)
class SceneLoad:
    """Properties of a scene that frame times grow with."""

    num_triangles: int
    has_textures: bool
    num_point_lights: int

    @classmethod
    def from_scene(cls, mesh: SceneMesh, lights: Iterable[Light]) -> SceneLoad:
        """Properties of a mesh under lights, those that are not culled."""
        num_point_lights = sum(isinstance(light, PointLight) for light in lights)
        return cls(len(mesh), bool(mesh.textures), num_point_lights)

    def __str__(self) -> str:
        textures = ", textures" if self.has_textures else ""
        lights = f", {self.num_point_lights} point lights" if self.num_point_lights else ""
        return f"{self.num_triangles} triangles{textures}{lights}"


@dataclass(frozen=True, slots=True)
class ImageLoad:
    """Properties of an image that frame times grow with."""

    num_pixels: int = 640 * 640
    samples: int = 1
    """Samples along a pixel's side; a pixel has samples^2."""
    effects: frozenset[str] = frozenset()
    """Names of the effects that the image may need."""

    @classmethod
    def from_camera(
        cls,
        camera: OmniCamera,
        settings: RenderSettings,
        effects: EffectSettings = NO_EFFECT_SETTINGS,
    ) -> ImageLoad:
        """Properties of a camera's image."""
        num_pixels = camera.width_px * camera.height_px
        names = find_possible_effects(effects, camera)
        return cls(num_pixels, requested_samples(settings), names)

    @property
    def num_samples(self) -> int:
        """Samples of the whole image."""
        return self.num_pixels * self.samples**2

    def __str__(self) -> str:
        megapixels = _PER_MILLION * self.num_pixels
        effects = f" with {len(self.effects)} effects" if self.effects else ""
        samples = f"{self.samples} x {self.samples} samples"
        return f"{megapixels:.2g} million pixels of {samples}{effects}"


@dataclass(frozen=True, slots=True)
class RendererRule:
    """Rule for one scene."""

    scene: SceneLoad
    engines: Mapping[RendererKind, RenderEngine]
    """Engine of each renderer; one without rates, such as a graphics processor, is left out."""

    def predict_frame_ms(self, kind: RendererKind, image: ImageLoad) -> float | None:
        """Milliseconds of a frame on the rule's machine; None for a renderer without rates."""
        engine = self.engines.get(kind)
        return None if engine is None else predict_frame_ms(engine, self.scene, image)

    def find_fastest(self, image: ImageLoad) -> RendererKind:
        """Renderer with the shortest frame time, of those with rates."""
        return min(
            self.engines, key=lambda kind: predict_frame_ms(self.engines[kind], self.scene, image)
        )

    def explain(self, image: ImageLoad) -> str:
        """The rule's numbers in words."""
        times = ", ".join(
            f"{kind.value} ({engine.value}) {predict_frame_ms(engine, self.scene, image):.0f} ms"
            for kind, engine in self.engines.items()
        )
        return f"{times} for {image}, {self.scene}"


def predict_frame_ms(engine: RenderEngine, scene: SceneLoad, image: ImageLoad) -> float:
    """Milliseconds of a frame on the rule's machine."""
    features = rule_features(engine, scene, image)
    frame_ms = sum(rate * feature for rate, feature in zip(_RATES[engine], features, strict=True))
    effects_ms = predict_effects_ms(
        engine, image.effects, num_pixels=image.num_pixels, num_samples=image.num_samples
    )
    return frame_ms + effects_ms


def rule_features(engine: RenderEngine, scene: SceneLoad, image: ImageLoad) -> tuple[float, ...]:
    """Quantities that an engine's frame time grows with: 1 for the constant, others in millions."""
    pixels, samples = _PER_MILLION * image.num_pixels, _PER_MILLION * image.num_samples
    triangles = _PER_MILLION * scene.num_triangles
    if engine is RenderEngine.SOFTWARE_OPENGL:
        # Faces have about as many texels as the image has pixels, and all light is computed there.
        shaded = (pixels * scene.has_textures, pixels * scene.num_point_lights)
        return 1.0, triangles, pixels, samples, *shaded
    # Among few triangles one surface fills most tiles of an image; the more there are, the more
    # samples are traced. Textures and point lights take time in every sample.
    shaded = (samples * scene.has_textures, samples * scene.num_point_lights)
    return 1.0, pixels, samples, samples * triangles, *shaded


def largest_image(
    cameras: Iterable[tuple[OmniCamera, RenderSettings, EffectSettings]],
) -> ImageLoad:
    """Image that takes longest, of all cameras of a server; a small one without cameras."""
    images = [ImageLoad.from_camera(*camera) for camera in cameras]
    return max(images, key=_image_ms, default=ImageLoad(num_pixels=0))


def _image_ms(image: ImageLoad) -> float:
    """Milliseconds of an image of an empty scene: the order of images is that of any engine."""
    return predict_frame_ms(RenderEngine.KERNEL, SceneLoad(0, False, 0), image)
