/* Provides catoptra_cast: distances along rays, for sensors.
 * Float64 twin: render/trace/reference. Owns nothing: all arrays are Python's.
 * Threads: any threads at once: no pool, no state. */
#include "device.h"

#include <math.h>

static void load_cast(const float *origins, const float *directions, int count, RayBlock *rays) {
    *rays = (RayBlock){.has_origins = 1, .active = (1u << count) - 1u};
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int from = lane < count ? 3 * lane : 0;
        set_lane(rays->origin, lane, vec3(origins + from));
        set_lane(rays->direction, lane, vec3(directions + from));
        rays->limit[lane] = INFINITY;
    }
}

void catoptra_cast(const Mesh *mesh, int64_t count, const float *origins, const float *directions,
                   float *range_m, int32_t *triangle) {
    for (int64_t first = 0; first < count; first += BLOCK_RAYS) {
        RayBlock rays;
        HitBlock hits;
        int lanes = count - first < BLOCK_RAYS ? (int)(count - first) : BLOCK_RAYS;
        load_cast(origins + 3 * first, directions + 3 * first, lanes, &rays);
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            hits.triangle[lane] = NO_TRIANGLE;
        intersect_bvh(&mesh->bvh, OBJECT_STATIC, &rays, &hits);
        for (int lane = 0; lane < lanes; lane++) {
            range_m[first + lane] = rays.limit[lane];
            triangle[first + lane] = hits.triangle[lane];
        }
    }
}
