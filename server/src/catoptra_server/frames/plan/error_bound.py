"""Error bound of a plan: the largest displacement of any outline in a frame.

Each sample of a frame shows the scene in some direction. `geometric` bounds the distance between
that sample and the pixel to which the camera model projects that direction, over the visible image,
in pixels and as an angle at the effective viewpoint. Camera and plan alone determine the bound of a
plan, before anything is rendered; each frame adds the share of the scene. A bound, not an estimate:
tests compare it with every ray of trace and with silhouettes of raster. None is ever exceeded, or
twice the largest error seen. 3 to 27 ms at 640 px, 2 microseconds when cached.

| component | cause                                 | computed in                                  |
|-----------|---------------------------------------|----------------------------------------------|
| polygons  | interpolation over flat facets        | `facet_error.py`: on the mesh, in float64    |
| rim       | a mesh that ends within the rim       | `facet_error.py:rim_gap`: closed form        |
| faces     | texels between viewpoint and mirror   | here: half a texel's image                   |
| corners   | mesh corners on the rasterizer's grid | here                                         |
| rounding  | float32 directions and atlas          | here                                         |
| scene     | float32 coordinates of the scene      | `effects/bounds/coordinate_rounding.py`      |
|           | one viewpoint for rays that miss it   | here: in closed form for each ring           |

All but the rim add up, in each of 64 rings of the image, and the largest ring is the bound. Beyond
the end of the mesh nothing is shown that could be displaced as well, so the rim is a lower limit of
the total rather than a summand. Not included: the spacing of the
samples, which is `sampling` and adds to any measurement in a frame (`marker_error_px` is both, for
the centroid of a disc); objects smaller than four of a face's texels; the tessellation of the scene
itself; grey levels.

Faces. A texel holds the mean of some samples, and the image a bilinear mix of four texels; a
straight edge appears where that mix passes one half. With one sample a texel the edge is displaced
by at most half a texel. For let L be the signed distance from the edge at the texel centres, and w
the bilinear weights at a point with L(point) = sum w L and half of the weight on centres with L >
0: the largest such L(point) within a square of centres is 1/2, for an edge along the texels. Texels
need not be square for that. With more samples a texel holds steps of coverage, and the displacement
depends on the sample pattern. An object smaller than a texel may be missed, and corners are rounded
off (the tip of a right angle by 0.7 texels); that displaces nothing of the remainder. The bound is
for edges with a radius of curvature of at least two texels.

Rounding. Trace and the shader of mirror meshes hold directions as float32, each component rounded
to a part in 2^24 =: 1 / u. A direction that is off by an angle is displaced by that angle times at
most `max_px_per_rad`, so all that remains is the number of u. Raster also holds coordinates in the
atlas, as fractions of its width. What the scene's coordinates displace depends on the viewpoint and
on what is near: thousandths of a pixel in the bundled worlds.

Samples. A sample stands for a square of the image, so an outline is displaced by half a square's
diagonal at most, in any direction and for any shape. A frame keeps the mean of each pixel's
samples: the centroid of a disc is displaced by the samples no more than its outline, and a little
by the pixels. With texels denser than samples, one bilinear lookup a sample skips texels, and small
objects flicker or vanish; with texels sparser than samples, the image is blurred.

To add a component: a function that returns a GeometricError, and its line in
`_additive_components`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.elementary import (
    arctan,
    arctan2,
    cos,
    hypot,
    interpolate_linear,
    sin,
)
from catoptra_protocol.optics.image_plane import compute_image_scale, visible_radii_px
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.bounds.coordinate_rounding import UNIT_ROUNDOFF, CoordinateErrors
from catoptra_server.frames.plan.faces import TexelFootprint, texel_footprint
from catoptra_server.frames.plan.facet_error import (
    NUM_RADII,
    GeometricError,
    apply_floor,
    facet_errors,
    max_by_radius,
    rim_gap,
    sum_errors,
    weighted_rms,
)
from catoptra_server.render.projection.large_triangles import MAX_SIZE_PER_DISTANCE
from catoptra_server.render.renderer import FaceRegion, PerPixel, RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Tessellation


@dataclass(frozen=True, slots=True)
class ErrorBound:
    """Bound of a plan for a camera."""

    geometric: GeometricError
    """Displacement of samples, all components together."""
    sampling: _SamplingError
    """Further displacement by the spacing of the samples."""
    components: tuple[_ErrorComponent, ...]
    """Components of the geometric error."""
    rim_radius_px: float
    model_px: float = 0.0
    """How far the model may be from the calibrated lens, which no plan changes; 0: not stated."""

    @property
    def outline_error_px(self) -> float:
        """Largest displacement of an outline: geometric error and sampling.

        An accuracy target limits this number, which every frame carries.
        """
        return self.geometric.max_px + self.sampling.edge_error_px

    def outline_error_at_px(self, radius: float) -> float:
        """Largest displacement of an outline at a place in the image.

        Args:
            radius: Distance from the image centre, over the rim's, 0 to 1.
        """
        rim_px = next((part.max_px for part in self.components if part.name == "rim"), 0.0)
        # Straight sides cut into the outermost part of the image alone. Its ring is one wider.
        rim_ring = 1.0 - rim_px / self.rim_radius_px - 1.0 / NUM_RADII
        geometric_px = max(self.geometric.at_px(radius), rim_px if radius >= rim_ring else 0.0)
        return geometric_px + self.sampling.edge_error_px

    @property
    def marker_error_px(self) -> float:
        """Largest error of the measured centre of a marker of at least one pixel."""
        return self.geometric.max_px + self.sampling.centroid_error_px

    def numbers_by_name(self) -> dict[str, float]:
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
        if self.model_px > 0.0:
            numbers["model_px"] = self.model_px
        return numbers | {f"{part.name}_px": part.max_px for part in self.components}

    @property
    def _parts(self) -> tuple[_ErrorComponent, ...]:
        """Parts of the outline's error, that of the samples last."""
        samples = self.sampling.samples
        reason = f"{samples} x {samples} samples a pixel: more would help"
        return *self.components, _ErrorComponent("edge", self.sampling.edge_error_px, reason)

    def explain_size(self) -> str:
        """Total and largest part, with what would make that smaller."""
        part = max(self._parts, key=lambda one: one.max_px)
        return f"{part.name} {part.max_px:.3g} of {self.outline_error_px:.3g} px ({part.reason})"

    def __str__(self) -> str:
        geometric, footprint = self.geometric, self.sampling.texel_footprint
        parts = ", ".join(f"{part.name} {part.max_px:.2g}" for part in self._parts)
        text = (
            f"outlines are displaced by at most {self.outline_error_px:.3g} px ({parts}), samples "
            f"by {geometric.max_px:.3g} px or {geometric.max_deg:.2g} deg, "
            f"{geometric.rms_px:.2g} px rms"
        )
        if self.model_px > 0.0:
            text += f"; the model may be {self.model_px:.2g} px from the lens"
        if footprint is None:
            return text
        density = f"{footprint.min_texels_per_px:.2g} to {footprint.max_texels_per_px:.2g}"
        undersampled = ", undersampled" if self.sampling.is_undersampled else ""
        return f"{text}; {density} texels a px{undersampled}"


