/* One tile of a frame: its rays' hits, their radiance, its pixels. */
#ifndef CATOPTRA_TILES_H
#define CATOPTRA_TILES_H

#include "blur_intervals.h"
#include "direct_light.h"
#include "facet_plane.h"
#include "ray_order.h"
#include "short_list.h"

/* Surfaces by their representative triangle; other values say that nothing is known. */
enum { SURFACE_BACKGROUND = -1, SURFACE_UNKNOWN = -2 };

/* What is known of a tile. */
typedef struct {
    int32_t triangle; /* whose plane all rays meet first in the static scene, or as above */
    int32_t object;   /* the only dynamic object that rays may meet; OBJECT_NONE or OBJECT_ANY */
    LightProof proof;  /* what is known of the lights on the triangle's plane */
    int is_open;       /* no part of the sky is hidden anywhere on it */
    int is_shaded;     /* bodies may take baked light of the triangle, which has a grid */
    int may_be_thin; /* something may pass between the samples; known while a frame moves */
    const ShortList *short_list; /* all that may be seen of the static scene; NULL: not known */
    const FacetProofs *proofs; /* of the lights on facets of the static scene; NULL: none */
    const TriangleSet *triangles; /* likewise, during the exposure of a moving frame */
    const struct FacetPlane *plane; /* of the triangle; NULL: not found yet */
    /* (3, 16) of baked light, the same for all samples of a pixel; NULL: not known */
    const float (*factors)[BLOCK_RAYS];
    const float (*mirrored)[BLOCK_RAYS]; /* likewise of light that a glossy facet mirrors */
} TileContent;

#define UNKNOWN_CONTENT \
    ((TileContent){SURFACE_UNKNOWN, OBJECT_ANY, {0, 0}, 0, 0, 0, NULL, NULL, NULL, NULL, NULL, NULL})

/* Render a tile; where the triangle is unknown, rays are traced. */
void render_tile(const FrameState *state, int tile, const TileContent *content);

/* Whether one radiance is all that a tile shows. */
int is_single_radiance(const FrameState *state, int tile, const TileContent *content);

/* What is known of a tile, from the camera of another instant; `moved` holds its triangles. */
TileContent move_content(const FrameState *state, const TileContent *content, ShortList *moved);

/* Radiance, (3, 16), of a block of a unit at the state's instant, and what of it shadows take
 * unless `lost` is NULL; bit mask of its rays. */
uint32_t sample_block(const FrameState *state, int tile, const RayOrder *order, int unit, int block,
                      const TileContent *content, float radiance[3][BLOCK_RAYS],
                      LostLight *lost);

/* Rays of a block of a unit, from the camera of the state. */
void load_unit(const FrameState *state, int tile, const RayOrder *order, int unit, int block,
               RayBlock *rays);

/* Whether all rays of a tile see the mirror. */
int is_wholly_valid(const FrameState *state, int tile);

/* First hits of a block's rays, whose limits end there. */
void intersect_content(const FrameState *state, RayBlock *rays, HitBlock *hits,
                       const TileContent *content);

/* The same of the samples of a picture; bit mask of those that meet the watched object: that it is
 * seen is noted. */
uint32_t find_hits(const FrameState *state, RayBlock *rays, HitBlock *hits,
                   const TileContent *content);

/* Trace the rays of a tile against the static scene without any use of the hits. */
void trace_tile(const FrameState *state, int tile);

#endif
