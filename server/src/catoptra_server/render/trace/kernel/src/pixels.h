/* From the radiance of samples to the pixels of the image, encoded or linear. */
#ifndef CATOPTRA_PIXELS_H
#define CATOPTRA_PIXELS_H

#include "frame_state.h"

#include <string.h>

/* Sums of the samples of a tile's pixels, row by row. */
typedef struct {
    _Alignas(64) float sum[3][TILE_PX * TILE_PX];
} PixelSums;

/* The pixels of a tile within the image: the last row and column of tiles may reach beyond. */
typedef struct {
    char *first; /* first channel of the tile's first pixel */
    size_t row_bytes, pixel_bytes;
    int rows, columns;
} TilePixels;

/* Pixel of the tile, row by row, of a lane of one of the table's blocks. */
int pixel_of_lane(const FrameState *state, int block, int lane);

/* Values, (3, 16), of a tile's pixels for the rays of one of its blocks. */
void spread_pixels(const FrameState *state, const RayBlock *rays, const float pixels[3][BLOCK_RAYS],
                   float values[3][BLOCK_RAYS]);

TilePixels find_pixels(const FrameState *state, int tile);

/* Add a value of each of a block's rays, one channel, to the sums of its pixels; `samples`
 * along a side of each. */
void add_lanes(int samples, int block, const float values[BLOCK_RAYS],
               float sums[TILE_PX * TILE_PX]);

/* Add the (3, 16) radiance of a block's rays to the tile's pixels, from block 0 on. Samples beside
 * the mirror are black. */
void add_samples(const FrameState *state, int block, uint32_t active,
                 float radiance[3][BLOCK_RAYS], PixelSums *sums);

/* The same of a block of a row of pixels, whose lane l is of column l % 4. */
void add_row(int row, uint32_t active, float radiance[3][BLOCK_RAYS], PixelSums *sums);

/* Means of the samples into the image. */
void write_pixels(const FrameState *state, int tile, const PixelSums *sums);

/* One radiance for each of the tile's pixels, (3, 16), into the image. */
void write_radiance(const FrameState *state, int tile, const float radiance[3][TILE_PX * TILE_PX]);

/* A sensor's: the means of its pixels are clipped, once. What is not a number is black. */
static inline float clip(float value) { return value > 0.0f ? value < 1.0f ? value : 1.0f : 0.0f; }

/* Row of the sRGB table. */
static inline int32_t level_of(float linear) { return (int32_t)(clip(linear) * 65535.0f + 0.5f); }

static inline uint8_t encode(const FrameState *state, float linear) {
    return state->scene->srgb_table[level_of(linear)];
}

static inline char *pixel_at(const TilePixels *pixels, int row, int column) {
    return pixels->first + (size_t)row * pixels->row_bytes + (size_t)column * pixels->pixel_bytes;
}

static inline void write_mean(const FrameState *state, char *pixel, Vec3 mean) {
    if (state->frame->output == OUTPUT_LINEAR) {
        memcpy(pixel, &mean, 3 * sizeof(float));
        return;
    }
    pixel[0] = (char)encode(state, mean.x);
    pixel[1] = (char)encode(state, mean.y);
    pixel[2] = (char)encode(state, mean.z);
}

static inline void write_encoded(char *pixel, uint32_t rgb) {
    pixel[0] = (char)rgb;
    pixel[1] = (char)(rgb >> 8);
    pixel[2] = (char)(rgb >> 16);
}

#endif