@dataclass(frozen=True, slots=True)
class _ErrorComponent:
    """Contribution of one cause."""

    name: str
    max_px: float
    """Largest displacement by this cause alone."""
    reason: str
    """The cause, and what would make it smaller."""


# Largest displacement of the centroid of a disc one pixel wide, in the limit of infinitely many
# samples; less for larger discs. Searched in tests/server/frames/plan/test_error_bound.py.
_PIXEL_CENTROID_ERROR_PX = 0.07


@dataclass(frozen=True, slots=True)
class _SamplingError:
    """Error of a plan's samples."""

    samples: int
    """Samples along a pixel's side."""
    edge_error_px: float
    """Largest displacement of an outline."""
    texel_footprint: TexelFootprint | None
    """Texels of the faces; None without faces."""

    @property
    def centroid_error_px(self) -> float:
        """Largest displacement of the measured centroid of a disc of one pixel or more."""
        return self.edge_error_px + _PIXEL_CENTROID_ERROR_PX

    @property
    def minification(self) -> float:
        """Largest number of texels from one sample to the next; 0 without faces."""
        return (
            self.texel_footprint.max_texels_per_px / self.samples if self.texel_footprint else 0.0
        )

    @property
    def is_undersampled(self) -> bool:
        """Whether one lookup a sample skips texels anywhere in the image."""
        return self.minification > 1.0


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
        reason = f"{plan.surface.sectors} straight sides end within the rim: more would help"
        components = (*components, ("rim", gap, reason))
    named = tuple(_ErrorComponent(name, error.max_px, reason) for name, error, reason in components)
    return ErrorBound(
        geometric,
        _SamplingError(
            plan.samples,
            math.sqrt(0.5) / plan.samples,
            texel_footprint(camera, plan.face_regions) if plan.renderer.uses_faces else None,
        ),
        named,
        camera.rim_radius_px,
        camera.model_error_px,
    )


