/* Vectors of 8 and of 16 floats, in as many registers as the processor needs for them. The same
 * operations in the same order on each, so the same bits: sums of lanes have an order, too. */
#ifndef CATOPTRA_LANES_H
#define CATOPTRA_LANES_H

#include <stdint.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

/* Masks are 0 or -1 in each lane. Minima and maxima take the second of what is not a number. */
#define DEFINE_LANES(N)                                                                            \
    typedef float Floats##N __attribute__((vector_size(4 * N)));                                   \
    typedef int32_t Ints##N __attribute__((vector_size(4 * N)));                                   \
    static inline Floats##N splat##N(float value) { return (Floats##N){0} + value; }               \
    static inline Floats##N load##N(const float *values) {                                         \
        Floats##N loaded;                                                                          \
        __builtin_memcpy(&loaded, values, sizeof loaded);                                          \
        return loaded;                                                                             \
    }                                                                                              \
    static inline void store##N(Floats##N values, float *target) {                                 \
        __builtin_memcpy(target, &values, sizeof values);                                          \
    }                                                                                              \
    static inline Ints##N load_ints##N(const int32_t *values) {                                    \
        Ints##N loaded;                                                                            \
        __builtin_memcpy(&loaded, values, sizeof loaded);                                          \
        return loaded;                                                                             \
    }                                                                                              \
    static inline void store_ints##N(Ints##N values, int32_t *target) {                            \
        __builtin_memcpy(target, &values, sizeof values);                                          \
    }                                                                                              \
    static inline Floats##N select##N(Ints##N mask, Floats##N yes, Floats##N no) {                 \
        return (Floats##N)((mask & (Ints##N)yes) | (~mask & (Ints##N)no));                         \
    }                                                                                              \
    static inline Floats##N least##N(Floats##N a, Floats##N b) { return select##N(a < b, a, b); }  \
    static inline Floats##N most##N(Floats##N a, Floats##N b) { return select##N(a > b, a, b); }   \
    static inline Floats##N absolute##N(Floats##N a) {                                             \
        return (Floats##N)((Ints##N)a & 0x7fffffff);                                               \
    }

DEFINE_LANES(8)
DEFINE_LANES(16)

/* Bit masks of the lanes of masks. */
static inline uint32_t bits8(Ints8 mask) {
#if defined(__AVX__)
    return (uint32_t)_mm256_movemask_ps((__m256)mask);
#elif defined(__x86_64__)
    __m128 halves[2];
    __builtin_memcpy(halves, &mask, sizeof halves);
    return (uint32_t)(_mm_movemask_ps(halves[0]) | _mm_movemask_ps(halves[1]) << 4);
#else
    return (uint32_t)__builtin_reduce_or(mask & (Ints8){1, 2, 4, 8, 16, 32, 64, 128});
#endif
}

static inline uint32_t bits16(Ints16 mask) {
#if defined(__AVX512DQ__)
    return _mm512_movepi32_mask((__m512i)mask);
#else
    return bits8(__builtin_shufflevector(mask, mask, 0, 1, 2, 3, 4, 5, 6, 7)) |
           bits8(__builtin_shufflevector(mask, mask, 8, 9, 10, 11, 12, 13, 14, 15)) << 8;
#endif
}

/* Mask of the lanes of a bit mask. */
static inline Ints16 mask16(uint32_t bits) {
    return ((Ints16){1 << 0, 1 << 1, 1 << 2, 1 << 3, 1 << 4, 1 << 5, 1 << 6, 1 << 7, 1 << 8, 1 << 9,
                     1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15} &
            (int32_t)bits) != 0;
}

static inline float most_of16(Floats16 a) {
    Floats8 b = most8(__builtin_shufflevector(a, a, 0, 1, 2, 3, 4, 5, 6, 7),
                      __builtin_shufflevector(a, a, 8, 9, 10, 11, 12, 13, 14, 15));
    b = most8(b, __builtin_shufflevector(b, b, 4, 5, 6, 7, 0, 1, 2, 3));
    b = most8(b, __builtin_shufflevector(b, b, 2, 3, 0, 1, 6, 7, 4, 5));
    b = most8(b, __builtin_shufflevector(b, b, 1, 0, 3, 2, 5, 4, 7, 6));
    return b[0];
}

static inline float least_of16(Floats16 a) { return -most_of16(-a); }

#endif
