/* Fog on samples: Koschmieder's law by each hit's own distance. Float64 twin: world/objects.py.
 */
#ifndef CATOPTRA_FOG_H
#define CATOPTRA_FOG_H

#include "frame_state.h"
#include "shading.h"

static inline int has_fog(const FrameState *state) { return state->frame->fog_density > 0.0f; }

/* Mix the radiance of a block's samples with the airlight; dim what shadows take away. `is_plane`:
 * all rays meet one plane, at the distances that limit them. */
void fog_block(const FrameState *state, const RayBlock *rays, const HitBlock *hits, int is_plane,
               float radiance[3][BLOCK_RAYS], LostLight *lost);

/* Mean transmittances of the samples of a tile's pixels, where one plane fills the tile. */
void find_plane_transmittances(const FrameState *state, int tile, int32_t triangle,
                               float means[TILE_PX * TILE_PX]);

#endif