def add_scene(bound: ErrorBound, scene: GeometricError) -> ErrorBound:
    """Bound of a frame, from the plan's and the displacement by the scene's coordinates."""
    reason = "float32 coordinates of near or large triangles: smaller ones or distance would help"
    return replace(
        bound,
        geometric=sum_errors((bound.geometric, scene)),
        components=(*bound.components, _ErrorComponent("scene", scene.max_px, reason)),
    )


# In ordinary worlds and in large ones (`SceneMesh.is_large`). Corners and viewpoint are rounded
# once each, relative to the scene's centre; the arithmetic of rays adds its own: rectangles with an
# edge 2 cm to 5 m from the viewpoint were displaced by 1.0 times their size over distance, rounding
# of corners included. In large worlds corners are met in float64 relative to the camera: no outline
# of 200 km was displaced (tests/server/render/test_scene_rounding.py), whatever a triangle's size;
# objects are rounded in frames of their own.
_TRACE_COORDINATES = (
    CoordinateErrors(position_ulps=2.0, size_ulps=4.0, object_ulps=8.0),
    CoordinateErrors(0.0, size_ulps=1.0, max_size_per_distance=0.0, object_ulps=8.0),
)
# Positions have 48 bits until the viewpoint is subtracted. What is left are products of that
# difference, and the rasterizer's clipping. Of a thousand edges of rectangles of up to 200 km, seen
# through narrow lenses by llvmpipe, the worst was displaced by 0.37 times its size over distance,
# just below the limit; split ones by a tenth of that (tests/server/render/test_scene_rounding.py).
_RASTER_COORDINATES = CoordinateErrors(
    position_ulps=0.0, size_ulps=1.0, max_size_per_distance=MAX_SIZE_PER_DISTANCE
)


def coordinate_errors(renderer: RendererKind, *, is_large: bool) -> CoordinateErrors:
    """Errors of a renderer's coordinates of a scene."""
    return _RASTER_COORDINATES if renderer.uses_faces else _TRACE_COORDINATES[is_large]


@dataclass(frozen=True, slots=True)
class SceneDisplacement:
    """Displacement of a scene's points, seen from a viewpoint."""

    angle_rad: float
    """Largest by a renderer's coordinates."""
    nearest_m: float = math.inf
    """Distance of the nearest point, or less: what a missing viewpoint displaces."""


