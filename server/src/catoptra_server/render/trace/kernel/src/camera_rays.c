#include "camera_rays.h"

#include <math.h>
#include <string.h>

/* World directions and origins of a block whose rays share one pose. */
static void place_rays(const FrameState *state, size_t block, RayBlock *rays) {
    const Pose *pose = state->frame->camera;
    const float *from = state->rays->directions + block * 3 * BLOCK_RAYS;
    const float *r = pose->rotation;
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            rays->direction[axis][lane] = r[3 * axis] * from[lane] +
                                          r[3 * axis + 1] * from[BLOCK_RAYS + lane] +
                                          r[3 * axis + 2] * from[2 * BLOCK_RAYS + lane];
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            rays->origin[axis][lane] = pose->translation[axis];
    memset(rays->time, 0, sizeof rays->time);
}

/* The same for rays with origins or times of their own. */
static void place_rays_singly(const FrameState *state, size_t block, RayBlock *rays) {
    const RayTable *table = state->rays;
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
}

void load_block(const FrameState *state, size_t block, RayBlock *rays) {
    if (state->rays->origins || state->rays->times)
        place_rays_singly(state, block, rays);
    else
        place_rays(state, block, rays);
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        rays->limit[lane] = INFINITY;
    rays->active = state->rays->valid[block];
}
