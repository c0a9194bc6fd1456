"""The kernel's structures in ctypes: twins of `src/kernel.h`, member by member.

Pointers are plain addresses of NumPy arrays; whoever fills a structure keeps the arrays alive.
"""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_float, c_int32, c_int64, c_uint32, c_void_p
from typing import ClassVar

OUTPUT_SRGB, OUTPUT_LINEAR, OUTPUT_HITS, OUTPUT_LABELS, OUTPUT_FLOW = range(5)
FACET_UNLIT, FACET_TEXTURED, FACET_CORNER_COLOURS, FACET_GLOSSY = 1, 2, 4, 8
FACET_EMISSIVE, FACET_SMOOTH, FACET_TWO_SIDED, FACET_FILTERED = 16, 32, 64, 128
LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_RECTANGLE = 0, 1, 2
REST_FOUND, REST_ALOFT, REST_OVER, REST_NEEDS_TRIANGLES, REST_NO_MEMORY = range(5)
SAMPLE_CLAMP_U, SAMPLE_CLAMP_V, SAMPLE_NEAREST = 1, 2, 4

# ctypes' own annotation of `_fields_` is a list of pairs.
Fields = list[tuple[str, type]]


def _addresses(*names: str) -> Fields:
    """Members that are pointers, one after the other."""
    return [(name, c_void_p) for name in names]


class MeshArrays(ctypes.Structure):
    """Triangles and their materials."""

    _fields_: ClassVar[Fields] = [
        ("num_triangles", c_int32),
        *_addresses("corners", "normals", "albedo", "flags", "corner_albedo", "uv"),
        *_addresses(
            "uv_rows",
            "texture",
            "fine_corners",
            "emission",
            "corner_normals",
            "coverage",
            "blended",
        ),
        *_addresses("textures", "gloss"),
    ]


class TextureLevelStruct(ctypes.Structure):
    """Texels of an image, or of a coarser level."""

    _fields_: ClassVar[Fields] = [
        ("width", c_int32),
        ("height", c_int32),
        *_addresses("texels", "light"),
    ]


class TextureStruct(ctypes.Structure):
    """A texture at all its levels."""

    _fields_: ClassVar[Fields] = [
        ("num_levels", c_int32),
        ("sampling", c_int32),
        ("channels", c_int32),
        ("levels", c_void_p),
    ]


class LightStruct(ctypes.Structure):
    """Directional or point light."""

    _fields_: ClassVar[Fields] = [
        ("kind", c_int32),
        ("lights_scene", c_int32),
        ("position", c_double * 3),
        ("vector", c_float * 3),
        ("intensity", c_float * 3),
    ]


class HemisphereStruct(ctypes.Structure):
    """Irradiance from above and below."""

    _fields_: ClassVar[Fields] = [("up", c_float * 3), ("down", c_float * 3)]


class FacetSource(ctypes.Structure):
    """What flat surfaces are found by."""

    _fields_: ClassVar[Fields] = [
        ("num_triangles", c_int32),
        ("centre", c_double * 3),
        *_addresses("corners", "normals", "albedo", "uv", "texture", "object"),
        *_addresses("unlit", "has_colours"),
    ]


class SurfacesStruct(ctypes.Structure):
    """Flat surfaces."""

    _fields_: ClassVar[Fields] = [
        ("num_surfaces", c_int32),
        *_addresses("surface", "outer_edges", "representative"),
    ]


class OcclusionPatchStruct(ctypes.Structure):
    """A grid of factors of hemisphere light."""

    _fields_: ClassVar[Fields] = [
        ("column", c_float * 4),
        ("row", c_float * 4),
        ("left", c_int32),
        ("top", c_int32),
        ("right", c_int32),
        ("bottom", c_int32),
        ("offset", c_double * 2),
    ]


class OcclusionStruct(ctypes.Structure):
    """Ambient occlusion of the static scene."""

    _fields_: ClassVar[Fields] = [
        ("width", c_int32),
        ("height", c_int32),
        *_addresses("texels", "light", "patch_of", "patches"),
        ("num_patches", c_int32),
        *_addresses("dark_sums", "flat_factors", "means"),
    ]


