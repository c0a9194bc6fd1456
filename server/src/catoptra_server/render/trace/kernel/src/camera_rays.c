/* Provides camera_rays.h: blocks of the table's rays in the world.
 * Float64 twin: reference/reference_engine.py:_read_batch and
 * reference/meshes.py:interpolate_poses. Owns nothing: writes what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "camera_rays.h"

#include "lanes.h"

#include <math.h>

/* World directions and origins of rays with times of their own. */
static void place_rays_singly(const FrameState *state, const RayTable *table, size_t block,
                              RayBlock *rays) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        size_t at = block * 3 * BLOCK_RAYS + (size_t)lane;
        Pose pose;
        rays->time[lane] = table->times ? table->times[block * BLOCK_RAYS + (size_t)lane] : 0.0f;
        pose_at(state->frame->camera, state->frame->num_poses, 1, rays->time[lane], &pose);
        Vec3 direction = {table->directions[at], table->directions[at + BLOCK_RAYS],
                          table->directions[at + 2 * BLOCK_RAYS]};
        Vec3 origin = {0, 0, 0};
        if (table->origins)
            origin = (Vec3){table->origins[at], table->origins[at + BLOCK_RAYS],
                            table->origins[at + 2 * BLOCK_RAYS]};
        direction = rotate(pose.rotation, direction);
        /* Between two poses a rotation's entries shorten: distances are metres of unit rays. */
        direction = scale(1.0f / sqrtf(dot(direction, direction)), direction);
        origin = add(rotate(pose.rotation, origin), vec3(pose.translation));
        set_lane(rays->direction, lane, direction);
        set_lane(rays->origin, lane, origin);
    }
    rays->has_origins = 1;
}

/* Sum of the steps between neighbours in a row or column that are both valid; 1 or TILE_PX lanes
 * apart. */
static Vec3 mean_step(const float *directions, uint32_t valid, int lanes) {
    Vec3 sum = {0, 0, 0};
    int pairs = 0;
    for (int lane = 0; lane + lanes < BLOCK_RAYS; lane++) {
        int is_in_row = lanes > 1 || lane % TILE_PX < TILE_PX - 1;
        if (!is_in_row || !(valid >> lane & valid >> (lane + lanes) & 1))
            continue;
        const float *here = directions + lane, *there = here + lanes;
        sum = add(sum, (Vec3){there[0] - here[0], there[BLOCK_RAYS] - here[BLOCK_RAYS],
                              there[2 * BLOCK_RAYS] - here[2 * BLOCK_RAYS]});
        pairs++;
    }
    return pairs ? scale(1.0f / (float)pairs, sum) : sum;
}

/* The same of a block whose rays are all valid: steps between first and last add up. */
static void sum_full_steps(const float *directions, float sums[2][3]) {
    enum { LAST = TILE_PX - 1 };
    for (int axis = 0; axis < 3; axis++) {
        const float *from = directions + axis * BLOCK_RAYS;
        float right = 0.0f, down = 0.0f;
        for (int i = 0; i < TILE_PX; i++) {
            right += from[TILE_PX * i + LAST] - from[TILE_PX * i];
            down += from[TILE_PX * LAST + i] - from[i];
        }
        sums[0][axis] = right * (1.0f / (TILE_PX * LAST));
        sums[1][axis] = down * (1.0f / (TILE_PX * LAST));
    }
}

/* Steps as a facet mirrors them, longer by what its roughness spreads. */
static void mirror_steps(const MirrorPlane *plane, RaySteps *steps) {
    float spread = plane->spread * plane->spread;
    for (int i = 0; i < 2; i++) {
        Vec3 step = steps->step[i];
        float squared = dot(step, step);
        step = subtract(step, scale(2.0f * dot(plane->normal, step), plane->normal));
        steps->step[i] = squared > 0.0f ? scale(sqrtf(1.0f + spread / squared), step) : step;
    }
}

