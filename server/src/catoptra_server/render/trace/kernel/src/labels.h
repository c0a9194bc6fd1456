/* Labels of pixels: what the ray of each pixel's centre meets, and how many samples agree.
 *
 * A tile that a proof has filled with one plane takes no ray: its number is that of the plane, its
 * ranges are those of the plane. Twin: reference/pixel_labels.py.
 */
#ifndef CATOPTRA_LABELS_H
#define CATOPTRA_LABELS_H

#include "tiles.h"

/* Channels of a tile, of a table of one sample a pixel. */
void label_tile(const FrameState *state, int tile, const TileContent *content);

/* Samples of a tile that meet the expected objects. */
void count_agreement(const FrameState *state, int tile, const TileContent *content);

#endif
