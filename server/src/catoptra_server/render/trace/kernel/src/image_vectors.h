/* Vectors of a row of a cell: minima and maxima of floats are no vector code by themselves. */
#ifndef CATOPTRA_IMAGE_VECTORS_H
#define CATOPTRA_IMAGE_VECTORS_H

#include "image_planes.h"
#include "lanes.h"

static inline Ints16 columns_below(int count) {
    return (Ints16){0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15} < count;
}

/* The first columns of a row; its first value in the others. */
static inline Floats16 load_columns(const float *values, int count) {
    return select16(columns_below(count), load16(values), (Floats16){0} + values[0]);
}

/* The first vector in even columns, the second in odd ones. */
static inline Floats16 alternate16(Floats16 even, Floats16 odd) {
    return __builtin_shufflevector(even, odd, 0, 17, 2, 19, 4, 21, 6, 23, 8, 25, 10, 27, 12, 29, 14,
                                   31);
}

#endif
