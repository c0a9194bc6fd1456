/* The rays of a block in the world, from the camera's table and pose. */
#ifndef CATOPTRA_CAMERA_RAYS_H
#define CATOPTRA_CAMERA_RAYS_H

#include "frame_state.h"

/* Steps from a ray to its neighbours to the right and below, in the world; means over a block, zero
 * where no two neighbours are valid. Twin: `steps` of reference_engine.py's batches. */
typedef struct {
    Vec3 step[2];
} RaySteps;

/* Fetch ahead, for a block of rays, the same one of the tile that mostly follows. */
static inline void fetch_next_tile(const FrameState *state, const float *directions) {
    for (int axis = 0; axis < 3; axis++)
        __builtin_prefetch(directions + (3 * state->rays->samples * state->rays->samples + axis) *
                                            BLOCK_RAYS);
}

RaySteps find_ray_steps(const FrameState *state, const RayBlock *rays);

/* Rays of a block of the table, without limits, in the frame's coordinates. */
void load_block(const FrameState *state, size_t block, RayBlock *rays);

/* The same of another table of the camera's. */
void load_rays(const FrameState *state, const RayTable *table, size_t block, RayBlock *rays);

/* The same of the rays of a tile that a block of a RayOrder names. */
void load_ordered(const FrameState *state, int tile, const uint16_t *source, RayBlock *rays);

#endif