RaySteps find_ray_steps(const FrameState *state, const RayBlock *rays) {
    const float *directions = state->rays->directions + rays->index * 3 * BLOCK_RAYS;
    uint32_t valid = state->rays->valid[rays->index];
    float sums[2][3];
    RaySteps steps;
    if (valid == 0xffff) {
        sum_full_steps(directions, sums);
        steps = (RaySteps){{vec3(sums[0]), vec3(sums[1])}};
    } else {
        steps = (RaySteps){
            {mean_step(directions, valid, 1), mean_step(directions, valid, TILE_PX)}};
    }
    /* A camera turns by little within an exposure: the first ray's pose serves all of a block. */
    Pose pose = state->camera;
    if (!state->has_one_pose)
        pose_at(state->frame->camera, state->frame->num_poses, 1, rays->time[0], &pose);
    for (int i = 0; i < 2; i++)
        steps.step[i] = rotate(pose.rotation, steps.step[i]);
    if (state->mirror)
        mirror_steps(state->mirror, &steps);
    return steps;
}

/* World directions from a pose, and its origin, of directions in the mirror frame. */
static void turn_rays(const FrameState *state, const float *from, RayBlock *rays) {
    const Pose *pose = &state->camera;
    const float *r = pose->rotation;
    Floats16 x = load16(from), y = load16(from + BLOCK_RAYS), z = load16(from + 2 * BLOCK_RAYS);
    fetch_next_tile(state, from);
    for (int axis = 0; axis < 3; axis++) {
        store16(r[3 * axis] * x + r[3 * axis + 1] * y + r[3 * axis + 2] * z, rays->direction[axis]);
        store16(splat16(pose->translation[axis]), rays->origin[axis]);
    }
    store16(splat16(state->time), rays->time);
    rays->has_origins = 0;
}

/* Origins in the world of origins in the mirror frame. */
static void place_origins(const FrameState *state, const float *from, RayBlock *rays) {
    const float *r = state->camera.rotation, *t = state->camera.translation;
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            rays->origin[axis][lane] = t[axis] + (r[3 * axis] * from[lane] +
                                                  r[3 * axis + 1] * from[BLOCK_RAYS + lane] +
                                                  r[3 * axis + 2] * from[2 * BLOCK_RAYS + lane]);
    rays->has_origins = 1;
}

void load_ordered(const FrameState *state, int tile, const uint16_t *source, RayBlock *rays) {
    size_t first = (size_t)tile * (size_t)state->rays->samples * (size_t)state->rays->samples;
    const float *table_origins = state->rays->origins;
    _Alignas(64) float directions[3][BLOCK_RAYS], origins[3][BLOCK_RAYS];
    uint32_t active = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int is_ray = source[lane] != NO_RAY;
        size_t block = first + (is_ray ? source[lane] / BLOCK_RAYS : 0);
        int at = is_ray ? source[lane] % BLOCK_RAYS : 0;
        const float *from = state->rays->directions + block * 3 * BLOCK_RAYS + at;
        for (int axis = 0; axis < 3; axis++)
            directions[axis][lane] = from[axis * BLOCK_RAYS];
        const float *start = table_origins ? table_origins + block * 3 * BLOCK_RAYS + at : from;
        for (int axis = 0; axis < 3; axis++)
            origins[axis][lane] = start[axis * BLOCK_RAYS];
        active |= (uint32_t)(is_ray && state->rays->valid[block] >> at & 1) << lane;
    }
    turn_rays(state, directions[0], rays);
    if (table_origins)
        place_origins(state, origins[0], rays);
    /* The block of the table whose steps between neighbours are nearest. */
    rays->index = first + source[0] / BLOCK_RAYS;
    store16(splat16(INFINITY), rays->limit);
    rays->active = active;
}

void load_rays(const FrameState *state, const RayTable *table, size_t block, RayBlock *rays) {
    size_t first = block * 3 * BLOCK_RAYS;
    if (table->times)
        place_rays_singly(state, table, block, rays);
    else
        turn_rays(state, table->directions + first, rays);
    if (table->origins && !table->times)
        place_origins(state, table->origins + first, rays);
    store16(splat16(INFINITY), rays->limit);
    rays->active = table->valid[block];
    rays->index = block;
}

void load_block(const FrameState *state, size_t block, RayBlock *rays) {
    load_rays(state, state->rays, block, rays);
}