def scene_error(
    camera: OmniCamera, renderer: RendererKind, scene: SceneDisplacement
) -> GeometricError:
    """The scene's part of the bound of a renderer's frames."""
    by_coordinates = angle_error(camera, scene.angle_rad)
    has_viewpoint = renderer.uses_faces or camera.is_approximated
    if not has_viewpoint or not isinstance(camera.projection, NonCentralMirror):
        return by_coordinates
    return sum_errors((by_coordinates, _miss_error(camera, camera.projection, scene.nearest_m)))


@lru_cache(maxsize=64)
def _miss_error(camera: OmniCamera, mirror: NonCentralMirror, nearest_m: float) -> GeometricError:
    """Displacement of points on the mirror's rays that are taken for rays of its viewpoint.

    What is drawn within the image counts, and what belongs there.
    """
    radius_px = np.linspace(0.0, camera.rim_radius_px, 4 * NUM_RADII + 1)
    t, r, z = mirror.ray_from_radius_ratio(radius_px / camera.scale_px)
    theta = 2.0 * arctan(np.minimum(t, camera.rim_t))
    turn_rad = _viewpoint_turn(theta, r, z, nearest_m)
    # Farther points of the same ray are drawn up to the rim. Across the axis radii are negative.
    seen_rad = np.clip(theta + turn_rad, -camera.rim_rad, camera.rim_rad)
    drawn_rad = np.maximum(np.abs(seen_rad), theta[0])
    # Between rays a line and a step of Newton's: good to 1e-4 of an error, in 3 to 13 ms instead
    # of 4 to 44 by the exact inverse.
    near_px = interpolate_linear(drawn_rad, theta, radius_px)
    near_t, _, _ = mirror.ray_from_radius_ratio(near_px / camera.scale_px)
    slope_px = interpolate_linear(drawn_rad, theta, np.gradient(radius_px, theta))
    drawn_px = near_px + slope_px * (drawn_rad - 2.0 * arctan(np.minimum(near_t, camera.rim_t)))
    error_px = camera.max_stretch * np.abs(np.copysign(drawn_px, seen_rad) - radius_px)
    # Between two rays a kink, where the rim or a cone's apex ends the image, is no higher than the
    # slope beside it leads.
    steps_px = np.abs(np.diff(error_px))
    largest_px = error_px + np.maximum(np.append(steps_px, 0.0), np.append(0.0, steps_px))
    low_px, high_px = np.minimum(radius_px, drawn_px), np.maximum(radius_px, drawn_px)
    first_px, last_px = visible_radii_px(camera)
    is_visible = (low_px <= last_px) & (high_px >= first_px)
    # From the pixel of the model to the one that is drawn, and in the rings beside.
    px_per_ring, ring = camera.rim_radius_px / NUM_RADII, np.arange(NUM_RADII)[:, None]
    reaches = (low_px < (ring + 2) * px_per_ring) & (high_px >= (ring - 1) * px_per_ring)
    by_radius_px = np.where(is_visible & reaches, largest_px, 0.0).max(axis=1)
    weight = radius_px * is_visible
    return GeometricError(
        max_px=float(by_radius_px.max()),
        rms_px=weighted_rms(error_px, weight),
        max_deg=math.degrees(float(np.abs(turn_rad[is_visible]).max())),
        rms_deg=math.degrees(weighted_rms(turn_rad, weight)),
        by_radius_px=tuple(by_radius_px.tolist()),
    )


def _viewpoint_turn(theta: Floats, r: Floats, z: Floats, nearest_m: float) -> Floats:
    """(n,) angles by which points on rays seem farther from the axis, seen from the viewpoint.

    A point is seen at theta + arctan2(miss, ahead), the ray's distance from the viewpoint and the
    point's distance along it; of the nearest point that both ray and scene may have.

    Args:
        theta: Angles of the rays.
        r: Distances from the axis at which they begin, on the mirror.
        z: Heights there.
        nearest_m: Distance of the nearest point of the scene from the viewpoint, or less.
    """
    sine, cosine = sin(theta), cos(theta)
    miss_m = r * cosine - z * sine
    is_before = hypot(r, z) < nearest_m
    nearest_ahead_m = np.sqrt(np.where(is_before, nearest_m**2 - miss_m * miss_m, 0.0))
    turn_rad: Floats = arctan2(miss_m, np.where(is_before, nearest_ahead_m, r * sine + z * cosine))
    return turn_rad


