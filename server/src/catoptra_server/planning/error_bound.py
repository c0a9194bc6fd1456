"""Error bound of a plan: the largest distance by which its frames displace any outline.

Each sample of a frame shows the scene in some direction. `geometric` bounds the distance between
that sample and the pixel to which the camera model projects that direction, over the visible image,
in pixels and as an angle at the effective viewpoint. Camera and plan alone determine the bound of a
plan, before anything is rendered; each frame adds what its scene contributes.

The bound is a sum of named components:

| component | cause                                 | computed in                               |
|-----------|---------------------------------------|-------------------------------------------|
| polygons  | interpolation over flat facets        | `facet_error`: on the mesh, in float64    |
| rim       | a mesh that ends within the rim       | `facet_error.rim_gap`: closed form        |
| faces     | texels between viewpoint and mirror   | `face_lookup_error`: half a texel's image |
| corners   | mesh corners on the rasterizer's grid | `rounding_error.corner_error`             |
| rounding  | float32 directions and atlas          | `rounding_error`                          |
| scene     | float32 coordinates of the scene      | `rounding_error.scene_error`: each frame  |

All but the rim add up: beyond the end of the mesh nothing is shown that could be displaced as well,
so the rim is a lower limit of the total rather than a summand.

Not included: the spacing of the samples, which is `sampling` and adds to any measurement in a frame
(`marker_error_px` is both, for the centroid of a disc); objects smaller than four of a face's
texels; the tessellation of the scene itself; grey levels.

To add a component: a function that returns a GeometricError, and its line in
`_additive_components`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.planning.face_lookup_error import (
    face_lookup_error,
    max_edge_displacement_texels,
)
from catoptra_server.planning.facet_error import facet_error, facet_error_by_radius, rim_gap
from catoptra_server.planning.geometric_error import GeometricError, apply_floor, sum_errors
from catoptra_server.planning.rounding_error import corner_error, rounding_error, scene_error
from catoptra_server.planning.sampling_error import SamplingError, sampling_error
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.world.mirror_mesh import Tessellation

__all__ = ["ErrorBound", "ErrorComponent", "GeometricError", "SamplingError", "error_bound"]


@dataclass(frozen=True, slots=True)
class ErrorComponent:
    """Contribution of one cause."""

    name: str
    max_px: float
    """Largest displacement by this cause alone."""
    reason: str


@dataclass(frozen=True, slots=True)
class ErrorBound:
    """Bound of a plan for a camera."""

    geometric: GeometricError
    """Displacement of samples, all components together."""
    sampling: SamplingError
    """Further displacement by the spacing of the samples."""
    components: tuple[ErrorComponent, ...]
    """Components of the geometric error."""
    rim_radius_px: float
    polygons_by_radius_px: tuple[float, ...] = ()
    """Displacement by flat facets in rings of equal width, from the centre to the rim; empty for
    the exact model."""

    @property
    def outline_error_px(self) -> float:
        """Largest displacement of an outline: geometric error and sampling.

        An accuracy target limits this number, and every frame carries it.
        """
        return self.geometric.max_px + self.sampling.edge_error_px

    def outline_error_at_px(self, radius: float) -> float:
        """Largest displacement of an outline at a place in the image.

        Args:
            radius: Distance from the image centre over that of the rim, 0 to 1.
        """
        rings = self.polygons_by_radius_px
        if not rings:
            return self.outline_error_px
        own_px = rings[min(int(radius * len(rings)), len(rings) - 1)]
        others_px = sum(p.max_px for p in self.components if p.name not in ("polygons", "rim"))
        rim_px = next(p.max_px for p in self.components if p.name == "rim")
        # Straight sides cut into the outermost part of the image alone. Its ring is one wider.
        rim_ring = 1.0 - rim_px / self.rim_radius_px - 1.0 / len(rings)
        geometric_px = max(own_px + others_px, rim_px if radius >= rim_ring else 0.0)
        return geometric_px + self.sampling.edge_error_px

    @property
    def marker_error_px(self) -> float:
        """Largest error of the measured centre of a marker of at least one pixel."""
        return self.geometric.max_px + self.sampling.centroid_error_px

    def as_dict(self) -> dict[str, float]:
        """All numbers by their names in a frame header; a component is `<name>_px`."""
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
        footprint = sampling.texel_footprint
        if footprint is not None:
            numbers["texels_per_px_min"] = footprint.min_texels_per_px
            numbers["texels_per_px_median"] = footprint.median_texels_per_px
            numbers["texels_per_px_max"] = footprint.max_texels_per_px
        return numbers | {f"{part.name}_px": part.max_px for part in self.components}

    def __str__(self) -> str:
        geometric, sampling = self.geometric, self.sampling
        parts = ", ".join(f"{part.name} {part.max_px:.2g}" for part in self.components)
        text = (
            f"displaced by at most {geometric.max_px:.3g} px or {geometric.max_deg:.2g} deg, "
            f"{geometric.rms_px:.2g} px rms ({parts}); samples add {sampling.edge_error_px:.2g} px"
        )
        footprint = sampling.texel_footprint
        if footprint is None:
            return text
        density = f"{footprint.min_texels_per_px:.2g} to {footprint.max_texels_per_px:.2g}"
        undersampled = ", undersampled" if sampling.is_undersampled else ""
        return f"{text}; {density} texels a px{undersampled}"


# Candidates of a target are some 130 plans a camera; two cameras' fit. 3 to 27 ms at 640 px, 2
# microseconds from the cache.
@lru_cache(maxsize=256)
def error_bound(camera: OmniCamera, plan: RenderPlan) -> ErrorBound:
    """Error bound of a plan for a camera.

    Raises:
        DomainError: A mirror mesh under an orthographic camera, which has no pinhole.
    """
    components = _additive_components(camera, plan)
    geometric = sum_errors(error for _, error, _ in components)
    if isinstance(plan.surface, Tessellation):
        gap = rim_gap(camera, plan.surface)
        geometric = apply_floor(geometric, gap)
        reason = f"{plan.surface.sectors} straight sides end within the rim"
        components = (*components, ("rim", gap, reason))
    named = tuple(ErrorComponent(name, error.max_px, reason) for name, error, reason in components)
    return ErrorBound(
        geometric,
        sampling_error(camera, plan),
        named,
        camera.rim_radius_px,
        facet_error_by_radius(camera, plan.surface)
        if isinstance(plan.surface, Tessellation)
        else (),
    )


def add_scene(bound: ErrorBound, camera: OmniCamera, angle_rad: float) -> ErrorBound:
    """Bound of a frame, from that of its plan.

    Args:
        camera: The plan's camera.
        angle_rad: Largest displacement by the scene's coordinates
            (`bounds/coordinate_rounding`).
    """
    error = scene_error(camera, angle_rad)
    reason = "float32 coordinates of corners and viewpoint"
    return replace(
        bound,
        geometric=sum_errors((bound.geometric, error)),
        components=(*bound.components, ErrorComponent("scene", error.max_px, reason)),
    )


_Component = tuple[str, GeometricError, str]  # name, error, reason


def _additive_components(camera: OmniCamera, plan: RenderPlan) -> tuple[_Component, ...]:
    """Components that add up."""
    has_faces, has_mesh = plan.renderer.uses_faces, isinstance(plan.surface, Tessellation)
    components: list[_Component] = []
    if isinstance(plan.surface, Tessellation):
        components.append(_facet_component(camera, plan.surface))
    if has_faces:
        components.append(_face_component(camera, plan))
    # Trace intersects no rasterized corner: its mesh is evaluated in float64 at each sample.
    if has_faces and has_mesh:
        corners = corner_error(camera, plan.samples)
        components.append(("corners", corners, "snapped to 256ths of the rendered pixels"))
    cause = "float32 atlas coordinates" if has_faces else "float32 rays, rotated"
    return (*components, ("rounding", rounding_error(camera, plan), cause))


def _facet_component(camera: OmniCamera, tessellation: Tessellation) -> _Component:
    size = f"{tessellation.sectors} x {tessellation.rings} flat polygons"
    reason = f"{size}, {tessellation.interpolation.value} interpolated"
    return "polygons", facet_error(camera, tessellation), reason


def _face_component(camera: OmniCamera, plan: RenderPlan) -> _Component:
    error = face_lookup_error(camera, plan.face_regions, face_samples=plan.face_samples)
    displacement = max_edge_displacement_texels(plan.face_samples)
    reason = f"edges move by {displacement:.2f} texels, the finest {plan.face_size_px} a face"
    return "faces", error, reason
