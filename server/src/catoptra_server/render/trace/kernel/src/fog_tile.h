/* Tiles of one facet of one radiance in fog: transmittances instead of rays. */
#ifndef CATOPTRA_FOG_TILE_H
#define CATOPTRA_FOG_TILE_H

#include "frame_state.h"

/* Whether the mean of such a tile's samples is that of their transmittances. */
int is_fogged_as_one(const FrameState *state, int tile);

/* Fill the tile of a facet that has one radiance in clear air. */
void fill_fogged_tile(const FrameState *state, int tile, int32_t triangle, Vec3 radiance);

#endif
