/* The kernel's interface to Python: plain structures of pointers to NumPy's arrays.
 *
 * Python twin: kernel_structs.py, with the same members in the same order; `catoptra_abi` returns
 * the sizes that the library was compiled with. Whoever passes an array keeps it alive as long as
 * the object that it was passed for. All lengths are metres. Scene coordinates are those of the
 * world less the centre of the static scene; a frame's are those less its origin, the camera's
 * place in worlds that are large for float32, else zero.
 */
#ifndef CATOPTRA_KERNEL_H
#define CATOPTRA_KERNEL_H

#include <stddef.h>
#include <stdint.h>

#define CATOPTRA_EXPORT __attribute__((visibility("default")))

enum { TILE_PX = 4, BLOCK_RAYS = 16, MAX_SAMPLES = 16 };

enum {
    FACET_UNLIT = 1,
    FACET_TEXTURED = 2,
    FACET_CORNER_COLOURS = 4,
    FACET_GLOSSY = 8,
    FACET_EMISSIVE = 16,
    FACET_SMOOTH = 32,    /* lit by normals between those at its corners */
    FACET_TWO_SIDED = 64, /* its back is lit by the opposite normal */
    FACET_FILTERED = 128, /* it has holes, or from behind is none: unless FACET_TWO_SIDED */
    /* Facets whose radiance is computed at each point, whatever the lights. */
    FACET_COMPUTED = FACET_CORNER_COLOURS | FACET_EMISSIVE | FACET_SMOOTH
};

enum { LIGHT_DIRECTIONAL = 0, LIGHT_POINT = 1, LIGHT_RECTANGLE = 2 };

/* From OUTPUT_HITS on no light is computed. */
enum {
    OUTPUT_SRGB = 0,
    OUTPUT_LINEAR = 1,
    OUTPUT_HITS = 2,
    OUTPUT_LABELS = 3,
    OUTPUT_FLOW = 4
};

/* Object numbers: nothing, the static scene, 1 + index of a dynamic object, any of these. */
/* What a part of a frame may decide on. */
enum { MEASURE_SHADOWS = 1, MEASURE_LIGHT = 2, MEASURE_WATCHED = 4 };
enum { OBJECT_NONE = -1, OBJECT_STATIC = 0, OBJECT_ANY = INT32_MAX };

typedef struct Device Device;
typedef struct Mesh Mesh;
typedef struct View View;

/* The image or a coarser level: linear light as uint16, 65535 = white, or the image's sRGB bytes;
 * (height + 2, width + 2, channels), with a border of one texel repeated from the other side, and
 * one readable number behind the last. */
typedef struct {
    int32_t width, height; /* without border */
    const void *texels;
    const float *light; /* (256,) linear light of sRGB bytes, 65535 = white; NULL for uint16 */
} TextureLevel;

enum { SAMPLE_CLAMP_U = 1, SAMPLE_CLAMP_V = 2, SAMPLE_NEAREST = 4 };

typedef struct {
    int32_t num_levels;
    int32_t sampling; /* SAMPLE_... bits; 0: it repeats, and is interpolated */
    int32_t channels; /* 3, or 4 with opacity */
    const TextureLevel *levels; /* the image, then each of half the sides of the one before */
} Texture;

