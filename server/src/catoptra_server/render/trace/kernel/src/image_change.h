/* The change of the finished picture's pixels in encoded grey levels, and bounds of it that cost
 * little. On its way to the picture light is multiplied by any of the stage's gains: a difference
 * shows most where the larger value just reaches white. What spills over at a full well shows most
 * in a black pixel beside.
 *
 * Only where a bound says that nothing larger and no visible change can be found are pixels left
 * out, so that the result depends neither on threads nor on the order of cells. Of a cell that
 * stays plain its bound counts.
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

/* Change above the well, of light by its larger value. */
static inline Floats16 excess_changes(const ImageStage *stage, Floats16 high, Floats16 difference) {
    return least16(stage->spill[0] * difference, stage->spill[0] * high - 1.0f);
}

/* Change of a black pixel beside light that changes above the well. */
static inline float spilt_levels(const ImageStage *stage, Floats16 excess) {
    float change = stage->spill[1] * most_of16(excess);
    return change > 0.0f ? grey_levels((Floats16){change})[0] : 0.0f;
}

/* Largest change of light: the curve is concave, so the darkest changes most; of what reaches
 * beyond white, below white. */
static inline float bound_change(const ImageStage *stage, LightChange light) {
    float low = light.low, difference = light.difference;
    float change = stage->largest_gain * difference, base = stage->largest_gain * low;
    change = change < 1.0f ? change : 1.0f;
    base = base < 1.0f - change ? base : 1.0f - change;
    base = base > 0.0f ? base : 0.0f;
    Floats16 levels = grey_levels((Floats16){base, base + change});
    Floats16 excess = excess_changes(stage, splat16(light.high), splat16(difference));
    return levels[1] - levels[0] + 1e-2f + spilt_levels(stage, excess);
}

static inline Floats16 level_changes(const ImageStage *stage, Floats16 before, Floats16 after) {
    const Floats16 least = splat16(stage->least_gain), largest = splat16(stage->largest_gain);
    Floats16 top = most16(before, after);
    Floats16 gains = select16(largest * top > 1.0f, 1.0f / top, largest);
    gains = most16(gains, least);
    Floats16 change = grey_levels(gains * after) - grey_levels(gains * before);
    return most16(change, -change);
}

/* 255 times a bound of the curve's slope, from 0 on: the power -7/12 by a straight line through the
 * logarithm that a float's bits are, which is at most 0.086 below the true one and never above. */
static inline Floats16 bound_slopes(Floats16 light) {
    const float log_of_one = 127.0f * 8388608.0f, power = -7.0f / 12.0f;
    /* 1.055 / 2.4, and 2 % for the curve's linear part, whose slope is 12.92. */
    const float factor = 255.0f * 1.055f / 2.4f * 1.02f;
    Floats16 bits = __builtin_convertvector((Ints16)most16(light, splat16(0.0031308f)), Floats16);
    Ints16 raised = __builtin_convertvector((1.0f - power) * log_of_one + power * bits, Ints16);
    return factor * (Floats16)raised;
}

/* Bounds of the changes of 16 values: the curve is concave, and the largest gain shows most. What
 * is white with the least gain is white with all. */
static inline Floats16 bound_changes(const ImageStage *stage, Floats16 before, Floats16 after) {
    Floats16 zero = {0}, white = splat16(1.0f / stage->least_gain);
    Floats16 low = most16(least16(least16(before, after), white), zero);
    Floats16 difference = most16(least16(most16(before, after), white), zero) - low;
    return bound_slopes(stage->largest_gain * low) * (stage->largest_gain * difference) + 1e-2f;
}

/* Changes above the well: of each pixel's colour that changes most, and the largest of a column. */
typedef struct {
    Floats16 rows[CELL_ROWS], largest;
} CellExcess;

static inline CellExcess find_excess(const ImageStage *stage, const CellValues *before,
                                     const CellValues *after, const Cell *cell) {
    CellExcess excess = {{{0}}, {0}};
    Floats16 highest = {0};
    for (int plane = 0; plane < after->planes; plane++)
        for (int row = 0; row < cell->rows; row++) {
            highest = most16(load16(before->values[plane][row]), highest);
            highest = most16(load16(after->values[plane][row]), highest);
        }
    if (stage->spill[0] * most_of16(highest) <= 1.0f)
        return excess;
    for (int plane = 0; plane < after->planes; plane++)
        for (int row = 0; row < cell->rows; row++) {
            Floats16 one = load_columns(before->values[plane][row], cell->columns);
            Floats16 other = load_columns(after->values[plane][row], cell->columns);
            Floats16 high = most16(one, other), difference = high - least16(one, other);
            excess.rows[row] = most16(excess_changes(stage, high, difference), excess.rows[row]);
            excess.largest = most16(excess.rows[row], excess.largest);
        }
    return excess;
}

