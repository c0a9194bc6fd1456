/* The change of the finished picture's pixels in encoded grey levels, and bounds of it that cost
 * little. On its way to the picture light is multiplied by any of the stage's gains: a difference
 * shows most where the larger value just reaches white. What spills over at a full well shows most in
 * a black pixel beside.
 *
 * Only where a bound says that nothing larger and no visible change can be found are pixels left
 * out, so that the result depends neither on threads nor on the order of cells. Of a cell that stays
 * plain its bound counts.
 */
#ifndef CATOPTRA_IMAGE_CHANGE_H
#define CATOPTRA_IMAGE_CHANGE_H

#include "image_planes.h"
#include "image_vectors.h"

#include <math.h>

/* 255 times the sRGB curve of light clipped to 0 .. 1, within 1e-3; without libm. */
static inline Floats16 grey_levels(Floats16 light) {
    const Floats16 zero = {0}, kink = zero + 0.0031308f;
    Floats16 clipped = least16(most16(light, zero), zero + 1.0f);
    Ints16 is_curved = clipped > kink;
    /* x^(1/2.4) = 2^(log2(x) / 2.4): exponent and mantissa apart. */
    Ints16 bits = (Ints16)select16(is_curved, clipped, kink);
    Floats16 exponent = __builtin_convertvector((bits >> 23) - 127, Floats16);
    Floats16 t = (Floats16)((bits & 0x7fffff) | 0x3f800000) - 1.0f;
    Floats16 log2 = t * (1.442693f + t * (-0.72114408f + t * (0.477496356f + t * (-0.338377208f +
                    t * (0.213943213f + t * (-0.0946268067f + t * 0.0200166497f))))));
    Floats16 power = (exponent + log2) * (1.0f / 2.4f);
    /* Between -3.5 and 0. */
    Ints16 whole = __builtin_convertvector(power + 8.0f, Ints16) - 8;
    Floats16 f = power - __builtin_convertvector(whole, Floats16);
    Floats16 fraction = 0.999999881f + f * (0.693154514f + f * (0.240141824f + f * (0.0558603369f +
                        f * (0.00894959085f + f * 0.001893754f))));
    Floats16 curved = (1.055f * 255.0f) * (fraction * (Floats16)((whole + 127) << 23)) -
                      0.055f * 255.0f;
    return select16(is_curved, curved, clipped * (12.92f * 255.0f));
}

/* Light that changes, and by how much at most. */
typedef struct {
    float low, high, difference;
} LightChange;

/* Change of a black pixel beside light that changes above the well. */
static inline float spilt_levels(const ImageStage *stage, LightChange light) {
    float excess = stage->spill[0] * light.high - 1.0f, change = stage->spill[0] * light.difference;
    change = stage->spill[1] * (change < excess ? change : excess);
    return change > 0.0f ? grey_levels((Floats16){change})[0] : 0.0f;
}

/* Largest change of light: the curve is concave, so the darkest changes most; of what reaches beyond
 * white, below white. */
static inline float bound_change(const ImageStage *stage, LightChange light) {
    float low = light.low, difference = light.difference;
    float change = stage->largest_gain * difference, base = stage->largest_gain * low;
    change = change < 1.0f ? change : 1.0f;
    base = base < 1.0f - change ? base : 1.0f - change;
    base = base > 0.0f ? base : 0.0f;
    Floats16 levels = grey_levels((Floats16){base, base + change});
    return levels[1] - levels[0] + 1e-2f + spilt_levels(stage, light);
}

static inline Floats16 level_changes(const ImageStage *stage, Floats16 before, Floats16 after) {
    const Floats16 zero = {0}, least = zero + stage->least_gain, largest = zero + stage->largest_gain;
    Floats16 top = most16(before, after);
    Floats16 gains = select16(largest * top > 1.0f, 1.0f / top, largest);
    gains = most16(gains, least);
    Floats16 change = grey_levels(gains * after) - grey_levels(gains * before);
    return most16(change, -change);
}

/* Two versions of a cell, row by row. */
typedef struct {
    const float *before, *after;
    size_t before_stride, after_stride;
} Versions;

