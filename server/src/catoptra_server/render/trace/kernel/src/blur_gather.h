/* What a tile shows during an exposure by the sharp frame's samples, where all of it moves as one.
 *
 * The light of a pixel is the mean along its path, which is read between samples by cubic splines.
 * Straight lines between them would give other means: by as much is doubted what lies between.
 * Source: Catmull and Rom 1974, "A class of local interpolating splines".
 */
#ifndef CATOPTRA_BLUR_GATHER_H
#define CATOPTRA_BLUR_GATHER_H

#include "frame_state.h"

/* Samples of a pixel along a side; the longest path by column and by row, px. */
enum { GATHERED_SIDE = 2 };
#define MAX_PATH_PX 3.0f

/* Samples of a frame's tiles. */
typedef struct {
    uint8_t *is_sampled; /* (t,) others show one light in all samples of a pixel */
    float *radiance;     /* (t, 4, 3, 16) */
} TileSamples;

/* Mean light, (3, 16), of a tile's pixels in some of its rows, a bit mask, along a path of so many
 * columns and rows about each, and what is doubted of it. `means`, (t, 3, 16), are those of the
 * sharp frame. The tile counts for those around that the picture lacks. */
void gather_tile(const FrameState *state, int32_t number, const TileSamples *samples,
                 const float *means, const float path[2], int rows, float gathered[3][BLOCK_RAYS],
                 float doubts[3][BLOCK_RAYS]);

#endif
