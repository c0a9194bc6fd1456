/* Provides image_points.h: gains, dust, fixed pattern, converter and noise.
 * Float64 twins: `apply` of the effects in effects/, one for each kind. Owns nothing: planes are
 * the job's, maps Python's.
 * Threads: any thread of the pool, each for cells of its own. */
#include "image_points.h"

#include "image_change.h"
#include "image_glare.h"

#include <math.h>

#define SQRT_HALF 0.70710678f

/* A cell of three colours on its way through stages of one pass. */
typedef struct {
    _Alignas(64) float values[3][CELL_ROWS][CELL_COLUMNS];
} CellValues;

typedef void ChangeRow(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                       float *values, int count);

static const float *map_at(const ImageStage *stage, int map, size_t first) {
    return (const float *)stage->maps[map] + first;
}

static void change_gain(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                        float *values, int count) {
    (void)pass;
    float gain = stage->numbers[channel];
    if (!stage->maps[0]) {
        for (int x = 0; x < count; x++)
            values[x] *= gain;
        return;
    }
    const float *gains = map_at(stage, 0, first);
    for (int x = 0; x < count; x++)
        values[x] *= gains[x];
}

static void change_auto_gain(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                             float *values, int count) {
    (void)channel, (void)first;
    const float *numbers = stage->numbers;
    float gain = pass->mean_luminance > 0.0f ? numbers[0] / pass->mean_luminance : numbers[2];
    gain = gain > numbers[1] ? gain < numbers[2] ? gain : numbers[2] : numbers[1];
    for (int x = 0; x < count; x++)
        values[x] *= gain;
}

static void change_clipped_gain(const Pass *pass, const ImageStage *stage, int channel,
                                size_t first, float *values, int count) {
    (void)pass, (void)first;
    for (int x = 0; x < count; x++)
        values[x] = (values[x] < 1.0f ? values[x] : 1.0f) * stage->numbers[channel];
}

static void change_cover(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                         float *values, int count) {
    (void)channel;
    float scattered = stage->numbers[0] * pass->mean_luminance;
    const float *coverage = map_at(stage, 0, first);
    for (int x = 0; x < count; x++)
        values[x] = values[x] + coverage[x] * (scattered - values[x]);
}

static void change_pattern(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                           float *values, int count) {
    size_t plane = (size_t)pass->job->width * (size_t)pass->job->height * (size_t)channel;
    const float *gains = map_at(stage, 0, plane + first);
    const float *offsets = map_at(stage, 1, plane + first);
    for (int x = 0; x < count; x++)
        values[x] = values[x] * gains[x] + offsets[x];
}

static void quantise(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                     float *values, int count) {
    (void)pass, (void)channel, (void)first;
    float max_code = stage->numbers[0];
    for (int x = 0; x < count; x++) {
        float code = floorf(values[x] * max_code + 0.5f) / max_code;
        values[x] = code < 1.0f ? code : 1.0f;
    }
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

static void draw_variates(const float *quantiles, const uint32_t *words, float *variates) {
    for (int i = 0; i < CELL_COLUMNS; i++)
        variates[i] = (quantiles[words[i] & 0xffffu] + quantiles[words[i] >> 16]) * SQRT_HALF;
}

static void add_noise(const Pass *pass, const ImageStage *stage, const Cell *cell,
                      CellValues *cells) {
    uint32_t words[3][CELL_COLUMNS];
    float variates[CELL_COLUMNS], scale = stage->numbers[0];
    for (int row = 0; row < cell->rows; row++) {
        hash_pixels(stage->key, (uint32_t)cell->left, (uint32_t)(cell->top + row), words);
        for (int channel = 0; channel < 3; channel++) {
            float *values = cells->values[channel][row];
            draw_variates(pass->job->quantiles, words[channel], variates);
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

static void change_cell(const Pass *pass, const ImageStage *stage, const Cell *cell,
                        CellValues *cells) {
    if (stage->kind == STAGE_SHOT_NOISE || stage->kind == STAGE_READ_NOISE) {
        add_noise(pass, stage, cell, cells);
        return;
    }
    for (int channel = 0; channel < 3; channel++)
        for (int row = 0; row < cell->rows; row++) {
            size_t first = (size_t)(cell->top + row) * (size_t)pass->job->width;
            CHANGES[stage->kind](pass, stage, channel, first + (size_t)cell->left,
                                 cells->values[channel][row], cell->columns);
        }
}

static int is_dark(const CellValues *cells, const Cell *cell) {
    Floats16 high = {0};
    for (int channel = 0; channel < 3; channel++)
        for (int row = 0; row < cell->rows; row++) {
            Floats16 values = load_columns(cells->values[channel][row], cell->columns);
            high = most16(most16(values, -values), high);
        }
    return largest_of(high) == 0.0f;
}

static void measure_values(const ImageStage *stage, ChangeMeasure *change,
                           const CellValues *before, const CellValues *after, const Cell *cell) {
    Versions versions[3];
    for (int channel = 0; channel < 3; channel++)
        versions[channel] = (Versions){before->values[channel][0], after->values[channel][0],
                                       CELL_COLUMNS, CELL_COLUMNS};
    measure_versions(stage, change, versions, cell);
}

/* In place: only this thread sees the cell. */
void change_points(Pass *pass, const Cell *cell) {
    CellValues before, after;
    for (int channel = 0; channel < 3; channel++)
        for (int row = 0; row < cell->rows; row++)
            memcpy(after.values[channel][row],
                   row_at(&pass->from, channel, cell->top + row) + cell->left,
                   sizeof after.values[channel][row]);
    for (int i = 0; i < pass->count; i++) {
        const ImageStage *stage = pass->stage + i;
        /* Nothing multiplies black: most of it lies beside the mirror. */
        int keeps_black = stage->kind <= STAGE_CLIPPED_GAIN || stage->kind == STAGE_SHOT_NOISE;
        if (keeps_black && is_dark(&after, cell))
            continue;
        if (stage->limits.max_change >= 0.0f)
            before = after;
        change_cell(pass, stage, cell, &after);
        if (stage->limits.max_change >= 0.0f)
            measure_values(stage, pass->changes + i, &before, &after, cell);
    }
    for (int channel = 0; channel < 3; channel++)
        for (int row = 0; row < cell->rows; row++)
            memcpy(row_at(&pass->from, channel, cell->top + row) + cell->left,
                   after.values[channel][row], sizeof(float) * (size_t)cell->columns);
}
