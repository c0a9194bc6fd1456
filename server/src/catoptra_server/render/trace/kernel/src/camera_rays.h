/* The rays of a block in the world, from the camera's table and pose. */
#ifndef CATOPTRA_CAMERA_RAYS_H
#define CATOPTRA_CAMERA_RAYS_H

#include "frame_state.h"

/* Rays of a block of the table, without limits, in Embree's coordinates. */
void load_block(const FrameState *state, size_t block, RayBlock *rays);

#endif
