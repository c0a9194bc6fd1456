/* Provides catoptra_cast: distances along single rays, for sensors.
 * Float64 twin: none; render/trace/ray_caster.py:EmbreeRayCaster gives the same bits. Owns
 * nothing: all arrays are Python's.
 * Threads: any threads at once: no pool, no state. */
#include "device.h"

#include <math.h>

void catoptra_cast(const Mesh *mesh, int64_t count, const float *origins, const float *directions,
                   float *range_m, int32_t *triangle) {
    /* Without the coherent flag: few rays, in all directions. */
    RTCQueryArguments arguments = {.feature_mask = RTC_FEATURE_FLAG_ALL};
    for (int64_t i = 0; i < count; i++) {
        const float *origin = origins + 3 * i, *direction = directions + 3 * i;
        RTCRayHit1 hit = {
            .ray = {
                .origin = {origin[0], origin[1], origin[2]},
                .direction = {direction[0], direction[1], direction[2]},
                .tfar = INFINITY,
                .mask = 0xffffffffu,
            },
            .geometry = RTC_INVALID_GEOMETRY_ID,
            .instance = RTC_INVALID_GEOMETRY_ID,
        };
        if (mesh->scene)
            mesh->device->embree.intersect1(mesh->scene, &hit, &arguments);
        int is_hit = hit.geometry != RTC_INVALID_GEOMETRY_ID;
        range_m[i] = is_hit ? hit.ray.tfar : INFINITY;
        triangle[i] = is_hit ? (int32_t)hit.triangle : -1;
    }
}
