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
/* Twin: NUM_INTERVALS of effects/sensor/response.py. */
#define RESPONSE_STEPS 4096

typedef void ChangeCell(const Pass *pass, const ImageStage *stage, const Cell *cell,
                        CellValues *cells);

/* Colours of a row in even and in odd columns: the same, or those that a mosaic keeps. */
typedef struct {
    int even, odd;
} Colours;

static Colours colours_of(const CellValues *cells, int plane, int row) {
    int is_odd = row & 1;
    return cells->planes == 1 ? (Colours){is_odd, is_odd + 1} : (Colours){plane, plane};
}

#define EACH_ROW(cells, cell)                                                                      \
    for (int plane = 0; plane < (cells)->planes; plane++)                                          \
        for (int row = 0; row < (cell)->rows; row++)

static Floats16 numbers_of(const ImageStage *stage, Colours colours) {
    return alternate16(splat16(stage->numbers[colours.even]), splat16(stage->numbers[colours.odd]));
}

static Floats16 map_of(const Pass *pass, const ImageStage *stage, int map, const Cell *cell,
                       int row) {
    return load_map(stage->maps[map], place_in_map(pass, cell, row), cell->columns);
}

static Floats16 gains_of(const Pass *pass, const ImageStage *stage, const Cell *cell,
                         const CellValues *cells, int plane, int row) {
    return stage->maps[0] ? map_of(pass, stage, 0, cell, row)
                          : numbers_of(stage, colours_of(cells, plane, row));
}

static void change_gain(const Pass *pass, const ImageStage *stage, const Cell *cell,
                        CellValues *cells) {
    EACH_ROW(cells, cell) {
        float *values = cells->values[plane][row];
        store16(load16(values) * gains_of(pass, stage, cell, cells, plane, row), values);
    }
}

float find_auto_gain(const ImageStage *stage, float mean_luminance) {
    const float *numbers = stage->numbers;
    float gain = mean_luminance > 0.0f ? numbers[0] / mean_luminance : numbers[2];
    return gain > numbers[1] ? gain < numbers[2] ? gain : numbers[2] : numbers[1];
}

static void change_auto_gain(const Pass *pass, const ImageStage *stage, const Cell *cell,
                             CellValues *cells) {
    float gain = find_auto_gain(stage, pass->mean_luminance);
    EACH_ROW(cells, cell) {
        float *values = cells->values[plane][row];
        store16(load16(values) * gain, values);
    }
}

static void change_clipped_gain(const Pass *pass, const ImageStage *stage, const Cell *cell,
                                CellValues *cells) {
    (void)pass;
    EACH_ROW(cells, cell) {
        float *values = cells->values[plane][row];
        Floats16 gains = numbers_of(stage, colours_of(cells, plane, row));
        store16(least16(load16(values), splat16(1.0f)) * gains, values);
    }
}

static void change_curve(const float *table, const Cell *cell, CellValues *cells) {
    EACH_ROW(cells, cell) {
        float *values = cells->values[plane][row];
        Floats16 light = load16(values);
        Ints16 is_bent = light > 0.0f;
        if (!bits16(is_bent))
            continue;
        Floats16 lit = select16(is_bent, light, splat16(0.0f));
        Floats16 place = lit / (1.0f + lit) * (float)RESPONSE_STEPS;
        place = least16(place, splat16(RESPONSE_STEPS - 0.001f)); /* of infinite light, too */
        Ints16 left = __builtin_convertvector(place, Ints16);
        Longs16 pairs;
        for (int x = 0; x < CELL_COLUMNS; x++) {
            int64_t pair;
            memcpy(&pair, table + left[x], sizeof pair);
            pairs[x] = pair;
        }
        Floats16 low = (Floats16)__builtin_convertvector(pairs, Ints16);
        Floats16 high = (Floats16)__builtin_convertvector(pairs >> 32, Ints16);
        place -= __builtin_convertvector(left, Floats16);
        store16(select16(is_bent, low + place * (high - low), light), values);
    }
}

static void change_response(const Pass *pass, const ImageStage *stage, const Cell *cell,
                            CellValues *cells) {
    (void)pass;
    if (stage->maps[0]) {
        change_curve(stage->maps[0], cell, cells);
        return;
    }
    float knee = stage->numbers[0], above = stage->numbers[1], inverse = stage->numbers[2];
    EACH_ROW(cells, cell) {
        float *values = cells->values[plane][row];
        Floats16 light = load16(values);
        Floats16 x = most16(light - knee, splat16(0.0f)) / above;
        Floats16 shoulder = knee + above * (x * (1.0f + x * inverse) / (1.0f + x));
        shoulder = least16(shoulder, splat16(1.0f));
        store16(select16(light > knee, shoulder, light), values);
    }
}

static void change_cover(const Pass *pass, const ImageStage *stage, const Cell *cell,
                         CellValues *cells) {
    float scattered = stage->numbers[0] * pass->mean_luminance;
    EACH_ROW(cells, cell) {
        float *values = cells->values[plane][row];
        Floats16 light = load16(values), cover = map_of(pass, stage, 0, cell, row);
        store16(light + cover * (scattered - light), values);
    }
}

