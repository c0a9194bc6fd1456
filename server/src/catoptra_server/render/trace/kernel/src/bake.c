/* Provides catoptra_bake and catoptra_gather: light on the nodes of grids over a scene's surfaces.
 * Float64 twin: tests/server/render/trace/occlusion/test_light_bake.py. Owns nothing: all arrays
 * are Python's.
 * Threads: the pool's, each for nodes of its own; a node's sums have one order. */
#include "device.h"

#include <math.h>
#include <stdatomic.h>

enum { NODES_AT_ONCE = 64 };
/* Of a node and pass, about; lamps of a fourth of a ray each are not left to chance. */
#define LAMP_RAYS 16.0f
#define FAINTNESS 4.0f
/* Of a lamp a ray stands for its part of those of 16 passes: with that of its own pass a window of
 * 2 m lacked a twentieth at a metre. */
#define PASSES 16.0f
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
        int32_t *slots = job->hits + (size_t)node * (size_t)job->num_rays + first;
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

/* Rays to lamps, with the irradiance that each brings of a lamp of one unit. */
typedef struct {
    RayBlock rays;
    float weights[BLOCK_RAYS];
    int32_t columns[BLOCK_RAYS];
    int count;
} LampRays;

static Vec3 reach_lamp(const BakeLamp *lamp, const double *position) {
    float from[3];
    for (int axis = 0; axis < 3; axis++)
        from[axis] = (float)(lamp->corner[axis] - position[axis]);
    return vec3(from);
}

/* Light of a rectangle at a node, about: 0 where no point of it is before the node, or this behind
 * it; near it less than there is. */
static float weigh_lamp(const BakeLamp *lamp, const double *position, Vec3 normal) {
    Vec3 x = scale(0.5f, vec3(lamp->side_x)), y = scale(0.5f, vec3(lamp->side_y));
    Vec3 centre = add(reach_lamp(lamp, position), add(x, y));
    float height = dot(normal, centre) + fabsf(dot(normal, x)) + fabsf(dot(normal, y));
    float depth = -dot(vec3(lamp->normal), centre);
    float squared = dot(centre, centre) + dot(x, x) + dot(y, y);
    int is_seen = height > 0.0f && depth > 0.0f;
    return is_seen ? lamp->power * height * depth / (squared * squared) : 0.0f;
}

static void cast_to_lamps(const BakeJob *job, const double *place, LampRays *lamps, float *light) {
    uint32_t seen = lamps->rays.active;
    if (seen && job->casters)
        seen &= ~occlude_bvh(&job->casters->bvh, place, &lamps->rays, NULL);
    for (int lane = 0; lane < lamps->count; lane++)
        if (seen >> lane & 1)
            light[lamps->columns[lane]] += lamps->weights[lane];
    lamps->rays.active = 0;
    lamps->count = 0;
}

/* Add the ray from a node at an offset from a lamp, of which it stands for an area: near it for a
 * disc of that area. Of one unit a small lamp brings 1 at a metre before it. */
static void add_lamp_ray(const BakeLamp *lamp, Vec3 normal, Vec3 offset, float area, float weight,
                         LampRays *lamps) {
    int lane = lamps->count++;
    float squared = dot(offset, offset);
    float length = __builtin_sqrtf(squared > 1e-6f ? squared : 1e-6f);
    Vec3 towards = vec3(lamp->normal), direction = towards;
    lamps->rays.limit[lane] = INFINITY;
    if (lamp->kind != LIGHT_DIRECTIONAL) {
        direction = scale(1.0f / length, offset);
        lamps->rays.limit[lane] = BEFORE_LAMP * length;
        weight /= length * length + area / PI;
    }
    if (lamp->kind == LIGHT_RECTANGLE) {
        float leaving = -dot(direction, towards);
        weight *= leaving > 0.0f ? leaving : 0.0f;
    }
    weight *= dot(normal, direction);
    set_lane(lamps->rays.direction, lane, direction);
    lamps->columns[lane] = lamp->column;
    lamps->weights[lane] = weight;
    lamps->rays.active |= (uint32_t)(weight > 0.0f) << lane;
}

/* Rectangles share some rays by the light that each would bring if nothing hid it. One of some
 * light has a ray at least, so that what it brings hardly varies; of the others some are drawn. */
static void light_node(const BakeJob *job, int32_t node) {
    const double *position = job->positions + 3 * (size_t)node;
    Vec3 origin, normal = vec3(job->axes + 9 * (size_t)job->grid[node] + 6);
    const double *place = job->casters ? place_node(job->casters, position, &origin) : NULL;
    float *light = job->light + (size_t)node * (size_t)job->num_columns, total = 0.0f;
    LampRays lamps = {.count = 0};
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        set_lane(lamps.rays.origin, lane, job->casters ? origin : (Vec3){0, 0, 0});
        set_lane(lamps.rays.direction, lane, (Vec3){0, 0, 1});
    }
    for (int number = 0; number < job->num_lamps; number++)
        if (job->lamps[number].kind == LIGHT_RECTANGLE)
            total += weigh_lamp(job->lamps + number, position, normal);
    for (int number = 0; number < job->num_lamps; number++) {
        const BakeLamp *lamp = job->lamps + number;
        Vec3 offset = reach_lamp(lamp, position);
        int is_area = lamp->kind == LIGHT_RECTANGLE, count = !job->pass_number;
        float chance = 1.0f, weight = is_area ? weigh_lamp(lamp, position, normal) : 1.0f;
        uint32_t right = hash((uint32_t)node, job->pass_number, 2u + 2u * (uint32_t)number);
        uint32_t down = hash((uint32_t)node, job->pass_number, 3u + 2u * (uint32_t)number);
        if (is_area) {
            float share = weight > 0.0f ? LAMP_RAYS * weight / total : 0.0f;
            chance = FAINTNESS * share < 1.0f ? FAINTNESS * share : 1.0f;
            count = fraction(down << 16) >= chance ? 0 : share > 1.0f ? (int)share : 1;
        }
        for (int ray = 0; ray < count; ray++) {
            /* Source: Roberts 2018, R2: any run of its points is spread evenly. */
            float x = fraction(right + (uint32_t)ray * 3242174889u);
            float y = fraction((down & 0xffff0000u) + (uint32_t)ray * 2447445414u);
            Vec3 at = is_area ? add(scale(x, vec3(lamp->side_x)), scale(y, vec3(lamp->side_y)))
                              : (Vec3){0, 0, 0};
            float part = 1.0f / (float)count;
            add_lamp_ray(lamp, normal, add(offset, at), part * lamp->area / PASSES,
                         part / chance, &lamps);
            if (lamps.count == BLOCK_RAYS)
                cast_to_lamps(job, place, &lamps, light);
        }
    }
    cast_to_lamps(job, place, &lamps, light);
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
        for (int32_t node = first; node < first + NODES_AT_ONCE && node < job->num_nodes; node++) {
            const int32_t *slots = job->hits + (size_t)node * (size_t)job->num_rays;
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
            float *mean = job->means + 3 * (size_t)node;
            mean[0] = sum.x;
            mean[1] = sum.y;
            mean[2] = sum.z;
        }
}

void catoptra_gather(Device *device, const GatherJob *job) {
    Gather gather = {job, 0};
    workers_run(device->workers, gather_nodes, &gather);
}
