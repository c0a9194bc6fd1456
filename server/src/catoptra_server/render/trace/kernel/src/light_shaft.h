/* Whether anything reaches into the way of a light to a part of a surface: a shaft (Haines and
 * Wallace 1991, "Shaft culling for efficient ray-traced radiosity"), the hull of four points and
 * the light, against the hierarchies of casters and objects.
 *
 * What is told apart is farther apart than shadow rays can differ from the ways between points and
 * light: they begin 2^-18 of the largest coordinate beside their points, and end as far beside a
 * lamp; points, directions and tests are rounded by less.
 */
#ifndef CATOPTRA_LIGHT_SHAFT_H
#define CATOPTRA_LIGHT_SHAFT_H

#include "frame_state.h"

enum { MAX_SHAFTS = 32 };

/* Lights, of the first ones and other than those of a mask, of which it is certain that they meet
 * nothing but a static facet's own surface on their way to the quadrangle between four points of
 * its plane, in rows. `blockers` are 0, or what was in the way of an earlier one: mostly it still
 * is. */
uint32_t find_free_lights(const FrameState *state, int32_t triangle, const Vec3 corners[4],
                          uint32_t others, int32_t blockers[MAX_SHAFTS]);

#endif
