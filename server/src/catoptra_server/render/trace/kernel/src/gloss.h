/* Light that glossy facets mirror: one ray a sample. Float64 twin: reference/pixels.py. */
#ifndef CATOPTRA_GLOSS_H
#define CATOPTRA_GLOSS_H

#include "direct_light.h"

/* Mix what glossy hits mirror into their radiance, (3, 16), and into what shadows take of it;
 * `lost` may be NULL. `is_noted`: the change counts in the frame's measure. */
void add_gloss(const FrameState *state, const RayBlock *rays, const HitBlock *hits, int is_noted,
               float radiance[3][BLOCK_RAYS], LostLight *lost);

#endif
