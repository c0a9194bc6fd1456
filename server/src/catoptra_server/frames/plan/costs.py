"""Prediction of frame times: rates of each stage, fitted to measured frames, kept and corrected.

A stage's time is a sum of rates times quantities of the plan: a constant, and so much a ray, a
sample, a texel. Rates hold for one scene, one camera and one renderer on one machine.

| renderer | stage  | time grows with                                                    |
|----------|--------|--------------------------------------------------------------------|
| trace    | trace  | samples, and their number along a side: along an edge of a surface |
|          |        | pixels take all samples, inside a surface the kernel takes few     |
| raster   | faces  | the scene's triangles (constant), texels, further samples a texel  |
| raster   | mirror | samples of the image, and texels: a larger atlas exceeds the cache |
| any      | other  | samples: averaging, read-back, time between the stages             |

* Drawn frames differ from timed ones in two ways. The load of the machine and the viewpoint
  multiply all times of a renderer; stages that no timed plan has, such as effects, are added.
  Predictions are within 25 % of drawn frames in 27 of 30 cases
  (`tests/measurements/predicted_times.py`).
* Rates are stored on disk, so that a restarted server does not measure again. A file belongs to one
  renderer on one processor or graphics card, one scene, camera, surface and release. An unreadable
  file only means a new measurement: the cache may be deleted at any time.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import platform
from collections.abc import Container, Iterable, Mapping
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server import __version__
from catoptra_server.effects import EffectSettings
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.render.renderer import MirrorSurface, RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.array_cache import write_cache_file
from catoptra_server.runtime.memory import count_processors
from catoptra_server.world.scene_mesh import SceneMesh

Rates = Mapping[str, tuple[float, ...]]  # ms for one unit of each quantity, by stage

# Quantities in millions: rates are then milliseconds of ordinary size, and the fit is conditioned.
_PER_MILLION = 1e-6
# The fit minimizes relative errors; a stage shorter than this is weighted as if it took this long.
_MIN_MS = 0.2


@dataclass(frozen=True, slots=True)
class PlanTiming:
    """Measured times of a plan."""

    plan: RenderPlan
    stage_ms: Mapping[str, float]
    """Median milliseconds of each stage."""


@dataclass(frozen=True, slots=True)
class CostModel:
    """Rates of one camera in one scene."""

    camera: OmniCamera
    rates: Mapping[str, Rates]
    """Rates by name of the renderer."""

    def predict_frame_ms(self, plan: RenderPlan) -> float:
        """Predicted milliseconds of a frame.

        Raises:
            KeyError: No plan of this renderer was measured.
        """
        return sum(self.predict_stage_ms(plan).values())

    def predict_stage_ms(self, plan: RenderPlan) -> dict[str, float]:
        """Predicted milliseconds of each stage."""
        return {
            stage: float(np.dot(rates, _cost_features(stage, plan, self.camera)))
            for stage, rates in self.rates[plan.renderer.value].items()
        }


def describe_rates(rates: Mapping[str, Rates]) -> str:
    """Rates for a log: of each stage the constant, and the rates per million of the quantities."""
    stages = [(f"{group} {stage}", r) for group in rates for stage, r in rates[group].items()]
    return "; ".join(
        f"{name} {constant:.3g} ms + {', '.join(f'{rate:.3g}' for rate in others)} ms/million"
        for name, (constant, *others) in stages
    )


def _cost_features(stage: str, plan: RenderPlan, camera: OmniCamera) -> tuple[float, ...]:
    """Quantities that a stage's time grows with: 1 for the constant, others in millions."""
    samples = _PER_MILLION * camera.width_px * camera.height_px * plan.samples**2
    texels = _PER_MILLION * sum(region.num_texels for region in plan.face_regions)
    match stage:
        case "trace":
            return 1.0, samples / plan.samples, samples
        case "faces":
            # The first sample of a texel is in `texels`: multisampling shades once, stores more.
            return 1.0, texels, texels * (plan.face_samples - 1)
        case "mirror":
            return 1.0, samples, texels
    return 1.0, samples