_Component = tuple[str, GeometricError, str]  # name, error, reason


def _additive_components(camera: OmniCamera, plan: RenderPlan) -> tuple[_Component, ...]:
    """Components that add up."""
    has_faces, has_mesh = plan.renderer.uses_faces, isinstance(plan.surface, Tessellation)
    components: list[_Component] = []
    if isinstance(plan.surface, Tessellation):
        components.append(_facet_component(camera, plan.surface))
    if has_faces:
        components.append(_face_component(camera, plan))
    # Trace intersects no rasterized corner: the mesh is evaluated in float64 at each sample.
    if has_faces and has_mesh:
        corners = _corner_error(camera, plan.samples)
        cause = "snapped to 256ths of a sample: more samples would help"
        components.append(("corners", corners, cause))
    what = "atlas coordinates" if has_faces else "rays, rotated"
    cause = f"float32 {what}: a smaller image would help"
    return (*components, ("rounding", _rounding_error(camera, plan), cause))


def _facet_component(camera: OmniCamera, tessellation: Tessellation) -> _Component:
    size = f"{tessellation.sectors} x {tessellation.rings} flat polygons"
    reason = f"{size}, {tessellation.interpolation.value} interpolated"
    return "polygons", facet_errors(camera, tessellation), f"{reason}: more would help"


def _face_component(camera: OmniCamera, plan: RenderPlan) -> _Component:
    error = _face_lookup_error(camera, plan.face_regions, face_samples=plan.face_samples)
    displacement = _max_edge_displacement_texels(plan.face_samples)
    reason = f"edges move by {displacement:.2f} texels, the finest {plan.face_size_px} a face: "
    reason += "finer faces, or trace, would help"
    return "faces", error, reason


# Largest displacement in texels by samples a texel. 1: one half, and 1 / (8 * 2) by which an arc of
# radius two departs from a chord of one texel. More: the worst of arcs from radius two to straight,
# in the standard sample patterns of drivers, and a twentieth in reserve; searched in
# tests/server/frames/plan/test_error_bound.py.
_MAX_EDGE_DISPLACEMENT_TEXELS = {1: 0.5 + 1.0 / 16.0, 2: 0.50, 4: 0.38, 8: 0.32, 16: 0.29}
# Hardware holds triangle corners and texture coordinates in 256ths, rounded by half a step along
# both sides: twice sqrt(2) / 512.
_FIXED_POINT_TEXELS = math.sqrt(2.0) / 256.0


def _max_edge_displacement_texels(face_samples: int) -> float:
    """Largest displacement of an edge by texels; drivers take at least the requested samples."""
    tabulated = max(samples for samples in _MAX_EDGE_DISPLACEMENT_TEXELS if samples <= face_samples)
    return _MAX_EDGE_DISPLACEMENT_TEXELS[tabulated] + _FIXED_POINT_TEXELS


def _face_lookup_error(
    camera: OmniCamera, regions: tuple[FaceRegion, ...], *, face_samples: int
) -> GeometricError:
    """Displacement by the texels of face regions.

    The rms is of edges uniformly distributed between two texels: 1 / sqrt 3 of the maximum.
    """
    footprint = texel_footprint(camera, regions)
    displacement = _max_edge_displacement_texels(face_samples)
    rms = displacement / math.sqrt(3.0)
    return GeometricError(
        max_px=displacement * footprint.max_px,
        rms_px=rms * footprint.rms_px,
        max_deg=math.degrees(displacement * footprint.max_rad),
        rms_deg=math.degrees(rms * footprint.rms_rad),
        by_radius_px=tuple(displacement * px for px in footprint.by_radius_px),
    )


