/* Tiles that one plain facet fills, from which a part of the sky is hidden: a factor for each
 * pixel, without a ray. */
#ifndef CATOPTRA_OCCLUDED_TILES_H
#define CATOPTRA_OCCLUDED_TILES_H

#include "beams.h"
#include "tiles.h"

/* Also tiles of open sky, whose content is rendered as such. 0, and nothing done, unless the sky is
 * open or the content is one facet without texture under constant lights, whose factors vary little
 * within a pixel. `beam`: the tile's. */
int fill_occluded_tile(const FrameState *state, int tile, const TileContent *content,
                       const Beam *beam);

#endif