class SceneStruct(ctypes.Structure):
    """Static scene, its lights and tables."""

    _fields_: ClassVar[Fields] = [
        *_addresses("mesh", "casters", "sharp_radiance", "ambient_radiance", "encoded"),
        ("num_textures", c_int32),
        ("textures", c_void_p),
        ("num_lights", c_int32),
        ("lights", c_void_p),
        ("hemisphere", HemisphereStruct),
        ("object_hemisphere", HemisphereStruct),
        *_addresses("srgb_table", "caster_triangles", "light_maps"),
        ("surfaces", SurfacesStruct),
        ("occlusion", OcclusionStruct),
        ("sky", c_void_p),
        ("sky_size", c_int32),
    ]


class RayTableStruct(ctypes.Structure):
    """Rays of a camera."""

    _fields_: ClassVar[Fields] = [
        ("width_px", c_int32),
        ("height_px", c_int32),
        ("samples", c_int32),
        ("num_tiles", c_int32),
        ("tile_columns", c_int32),
        *_addresses("tiles", "directions", "valid", "origins", "times"),
    ]


class PoseStruct(ctypes.Structure):
    """Rotation, row by row, and translation."""

    _fields_: ClassVar[Fields] = [("rotation", c_float * 9), ("translation", c_float * 3)]


class LabelsStruct(ctypes.Structure):
    """Channels of labels."""

    _fields_: ClassVar[Fields] = [
        ("centres", RayTableStruct),
        *_addresses("centre_tile", "is_held", "triangle_numbers", "object_numbers", "class_table"),
        ("centre", c_double * 3),
        *_addresses("range_m", "normal", "point", "ids", "classes", "agreement"),
    ]


class FlowStruct(ctypes.Structure):
    """Points and projection of an optical flow."""

    _fields_: ClassVar[Fields] = [
        *_addresses("points", "ids", "motion_of", "motions"),
        ("centre", c_double * 3),
        ("num_nodes", c_int32),
        ("first", c_float),
        ("last", c_float),
        ("nodes_per_unit", c_float),
        *_addresses("radius_px", "origin_r", "origin_z"),
        ("axes", c_float * 4),
        ("centre_px", c_float * 2),
        ("flow", c_void_p),
    ]


class ChangeLimits(ctypes.Structure):
    """Change that nobody misses."""

    _fields_: ClassVar[Fields] = [
        ("max_change", c_float),
        ("plain_change", c_float),
        ("max_visible", c_int32),
    ]


class PixelChange(ctypes.Structure):
    """Change by an effect."""

    _fields_: ClassVar[Fields] = [("largest", c_float), ("num_visible", c_int32)]


class FrameStruct(ctypes.Structure):
    """One exposure and its outputs."""

    _fields_: ClassVar[Fields] = [
        ("origin", c_double * 3),
        ("num_poses", c_int32),
        ("camera", c_void_p),
        ("num_objects", c_int32),
        ("objects", c_void_p),
        ("object_poses", c_void_p),
        ("object_light", c_void_p),
        ("shades", c_void_p),
        ("num_boxes", c_int32),
        ("boxes", c_void_p),
        ("box_object", c_void_p),
        ("has_shadows", c_int32),
        ("measures_shadows", c_int32),
        ("ends_measures", c_int32),
        ("limits", ChangeLimits),
        ("watched_object", c_int32),
        ("has_few_rays", c_int32),
        ("output", c_int32),
        *_addresses("image", "range_m", "triangle", "object", "inverse_range"),
        ("exposure", c_float),
        ("readout", c_float),
        ("blur_threshold", c_float),
        ("least_gain", c_float),
        ("largest_gain", c_float),
        ("spill", c_float * 2),
        ("max_instants", c_int32),
        ("fog_density", c_float),
        ("airlight", c_float * 3),
        ("measures_fog", c_int32),
        ("has_gloss", c_int32),
        ("measures_gloss", c_int32),
        ("gloss_limit", c_float),
        ("brightest", c_float),
        ("labels", c_void_p),
        ("flow", c_void_p),
    ]


class FrameCounts(ctypes.Structure):
    """Counts of a frame."""

    _fields_: ClassVar[Fields] = [
        ("num_filled_tiles", c_int32),
        ("num_tiles", c_int32),
        ("shadow_change", PixelChange),
        ("shows_watched", c_int32),
        ("drops_layers", c_int32),
        ("watched_change", PixelChange),
        ("num_blurred_tiles", c_int32),
        ("num_instants", c_int32),
        ("num_blur_rays", c_int64),
        ("blur_change", PixelChange),
        ("rolling_change", PixelChange),
        ("blur_ms", c_float),
        ("fog_change", PixelChange),
        ("gloss_change", PixelChange),
        ("light_change", PixelChange),
        ("ended_measures", c_int32),
    ]


