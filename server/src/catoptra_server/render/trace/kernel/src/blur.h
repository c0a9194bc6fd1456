/* Tiles of a moving frame at several instants of their exposure. */
#ifndef CATOPTRA_BLUR_H
#define CATOPTRA_BLUR_H

#include "tiles.h"

/* What a thread's tiles took. */
typedef struct BlurResult {
    int64_t num_rays;
} BlurResult;

/* Draw a tile again, as many instants as the frame's plan has for it; none leave it as it is. */
void blur_tile(const FrameState *state, int tile, const TileContent *content, BlurResult *result);

#endif
