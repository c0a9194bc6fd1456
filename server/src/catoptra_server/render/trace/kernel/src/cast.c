/* Provides catoptra_cast: distances along rays, for sensors.
 * Float64 twin: render/trace/reference. Owns nothing: all arrays are Python's.
 * Threads: any threads at once: no pool, no state. */
#include "device.h"

#include <math.h>

/* Rays relative to a place. */
static void load_cast(const double *origins, const float *directions, const double place[3],
                      int count, RayBlock *rays) {
    *rays = (RayBlock){.has_origins = 1, .active = (1u << count) - 1u};
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int from = lane < count ? 3 * lane : 0;
        for (int axis = 0; axis < 3; axis++)
            rays->origin[axis][lane] = (float)(origins[from + axis] - place[axis]);
        set_lane(rays->direction, lane, vec3(directions + from));
        rays->limit[lane] = INFINITY;
    }
}

void catoptra_cast(const Mesh *mesh, int64_t count, const double *origins, const float *directions,
                   float *range_m, int32_t *triangle) {
    static const double centre[3];
    for (int64_t first = 0; first < count; first += BLOCK_RAYS) {
        RayBlock rays;
        HitBlock hits;
        int lanes = count - first < BLOCK_RAYS ? (int)(count - first) : BLOCK_RAYS;
        /* The rays of a block begin near each other: at a sensor, or below a robot. */
        const double *place = mesh->bvh.fine_leaves ? origins + 3 * first : NULL;
        load_cast(origins + 3 * first, directions + 3 * first, place ? place : centre, lanes,
                  &rays);
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            hits.triangle[lane] = NO_TRIANGLE;
        intersect_bvh(&mesh->bvh, place, OBJECT_STATIC, &rays, &hits);
        for (int lane = 0; lane < lanes; lane++) {
            range_m[first + lane] = rays.limit[lane];
            triangle[first + lane] = hits.triangle[lane];
        }
    }
}
