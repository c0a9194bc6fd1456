/* What an effect changes of the finished picture: the largest change of any pixel, and the number
 * of pixels that change visibly, found by all threads of a pass.
 *
 * Both are independent of the order in which threads find them. Once one number is beyond its
 * limit, the effect is on whatever else is found, and pixels are no longer counted.
 */
#ifndef CATOPTRA_PIXEL_CHANGE_H
#define CATOPTRA_PIXEL_CHANGE_H

#include "kernel.h"

#include <stdatomic.h>
#include <string.h>

/* Grey levels. A pixel that changes by at most half a level is the same after rounding, or its
 * neighbour; no mean of pixels that change by less than this changes by half a level. Twin, with
 * the proof: effects/__init__.py:COUNTED_LEVELS. */
#define VISIBLE_LEVELS 0.375f

/* Where an image's stage changes what, by cells of 16 x 8 px. */
typedef struct {
    uint16_t *visible;  /* (h, cell columns) bits of visible pixels, before a mosaic; or NULL */
    float *excess;      /* (cells, 8, 16) changes above the well, before overflow; or NULL */
    uint8_t *overflows; /* (cells,) where they are written */
    int cell_columns;
} ChangeMaps;

typedef struct {
    _Atomic uint32_t largest; /* bits of a float of 0 or more, which sort as the float does */
    atomic_int num_visible;
    atomic_int spills; /* visibly, into any pixel */
    ChangeMaps maps;
} ChangeMeasure;

static inline float read_largest(const ChangeMeasure *measure) {
    uint32_t bits = atomic_load_explicit(&measure->largest, memory_order_relaxed);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline void raise_largest(ChangeMeasure *measure, float value) {
    uint32_t bits, known = atomic_load_explicit(&measure->largest, memory_order_relaxed);
    if (value == 0.0f)
        return; /* whose sign may be set */
    memcpy(&bits, &value, sizeof bits);
    while (bits > known && !atomic_compare_exchange_weak(&measure->largest, &known, bits))
        ;
}

/* Whether the number of pixels still decides. */
static inline int is_counted(const ChangeMeasure *measure, const ChangeLimits *limits) {
    return read_largest(measure) <= limits->max_change &&
           atomic_load_explicit(&measure->num_visible, memory_order_relaxed) <= limits->max_visible;
}

static inline void count_visible(ChangeMeasure *measure, int pixels) {
    if (pixels)
        atomic_fetch_add_explicit(&measure->num_visible, pixels, memory_order_relaxed);
}

static inline void add_measure(ChangeMeasure *to, const ChangeMeasure *from) {
    raise_largest(to, read_largest(from));
    count_visible(to, atomic_load(&from->num_visible));
    if (atomic_load(&from->spills))
        atomic_store_explicit(&to->spills, 1, memory_order_relaxed);
}

/* The result for a picture of some pixels: all of them where counting ended. */
static inline PixelChange conclude_change(const ChangeMeasure *measure, const ChangeLimits *limits,
                                          int pixels) {
    int is_known = is_counted(measure, limits) && !atomic_load(&measure->spills);
    int visible = is_known ? atomic_load(&measure->num_visible) : pixels;
    return (PixelChange){read_largest(measure), visible < pixels ? visible : pixels};
}

#endif