/* Triangles and their materials. Arrays of n + 1 rows end with the background. */
typedef struct {
    int32_t num_triangles;
    const float *corners;        /* (n, 3, 3) */
    const float *normals;        /* (n, 3) unit */
    const float *albedo;         /* (n, 3) linear */
    const uint8_t *flags;        /* (n,) FACET_... */
    const float *corner_albedo;  /* (n, 3, 3) linear, of FACET_CORNER_COLOURS; or NULL */
    const double *uv;            /* (k, 3, 2) texture coordinates at corners; or NULL */
    const int32_t *uv_rows;      /* (n,) row of uv of each triangle; NULL: its own, k = n */
    const int32_t *texture;      /* (n,) index into textures, -1 for none; or NULL */
    const double *fine_corners;  /* (n, 3, 3) of a mesh that is large for float32; or NULL */
    const float *emission;       /* (n, 3) linear, of facets with FACET_EMISSIVE; or NULL */
    const float *corner_normals; /* (n, 3, 3) unit, of facets with FACET_SMOOTH; or NULL */
    /* (n, 3) opacity at corners over that of the emptiest point which is a surface, with
     * FACET_FILTERED; infinite without holes, NULL without such facets. Times the texture's. */
    const float *coverage;
    /* (n,) whether facets with coverage let what lies behind through, by an opacity of half of it;
     * or NULL. */
    const uint8_t *blended;
    const Texture *textures; /* of `texture`, for holes and of objects; or NULL */
    const float *gloss; /* (n, 2) reflectance along the normal, 0 for matt; roughness. Or NULL */
} MeshArrays;

/* (3, 2) texture coordinates at the corners of a triangle. */
static inline const double *corner_uv(const MeshArrays *mesh, int32_t triangle) {
    return mesh->uv + 6 * (size_t)(mesh->uv_rows ? mesh->uv_rows[triangle] : triangle);
}

typedef struct {
    int32_t kind;
    int32_t lights_scene; /* 0: culled for the static scene, lights dynamic objects alone */
    double position[3];   /* of a point light, scene coordinates */
    float vector[3];      /* unit direction towards a directional light; place of a point light */
    float intensity[3];   /* irradiance at normal incidence; radiant intensity of a point light */
} Light;

/* Light that no surface occludes: irradiance from above and from below. */
typedef struct {
    float up[3], down[3];
} Hemisphere;

/* What flat surfaces are found by: a scene in float64, world frame. */
typedef struct {
    int32_t num_triangles;
    double centre[3];           /* origin of scene coordinates */
    const double *corners;      /* (n, 3, 3) */
    const double *normals;      /* (n, 3) unit; zero without area */
    const double *albedo;       /* (n, 3) */
    const double *uv;           /* (n, 3, 2); NULL without textures */
    const int32_t *texture;     /* (n,) -1 for none */
    const int32_t *object;      /* (n,) */
    const uint8_t *unlit;       /* (n,) */
    const uint8_t *has_colours; /* (n,) the colour varies over the triangle */
} FacetSource;

/* Flat surfaces of the static scene, for the proof that one of them fills a tile: connected
 * coplanar triangles of one material. */
typedef struct {
    int32_t num_surfaces;
    const int32_t *surface;        /* (n,) surface of each triangle */
    const uint8_t *outer_edges;    /* (n,) bit k: edge k to k + 1 bounds its surface */
    const int32_t *representative; /* (s,) the largest triangle of each surface */
} Surfaces;

/* A grid of factors of hemisphere light: a point's column in the atlas is column . (x, y, z, 1). */
typedef struct {
    float column[4], row[4];          /* scene coordinates */
    int32_t left, top, right, bottom; /* first and last nodes; two a side at least */
    double offset[2];                 /* the last of column and of row, not rounded */
} OcclusionPatch;

/* Ambient occlusion; without it, `texels` is NULL. */
typedef struct {
    int32_t width, height;         /* of the atlas */
    const uint8_t *texels;         /* (h, w), 255 = open */
    /* (h, w, 3) of colours instead, 65535 = open, one readable number behind the last; or NULL */
    const uint16_t *light;
    const int32_t *patch_of;       /* (n,) grid of each triangle; -1: open, or one factor */
    const OcclusionPatch *patches; /* (m,) */
    int32_t num_patches;           /* m */
    const int32_t *dark_sums;      /* (h + 1, w + 1) nodes above and left that are not open */
    const float *flat_factors;        /* (n, 3) factors of facets without a grid; NULL: all 1 */
    const float *means; /* (m, 3) factors without the effect; NULL: its change is not wanted */
} Occlusion;

