/* From the radiance of samples to the pixels of the image, encoded or linear. */
#ifndef CATOPTRA_PIXELS_H
#define CATOPTRA_PIXELS_H

#include "frame_state.h"

#include <string.h>

/* Radiance of all samples of a tile, as a grid of (4 samples)^2. */
typedef struct {
    Vec3 radiance[TILE_PX * MAX_SAMPLES][TILE_PX * MAX_SAMPLES];
} SampleGrid;

/* The pixels of a tile within the image: the last row and column of tiles may reach beyond. */
typedef struct {
    char *first; /* first channel of the tile's first pixel */
    size_t row_bytes, pixel_bytes;
    int rows, columns;
} TilePixels;

TilePixels find_pixels(const FrameState *state, int tile);

/* Radiance of a block's rays into the tile's grid; samples beside the mirror are black. */
void store_radiance(const FrameState *state, int block, uint32_t active, const Vec3 *radiance,
                    SampleGrid *grid);

/* Means of the samples into the image. */
void write_pixels(const FrameState *state, int tile, const SampleGrid *grid);

/* Values between 0 and 1; what is not a number is black. */
static inline float clip(float value) { return value > 0.0f ? value < 1.0f ? value : 1.0f : 0.0f; }

static inline Vec3 clip3(Vec3 a) { return (Vec3){clip(a.x), clip(a.y), clip(a.z)}; }

static inline uint8_t encode(const FrameState *state, float linear) {
    return state->scene->srgb_table[(int32_t)(clip(linear) * 65535.0f + 0.5f)];
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
