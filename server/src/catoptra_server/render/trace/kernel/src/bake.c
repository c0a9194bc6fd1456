/* Provides catoptra_bake and catoptra_gather: light on the nodes of grids over a scene's surfaces.
 * Float64 twin: tests/server/render/trace/occlusion/test_light_bake.py. Owns nothing: all arrays
 * are Python's.
 * Threads: the pool's, each for nodes of its own; a node's sums have one order. */
#include "device.h"

#include <math.h>
#include <stdatomic.h>

enum { NODES_AT_ONCE = 64, SAMPLES = 8, LAMPS_AT_ONCE = BLOCK_RAYS / SAMPLES };
#define INSIDE_M 0.5f
#define PI 3.14159265f
/* A lamp's own surface hides nothing of it. */
#define BEFORE_LAMP 0.9999f

typedef struct {
    const BakeJob *job;
    atomic_int next;
} Bake;

typedef struct {
    const GatherJob *job;
    atomic_int next;
} Gather;

/* Evenly distributed bits of three numbers. Source: Jarzynski & Olano 2020, pcg3d. */
static uint32_t hash(uint32_t x, uint32_t y, uint32_t z) {
    x = x * 1664525u + 1013904223u;
    y = y * 1664525u + 1013904223u;
    z = z * 1664525u + 1013904223u;
    x += y * z;
    y += z * x;
    z += x * y;
    x ^= x >> 16;
    y ^= y >> 16;
    z ^= z >> 16;
    x += y * z;
    y += z * x;
    return x ^ y >> 7;
}

static float fraction(uint32_t bits) { return (float)(bits >> 8) * 0x1p-24f; }

static const double *place_node(const Mesh *mesh, const double *position, Vec3 *origin) {
    const double *place = mesh->bvh.fine_leaves ? position : NULL;
    *origin = place ? (Vec3){0, 0, 0}
                    : (Vec3){(float)position[0], (float)position[1], (float)position[2]};
    return place;
}

/* 16 directions about a node's normal, distributed by the cosine: a part of the sequence, shifted
 * in both dimensions by the node's own random numbers. */
static void aim_rays(const BakeJob *job, int32_t node, const float *sequence, RayBlock *rays) {
    uint32_t first = hash((uint32_t)node, job->pass_number, 0), second = hash((uint32_t)node, job->pass_number, 1);
    float shift = fraction(first);
    const float *turn = job->turns + 2 * (second >> 24);
    const float *axes = job->axes + 9 * (size_t)job->grid[node];
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        float across = sequence[3 * lane] + shift;
        across = across < 1.0f ? across : across - 1.0f;
        float cosine = sequence[3 * lane + 1], sine = sequence[3 * lane + 2];
        float radius = __builtin_sqrtf(across), height = __builtin_sqrtf(1.0f - across);
        float x = radius * (cosine * turn[0] - sine * turn[1]);
        float y = radius * (sine * turn[0] + cosine * turn[1]);
        for (int axis = 0; axis < 3; axis++)
            rays->direction[axis][lane] =
                x * axes[axis] + y * axes[3 + axis] + height * axes[6 + axis];
        rays->limit[lane] = INFINITY;
    }
}

static int32_t limit_node(double position, int32_t first, int32_t last) {
    double rounded = position + 0.5;
    return rounded > (double)first ? rounded < (double)last ? (int32_t)rounded : last : first;
}

/* Texel of a square per hemisphere, its corners the horizon: an octahedron, unfolded. */
static int32_t sky_texel(int32_t side, Vec3 direction) {
    float sum = fabsf(direction.x) + fabsf(direction.y) + fabsf(direction.z);
    float x = direction.x / sum, y = direction.y / sum;
    int32_t column = (int32_t)(0.5f * (x + y + 1.0f) * (float)side);
    int32_t row = (int32_t)(0.5f * (x - y + 1.0f) * (float)side);
    column = column < side ? column : side - 1;
    row = row < side ? row : side - 1;
    return ((direction.z < 0.0f ? 0 : side) + row) * side + column;
}

