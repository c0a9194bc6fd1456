/* Provides image_points.h: gains, dust, fixed pattern, converter and noise.
 * Float64 twins: `apply` of the effects in effects/, one for each kind. Owns nothing: planes are
 * the job's, maps Python's.
 * Threads: any thread of the pool, each for cells of its own. */
#include "image_points.h"

#include "image_change.h"
#include "image_glare.h"

#include <math.h>
#include <string.h>

#define SQRT_HALF 0.70710678f

typedef void ChangeRow(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                       float *values, int count);

static Floats16 map_row(const ImageStage *stage, int map, size_t first, int count) {
    return load_map(stage->maps[map], first, count);
}

static void change_gain(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                        float *values, int count) {
    (void)pass;
    Floats16 gains = stage->maps[0] ? map_row(stage, 0, first, count)
                                    : splat16(stage->numbers[channel]);
    store16(load16(values) * gains, values);
}

static void change_auto_gain(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                             float *values, int count) {
    (void)channel, (void)first, (void)count;
    const float *numbers = stage->numbers;
    float gain = pass->mean_luminance > 0.0f ? numbers[0] / pass->mean_luminance : numbers[2];
    gain = gain > numbers[1] ? gain < numbers[2] ? gain : numbers[2] : numbers[1];
    store16(load16(values) * gain, values);
}

static void change_clipped_gain(const Pass *pass, const ImageStage *stage, int channel,
                                size_t first, float *values, int count) {
    (void)pass, (void)first, (void)count;
    store16(least16(load16(values), splat16(1.0f)) * stage->numbers[channel], values);
}

static void change_cover(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                         float *values, int count) {
    (void)channel;
    float scattered = stage->numbers[0] * pass->mean_luminance;
    Floats16 light = load16(values);
    store16(light + map_row(stage, 0, first, count) * (scattered - light), values);
}

static void change_pattern(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                           float *values, int count) {
    first += (size_t)pass->job->width * (size_t)pass->job->height * (size_t)channel;
    store16(load16(values) * map_row(stage, 0, first, count) + map_row(stage, 1, first, count),
            values);
}

static void quantise(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                     float *values, int count) {
    (void)pass, (void)channel, (void)first, (void)count;
    float max_code = stage->numbers[0];
    Floats16 codes = __builtin_elementwise_floor(load16(values) * max_code + 0.5f) / max_code;
    store16(least16(codes, splat16(1.0f)), values);
}

static ChangeRow *const CHANGES[] = {
    [STAGE_GAIN] = change_gain,
    [STAGE_AUTO_GAIN] = change_auto_gain,
    [STAGE_CLIPPED_GAIN] = change_clipped_gain,
    [STAGE_COVER] = change_cover,
    [STAGE_PATTERN] = change_pattern,
    [STAGE_QUANTISE] = quantise,
    [STAGE_GLARE] = change_glare,
};

/* Hash of three words to three uniform words (pcg3d); one vector of pixels at once. */
static void hash_pixels(const uint32_t key[4], uint32_t column, uint32_t row,
                        uint32_t words[3][CELL_COLUMNS]) {
    const uint32_t factor = 1664525u, increment = 1013904223u;
    for (uint32_t i = 0; i < CELL_COLUMNS; i++) {
        uint32_t x = (column + i + key[0]) * factor + increment;
        uint32_t y = (row + key[1]) * factor + increment;
        uint32_t z = key[2] * factor + increment;
        x += y * z;
        y += z * x;
        z += x * y;
        x ^= x >> 16;
        y ^= y >> 16;
        z ^= z >> 16;
        x += y * z;
        y += z * x;
        z += x * y;
        words[0][i] = x;
        words[1][i] = y;
        words[2][i] = z;
    }
}

