"""The bound of a plan: how far its frames show things from where the camera law puts them.

What it says. Each sample of a frame shows the scene in some direction; `geometric` bounds the
distance between that sample and the place where the law puts that direction, over the visible
image, in pixels and as an angle at the effective viewpoint. It is computed before anything is
drawn, from the camera and the plan alone.

What it includes, each a part with a name:

| part     | of                                   | computed in                               |
|----------|--------------------------------------|-------------------------------------------|
| polygons | interpolation over flat facets       | `facet_error`: on the mesh, in float64    |
| rim      | polygons that end within the rim     | `facet_error.rim_gap`: closed form        |
| faces    | texels between viewpoint and mirror  | `face_lookup_error`: half a texel's image |
| corners  | polygons on the rasteriser's grid    | `rounding_error.corner_error`             |
| rounding | float32 directions and places        | `rounding_error`                          |

The parts add up, but for the rim: where polygons end too early nothing is shown that could be
displaced too, so the whole is at least the rim's part, not more by it.

What it does not include: the samples' own spacing, which is `sampling` and comes on top of what is
measured in a frame (`marker_error_px` is both, for the centroid of a disc); things smaller than four of a
face's texels; the float32 corners of the scene, a part in 1.7e7 of the distance from the middle of
the scene; the scene's own polygons; grey levels.

To add a part: a function that returns a GeometricError, and its line in `_parts`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.face_lookup_error import (
    face_lookup_error,
    max_edge_displacement_texels,
)
from catoptra_server.planning.facet_error import facet_error, rim_gap
from catoptra_server.planning.geometric_error import GeometricError, apply_floor, sum_errors
from catoptra_server.planning.rounding_error import corner_error, rounding_error
from catoptra_server.planning.sampling_error import SamplingError, sampling_error
from catoptra_server.render.render_plan import RendererKind, RenderPlan
from catoptra_server.scene.mirror_mesh import Tessellation

__all__ = ["ErrorBound", "ErrorComponent", "GeometricError", "SamplingError", "error_bound"]


@dataclass(frozen=True, slots=True)
class ErrorComponent:
    """What one cause adds at most, and why."""

    name: str
    max_px: float
    reason: str


@dataclass(frozen=True, slots=True)
class ErrorBound:
    """The bound of a plan for a camera, and the parts that its geometric error is made of."""

    geometric: GeometricError
    sampling: SamplingError
    components: tuple[ErrorComponent, ...]

    @property
    def outline_error_px(self) -> float:
        """Return how far off any outline in a frame may be: displaced, and as samples leave it.

        This is the error that a tolerance is about, and the one number that frames carry.
        """
        return self.geometric.max_px + self.sampling.edge_error_px

    @property
    def marker_error_px(self) -> float:
        """Return how far off a marker's middle may be measured in a frame; from one pixel on."""
        return self.geometric.max_px + self.sampling.centroid_error_px

    def as_dict(self) -> dict[str, float]:
        """Return the numbers by name, for a header. A part is `<name>_px`; absent where unused."""
        geometric, sampling = self.geometric, self.sampling
        numbers = {
            "max_px": geometric.max_px,
            "rms_px": geometric.rms_px,
            "max_deg": geometric.max_deg,
            "rms_deg": geometric.rms_deg,
            "edge_px": sampling.edge_error_px,
            "outline_px": self.outline_error_px,
            "marker_px": self.marker_error_px,
        }
        if sampling.texel_footprint is not None:
            numbers["texels_per_px_min"] = sampling.texel_footprint.min_texels_per_px
            numbers["texels_per_px_median"] = sampling.texel_footprint.median_texels_per_px
            numbers["texels_per_px_max"] = sampling.texel_footprint.max_texels_per_px
        return numbers | {f"{part.name}_px": part.max_px for part in self.components}

    def __str__(self) -> str:
        geometric, sampling = self.geometric, self.sampling
        parts = ", ".join(f"{part.name} {part.max_px:.2g}" for part in self.components)
        text = (
            f"at most {geometric.max_px:.3g} px or {geometric.max_deg:.2g} deg off, "
            f"{geometric.rms_px:.2g} px rms ({parts}); samples leave {sampling.edge_error_px:.2g} px"
        )
        if sampling.texel_footprint is None:
            return text
        texels = f"{sampling.texel_footprint.min_texels_per_px:.2g} to {sampling.texel_footprint.max_texels_per_px:.2g} texels a px"
        return f"{text}; {texels}" + (
            ", more than its taps see" if sampling.is_undersampled else ""
        )


@lru_cache(maxsize=256)
def error_bound(camera: OmniCamera, plan: RenderPlan) -> ErrorBound:
    """Return the bound of a plan. Raises DomainError for polygons without a pinhole."""
    parts = _additive_components(camera, plan)
    geometric = sum_errors(error for _, error, _ in parts)
    if isinstance(plan.surface, Tessellation):
        gap = rim_gap(camera, plan.surface)
        geometric = apply_floor(geometric, gap)
        parts = (*parts, ("rim", gap, f"{plan.surface.sectors} straight sides end within it"))
    named = tuple(ErrorComponent(name, error.max_px, reason) for name, error, reason in parts)
    return ErrorBound(geometric, sampling_error(camera, plan), named)


_Component = tuple[str, GeometricError, str]


def _additive_components(camera: OmniCamera, plan: RenderPlan) -> tuple[_Component, ...]:
    """Return the name, the error and the reason of everything that adds up."""
    is_raster = plan.renderer is RendererKind.RASTER
    parts: list[_Component] = []
    if isinstance(plan.surface, Tessellation):
        parts.append(_facet_component(camera, plan.surface))
    if is_raster:
        parts.append(_face_component(camera, plan))
    if is_raster and isinstance(plan.surface, Tessellation):
        corners = corner_error(camera, plan.samples)
        parts.append(("corners", corners, "they stand on 256ths of the drawn pixels"))
    why = "float32 places in the atlas" if is_raster else "float32 rays, turned"
    return (*parts, ("rounding", rounding_error(camera, plan), why))


def _facet_component(camera: OmniCamera, tessellation: Tessellation) -> _Component:
    of = f"{tessellation.sectors} x {tessellation.rings} flat polygons"
    return (
        "polygons",
        facet_error(camera, tessellation),
        f"{of}, {tessellation.interpolation.value} between",
    )


def _face_component(camera: OmniCamera, plan: RenderPlan) -> _Component:
    error = face_lookup_error(camera, plan.face_regions, face_samples=plan.face_samples)
    moved = max_edge_displacement_texels(plan.face_samples)
    return (
        "faces",
        error,
        f"edges move by {moved:.2f} texels, the finest {plan.face_size_px} a face",
    )
