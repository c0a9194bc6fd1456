/* Light that glossy facets mirror: one ray a sample. Float64 twin: reference/pixels.py. */
#ifndef CATOPTRA_GLOSS_H
#define CATOPTRA_GLOSS_H

#include "direct_light.h"

/* From here on roughness spreads a mirrored ray over more than a pixel, 0.01 radians. */
#define SHARED_ROUGHNESS 0.1f

/* Light that a tile's pixels mirror, the last of each: its samples on one facet share a ray. */
typedef struct MirroredPixels {
    uint32_t pixels; /* bit mask */
    _Alignas(64) int32_t triangle[BLOCK_RAYS];
    float light[3][BLOCK_RAYS];
    LostLight lost;
} MirroredPixels;

/* Mix what glossy hits mirror into their radiance, (3, 16), and into what shadows take of it;
 * `lost` may be NULL. `shared`: of the samples before; NULL: none. `is_noted`: the change counts in
 * the frame's measure. */
void add_gloss(const FrameState *state, const RayBlock *rays, const HitBlock *hits, int is_noted,
               MirroredPixels *shared, float radiance[3][BLOCK_RAYS], LostLight *lost);

#endif