typedef struct {
    Mesh *mesh;
    Mesh *casters;               /* triangles that occlude lights; NULL: all of `mesh` */
    const float *sharp_radiance; /* (n + 1, 3) by all lights but point lights, none occluded */
    const float *ambient_radiance; /* (n + 1, 3) by light that nothing occludes */
    const uint32_t *encoded;     /* (n + 1,) sRGB of sharp_radiance, R in the lowest byte */
    int32_t num_textures;
    const Texture *textures;
    int32_t num_lights;
    const Light *lights;
    Hemisphere hemisphere;         /* of the static scene */
    Hemisphere object_hemisphere;  /* of dynamic objects */
    const uint8_t *srgb_table;   /* (65536,) sRGB of linear light */
    const int32_t *caster_triangles; /* triangle of `mesh` of each of `casters`; NULL without */
    void *light_maps; /* of catoptra_build_light_maps; NULL until the first frame with shadows */
    Surfaces surfaces;
    Occlusion occlusion;
    /* (sky_size + 2, sky_size + 2) shared exponents of what rays show that meet nothing; NULL where
     * that is the last row of the tables. */
    const uint32_t *sky;
    int32_t sky_size;
} Scene;

/* Rays of a camera; twin: ray_table.RayTable. */
typedef struct {
    int32_t width_px, height_px, samples, num_tiles, tile_columns;
    const int32_t *tiles;     /* (t,) */
    const float *directions;  /* (t, samples^2, 3, 16) */
    const uint16_t *valid;    /* (t, samples^2) */
    const float *origins;     /* (t, samples^2, 3, 16) or NULL */
    const float *times;       /* (t, samples^2, 16) or NULL */
} RayTable;

/* A rotation, row by row, and a translation. */
typedef struct {
    float rotation[9];
    float translation[3];
} Pose;

/* Where the points of a picture are in the image of the frame; twin: flow_tables.FlowTables. */
typedef struct {
    const float *points;      /* (h, w, 3) world frame; not a number for none */
    const uint16_t *ids;      /* (h, w) numbers of their objects */
    const int32_t *motion_of; /* (65536,) index into motions; -1: at rest, below: not in frame */
    const Pose *motions;      /* there from here, the frame's coordinates */
    double centre[3];         /* their origin in the world */
    int32_t num_nodes;        /* of the tables by evenly spaced places, of t / (1 + t) of t =
                                 tan(angle from the axis / 2) */
    float first, last, nodes_per_unit;
    const float *radius_px;   /* (num_nodes,) */
    const float *origin_r;    /* (num_nodes,) or NULL: rays begin at the viewpoint */
    const float *origin_z;    /* likewise */
    float axes[4];            /* (2, 2) displacements of the azimuths of x and y */
    float centre_px[2];
    float *flow;              /* (h, w, 2) written whole; not a number where unknown */
} Flow;

/* Channels of labels, (h, w) or (h, w, 3), written whole; NULL where one is not wanted. */
typedef struct {
    RayTable centres;           /* rays of the pixels' centres, one sample a pixel */
    const int32_t *centre_tile; /* (t,) of catoptra_match_centres, as is_held */
    const uint8_t *is_held;
    const uint16_t *triangle_numbers; /* (n,) number of each triangle's object, from 1 */
    const uint16_t *object_numbers;   /* (o,) of each dynamic object */
    const uint16_t *class_table;      /* (65536,) class of each number */
    double centre[3];                 /* origin of the frame's coordinates in the world */
    float *range_m;                   /* infinite where nothing is met */
    float *normal;                    /* likewise zero */
    float *point;                     /* not a number */
    uint16_t *ids, *classes;          /* zero */
    uint8_t *agreement;               /* zero; of the samples of the view's rays */
} Labels;

/* Change of the finished picture that nobody misses; twin: effects.Threshold. */
typedef struct {
    float max_change;    /* of any pixel, grey levels; negative: nothing is measured */
    float plain_change;  /* up to it parts of an image may be drawn without an effect, uncounted */
    int32_t max_visible; /* pixels that may change by more than VISIBLE_LEVELS */
} ChangeLimits;

