/* Tiles of a moving frame at several instants of their exposure. */
#ifndef CATOPTRA_BLUR_H
#define CATOPTRA_BLUR_H

#include "tiles.h"

/* Draw a tile again, as many instants as the frame's plan has for it, whose rays are counted; none
 * leave it as it is. */
void blur_tile(const FrameState *state, int tile, const TileContent *content, int64_t *num_rays);

#endif
