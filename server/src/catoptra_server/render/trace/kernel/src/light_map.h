/* Where nothing can occlude a directional light: a conservative height map of the casters.
 *
 * Cells of a plane across the light store how far towards the light the casters above them reach:
 * the highest surface, and the highest point of all others, so that a surface does not occlude
 * itself. A point as high as all others in its cell is lit without a ray; the map never says that
 * a point is in shadow. Built once, at the first frame with shadows: most points of a scene are lit
 * (95 to 97 % of the soccer field's pixels).
 */
#ifndef CATOPTRA_LIGHT_MAP_H
#define CATOPTRA_LIGHT_MAP_H

#include "frame_state.h"

/* Cells of each light's map that dynamic objects may occlude in a frame; NULL without objects, or
 * if memory is short (`*failed`). */
uint8_t *mark_objects(const FrameState *state, int *failed);

/* Whether nothing occludes directional light `light` at a point on a static facet. */
int is_lit_by_map(const FrameState *state, int light, int32_t triangle, Vec3 point);

/* Whether nothing occludes any directional light on the part of a facet between four points. */
int is_quad_lit(const FrameState *state, int32_t triangle, const Vec3 corners[4]);

#endif
