/* Labels of pixels: what the ray of each pixel's centre meets, and how many samples agree.
 *
 * Found beside an image whose samples are traced anyway, or alone. A tile that a proof has filled
 * with one plane takes no ray: its number is that of the plane, its ranges are those of the plane.
 * Twin: reference/pixels.py.
 */
#ifndef CATOPTRA_LABELS_H
#define CATOPTRA_LABELS_H

#include "tiles.h"

/* Objects of a tile's pixels, row by row. */
typedef struct {
    uint16_t number[TILE_PX * TILE_PX]; /* what the centre meets; 0 for nothing */
    int count[TILE_PX * TILE_PX];       /* samples that meet the same */
} TileLabels;

/* What the centres of a tile's pixels meet, into the channels; no sample is counted yet. */
void label_centres(const FrameState *state, int tile, const TileContent *content,
                   TileLabels *found);

/* Count the samples of a block, by what they meet. */
void count_samples(const FrameState *state, int block, uint32_t active, const HitBlock *hits,
                   TileLabels *found);

/* Agreement of a tile whose samples are all counted, into its channel. */
void write_agreement(const FrameState *state, int tile, const TileLabels *found);

/* All labels of a tile that one plane or the background fills. */
void label_filled_tile(const FrameState *state, int tile, const TileContent *content);

/* All labels of a tile of which no image is drawn. */
void label_tile(const FrameState *state, int tile, const TileContent *content);

/* Labels of the pixels that no tile of the view has. */
void label_beside_view(const Labels *labels, const View *view);

#endif
