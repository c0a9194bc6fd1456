/* Ranges of pixels from the hits of the frame's own samples.
 *
 * The mean of inverse ranges: what depends on a range, as a defocus' diameter or a parallax, is
 * linear in its inverse, nothing at infinity is zero, and between two surfaces the mean weighs
 * both.
 */
#ifndef CATOPTRA_RANGES_H
#define CATOPTRA_RANGES_H

#include "frame_state.h"
#include "pixels.h"

/* Inverse distances of a block's hits, which limit its rays, 1/m; 0 without a hit. */
void find_inverse_ranges(const RayBlock *rays, const HitBlock *hits, float inverse[BLOCK_RAYS]);

/* Inverse ranges of a tile that one plane fills, into the frame, if these are wanted. */
void fill_ranges(const FrameState *state, int tile, int32_t triangle);

/* Sums of all samples' inverse ranges, of 16 pixels, as their means into the frame. */
void write_ranges(const FrameState *state, int tile, const float sums[TILE_PX * TILE_PX]);

#endif