/* Change of the finished picture by an effect; twin: effects.EffectChange. */
typedef struct {
    float largest;       /* of any pixel, grey levels */
    int32_t num_visible; /* pixels that change by more than VISIBLE_LEVELS, at most */
} PixelChange;

typedef struct {
    double origin[3];    /* of the frame's coordinates, scene coordinates */
    int32_t num_poses;   /* K >= 1 poses of the camera and of each object, evenly spaced in time */
    const Pose *camera;  /* (K,) the frame's coordinates from the mirror frame */
    int32_t num_objects;
    Mesh *const *objects;     /* (o,) */
    const Pose *object_poses; /* (K, o) the frame's coordinates from each object's frame */
    /* (o, 6, 3) irradiance of surfaces that face x, -x, y, -y, down and up; NULL: the scene's. */
    const float *object_light;
    /* (o, 6) centre and half sides of the box by which each object shades baked light, in its
     * frame; half sides of 0: it shades none. NULL: none does. */
    const float *shades;
    int32_t num_boxes;
    const float *boxes;        /* (b, 6) centre and half size in the frame of an object */
    const int32_t *box_object; /* (b,) index of the object that a box encloses a part of */
    int32_t has_shadows;
    int32_t measures_shadows; /* the frame decides on shadows by their change, */
    /* Once a part of the picture decides that shadows, baked light or the watched object are on, the
     * rest need not measure them. */
    int32_t ends_measures;
    /* Of all effects that are measured. Lamps whose light changes by less than the plain change,
     * together, cast no shadow rays where shadows are measured. */
    ChangeLimits limits;
    int32_t watched_object;   /* number in hits of the object of watched_change; 0 for none */
    int32_t has_few_rays; /* they take less time than proofs of what fills parts of the image */
    int32_t output;
    void *image;       /* (h, w, 3) uint8 or float32, zero; unused for OUTPUT_HITS */
    float *range_m;    /* (t, samples^2, 16), for OUTPUT_HITS */
    int32_t *triangle; /* likewise */
    int32_t *object;   /* likewise */
    float *inverse_range; /* (h, w) means of 1 / range over the samples, zero; or NULL */
    float exposure; /* time for which a row is exposed, of the poses' whole time; 0: an instant */
    float readout;  /* from the first row's exposure to that of a row after the last, likewise */
    float blur_threshold;  /* grey levels; changes up to it may be left out. Negative: none is */
    float least_gain, largest_gain; /* from the frame's light to that of the finished picture */
    float spill[2]; /* gain up to the well; part of what is above that reaches other pixels */
    int32_t max_instants;  /* limit of the instants of a pixel's exposure */
    float fog_density;     /* extinction per metre; 0: clear air */
    float airlight[3];     /* linear radiance */
    int32_t measures_fog;  /* fog_change of the counts is wanted */
    int32_t has_gloss;
    int32_t measures_gloss; /* gloss_change of the counts is wanted */
    float gloss_limit; /* grey levels up to which no mirrored ray is cast; negative: all are */
    float brightest;   /* largest radiance of anything */
    const Labels *labels;  /* alone, with OUTPUT_LABELS, or beside an image at rest; or NULL */
    const Flow *flow;      /* of OUTPUT_FLOW */
} Frame;

/* What a frame took, beside its pixels. */
typedef struct {
    int32_t num_filled_tiles; /* tiles that one surface was proven to fill */
    int32_t num_tiles;
    /* By shadows, with what lamps without a ray may add: of the sharp frame, and at any instant
     * that its blur traces where the sharp frame's is within the limits. */
    PixelChange shadow_change;
    int32_t shows_watched; /* whether the watched object is seen, at any instant */
    int32_t drops_layers;  /* whether a ray meets more blended facets than it shows */
    PixelChange watched_change; /* of the sharp frame against that without the object */
    int32_t num_blurred_tiles; /* tiles whose exposure was sampled at several instants */
    int32_t num_instants;      /* largest number of instants of a pixel */
    int64_t num_blur_rays;     /* rays of those */
    PixelChange blur_change;    /* by them */
    PixelChange rolling_change; /* bound of the change by the rows' own times */
    float blur_ms;              /* time for the instants */
    PixelChange fog_change;
    PixelChange gloss_change; /* pixels counted by their samples */
    PixelChange light_change; /* by baked light; likewise */
    int32_t ended_measures; /* MEASURE_...: whose largest change is that of a part */
} FrameCounts;