def fit_cost_model(camera: OmniCamera, timings: Iterable[PlanTiming]) -> CostModel:
    """Fit rates to measured frames, by relative least squares."""
    by_group: dict[str, list[PlanTiming]] = {}
    for timing in timings:
        by_group.setdefault(timing.plan.renderer.value, []).append(timing)
    rates = {group: _fit_rates(camera, members) for group, members in by_group.items()}
    return CostModel(camera, rates)


def _fit_rates(camera: OmniCamera, timings: list[PlanTiming]) -> Rates:
    return {
        stage: _fit_nonnegative_rates(
            np.array([_cost_features(stage, timing.plan, camera) for timing in timings]),
            np.array([timing.stage_ms.get(stage, 0.0) for timing in timings]),
        )
        for stage in sorted({stage for timing in timings for stage in timing.stage_ms})
    }


def grows_with_quantities(rates: Rates) -> bool:
    """Whether frames of a renderer take longer with more samples or texels, all rates finite.

    Frames measured while other programs use the processors may not: those rates mean nothing.
    """
    values = [rate for stage in rates.values() for rate in stage]
    growing = [rate for stage in rates.values() for rate in stage[1:]]
    return all(map(math.isfinite, values)) and sum(growing) > 0.0


def _fit_nonnegative_rates(features: Floats, ms: Floats) -> tuple[float, ...]:
    """Non-negative rates (k,) by which features (n, k) explain times (n,) best.

    Of solutions that explain equally much, the one with fewest non-zero rates is taken, and of
    those the one without a constant: a single frame cannot separate a constant from a rate.
    """
    weight = 1.0 / np.maximum(ms, _MIN_MS)
    rows, target = features * weight[:, None], ms * weight
    best, min_residual = np.zeros(features.shape[1]), float(target @ target)
    # At most three features, so seven supports: enumeration is exact and needs no NNLS solver.
    for support in _index_subsets(features.shape[1]):
        rates = np.zeros(features.shape[1])
        rates[support] = np.linalg.lstsq(rows[:, support], target, rcond=None)[0]
        residual = float(np.square(rows @ rates - target).sum())
        # A margin above rounding: equal fits must not displace the smaller support.
        if (rates >= 0.0).all() and residual < min_residual - 1e-12:
            best, min_residual = rates, residual
    return tuple(float(rate) for rate in best)


def _index_subsets(count: int) -> Iterable[list[int]]:
    """Non-empty subsets of range(count), small ones first, those with the constant (0) last."""
    sizes = range(1, count + 1)
    last_first = range(count - 1, -1, -1)
    return [list(used) for size in sizes for used in itertools.combinations(last_first, size)]


# Increased when the meaning of a rate or the name of a stage changes.
_FORMAT_VERSION = 4
_CPU_INFO = Path("/proc/cpuinfo")


class CostCache:
    """Cost files of one scene."""

    def __init__(self, folder: Path | None, scene: SceneMesh) -> None:
        self._folder = folder
        self._scene = scene
        self._digest = ""

    def read(self, key: str) -> dict[str, Rates] | None:
        """Rates under a key, by renderer; None for an absent or unreadable file."""
        if self._folder is None:
            return None
        import json  # late: cameras without an accuracy target have no costs

        try:
            groups = json.loads(self._path(key).read_text(encoding="utf-8"))
            return {
                str(group): {str(s): tuple(map(float, rates)) for s, rates in stages.items()}
                for group, stages in groups.items()
            }
        # Malformed content raises any of these, by the depth at which the form is wrong.
        except (OSError, ValueError, AttributeError, TypeError):
            return None

    def write(self, key: str, rates: Mapping[str, Rates]) -> None:
        """Store rates under a key, atomically."""
        if self._folder is None:
            return
        import json

        write_cache_file(self._path(key), json.dumps(rates, indent=1).encode())

    def make_key(
        self, renderer_description: str, camera: OmniCamera, surface: MirrorSurface
    ) -> str:
        """Key of everything that the rates depend on.

        Args:
            renderer_description: The renderer's `describe()`: library, device, threads.
        """
        # On demand: hashing a million triangles takes half a second.
        if not self._digest:
            self._digest = hash_scene(self._scene)
        facts = (renderer_description, self._digest, camera, surface)
        parts = (_FORMAT_VERSION, __version__, _describe_processor(), *facts)
        # repr of frozen dataclasses names every field, so a new field changes the key.
        return hashlib.sha256("\n".join(map(repr, parts)).encode()).hexdigest()[:32]

    def _path(self, key: str) -> Path:
        assert self._folder is not None, "a path exists only with a folder"
        return self._folder / f"{key}.json"