static int32_t find_slot(const BakeJob *job, const double *origin, Vec3 direction, float distance,
                         int32_t triangle) {
    if (triangle == NO_TRIANGLE)
        return job->sky_slot + sky_texel(job->sky_side, direction);
    int32_t grid = job->grid_of[triangle];
    if (grid < 0)
        return job->slot_of[triangle];
    const OcclusionPatch *patch = job->patches + grid;
    double along[3] = {direction.x, direction.y, direction.z}, column = patch->offset[0],
           row = patch->offset[1];
    for (int axis = 0; axis < 3; axis++) {
        double at = origin[axis] + (double)distance * along[axis];
        column += at * (double)patch->column[axis];
        row += at * (double)patch->row[axis];
    }
    return limit_node(row, patch->top, patch->bottom) * job->width +
           limit_node(column, patch->left, patch->right);
}

static void cast_node(const BakeJob *job, int32_t node) {
    const double *position = job->positions + 3 * (size_t)node;
    Vec3 origin;
    const double *place = place_node(job->mesh, position, &origin);
    for (int32_t first = 0; first < job->num_rays; first += BLOCK_RAYS) {
        RayBlock rays = {.has_origins = 0, .active = 0xffff};
        HitBlock hits;
        for (int lane = 0; lane < BLOCK_RAYS; lane++) {
            set_lane(rays.origin, lane, origin);
            hits.triangle[lane] = NO_TRIANGLE;
        }
        aim_rays(job, node, job->sequence + 3 * (size_t)first, &rays);
        intersect_bvh(&job->mesh->bvh, place, OBJECT_STATIC, &rays, &hits);
        int32_t *slots = job->hits + (size_t)node * (size_t)job->stride + first;
        for (int lane = 0; lane < BLOCK_RAYS; lane++) {
            int32_t triangle = hits.triangle[lane];
            Vec3 direction = get_lane((const float(*)[BLOCK_RAYS])rays.direction, lane);
            slots[lane] = find_slot(job, position, direction, rays.limit[lane], triangle);
            if (triangle != NO_TRIANGLE &&
                (rays.limit[lane] < INSIDE_M || node >= job->first_probe))
                job->backs[node] +=
                    dot(vec3(job->normals + 3 * (size_t)triangle), direction) > 0.0f;
        }
    }
}

/* The ray from a node to a sample of a lamp, and the irradiance that it brings of one unit: at a
 * metre before a small lamp 1. Near a lamp each sample counts as a disc of its area. */
static float aim_at_lamp(const BakeJob *job, int32_t node, int number, int sample, int lane,
                         RayBlock *rays) {
    const BakeLamp *lamp = job->lamps + number;
    const double *position = job->positions + 3 * (size_t)node;
    Vec3 normal = vec3(job->axes + 9 * (size_t)job->grid[node] + 6), towards = vec3(lamp->normal);
    if (lamp->kind != LIGHT_RECTANGLE && sample)
        return 0.0f;
    rays->limit[lane] = INFINITY;
    if (lamp->kind == LIGHT_DIRECTIONAL) {
        set_lane(rays->direction, lane, towards);
        return dot(normal, towards);
    }
    float from[3], disc = 0.0f, weight = 1.0f;
    for (int axis = 0; axis < 3; axis++)
        from[axis] = (float)(lamp->corner[axis] - position[axis]);
    Vec3 offset = vec3(from);
    if (lamp->kind == LIGHT_RECTANGLE) {
        uint32_t bits = hash((uint32_t)node, job->pass_number, 2u + (uint32_t)number);
        float x = (float)(sample % 4) + fraction(bits << 8), y = (float)(sample / 4);
        y += fraction((bits >> 16) << 16);
        offset = add(offset, add(scale(0.25f * x, vec3(lamp->side_x)),
                                 scale(0.5f * y, vec3(lamp->side_y))));
        disc = lamp->area / (PI * SAMPLES);
        weight = 1.0f / SAMPLES;
    }
    float squared = dot(offset, offset);
    float length = __builtin_sqrtf(squared > 1e-6f ? squared : 1e-6f);
    Vec3 direction = scale(1.0f / length, offset);
    set_lane(rays->direction, lane, direction);
    rays->limit[lane] = BEFORE_LAMP * length;
    if (lamp->kind == LIGHT_RECTANGLE) {
        float leaving = -dot(direction, towards);
        weight *= leaving > 0.0f ? leaving : 0.0f;
    }
    return weight * dot(normal, direction) / (length * length + disc);
}