CATOPTRA_EXPORT int32_t catoptra_abi(int32_t structure);

/* Device with a pool of threads. NULL on failure, with the reason in `error` (256 bytes). */
CATOPTRA_EXPORT Device *catoptra_open(int32_t threads, char *error);
CATOPTRA_EXPORT void catoptra_close(Device *device);

/* Triangles for rays of which none slips between two that share an edge. */
CATOPTRA_EXPORT Mesh *catoptra_commit_mesh(Device *device, const MeshArrays *arrays, char *error);
CATOPTRA_EXPORT void catoptra_release_mesh(Mesh *mesh);

/* Other looks of the same triangles, whose corners are not read again. */
CATOPTRA_EXPORT void catoptra_repaint_mesh(Mesh *mesh, const MeshArrays *arrays);

/* Surfaces of (n,) triangles, into the arrays of `Surfaces`; their number, -1 if memory is
 * short. */
CATOPTRA_EXPORT int32_t catoptra_find_surfaces(Device *device, const FacetSource *facets,
                                               int32_t *surface, uint8_t *outer_edges,
                                               int32_t *representative);

CATOPTRA_EXPORT View *catoptra_prepare(Device *device, const RayTable *rays, char *error);
CATOPTRA_EXPORT int64_t catoptra_view_bytes(const View *view);
CATOPTRA_EXPORT void catoptra_release_view(View *view);

/* For each tile of a view, the tile of a table of the same image's pixel centres, -1 for none; and
 * whether proofs about the view's tile are proofs about these rays. Returns the number of tiles of
 * the table that the view lacks, whose labels would be missing; -1 if memory is short. */
CATOPTRA_EXPORT int32_t catoptra_match_centres(const View *view, const RayTable *centres,
                                               int32_t *centre_tile, uint8_t *is_held);

/* Maps of where nothing occludes a scene's directional lights; NULL if memory is short. */
CATOPTRA_EXPORT void *catoptra_build_light_maps(const Scene *scene);
CATOPTRA_EXPORT void catoptra_release_light_maps(void *light_maps, int32_t num_lights);

/* 0, or the reason of the failure in `error`. */
CATOPTRA_EXPORT int32_t catoptra_render(Device *device, const Scene *scene, const View *view,
                                        const Frame *frame, FrameCounts *counts, char *error);

/* First hits of single rays with a mesh: (count, 3) origins and unit directions in the mesh's
 * coordinates; distances, INFINITY and triangle -1 without a hit. Any threads may cast at once. */
CATOPTRA_EXPORT void catoptra_cast(const Mesh *mesh, int64_t count, const double *origins,
                                   const float *directions, float *range_m, int32_t *triangle);

/* A light that the nodes of grids see; of a rectangle the whole area shines, on one side. */
typedef struct {
    int32_t kind;
    int32_t column;   /* of its light; that of several is their sum */
    float area;       /* of a rectangle, square metres; 0 of all others */
    float power;      /* of a rectangle, by which rays are shared */
    double corner[3]; /* of a rectangle; place of a point light */
    float side_x[3], side_y[3];
    float normal[3]; /* unit, on which it shines; towards a directional light */
} BakeLamp;

/* One pass of rays from the nodes of grids. What a ray meets is a slot of a table of radiance: a
 * node of the atlas, a triangle without a grid, or a texel of the sky. */
