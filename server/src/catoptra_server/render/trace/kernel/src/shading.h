/* Linear radiance of the hits of a block. Float64 twin: scene/shading.py. */
#ifndef CATOPTRA_SHADING_H
#define CATOPTRA_SHADING_H

#include "frame_state.h"

/* Radiance by ray, (16, 3); rays that are not active are left as they are. */
void shade_block(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                 Vec3 radiance[BLOCK_RAYS]);

#endif