/* Normal variates of one colour, or of those that a mosaic keeps in even and odd columns. */
static void draw_variates(const float *quantiles, const uint32_t *even, const uint32_t *odd,
                          float *variates) {
    for (int i = 0; i < CELL_COLUMNS; i++) {
        uint32_t word = i & 1 ? odd[i] : even[i];
        variates[i] = (quantiles[word & 0xffffu] + quantiles[word >> 16]) * SQRT_HALF;
    }
}

static void add_noise(const Pass *pass, const ImageStage *stage, const Cell *cell,
                      CellValues *cells) {
    uint32_t words[3][CELL_COLUMNS];
    float variates[CELL_COLUMNS], scale = stage->numbers[0];
    for (int row = 0; row < cell->rows; row++) {
        hash_pixels(stage->key, (uint32_t)cell->left, (uint32_t)(cell->top + row), words);
        for (int plane = 0; plane < cells->planes; plane++) {
            int even = cells->planes == 1 ? row & 1 : plane;
            draw_variates(pass->job->quantiles, words[even],
                          words[cells->planes == 1 ? even + 1 : plane], variates);
            float *values = cells->values[plane][row];
            if (stage->kind == STAGE_READ_NOISE)
                for (int x = 0; x < CELL_COLUMNS; x++)
                    values[x] = values[x] + scale * variates[x];
            else
                for (int x = 0; x < CELL_COLUMNS; x++) {
                    float light = values[x] > 0.0f ? values[x] : 0.0f;
                    float noisy = values[x] + sqrtf(light * scale) * variates[x];
                    values[x] = noisy < 1.0f ? noisy : 1.0f;
                }
        }
    }
}

/* A row of one colour, or of the two that a mosaic keeps: of both, each in its columns. */
static void change_row(const Pass *pass, const ImageStage *stage, const Cell *cell, int row,
                       CellValues *cells) {
    ChangeRow *const change = CHANGES[stage->kind];
    size_t first = place_in_map(pass, cell, row);
    if (cells->planes == 1) {
        float *even = cells->values[0][row], odd[CELL_COLUMNS];
        memcpy(odd, even, sizeof odd);
        change(pass, stage, row & 1, first, even, cell->columns);
        change(pass, stage, (row & 1) + 1, first, odd, cell->columns);
        store16(alternate16(load16(even), load16(odd)), even);
        return;
    }
    for (int channel = 0; channel < 3; channel++)
        change(pass, stage, channel, first, cells->values[channel][row], cell->columns);
}

static void change_cell(const Pass *pass, const ImageStage *stage, const Cell *cell,
                        CellValues *cells) {
    if (stage->kind == STAGE_SHOT_NOISE || stage->kind == STAGE_READ_NOISE) {
        add_noise(pass, stage, cell, cells);
        return;
    }
    for (int row = 0; row < cell->rows; row++)
        change_row(pass, stage, cell, row, cells);
}

static int is_dark(const CellValues *cells, const Cell *cell) {
    Ints16 is_light = {0};
    for (int plane = 0; plane < cells->planes; plane++)
        for (int row = 0; row < cell->rows; row++)
            is_light |= load16(cells->values[plane][row]) != 0.0f;
    return !bits16(is_light & columns_below(cell->columns));
}

void change_points(const Pass *pass, const Cell *cell, CellValues *values) {
    CellValues before;
    for (const ImageStage *stage = pass->points; stage < pass->points + pass->num_points; stage++) {
        /* Nothing multiplies black: most of it lies beside the mirror. */
        int keeps_black = stage->kind <= STAGE_CLIPPED_GAIN || stage->kind == STAGE_SHOT_NOISE;
        int is_measured = pass->changes && stage->threshold >= 0.0f;
        if (keeps_black && is_dark(values, cell))
            continue;
        if (is_measured)
            memcpy(before.values, values->values, sizeof before.values[0] * (size_t)values->planes);
        change_cell(pass, stage, cell, values);
        if (is_measured)
            measure_change(stage, &pass->changes[stage - pass->job->stages].largest, &before,
                           values, cell);
    }
}