typedef struct {
    const Mesh *mesh;        /* surfaces that rays end on */
    const Mesh *casters;     /* what hides lamps; NULL: nothing */
    int32_t num_nodes;
    int32_t first_probe;     /* nodes from here on stand free: they see no back from outside */
    const double *positions; /* (n, 3) before their surfaces */
    const int32_t *grid;     /* (n,) */
    const float *axes;       /* (m, 3, 3) of each grid: two along it, and its normal */
    const float *normals;    /* (t, 3) of the mesh's triangles; zero with two sides */
    const int32_t *grid_of;  /* (t,) -1 for none */
    const int32_t *slot_of;  /* (t,) of those without a grid */
    const OcclusionPatch *patches; /* (m,) */
    int32_t width;           /* of the atlas: the slot of a node is row * width + column */
    int32_t sky_slot, sky_side; /* first texel; nodes along a square for each hemisphere */
    uint32_t pass_number;
    int32_t num_rays;        /* of a node, a multiple of 16 */
    const float *sequence;   /* (num_rays, 3) squared sine, cosine and sine of the azimuth */
    const float *turns;      /* (256, 2) cosines and sines of turns about the normal */
    int32_t *hits;           /* (n, num_rays) slots that rays end on */
    int32_t *backs;          /* (n,) counts rays that meet backs, near nodes of surfaces */
    int32_t num_lamps, num_columns;
    const BakeLamp *lamps;
    float *light;            /* (n, num_columns) irradiance by lamps of one unit is added; of points and
                              * directional lights in pass 0 alone */
} BakeJob;

/* Means of radiance over stored hits. */
typedef struct {
    int32_t num_nodes, num_rays;
    const int32_t *hits;   /* (n, num_rays) */
    const float *radiance; /* (slots, 3), negative where it is not known */
    float *means;          /* (n, 3) */
} GatherJob;

CATOPTRA_EXPORT void catoptra_bake(Device *device, const BakeJob *job);
CATOPTRA_EXPORT void catoptra_gather(Device *device, const GatherJob *job);

/* A plane on which a body rests, through the middle of its side, and its heading; z points down. */
typedef struct {
    double x, y, z, slope_x, slope_y, cosine, sine;
} Stance;

/* One side of a body. */
typedef struct {
    int32_t num_points, num_wheels;
    const double *points; /* (num_points, 3) that may touch what is below, in the side's frame */
    const double *lifts;  /* how far above them rays begin */
    const double *wheels; /* (num_wheels, 2) */
    double half[2], rise, radius;
    double origin[3]; /* of the robot, in the side's frame */
} RestingSide;

/* A body that sinks; members as in `simulation/resting.py:Sinking`. */
typedef struct {
    const Mesh *mesh; /* NULL: there is nothing below */
    double centre[3]; /* of the mesh's coordinates */
    const RestingSide *side;
    const double *triangles; /* (num_triangles, 3, 3) near `near`, or NULL */
    const double *boxes;     /* (num_boxes, 15) rotation, middle, half sides of other robots */
    int32_t num_triangles, num_boxes;
    Stance stance; /* to begin with, and where it ends */
    Stance goal, before, near;
    double sink, calm, floor_z;
    int32_t contacts[3];
    int32_t is_lifted; /* whether `before` counts */
    int32_t num_steps; /* of the search so far, begins at 0 */
    int32_t has_moved, is_even, touching, is_on_robot; /* written */
} Sinking;

typedef enum {
    REST_FOUND,
    REST_ALOFT,           /* it fell without any contact */
    REST_OVER,            /* its centre is beyond all points */
    REST_NEEDS_TRIANGLES, /* near the stance; then call again */
    REST_NO_MEMORY,
    REST_MOVES /* never returned */
} RestState;

/* The stance in which a body comes to rest. Any threads may settle at once. */
CATOPTRA_EXPORT RestState catoptra_settle(Sinking *job);

/* Largest gaps along any axis between a box (rotation, middle, half sides) and each of (count, 3, 3)
 * triangles that are near; negative: the depth of the overlap. */
CATOPTRA_EXPORT void catoptra_separate(const double box[15], int64_t count,
                                       const double *triangles, double *gaps);

/* Trace all rays of a view against the static scene, and nothing else: the rate of bare rays. */
CATOPTRA_EXPORT int32_t catoptra_trace(Device *device, const Scene *scene, const View *view,
                                       const Frame *frame, char *error);

#endif
