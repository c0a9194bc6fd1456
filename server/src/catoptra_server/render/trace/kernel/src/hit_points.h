/* Hit points computed anew from the triangle that a ray meets.
 *
 * Embree's own distances and coordinates differ in their last bits between packet widths; these
 * depend on the ray and the triangle alone.
 */
#ifndef CATOPTRA_HIT_POINTS_H
#define CATOPTRA_HIT_POINTS_H

#include "frame_state.h"

typedef struct {
    float distance;
    float u, v;    /* barycentric weights of corners 1 and 2 */
    Vec3 position; /* Embree's coordinates */
    Vec3 normal;   /* unit, by the winding; Embree's axes */
} HitPoint;

/* Point at which ray `lane` meets the plane of its triangle; also beside the triangle. */
void find_hit_point(const FrameState *state, const RayBlock *rays, const HitBlock *hits, int lane,
                    HitPoint *point);

#endif
