/* Provides packets.h: a block's queries to Embree in packets of the device's width.
 * Float64 twin: none; which triangle is met comes from Embree in both engines. Owns nothing:
 * writes what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "packets.h"

#include <string.h>

/* One definition for each width: Embree's structures differ in nothing but the lengths. */

#define LOAD_RAYS(WIDTH, RAY, FIRST)                                                               \
    do {                                                                                           \
        for (int axis = 0; axis < 3; axis++) {                                                     \
            memcpy((RAY)->origin[axis], rays->origin[axis] + (FIRST), sizeof(float) * (WIDTH));    \
            memcpy((RAY)->direction[axis], rays->direction[axis] + (FIRST),                        \
                   sizeof(float) * (WIDTH));                                                       \
        }                                                                                          \
        memcpy((RAY)->time, rays->time + (FIRST), sizeof(float) * (WIDTH));                        \
        memcpy((RAY)->tfar, rays->limit + (FIRST), sizeof(float) * (WIDTH));                       \
        memset((RAY)->tnear, 0, sizeof(float) * (WIDTH));                                          \
        memset((RAY)->mask, 0xff, sizeof(uint32_t) * (WIDTH));                                     \
        memset((RAY)->flags, 0, sizeof(uint32_t) * (WIDTH));                                       \
        for (int lane = 0; lane < (WIDTH); lane++)                                                 \
            valid[lane] = rays->active >> ((FIRST) + lane) & 1 ? -1 : 0;                           \
    } while (0)

#define DEFINE_INTERSECT(WIDTH)                                                                    \
    static void intersect_packet##WIDTH(const Device *device, RTCScene scene, int32_t object,      \
                                        RayBlock *rays, HitBlock *hits, int first,                 \
                                        RTCQueryArguments *arguments) {                            \
        _Alignas(64) int valid[WIDTH];                                                             \
        RTCRayHit##WIDTH packet;                                                                   \
        LOAD_RAYS(WIDTH, &packet.ray, first);                                                      \
        memset(packet.geometry, 0xff, sizeof packet.geometry);                                     \
        memset(packet.instance, 0xff, sizeof packet.instance);                                     \
        device->embree.intersect##WIDTH(valid, scene, &packet, arguments);                         \
        for (int lane = 0; lane < (WIDTH); lane++) {                                               \
            if (!valid[lane] || packet.geometry[lane] == RTC_INVALID_GEOMETRY_ID)                  \
                continue;                                                                          \
            rays->limit[first + lane] = packet.ray.tfar[lane];                                     \
            hits->triangle[first + lane] = (int32_t)packet.triangle[lane];                         \
            hits->object[first + lane] =                                                           \
                object == OBJECT_ANY ? 1 + (int32_t)packet.instance[lane] : object;                \
        }                                                                                          \
    }

#define DEFINE_OCCLUDE(WIDTH)                                                                      \
    static uint32_t occlude_packet##WIDTH(const Device *device, RTCScene scene,                    \
                                          const RayBlock *rays, int first,                         \
                                          RTCQueryArguments *arguments) {                          \
        _Alignas(64) int valid[WIDTH];                                                             \
        RTCRay##WIDTH packet;                                                                      \
        LOAD_RAYS(WIDTH, &packet, first);                                                          \
        device->embree.occluded##WIDTH(valid, scene, &packet, arguments);                          \
        uint32_t occluded = 0;                                                                     \
        for (int lane = 0; lane < (WIDTH); lane++)                                                 \
            /* Embree marks an occluded ray by a negative limit. */                                \
            occluded |= (uint32_t)(valid[lane] && packet.tfar[lane] < 0.0f) << (first + lane);     \
        return occluded;                                                                           \
    }

DEFINE_INTERSECT(4)
DEFINE_INTERSECT(8)
DEFINE_INTERSECT(16)
DEFINE_OCCLUDE(4)
DEFINE_OCCLUDE(8)
DEFINE_OCCLUDE(16)

static void load_ray(const RayBlock *rays, int lane, RTCRay1 *ray) {
    *ray = (RTCRay1){
        .origin = {rays->origin[0][lane], rays->origin[1][lane], rays->origin[2][lane]},
        .direction = {rays->direction[0][lane], rays->direction[1][lane], rays->direction[2][lane]},
        .time = rays->time[lane],
        .tfar = rays->limit[lane],
        .mask = 0xffffffffu,
    };
}

static void intersect_packet1(const Device *device, RTCScene scene, int32_t object,
                              RayBlock *rays, HitBlock *hits, int lane,
                              RTCQueryArguments *arguments) {
    RTCRayHit1 hit = {.geometry = RTC_INVALID_GEOMETRY_ID, .instance = RTC_INVALID_GEOMETRY_ID};
    load_ray(rays, lane, &hit.ray);
    device->embree.intersect1(scene, &hit, arguments);
    if (hit.geometry == RTC_INVALID_GEOMETRY_ID)
        return;
    rays->limit[lane] = hit.ray.tfar;
    hits->triangle[lane] = (int32_t)hit.triangle;
    hits->object[lane] = object == OBJECT_ANY ? 1 + (int32_t)hit.instance : object;
}

static uint32_t occlude_packet1(const Device *device, RTCScene scene, const RayBlock *rays,
                                int lane, RTCQueryArguments *arguments) {
    RTCRay1 ray;
    load_ray(rays, lane, &ray);
    device->embree.occluded1(scene, &ray, arguments);
    return (uint32_t)(ray.tfar < 0.0f) << lane;
}

static uint32_t packet_bits(int width) { return (1u << width) - 1u; }

void intersect_block(const Device *device, RTCScene scene, int32_t object, RayBlock *rays,
                     HitBlock *hits) {
    RTCQueryArguments arguments = {.flags = RTC_RAY_QUERY_FLAG_COHERENT,
                                   .feature_mask = RTC_FEATURE_FLAG_ALL};
    int width = device->packet_width;
    for (int first = 0; first < BLOCK_RAYS; first += width) {
        if (!(rays->active >> first & packet_bits(width)))
            continue;
        switch (width) {
        case 16:
            intersect_packet16(device, scene, object, rays, hits, first, &arguments);
            break;
        case 8:
            intersect_packet8(device, scene, object, rays, hits, first, &arguments);
            break;
        case 4:
            intersect_packet4(device, scene, object, rays, hits, first, &arguments);
            break;
        default:
            intersect_packet1(device, scene, object, rays, hits, first, &arguments);
        }
    }
}

uint32_t occlude_block(const Device *device, RTCScene scene, const RayBlock *rays,
                       int is_coherent) {
    RTCQueryArguments arguments = {.flags = is_coherent ? RTC_RAY_QUERY_FLAG_COHERENT : 0,
                                   .feature_mask = RTC_FEATURE_FLAG_ALL};
    int width = device->packet_width;
    uint32_t occluded = 0;
    for (int first = 0; first < BLOCK_RAYS; first += width) {
        if (!(rays->active >> first & packet_bits(width)))
            continue;
        switch (width) {
        case 16:
            occluded |= occlude_packet16(device, scene, rays, first, &arguments);
            break;
        case 8:
            occluded |= occlude_packet8(device, scene, rays, first, &arguments);
            break;
        case 4:
            occluded |= occlude_packet4(device, scene, rays, first, &arguments);
            break;
        default:
            occluded |= occlude_packet1(device, scene, rays, first, &arguments);
        }
    }
    return occluded;
}
