/* The exposure of a few pixels in one step: when each ray meets each triangle.
 *
 * While the camera moves, a ray enters and leaves a triangle where it passes one of its edges. Each
 * edge is a plane through the viewpoint, whose side is nearly linear in time over a part of the
 * exposure: its sides at a few instants give those at 16 or 32 times, as the bits of a word, and so
 * do the distances of two triangles. What a ray sees of a triangle of one radiance is a count of
 * bits; of one from which a part of the sky is hidden, times a mean factor (blur_occlusion.h).
 * Light of lamps that nothing occludes changes as evenly as such a factor.
 * Source: Gribel et al. 2010, "Analytical motion blur rasterization with compression"; they keep
 * intervals, where we keep bits.
 */
#ifndef CATOPTRA_BLUR_INTERVALS_H
#define CATOPTRA_BLUR_INTERVALS_H

#include "blur_occlusion.h"
#include "candidates.h"
#include "lanes.h"
#include "light_map.h"
#include "ray_order.h"
#include "short_list.h"

enum { MAX_MOVING = 40, MAX_PARTS = 8 };

/* Triangles of the static scene that a part of the image may show during the exposure. */
typedef struct TriangleSet {
    int count;
    int32_t triangle[MAX_MOVING];
    Vec3 viewpoint;
    Vec3 corners[MAX_MOVING][3]; /* relative to the viewpoint */
} TriangleSet;

/* A triangle in the mirror frame, as in short_list.h: three products with a direction, all above
 * zero where it is met, and their sum, the inverse distance. */
typedef struct {
    Vec3 dual[MAX_PARTS + 1][3]; /* at the begin of the exposure, and at the end of each part */
    Vec3 sum[MAX_PARTS + 1];     /* of the three */
    uint8_t across;              /* bit mask of those that some rays of the tile have below zero */
    Vec3 radiance;               /* as sensed */
    int is_constant;             /* it is the same all over the part of the image, but for */
    int is_occluded;             /* the sky's share, which differs from point to point: */
    Vec3 light, ambient;         /* radiance under the open sky, before the sensor; its share */
    uint32_t lamps;              /* bit mask of point lights that all of it sees */
    Vec3 normal[MAX_PARTS + 1];
    AtlasRays atlas[MAX_PARTS + 1];
    int32_t triangle;
    int source; /* place in the set */
} MovingTriangle;

typedef struct {
    int count, parts; /* parts of the exposure, 2 or more, of equal length */
    int bins;         /* times of a part */
    Floats16 phases;  /* place of each ray's times within the bins, from 0 to 1 */
    float centre;     /* time of its middle */
    const FrameState *state;
    Pose poses[MAX_PARTS + 1]; /* of the camera at the ends of the parts */
    Vec3 background;
    FacetProofs proofs;
    MovingTriangle triangles[MAX_MOVING];
} MovingScene;

/* Triangles among candidates; 0 if there are too many, or spheres around small ones. */
int collect_triangles(const FrameState *state, const CandidateList *candidates, TriangleSet *set);

/* The triangles that a tile shows during an exposure about a time; 0 if one passes through the
 * viewpoint, or if the exposure, of some steps of 2 px, is too long. */
int move_triangles(const FrameState *state, int tile, const TriangleSet *set, float centre,
                   int steps, MovingScene *scene);

/* The triangles as a list to be moved to instants of that exposure; 0 if there are too many. */
int list_moving(const TriangleSet *set, const MovingScene *scene, ShortList *list);

/* Corners of a part of the plane that fills a tile: it holds all that the exposure shows. 0 if some
 * ray does not meet the plane. */
int enclose_moving_plane(const FrameState *state, int tile, int32_t triangle, Vec3 corners[4]);

/* Add the mean radiance over the exposure, as sensed, of a block of directions in the mirror frame
 * to (3, 16); 0, with any part of it added, where a triangle is seen whose radiance varies. */
int integrate_block(const MovingScene *scene, const RayBlock *rays, float radiance[3][BLOCK_RAYS]);

#endif
