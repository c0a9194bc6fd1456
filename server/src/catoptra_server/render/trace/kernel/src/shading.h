/* Linear radiance of the hits of a block. Float64 twin: world/shading.py. */
#ifndef CATOPTRA_SHADING_H
#define CATOPTRA_SHADING_H

#include "direct_light.h"

/* Irradiance from the hemisphere; z points down, so an upward facet has normal z = -1. */
Vec3 ambient_irradiance(const Hemisphere *hemisphere, Vec3 normal);

/* Radiance of the facets of each object at its pose, for frames in which it is the same over each
 * facet; NULL where it is not, where a table takes longer than the rays, or where memory is short.
 * Freed by the caller. */
const Vec3 **light_objects(const FrameState *state);

/* Whether the radiance of a hit comes from a table, and the entry. */
int is_tabulated(const FrameState *state, int object, int triangle);
Vec3 table_entry(const FrameState *state, int object, int triangle);

/* Radiance, (3, 16), and what of it is lost by shadows; rays that are not active are left as they
 * are. `proof` is NULL, or what is known of the one static facet that all hits lie on; `proofs` is
 * NULL, or what is known of some of several; `lost` may be NULL, and its rays are set before.
 * `is_open`: nothing hides the sky from any hit. */
void shade_block(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                 const LightProof *proof, const FacetProofs *proofs, int is_open,
                 float radiance[3][BLOCK_RAYS], LostLight *lost);

#endif