class ImageStage(ctypes.Structure):
    """One change of an image; `src/image.h` has the meaning of numbers and maps by kind."""

    _fields_: ClassVar[Fields] = [
        ("kind", c_int32),
        ("size", c_int32),
        ("num_rows", c_int32),
        ("limits", ChangeLimits),
        ("least_gain", c_float),
        ("largest_gain", c_float),
        ("spill", c_float * 2),
        ("numbers", c_float * 4),
        ("key", c_uint32 * 4),
        ("maps", c_void_p * 4),
        ("change", PixelChange),
        ("other_change", PixelChange),
        ("deferred", c_void_p),
        ("ms", c_double),
    ]


class ImageJob(ctypes.Structure):
    """An image, its stages and outputs."""

    _fields_: ClassVar[Fields] = [
        ("width", c_int32),
        ("height", c_int32),
        *_addresses("light", "linear", "rgb", "srgb_table", "quantiles"),
        ("mirror_pixels", c_int32),
        ("num_stages", c_int32),
        ("stages", c_void_p),
        ("scratch", c_void_p),
        ("encode_ms", c_double),
    ]


class StanceStruct(ctypes.Structure):
    """A plane on which a body rests, and its heading."""

    _fields_: ClassVar[Fields] = [
        (name, c_double) for name in ("x", "y", "z", "slope_x", "slope_y", "cosine", "sine")
    ]


class RestingSide(ctypes.Structure):
    """One side of a body."""

    _fields_: ClassVar[Fields] = [
        ("num_points", c_int32),
        ("num_wheels", c_int32),
        *_addresses("points", "lifts", "wheels"),
        ("half", c_double * 2),
        ("rise", c_double),
        ("radius", c_double),
        ("origin", c_double * 3),
    ]


class SinkingStruct(ctypes.Structure):
    """A body that sinks."""

    _fields_: ClassVar[Fields] = [
        ("mesh", c_void_p),
        ("centre", c_double * 3),
        *_addresses("side", "triangles", "boxes"),
        ("num_triangles", c_int32),
        ("num_boxes", c_int32),
        *((name, StanceStruct) for name in ("stance", "goal", "before", "near")),
        *((name, c_double) for name in ("sink", "calm", "floor_z")),
        ("contacts", c_int32 * 3),
        *((name, c_int32) for name in ("is_lifted", "num_steps", "has_moved", "is_even")),
        *((name, c_int32) for name in ("touching", "is_on_robot")),
    ]


class BakeLamp(ctypes.Structure):
    """A light that the nodes of grids see."""

    _fields_: ClassVar[Fields] = [
        ("kind", c_int32),
        ("column", c_int32),
        ("area", c_float),
        ("power", c_float),
        ("corner", c_double * 3),
        ("side_x", c_float * 3),
        ("side_y", c_float * 3),
        ("normal", c_float * 3),
    ]


class BakeJob(ctypes.Structure):
    """One pass of rays from the nodes of grids."""

    _fields_: ClassVar[Fields] = [
        *_addresses("mesh", "casters"),
        ("num_nodes", c_int32),
        ("first_probe", c_int32),
        *_addresses("positions", "grid", "axes", "normals", "grid_of", "slot_of", "patches"),
        ("width", c_int32),
        ("sky_slot", c_int32),
        ("sky_side", c_int32),
        ("pass_number", c_uint32),
        ("num_rays", c_int32),
        *_addresses("sequence", "turns", "hits", "backs"),
        ("num_lamps", c_int32),
        ("num_columns", c_int32),
        *_addresses("lamps", "light"),
    ]


class GatherJob(ctypes.Structure):
    """Means of radiance over stored hits."""

    _fields_: ClassVar[Fields] = [
        ("num_nodes", c_int32),
        ("num_rays", c_int32),
        *_addresses("hits", "radiance", "means"),
    ]


# In the order of `catoptra_abi`.
STRUCTURES: tuple[type[ctypes.Structure], ...] = (
    MeshArrays,
    TextureLevelStruct,
    TextureStruct,
    LightStruct,
    FacetSource,
    SurfacesStruct,
    OcclusionPatchStruct,
    OcclusionStruct,
    SceneStruct,
    RayTableStruct,
    PoseStruct,
    LabelsStruct,
    FlowStruct,
    ChangeLimits,
    PixelChange,
    FrameStruct,
    FrameCounts,
    ImageStage,
    ImageJob,
    RestingSide,
    SinkingStruct,
    BakeLamp,
    BakeJob,
    GatherJob,
)
