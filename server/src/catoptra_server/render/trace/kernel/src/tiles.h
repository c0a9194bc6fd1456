/* One tile of a frame: its rays' hits, their radiance, its pixels. */
#ifndef CATOPTRA_TILES_H
#define CATOPTRA_TILES_H

#include "frame_state.h"

/* Surfaces by their representative triangle; other values say that nothing is known. */
enum { SURFACE_BACKGROUND = -1, SURFACE_UNKNOWN = -2 };

/* Render a tile. `triangle`: triangle whose plane all rays of the tile meet first, the background,
 * or SURFACE_UNKNOWN, in which case the rays are traced. */
void render_tile(const FrameState *state, int tile, int32_t triangle);

/* Trace the rays of a tile against the static scene without any use of the hits. */
void trace_tile(const FrameState *state, int tile);

#endif