# Rounding errors of a handful of operations rarely all have one sign. Measured in rays: an rms of
# 0.51 u where the largest was 2.44 u.
_RMS_FRACTION_OF_MAX = 0.2
# Trace computes in float64 and rounds twice: a unit vector (at most 1 u), and the rotation into the
# world, three products and two sums of rounded factors, each at most 1 u of a component. All at
# their worst and in one direction would be 8.7 u; the largest of 40 million rays in 200 rotations
# was 2.4 u.
_TRACE_ULPS = 3.0
# The shader of a mesh interpolates the direction between corners: about ten operations, all
# well conditioned, each at most 1 u.
_SHADER_ULPS = 8.0
# An atlas coordinate is divided by the width, rounded, and multiplied again by the sampler: each at
# most 1 u of a width.
_ATLAS_ULPS = 3.0
# The rasterizer snaps corners to 256ths of a rendered pixel: half a step along both sides.
_CORNER_PX = math.sqrt(2.0) / 512.0


def _rounding_error(camera: OmniCamera, plan: RenderPlan) -> GeometricError:
    """Displacement by float32 directions and atlas coordinates."""
    if not plan.renderer.uses_faces:
        return angle_error(camera, _TRACE_ULPS * UNIT_ROUNDOFF)
    lookup = _atlas_coordinate_error(camera, plan.face_regions)
    # The exact mirror's lookup map is computed in float64 and stored: no direction is ever float32.
    if isinstance(plan.surface, PerPixel):
        return lookup
    return sum_errors((angle_error(camera, _SHADER_ULPS * UNIT_ROUNDOFF), lookup))


# All candidates of a target ask for two angles.
@lru_cache(maxsize=64)
def angle_error(camera: OmniCamera, angle_rad: float) -> GeometricError:
    """Displacement of directions that are off by an angle at most."""
    scale = compute_image_scale(camera)
    largest_px = angle_rad * np.maximum(scale.radial, scale.tangential)
    return GeometricError(
        max_px=angle_rad * scale.max_px_per_rad,
        rms_px=_RMS_FRACTION_OF_MAX * angle_rad * scale.rms_px_per_rad,
        max_deg=math.degrees(angle_rad),
        rms_deg=_RMS_FRACTION_OF_MAX * math.degrees(angle_rad),
        by_radius_px=max_by_radius(camera, scale.radius_px, largest_px),
    )


def _atlas_coordinate_error(camera: OmniCamera, regions: tuple[FaceRegion, ...]) -> GeometricError:
    """Displacement in the widest atlas that could be packed: all regions side by side."""
    # The packing is the renderer's and not known here; a wider atlas only makes the bound larger.
    displacement_texels = _ATLAS_ULPS * UNIT_ROUNDOFF * sum(max(r.size_texels) for r in regions)
    footprint = texel_footprint(camera, regions)
    return GeometricError(
        max_px=displacement_texels * footprint.max_px,
        rms_px=_RMS_FRACTION_OF_MAX * displacement_texels * footprint.rms_px,
        max_deg=math.degrees(displacement_texels * footprint.max_rad),
        rms_deg=_RMS_FRACTION_OF_MAX * math.degrees(displacement_texels * footprint.rms_rad),
        by_radius_px=tuple(displacement_texels * px for px in footprint.by_radius_px),
    )


def _corner_error(camera: OmniCamera, samples: int) -> GeometricError:
    """Displacement by the snapped corners of a rasterized mesh, with samples^2 a pixel."""
    max_px = _CORNER_PX / samples
    scale = compute_image_scale(camera)
    min_px_per_rad = float(min(scale.radial.min(), scale.tangential.min()))
    max_deg = math.degrees(max_px / min_px_per_rad)
    return GeometricError(
        max_px, _RMS_FRACTION_OF_MAX * max_px, max_deg, _RMS_FRACTION_OF_MAX * max_deg
    )
