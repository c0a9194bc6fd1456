/* What bodies that move take of baked light near them: the form factors of boxes. */
#ifndef CATOPTRA_BODY_SHADE_H
#define CATOPTRA_BODY_SHADE_H

#include "frame_state.h"

/* Whether some body may shade points of the quadrangle between four points; for certain where none
 * does. */
int may_be_shaded(const FrameState *state, const Vec3 corners[4]);

/* Parts of its light, (16,), that bodies leave to each of a mask of rays which end on a facet; 0 if
 * all of it to all. */
int find_open_parts(const FrameState *state, uint32_t mask, const float ends[3][BLOCK_RAYS],
                    Vec3 normal, float parts[BLOCK_RAYS]);

#endif