/* Of a stage whose overflow is known later. */
static inline void keep_excess(const ChangeMaps *maps, const CellExcess *excess,
                               const Cell *cell) {
    size_t index = (size_t)(cell->row * maps->cell_columns + cell->column);
    if (!(most_of16(excess->largest) > 0.0f))
        return;
    maps->overflows[index] = 1;
    memcpy(maps->excess + index * CELL_ROWS * CELL_COLUMNS, excess->rows, sizeof excess->rows);
}

static inline void mark_visible(ChangeMeasure *measure, const Cell *cell, int row,
                                uint32_t pixels) {
    if (measure->maps.visible && pixels)
        measure->maps.visible[(cell->top + row) * measure->maps.cell_columns + cell->column] |=
            (uint16_t)pixels;
}

/* Note the change between two versions of a cell. What a bound shows to be neither larger than the
 * largest change so far nor visible is not computed. */
static inline void measure_change(const ImageStage *stage, ChangeMeasure *measure,
                                  const CellValues *before, const CellValues *after,
                                  const Cell *cell) {
    Ints16 in_image = columns_below(cell->columns);
    int counts = is_counted(measure, &stage->limits), pixels = 0;
    float spilt = 0.0f;
    if (stage->spill[1] > 0.0f) {
        CellExcess excess = find_excess(stage, before, after, cell);
        if (measure->maps.excess)
            keep_excess(&measure->maps, &excess, cell);
        else
            spilt = spilt_levels(stage, excess.largest);
    }
    float known = read_largest(measure) - spilt, largest = known > 0.0f ? known : 0.0f;
    for (int row = 0; row < cell->rows; row++) {
        uint32_t visible = 0;
        for (int plane = 0; plane < after->planes; plane++) {
            Floats16 one = load16(before->values[plane][row]);
            Floats16 other = load16(after->values[plane][row]);
            float unseen = counts && largest > VISIBLE_LEVELS ? VISIBLE_LEVELS : largest;
            Ints16 may_count = in_image & (one != other) &
                               ~(bound_changes(stage, one, other) <= unseen);
            if (!bits16(may_count))
                continue;
            Floats16 changes = select16(in_image, level_changes(stage, one, other), splat16(0.0f));
            visible |= bits16(changes > VISIBLE_LEVELS);
            largest = fmaxf(largest, most_of16(changes));
        }
        pixels += __builtin_popcount(visible);
        mark_visible(measure, cell, row, visible);
    }
    if (largest > known)
        raise_largest(measure, fminf(largest + spilt, 255.0f));
    if (counts)
        count_visible(measure, pixels);
    if (spilt > VISIBLE_LEVELS)
        atomic_store_explicit(&measure->spills, 1, memory_order_relaxed);
}

static inline int is_measured(const Pass *pass, const ImageStage *stage) {
    return pass->changes && stage->limits.max_change >= 0.0f;
}

static inline Changes *changes_of(const Pass *pass, const ImageStage *stage) {
    return pass->changes + (stage - pass->job->stages);
}

/* Whether a cell whose change has a bound may tell anything new. */
static inline int may_tell(const ImageStage *stage, const ChangeMeasure *measure, float bound) {
    return bound > read_largest(measure) ||
           (bound > VISIBLE_LEVELS && is_counted(measure, &stage->limits));
}

/* Measure the stage of a pass that reads other pixels, of a cell whose change has a bound. */
static inline void measure_cell(const Pass *pass, const Cell *cell, float bound,
                                const CellValues *after) {
    CellValues before;
    if (!is_measured(pass, pass->stage) ||
        !may_tell(pass->stage, &changes_of(pass, pass->stage)->own, bound))
        return;
    load_cell(pass, cell, &before);
    measure_change(pass->stage, &changes_of(pass, pass->stage)->own, &before, after, cell);
}

static inline void note_plain(ChangeMeasure *measure, float bound, const Cell *cell) {
    raise_largest(measure, bound);
    if (bound <= VISIBLE_LEVELS)
        return;
    count_visible(measure, cell->rows * cell->columns);
    for (int row = 0; row < cell->rows; row++)
        mark_visible(measure, cell, row, bits16(columns_below(cell->columns)));
}

/* Whether a cell may stay plain whose pixels exchange at most a fraction of their light with others
 * of a range, and the bound of its change; infinite where its overflow has to be known. */
static inline int is_plain(const Pass *pass, const Cell *cell, CellRange range, float fraction,
                           float *bound) {
    const ImageStage *stage = pass->stage;
    if (range.low == range.high)
        return 1;
    if (stage->limits.max_change < 0.0f)
        return 0;
    LightChange light = {range.low, range.high, fraction * (range.high - range.low)};
    *bound = bound_change(stage, light);
    if (*bound > stage->limits.plain_change) {
        if (stage->spill[0] * range.high > 1.0f)
            *bound = INFINITY;
        return 0;
    }
    if (pass->changes) {
        note_plain(&changes_of(pass, stage)->own, *bound, cell);
        note_plain(&changes_of(pass, stage)->other, *bound, cell);
    }
    return 1;
}

#endif
