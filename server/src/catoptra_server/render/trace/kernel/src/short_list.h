/* Hits of the rays of a part of the image with a few triangles, all tested in vector code.
 *
 * What reaches into a narrow beam is mostly two or three surfaces and the edges between them: 16
 * rays take 0.2 us, a search through the scene's hierarchy 1 us. Only certain hits count. Where a
 * ray passes an edge, or two triangles at one distance, as near as rounding, the search decides:
 * so both find the same triangles.
 */
#ifndef CATOPTRA_SHORT_LIST_H
#define CATOPTRA_SHORT_LIST_H

#include "candidates.h"

enum { MAX_SHORT = 12 };

/* A triangle as a basis: the components of a unit direction, and its product with the basis's sum,
 * are the barycentric weights of the point that it meets, and 1, over the distance. */
typedef struct {
    Vec3 dual[3], sum;
    float error[3];  /* bounds of the components' rounding errors */
    float sum_error; /* bound of the sum's */
    int32_t triangle;
    int32_t is_line; /* its plane holds the viewpoint: components alone, of any size */
} ShortTriangle;

typedef struct {
    int count;
    ShortTriangle triangles[MAX_SHORT];
    Vec3 viewpoint; /* or the middle of the origins of the rays, */
    Vec3 middle;    /* which is this in the mirror frame, */
    float radius;   /* and their largest distance from it; 0 for one viewpoint */
    Vec3 corners[MAX_SHORT][3]; /* relative to it */
} ShortList;

/* Triangles of the static scene among candidates; 0 if there are too many, spheres around small
 * triangles, or, for rays of several origins, one that is as near or seen as a line. */
int make_short_list(const FrameState *state, const CandidateList *candidates,
                    const BeamSides *sides, ShortList *list);

/* The same triangles from another pose of the camera; 0 as for a list. */
int move_short_list(const ShortList *list, const Pose *camera, ShortList *moved);

/* Hits of the active rays, which become their limits; 0 if one is not certain. */
int intersect_short_list(const ShortList *list, RayBlock *rays, HitBlock *hits);

#endif
