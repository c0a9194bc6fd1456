/* Provides pixels.h: sums of samples, and their means into the image.
 * Float64 twin: reference/reference_engine.py:mean_pixels, encode_pixels. Owns nothing: the image
 * is Python's.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "pixels.h"

#include "tile_place.h"

TilePixels find_pixels(const FrameState *state, int tile) {
    TilePlace place = place_tile(state->rays, state->rays->tiles[tile]);
    size_t pixel_bytes = state->frame->output == OUTPUT_LINEAR ? 3 * sizeof(float) : 3;
    return (TilePixels){
        .first = (char *)state->frame->image + place.first * pixel_bytes,
        .row_bytes = place.width_px * pixel_bytes,
        .pixel_bytes = pixel_bytes,
        .rows = place.rows,
        .columns = place.columns,
    };
}

/* Row or column of the pixel that a row or column of samples belongs to: a division by
 * multiplication, exact for all 64 rows. */
static int pixel_of(int sample, int reciprocal) { return sample * reciprocal >> 16; }

int pixel_of_lane(const FrameState *state, int block, int lane) {
    int samples = state->rays->samples, reciprocal = 65536 / samples + 1;
    int row = block / samples * TILE_PX + lane / TILE_PX;
    int column = block % samples * TILE_PX + lane % TILE_PX;
    return pixel_of(row, reciprocal) * TILE_PX + pixel_of(column, reciprocal);
}

void spread_pixels(const FrameState *state, const RayBlock *rays, const float pixels[3][BLOCK_RAYS],
                   float values[3][BLOCK_RAYS]) {
    size_t blocks = (size_t)state->rays->samples * (size_t)state->rays->samples;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int pixel = pixel_of_lane(state, (int)(rays->index % blocks), lane);
        set_lane(values, lane, get_lane(pixels, pixel));
    }
}

/* Two samples a side: a block has a quarter of the tile's pixels, of two lanes in two rows each. In
 * the order of the lanes, so that sums have the same last bit as one by one. */
static void add_quarter(int block, const float values[BLOCK_RAYS], float sums[TILE_PX * TILE_PX]) {
    Floats16 lanes = load16(values);
    Floats8 even = __builtin_shufflevector(lanes, lanes, 0, 2, 4, 6, 8, 10, 12, 14);
    Floats8 odd = __builtin_shufflevector(lanes, lanes, 1, 3, 5, 7, 9, 11, 13, 15);
    for (int pixel = 0; pixel < 4; pixel++) {
        int row = pixel / 2, column = pixel % 2, lane = 4 * row + column;
        float *sum = sums + (block / 2 * 2 + row) * TILE_PX + block % 2 * 2 + column;
        *sum = *sum + even[lane] + odd[lane] + even[lane + 2] + odd[lane + 2];
    }
}

void add_lanes(int samples, int block, const float values[BLOCK_RAYS],
               float sums[TILE_PX * TILE_PX]) {
    int reciprocal = 65536 / samples + 1;
    int top = block / samples * TILE_PX, left = block % samples * TILE_PX;
    if (samples == 2) {
        add_quarter(block, values, sums);
        return;
    }
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int row = pixel_of(top + lane / TILE_PX, reciprocal);
        sums[row * TILE_PX + pixel_of(left + lane % TILE_PX, reciprocal)] += values[lane];
    }
}

void add_samples(const FrameState *state, int block, uint32_t active,
                 float radiance[3][BLOCK_RAYS], PixelSums *sums) {
    int samples = state->rays->samples;
    for (int channel = 0; channel < 3; channel++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            if (!(active >> lane & 1))
                radiance[channel][lane] = 0.0f;
    if (samples == 1) {
        memcpy(sums->sum, radiance, sizeof sums->sum);
        return;
    }
    if (block == 0)
        memset(sums->sum, 0, sizeof sums->sum);
    for (int channel = 0; channel < 3; channel++)
        add_lanes(samples, block, radiance[channel], sums->sum[channel]);
}

void add_row(int row, uint32_t active, float radiance[3][BLOCK_RAYS], PixelSums *sums) {
    for (int channel = 0; channel < 3; channel++) {
        float *pixels = sums->sum[channel] + row * TILE_PX;
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            if (active >> lane & 1)
                pixels[lane % TILE_PX] += radiance[channel][lane];
    }
}

static void write_linear(const TilePixels *pixels, const float sum[3][TILE_PX * TILE_PX],
                         float factor) {
    for (int row = 0; row < pixels->rows; row++)
        for (int column = 0; column < pixels->columns; column++) {
            Vec3 mean = scale(factor, get_lane(sum, row * TILE_PX + column));
            memcpy(pixel_at(pixels, row, column), &mean, 3 * sizeof(float));
        }
}

/* Sums times a factor. */
static void write_scaled(const FrameState *state, int tile, const float sum[3][TILE_PX * TILE_PX],
                         float factor) {
    const uint8_t *table = state->scene->srgb_table;
    TilePixels pixels = find_pixels(state, tile);
    if (state->frame->output == OUTPUT_LINEAR) {
        write_linear(&pixels, sum, factor);
        return;
    }
    int32_t level[3][TILE_PX * TILE_PX];
    for (int channel = 0; channel < 3; channel++)
        for (int pixel = 0; pixel < TILE_PX * TILE_PX; pixel++)
            level[channel][pixel] = level_of(factor * sum[channel][pixel]);
    for (int row = 0; row < pixels.rows; row++) {
        uint8_t encoded[TILE_PX][3];
        for (int column = 0; column < TILE_PX; column++)
            for (int channel = 0; channel < 3; channel++)
                encoded[column][channel] = table[level[channel][row * TILE_PX + column]];
        memcpy(pixel_at(&pixels, row, 0), encoded, 3 * (size_t)pixels.columns);
    }
}

void write_pixels(const FrameState *state, int tile, const PixelSums *sums) {
    int samples = state->rays->samples * state->rays->samples;
    write_scaled(state, tile, sums->sum, 1.0f / (float)samples);
}

void write_radiance(const FrameState *state, int tile, const float radiance[3][TILE_PX * TILE_PX]) {
    write_scaled(state, tile, radiance, 1.0f);
}
