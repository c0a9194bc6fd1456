/* Hit points computed anew from the triangles that rays meet.
 *
 * A search tells which triangle is met; distance, weights and position follow here, for it, for
 * short lists and for planes alike.
 */
#ifndef CATOPTRA_HIT_POINTS_H
#define CATOPTRA_HIT_POINTS_H

#include "frame_state.h"

/* By component, for vector code; entries of rays outside the mask mean nothing. */
typedef struct {
    _Alignas(64) float distance[BLOCK_RAYS];
    float u[BLOCK_RAYS], v[BLOCK_RAYS]; /* barycentric weights of corners 1 and 2 */
    float position[3][BLOCK_RAYS];      /* the frame's coordinates */
    float normal[3][BLOCK_RAYS];        /* unit, by the winding; the scene's axes */
} HitPoints;

/* Points at which the rays of a mask meet the planes of their triangles; also beside these. */
void find_hit_points(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                     uint32_t mask, HitPoints *points);

/* A unit normal of an object's mesh, or of the static scene, along the scene's axes at a time. */
Vec3 turn_normal(const FrameState *state, int object, float time, Vec3 normal);

/* Distances of these points alone: in metres, of unit rays. */
void find_hit_distances(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                        uint32_t mask, float distance[BLOCK_RAYS]);

#endif
