/* A block of 16 rays, traced together, and what they meet. */
#ifndef CATOPTRA_RAY_BLOCK_H
#define CATOPTRA_RAY_BLOCK_H

#include "kernel.h"
#include "lanes.h"
#include "vectors.h"

#include <stddef.h>

typedef struct {
    _Alignas(64) float origin[3][BLOCK_RAYS];
    float direction[3][BLOCK_RAYS];
    float time[BLOCK_RAYS];
    float limit[BLOCK_RAYS]; /* hits beyond are ignored */
    int has_origins;         /* of each ray's own; else origin and time of lane 0 are all rays' */
    uint32_t active;         /* bit mask of the rays that are traced */
    size_t index;            /* of the block in the camera's table of rays */
} RayBlock;

typedef struct {
    _Alignas(64) int32_t triangle[BLOCK_RAYS];
    int32_t object[BLOCK_RAYS];
} HitBlock;

/* One ray's vector of a block that is stored by component. */
static inline Vec3 get_lane(const float components[3][BLOCK_RAYS], int lane) {
    return (Vec3){components[0][lane], components[1][lane], components[2][lane]};
}

static inline void set_lane(float components[3][BLOCK_RAYS], int lane, Vec3 value) {
    components[0][lane] = value.x;
    components[1][lane] = value.y;
    components[2][lane] = value.z;
}

/* The same vector for the rays of a mask. */
static inline void set_lanes(float components[3][BLOCK_RAYS], uint32_t lanes, Vec3 value) {
    float parts[3] = {value.x, value.y, value.z};
    for (int i = 0; i < 3; i++)
        store16(select16(mask16(lanes), splat16(parts[i]), load16(components[i])), components[i]);
}

/* Bit mask of the rays that meet the same facet as one of them. A block shows two or three. */
static inline uint32_t find_same(const HitBlock *hits, int lane) {
    return bits16((load_ints16(hits->triangle) == hits->triangle[lane]) &
                  (load_ints16(hits->object) == hits->object[lane]));
}

static inline void add_lane(float components[3][BLOCK_RAYS], int lane, Vec3 value) {
    set_lane(components, lane, add(get_lane((const float(*)[BLOCK_RAYS])components, lane), value));
}

#endif
