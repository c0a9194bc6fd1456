/* Where the pixels of a tile are in an image: the last row and column of tiles may reach beyond. */
#ifndef CATOPTRA_TILE_PLACE_H
#define CATOPTRA_TILE_PLACE_H

#include "kernel.h"

#include <stddef.h>

enum { TILE_PIXELS = TILE_PX * TILE_PX };
_Static_assert(TILE_PIXELS == BLOCK_RAYS, "one sample a pixel makes a tile a block");

typedef struct {
    int top, left;      /* of the tile's first pixel */
    int rows, columns;  /* of pixels within the image */
    size_t first;       /* number of the first pixel, row by row of the image */
    size_t width_px;
} TilePlace;

/* Place of a tile by its number in the image, as RayTable's tiles. */
static inline TilePlace place_tile(const RayTable *table, int32_t number) {
    int top = number / table->tile_columns * TILE_PX, left = number % table->tile_columns * TILE_PX;
    int rows = table->height_px - top, columns = table->width_px - left;
    return (TilePlace){
        .top = top,
        .left = left,
        .rows = rows < TILE_PX ? rows : TILE_PX,
        .columns = columns < TILE_PX ? columns : TILE_PX,
        .first = (size_t)top * (size_t)table->width_px + (size_t)left,
        .width_px = (size_t)table->width_px,
    };
}

#endif