/* A row of both versions; the same beyond the cell's columns. */
static inline void load_row(const Versions *versions, const Cell *cell, int row, Floats16 *before,
                            Floats16 *after) {
    *before = load_columns(versions->before + (size_t)row * versions->before_stride, cell->columns);
    *after = load16(versions->after + (size_t)row * versions->after_stride);
    *after = select16(columns_below(cell->columns), *after, *before);
}

/* Extremes of two versions of a cell. */
static inline LightChange compare_versions(const Versions *versions, const Cell *cell) {
    Floats16 lows = (Floats16){0} + versions->before[0], highs = lows, differences = {0};
    for (int row = 0; row < cell->rows; row++) {
        Floats16 before, after;
        load_row(versions, cell, row, &before, &after);
        Floats16 least = least16(before, after), most = most16(before, after);
        lows = least16(least, lows);
        highs = most16(most, highs);
        differences = most16(most - least, differences);
    }
    return (LightChange){smallest_of(lows), largest_of(highs), largest_of(differences)};
}

/* Note the change between two versions, in three colours, of a cell. */
static inline void measure_versions(const ImageStage *stage, ChangeMeasure *measure,
                                    const Versions versions[3], const Cell *cell) {
    float bound = 0.0f, spilt = 0.0f;
    for (int channel = 0; channel < 3; channel++) {
        LightChange light = compare_versions(&versions[channel], cell);
        if (light.difference == 0.0f)
            continue;
        bound = fmaxf(bound, bound_change(stage, light));
        spilt = fmaxf(spilt, spilt_levels(stage, light));
    }
    int counts = bound > VISIBLE_LEVELS && is_counted(measure, &stage->limits);
    if (bound <= read_largest(measure) && !counts)
        return;
    Floats16 largest = {0};
    Ints16 visible = {0};
    for (int row = 0; row < cell->rows; row++) {
        Floats16 change = {0};
        for (int channel = 0; channel < 3; channel++) {
            Floats16 before, after;
            load_row(&versions[channel], cell, row, &before, &after);
            change = most16(level_changes(stage, before, after), change);
        }
        largest = most16(change, largest);
        visible -= change > VISIBLE_LEVELS; /* minus one where it is */
    }
    float change = largest_of(largest) + spilt;
    raise_largest(measure, change < 255.0f ? change : 255.0f);
    int pixels = 0;
    for (int x = 0; x < CELL_COLUMNS; x++)
        pixels += visible[x];
    count_visible(measure, pixels);
    if (spilt > VISIBLE_LEVELS)
        atomic_store_explicit(&measure->spills, 1, memory_order_relaxed);
}

/* A cell of both images of a pass. */
static inline void find_versions(const Pass *pass, const Cell *cell, Versions versions[3]) {
    for (int channel = 0; channel < 3; channel++)
        versions[channel] = (Versions){row_at(&pass->from, channel, cell->top) + cell->left,
                                       row_at(&pass->to, channel, cell->top) + cell->left,
                                       pass->from.stride, pass->to.stride};
}

/* Measure a cell of a stage with limits. */
static inline void measure_cell(Pass *pass, const Cell *cell, ChangeMeasure *measure) {
    Versions versions[3];
    find_versions(pass, cell, versions);
    if (pass->stage->limits.max_change >= 0.0f)
        measure_versions(pass->stage, measure, versions, cell);
}

static inline void note_plain(ChangeMeasure *measure, float bound, const Cell *cell) {
    raise_largest(measure, bound);
    count_visible(measure, bound > VISIBLE_LEVELS ? cell->rows * cell->columns : 0);
}

/* Whether a cell may stay plain whose pixels exchange at most a fraction of their light with others
 * of a range. */
static inline int is_plain(Pass *pass, const Cell *cell, CellRange range, float fraction) {
    const ImageStage *stage = pass->stage;
    if (range.low == range.high)
        return 1;
    LightChange light = {range.low, range.high, fraction * (range.high - range.low)};
    float bound = bound_change(stage, light);
    if (stage->limits.max_change < 0.0f || bound > stage->limits.plain_change)
        return 0;
    note_plain(&pass->change, bound, cell);
    note_plain(&pass->other_change, bound, cell);
    return 1;
}

#endif
