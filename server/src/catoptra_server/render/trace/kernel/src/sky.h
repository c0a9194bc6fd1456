/* The sky by direction: what rays show that meet nothing. Float64 twin: world/panorama.py. */
#ifndef CATOPTRA_SKY_H
#define CATOPTRA_SKY_H

#include "ray_block.h"

/* Radiance of a mask of rays, which meet nothing; all others are left as they are. */
void show_sky(const Scene *scene, const RayBlock *rays, uint32_t mask,
              float radiance[3][BLOCK_RAYS]);

#endif
