/* Provides label_block.h: a tile's labels into the channels.
 * Float64 twin: reference/pixels.py:label_pixels. Owns nothing: channels are Python's.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "label_block.h"

#include <math.h>
#include <string.h>

typedef float Row __attribute__((vector_size(4 * TILE_PX)));
typedef float Rows __attribute__((vector_size(8 * TILE_PX)));

/* Vectors of four pixels by pixel: in three stores instead of twelve, which would wait for one
 * another. */
static inline void store_vectors(const float values[3][TILE_PIXELS], int first, float *pixels) {
    Row x, y, z, right;
    memcpy(&x, values[0] + first, sizeof x);
    memcpy(&y, values[1] + first, sizeof y);
    memcpy(&z, values[2] + first, sizeof z);
    Rows xy = __builtin_shufflevector(x, y, 0, 4, 1, 5, 2, 6, 3, 7);
    Rows zz = __builtin_shufflevector(z, z, 0, 1, 2, 3, 4, 5, 6, 7);
    Rows left = __builtin_shufflevector(xy, zz, 0, 1, 8, 2, 3, 9, 4, 5);
    right = __builtin_shufflevector(xy, zz, 10, 6, 7, 11);
    memcpy(pixels, &left, sizeof left);
    memcpy(pixels + 2 * TILE_PX, &right, sizeof right);
}

/* Values of a tile by component into a channel of `depth` values a pixel. */
static inline __attribute__((always_inline)) void
store_floats(const TilePlace *place, int depth, const float values[][TILE_PIXELS], int rows,
             int columns, float *channel) {
    for (int row = 0; row < rows; row++) {
        size_t at = place->first + (size_t)row * place->width_px;
        float *pixels = channel + (size_t)depth * at;
        if (depth == 3 && columns == TILE_PX)
            store_vectors(values, row * TILE_PX, pixels);
        else
            for (int column = 0; column < columns; column++)
                for (int axis = 0; axis < depth; axis++)
                    pixels[depth * column + axis] = values[axis][row * TILE_PX + column];
    }
}

static inline __attribute__((always_inline)) void
store_numbers(const TilePlace *place, const uint16_t numbers[TILE_PIXELS], int rows, int columns,
              uint16_t *channel) {
    for (int row = 0; row < rows; row++)
        for (int column = 0; column < columns; column++)
            channel[place->first + (size_t)row * place->width_px + (size_t)column] =
                numbers[row * TILE_PX + column];
}

static inline __attribute__((always_inline)) void
store_pixels(const Labels *labels, const TilePlace *place, const LabelBlock *block, int rows,
             int columns) {
    if (labels->ids)
        store_numbers(place, block->number, rows, columns, labels->ids);
    if (labels->classes) {
        uint16_t classes[TILE_PIXELS];
        for (int lane = 0; lane < TILE_PIXELS; lane++)
            classes[lane] = labels->class_table[block->number[lane]];
        store_numbers(place, classes, rows, columns, labels->classes);
    }
    if (labels->range_m)
        store_floats(place, 1, &block->range_m, rows, columns, labels->range_m);
    if (labels->normal)
        store_floats(place, 3, block->normal, rows, columns, labels->normal);
    if (labels->point)
        store_floats(place, 3, block->point, rows, columns, labels->point);
}

void store_block(const Labels *labels, const TilePlace *place, const LabelBlock *block) {
    /* With sides known to the compiler where the tile lies within the image. */
    if (place->rows == TILE_PX && place->columns == TILE_PX)
        store_pixels(labels, place, block, TILE_PX, TILE_PX);
    else
        store_pixels(labels, place, block, place->rows, place->columns);
}

void clear_block(LabelBlock *block) {
    for (int lane = 0; lane < TILE_PIXELS; lane++) {
        block->number[lane] = 0;
        block->range_m[lane] = INFINITY;
    }
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < TILE_PIXELS; lane++) {
            block->normal[axis][lane] = 0.0f;
            block->point[axis][lane] = NAN;
        }
}

void prefetch_block(const Labels *labels, const TilePlace *place) {
    for (int row = 0; row < place->rows; row++) {
        size_t at = place->first + (size_t)row * place->width_px;
        if (labels->ids)
            __builtin_prefetch(labels->ids + at, 1);
        if (labels->classes)
            __builtin_prefetch(labels->classes + at, 1);
        if (labels->range_m)
            __builtin_prefetch(labels->range_m + at, 1);
        if (labels->normal) {
            __builtin_prefetch(labels->normal + 3 * at, 1);
            __builtin_prefetch(labels->normal + 3 * at + 11, 1);
        }
        if (labels->point) {
            __builtin_prefetch(labels->point + 3 * at, 1);
            __builtin_prefetch(labels->point + 3 * at + 11, 1);
        }
    }
}
