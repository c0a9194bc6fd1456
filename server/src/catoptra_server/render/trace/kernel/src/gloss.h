/* Light that glossy facets mirror: one ray a sample. Float64 twin: reference/pixels.py. */
#ifndef CATOPTRA_GLOSS_H
#define CATOPTRA_GLOSS_H

#include "direct_light.h"

/* From here on roughness spreads a mirrored ray over more than a pixel, 0.01 radians. */
#define SHARED_ROUGHNESS 0.1f

/* Light that the pixels of a tile mirror, (3, 16), by one ray each, where a rough facet fills it;
 * 0 where the rays do not all meet one facet, so that edges in the mirror are those of samples. */
int mirror_pixels(const FrameState *state, int tile, int32_t triangle,
                  float light[3][BLOCK_RAYS]);

/* Mix what glossy hits mirror into their radiance, (3, 16), and into what shadows take of it;
 * `lost` may be NULL. `is_noted`: the change counts in the frame's measure. `known`: as of
 * `mirror_pixels`, or NULL. */
void add_gloss(const FrameState *state, const RayBlock *rays, const HitBlock *hits, int is_noted,
               const float (*known)[BLOCK_RAYS], float radiance[3][BLOCK_RAYS], LostLight *lost);

#endif