def hash_scene(scene: SceneMesh) -> str:
    """Digest of everything visible in a scene."""
    digest = hashlib.sha256()
    arrays = (scene.corners, scene.albedo, scene.unlit, scene.texture_index, *scene.textures)
    occlusion = () if scene.occlusion is None else scene.occlusion.arrays
    for array in (*arrays, scene.corner_albedo, *occlusion):
        if array is not None:
            digest.update(repr(array.shape).encode())
            digest.update(array.tobytes())
    return digest.hexdigest()


def _describe_processor() -> str:
    """Name of the processor, and the number of processors this process may use."""
    try:
        lines = _CPU_INFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    name = next((line for line in lines if line.startswith("model name")), None)
    # Only where the kernel names none: `platform` runs a process for its answer.
    return f"{name or platform.processor()}, {count_processors()}"


# Real frames take a few times the measured time at most; a larger quotient comes from a suspended
# process or a changed clock, and is not believed.
_MAX_FACTOR = 10.0
# In place of the calibrated stages, in frames of several time samples.
_MULTIPLIED_STAGES = frozenset({"accumulate"})

_EffectsKey = tuple[OmniCamera, EffectSettings]


def added_ms(stage_ms: Mapping[str, float], calibrated_stages: Container[str]) -> float:
    """Milliseconds of a frame's stages that no calibration has, such as effects."""
    return sum(
        ms
        for stage, ms in stage_ms.items()
        if stage not in calibrated_stages and stage not in _MULTIPLIED_STAGES
    )


class CostCorrections:
    """Corrections of one scene: a factor a renderer, added times a camera and renderer."""

    def __init__(self) -> None:
        """Create corrections without any frame."""
        self._factors: dict[RendererKind, float] = {}
        self._added_ms: dict[_EffectsKey, dict[RendererKind, float]] = {}

    def load_factor(self, kind: RendererKind) -> float:
        """Factor by which a renderer's frames take longer than calibrated ones."""
        return self._factors.get(kind, 1.0)

    def correct(self, camera: OmniCameraSpec, kind: RendererKind, ms: float) -> float:
        """Milliseconds of a drawn frame, from the cost model's."""
        known = self._added_ms.get(_effects_key(camera), {})
        # Until a renderer has drawn, what another one added; 0 before any frame.
        added_ms = known.get(kind, next(iter(known.values()), 0.0))
        return self.load_factor(kind) * ms + added_ms

    def update(
        self,
        camera: OmniCameraSpec,
        kind: RendererKind,
        model_ms: float,
        *,
        median_ms: float,
        added_ms: float,
    ) -> None:
        """Update the corrections by medians of drawn frames.

        Args:
            camera: Camera of the frames.
            kind: Renderer of the frames.
            model_ms: Milliseconds of the cost model, uncorrected: a correction must not feed on
                itself.
            median_ms: Median time of the frames.
            added_ms: Median time of their stages without calibration.
        """
        factor = (median_ms - added_ms) / model_ms
        self._factors[kind] = min(max(factor, 1.0 / _MAX_FACTOR), _MAX_FACTOR)
        self._added_ms.setdefault(_effects_key(camera), {})[kind] = added_ms

    def clear(self) -> None:
        """Forget the added times: cameras are planned anew."""
        self._added_ms.clear()


def _effects_key(camera: OmniCameraSpec) -> _EffectsKey:
    """Everything of a camera that added times depend on."""
    return camera.camera, camera.effect_settings