static Floats16 pattern_of(const Pass *pass, const void *map, const Cell *cell, int row,
                           Colours colours) {
    size_t plane = (size_t)pass->job->width * (size_t)pass->job->height;
    size_t first = place_in_map(pass, cell, row);
    Floats16 even = load_map(map, first + plane * (size_t)colours.even, cell->columns);
    if (colours.even == colours.odd)
        return even;
    return alternate16(even, load_map(map, first + plane * (size_t)colours.odd, cell->columns));
}

static void change_pattern(const Pass *pass, const ImageStage *stage, const Cell *cell,
                           CellValues *cells) {
    EACH_ROW(cells, cell) {
        float *values = cells->values[plane][row];
        Colours colours = colours_of(cells, plane, row);
        store16(load16(values) * pattern_of(pass, stage->maps[0], cell, row, colours) +
                    pattern_of(pass, stage->maps[1], cell, row, colours),
                values);
    }
}

static void quantise(const Pass *pass, const ImageStage *stage, const Cell *cell,
                     CellValues *cells) {
    (void)pass;
    float max_code = stage->numbers[0];
    EACH_ROW(cells, cell) {
        float *values = cells->values[plane][row];
        Floats16 codes = floor16(load16(values) * max_code + 0.5f) / max_code;
        store16(least16(codes, splat16(1.0f)), values);
    }
}

/* By both colours of a mosaic, each in its columns. */
static void add_glare(const Pass *pass, const ImageStage *stage, const Cell *cell,
                      CellValues *cells) {
    EACH_ROW(cells, cell) {
        float *values = cells->values[plane][row], odd[CELL_COLUMNS];
        Colours colours = colours_of(cells, plane, row);
        size_t first = place_in_map(pass, cell, row);
        memcpy(odd, values, sizeof odd);
        change_glare(pass, stage, colours.even, first, values, cell->columns);
        if (colours.odd == colours.even)
            continue;
        change_glare(pass, stage, colours.odd, first, odd, cell->columns);
        store16(alternate16(load16(values), load16(odd)), values);
    }
}

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
            Colours colours = colours_of(cells, plane, row);
            draw_variates(pass->job->quantiles, words[colours.even], words[colours.odd], variates);
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

static ChangeCell *const CHANGES[] = {
    [STAGE_GAIN] = change_gain,
    [STAGE_AUTO_GAIN] = change_auto_gain,
    [STAGE_CLIPPED_GAIN] = change_clipped_gain,
    [STAGE_RESPONSE] = change_response,
    [STAGE_COVER] = change_cover,
    [STAGE_PATTERN] = change_pattern,
    [STAGE_QUANTISE] = quantise,
    [STAGE_SHOT_NOISE] = add_noise,
    [STAGE_READ_NOISE] = add_noise,
    [STAGE_GLARE] = add_glare,
};

const ImageStage *find_exposure(const ImageJob *job, const ImageStage *stage) {
    const ImageStage *end = job->stages + job->num_stages, *next = stage;
    while (stage->kind == STAGE_GAIN && next < end && next->kind != STAGE_AUTO_GAIN)
        next++;
    return next < end ? next : stage;
}

void visit_factors(const Pass *pass, const ImageStage *automatic, const Cell *cell,
                   const CellValues *with) {
    for (const ImageStage *one = pass->job->stages; one < automatic; one++) {
        if (!is_measured(pass, one) || find_exposure(pass->job, one) != automatic)
            continue;
        CellValues without;
        without.planes = with->planes;
        ImageStage behind = *automatic;
        behind.limits = one->limits;
        Changes *changes = changes_of(pass, one);
        int is_exposed = automatic < pass->points + pass->num_points;
        float gain = find_auto_gain(automatic, changes->mean_luminance) /
                     find_auto_gain(automatic, pass->mean_luminance);
        EACH_ROW(with, cell) {
            Floats16 light = (is_exposed ? gain : 1.0f) * load16(with->values[plane][row]);
            store16(light / gains_of(pass, one, cell, with, plane, row),
                    without.values[plane][row]);
        }
        if (is_exposed)
            measure_change(&behind, &changes->own, &without, with, cell);
        else
            sum_luminance(pass, cell, &without, 1 + (int)(one - pass->job->stages));
    }
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
        int keeps_black = stage->kind <= STAGE_RESPONSE || stage->kind == STAGE_SHOT_NOISE;
        int measures = is_measured(pass, stage) && find_exposure(pass->job, stage) == stage;
        if ((keeps_black && is_dark(values, cell)) || stage->kind == STAGE_BLOOM)
            continue; /* in a pass, an overflow is one of no light */
        if (measures)
            memcpy(before.values, values->values, sizeof before.values[0] * (size_t)values->planes);
        CHANGES[stage->kind](pass, stage, cell, values);
        if (measures)
            measure_change(stage, &changes_of(pass, stage)->own, &before, values, cell);
        if (stage->kind == STAGE_AUTO_GAIN)
            visit_factors(pass, stage, cell, values);
    }
}