static void light_node(const BakeJob *job, int32_t node) {
    Vec3 origin;
    const Mesh *casters = job->casters;
    const double *place = place_node(casters, job->positions + 3 * (size_t)node, &origin);
    float *light = job->light + (size_t)node * (size_t)job->num_columns;
    for (int first = 0; first < job->num_lamps; first += LAMPS_AT_ONCE) {
        RayBlock rays = {.has_origins = 0};
        float weights[BLOCK_RAYS] = {0};
        for (int lane = 0; lane < BLOCK_RAYS; lane++) {
            int number = first + lane / SAMPLES;
            set_lane(rays.origin, lane, origin);
            set_lane(rays.direction, lane, (Vec3){0, 0, 1});
            weights[lane] = number < job->num_lamps
                                ? aim_at_lamp(job, node, number, lane % SAMPLES, lane, &rays)
                                : 0.0f;
            rays.active |= (uint32_t)(weights[lane] > 0.0f) << lane;
        }
        uint32_t seen = rays.active;
        if (seen && casters)
            seen &= ~occlude_bvh(&casters->bvh, place, &rays, NULL);
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            if (seen >> lane & 1)
                light[job->lamps[first + lane / SAMPLES].column] += weights[lane];
    }
}

static void bake_nodes(void *argument) {
    Bake *bake = argument;
    const BakeJob *job = bake->job;
    int32_t first;
    while ((first = atomic_fetch_add(&bake->next, NODES_AT_ONCE)) < job->num_nodes)
        for (int32_t node = first; node < first + NODES_AT_ONCE && node < job->num_nodes; node++) {
            cast_node(job, node);
            light_node(job, node);
        }
}

void catoptra_bake(Device *device, const BakeJob *job) {
    Bake bake = {job, 0};
    workers_run(device->workers, bake_nodes, &bake);
}

static void gather_nodes(void *argument) {
    Gather *gather = argument;
    const GatherJob *job = gather->job;
    int32_t first;
    while ((first = atomic_fetch_add(&gather->next, NODES_AT_ONCE)) < job->num_nodes)
        for (int32_t node = first; node < first + NODES_AT_ONCE && node < job->num_nodes; node++)
            for (int32_t pass = 0; pass < job->num_passes; pass++) {
                const int32_t *slots =
                    job->hits + (size_t)node * (size_t)job->stride + pass * job->num_rays;
                Vec3 sum = {0, 0, 0};
                int32_t known = 0;
                for (int32_t ray = 0; ray < job->num_rays; ray++) {
                    const float *radiance = job->radiance + 3 * (size_t)slots[ray];
                    if (radiance[0] >= 0.0f) {
                        sum = add(sum, vec3(radiance));
                        known++;
                    }
                }
                sum = scale(1.0f / (float)(known ? known : 1), sum);
                float *mean = job->means + 3 * ((size_t)pass * (size_t)job->num_nodes + (size_t)node);
                mean[0] = sum.x;
                mean[1] = sum.y;
                mean[2] = sum.z;
            }
}

void catoptra_gather(Device *device, const GatherJob *job) {
    Gather gather = {job, 0};
    workers_run(device->workers, gather_nodes, &gather);
}
