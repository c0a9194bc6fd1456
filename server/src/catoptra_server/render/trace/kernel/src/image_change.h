/* The change of the finished picture's pixels in encoded grey levels, and bounds of it that cost
 * little. On its way to the picture light is multiplied by any of the stage's gains: a difference
 * shows most where the larger value just reaches white.
 *
 * The maximum over an image is exact: only where a bound says that nothing larger can be found are
 * pixels left out, so that the result depends neither on threads nor on the order of cells.
 */
#ifndef CATOPTRA_IMAGE_CHANGE_H
#define CATOPTRA_IMAGE_CHANGE_H

#include "image_planes.h"
#include "image_vectors.h"

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

/* Largest change of light of at least `low` that changes by at most `difference`: the curve is
 * concave, so the darkest changes most; of what reaches beyond white, below white. */
static inline float bound_change(const ImageStage *stage, float low, float difference) {
    float change = stage->largest_gain * difference, base = stage->largest_gain * low;
    change = change < 1.0f ? change : 1.0f;
    base = base < 1.0f - change ? base : 1.0f - change;
    base = base > 0.0f ? base : 0.0f;
    Floats16 levels = grey_levels((Floats16){base, base + change});
    return levels[1] - levels[0] + 1e-2f;
}

static inline Floats16 level_changes(const ImageStage *stage, Floats16 before, Floats16 after) {
    const Floats16 zero = {0}, least = zero + stage->least_gain, largest = zero + stage->largest_gain;
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

/* Bounds of the changes of 16 values: the curve is concave, and the largest gain shows most. */
static inline Floats16 bound_changes(const ImageStage *stage, Floats16 before, Floats16 after) {
    Floats16 zero = {0}, low = most16(least16(before, after), zero);
    Floats16 difference = most16(most16(before, after), zero) - low;
    return bound_slopes(stage->largest_gain * low) * (stage->largest_gain * difference) + 1e-2f;
}

/* Raise a maximum by the change between two versions of a cell. What a bound shows to be no larger
 * than the maximum is not computed. */
static inline void measure_change(const ImageStage *stage, _Atomic uint32_t *maximum,
                                  const CellValues *before, const CellValues *after,
                                  const Cell *cell) {
    Ints16 in_image = columns_below(cell->columns);
    float known = read_maximum(maximum), largest = known;
    for (int plane = 0; plane < after->planes; plane++)
        for (int row = 0; row < cell->rows; row++) {
            Floats16 one = load16(before->values[plane][row]);
            Floats16 other = load16(after->values[plane][row]);
            Ints16 may_be_larger = in_image & (one != other) &
                                   ~(bound_changes(stage, one, other) <= largest);
            if (!bits16(may_be_larger))
                continue;
            Floats16 changes = level_changes(stage, one, other);
            float most = largest_of(select16(in_image, changes, splat16(0.0f)));
            largest = most > largest ? most : largest;
        }
    if (largest > known)
        raise_maximum(maximum, largest);
}

/* Measure the stage of a pass that reads other pixels. */
static inline void measure_cell(const Pass *pass, const Cell *cell, const CellValues *after) {
    const ImageStage *stage = pass->stage;
    CellValues before;
    if (!pass->changes || stage->threshold < 0.0f)
        return;
    load_cell(pass, cell, &before);
    measure_change(stage, &pass->changes[stage - pass->job->stages].largest, &before, after, cell);
}

/* Whether a cell may stay plain whose pixels exchange at most a fraction of their light with others
 * of a range. */
static inline int is_plain(const Pass *pass, CellRange range, float fraction) {
    float contrast = range.high - range.low;
    return pass->stage->threshold >= 0.0f &&
           bound_change(pass->stage, range.low, fraction * contrast) <= pass->stage->threshold;
}

#endif
