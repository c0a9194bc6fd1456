/* Labels of a tile by component, and their way into the channels, which are pixel by pixel. */
#ifndef CATOPTRA_LABEL_BLOCK_H
#define CATOPTRA_LABEL_BLOCK_H

#include "tile_place.h"

/* Values of a tile's pixels, by component for vector code. */
typedef struct {
    _Alignas(64) float range_m[TILE_PIXELS];
    float normal[3][TILE_PIXELS];
    float point[3][TILE_PIXELS];
    uint16_t number[TILE_PIXELS];
} LabelBlock;

/* Pixels whose rays meet nothing. */
void clear_block(LabelBlock *block);

/* Values of a tile into the channels that are wanted. */
void store_block(const Labels *labels, const TilePlace *place, const LabelBlock *block);

/* Ask for the memory that these values will be stored in: tiles lie in it far apart, and each store
 * would wait for its line. */
void prefetch_block(const Labels *labels, const TilePlace *place);

#endif
