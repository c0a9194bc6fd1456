/* Vectors of 4, 8 and 16 floats, in as many registers as the processor needs for them. The same
 * operations in the same order on each, so the same bits: sums of lanes have an order, too. */
#ifndef CATOPTRA_LANES_H
#define CATOPTRA_LANES_H

#include <stdint.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

/* Masks are 0 or -1 in each lane. Minima and maxima take the second of what is not a number. The
 * names of functions end with the number of lanes, and with d for doubles. */
#define DEFINE_LANES(S, N, VECTOR, MASK, REAL, INT)                                                \
    typedef REAL VECTOR __attribute__((vector_size(sizeof(REAL) * N)));                            \
    typedef INT MASK __attribute__((vector_size(sizeof(INT) * N)));                                \
    static inline VECTOR splat##S(REAL value) { return value - (VECTOR){0}; }                      \
    static inline VECTOR load##S(const REAL *values) {                                             \
        VECTOR loaded;                                                                             \
        __builtin_memcpy(&loaded, values, sizeof loaded);                                          \
        return loaded;                                                                             \
    }                                                                                              \
    static inline void store##S(VECTOR values, REAL *target) {                                     \
        __builtin_memcpy(target, &values, sizeof values);                                          \
    }                                                                                              \
    static inline MASK load_ints##S(const INT *values) {                                           \
        MASK loaded;                                                                               \
        __builtin_memcpy(&loaded, values, sizeof loaded);                                          \
        return loaded;                                                                             \
    }                                                                                              \
    static inline void store_ints##S(MASK values, INT *target) {                                   \
        __builtin_memcpy(target, &values, sizeof values);                                          \
    }                                                                                              \
    static inline VECTOR select##S(MASK mask, VECTOR yes, VECTOR no) {                             \
        return (VECTOR)((mask & (MASK)yes) | (~mask & (MASK)no));                                  \
    }                                                                                              \
    static inline VECTOR least##S(VECTOR a, VECTOR b) { return select##S(a < b, a, b); }           \
    static inline VECTOR most##S(VECTOR a, VECTOR b) { return select##S(a > b, a, b); }

DEFINE_LANES(4, 4, Floats4, Ints4, float, int32_t)
DEFINE_LANES(8, 8, Floats8, Ints8, float, int32_t)
DEFINE_LANES(16, 16, Floats16, Ints16, float, int32_t)
DEFINE_LANES(8d, 8, Doubles8, Longs8, double, int64_t)
DEFINE_LANES(16d, 16, Doubles16, Longs16, double, int64_t)

static inline Floats8 absolute8(Floats8 a) { return (Floats8)((Ints8)a & 0x7fffffff); }

static inline Floats16 absolute16(Floats16 a) { return (Floats16)((Ints16)a & 0x7fffffff); }

static inline Floats16 floor16(Floats16 values) {
#if __has_builtin(__builtin_elementwise_floor)
    return __builtin_elementwise_floor(values);
#else /* GCC, for its sanitizers */
    for (int lane = 0; lane < 16; lane++)
        values[lane] = __builtin_floorf(values[lane]);
    return values;
#endif
}

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

static inline uint32_t bits8d(Longs8 mask) { return bits8(__builtin_convertvector(mask, Ints8)); }

/* Mask of the lanes of a bit mask. */
static inline Ints16 mask16(uint32_t bits) {
    return ((Ints16){1 << 0, 1 << 1, 1 << 2, 1 << 3, 1 << 4, 1 << 5, 1 << 6, 1 << 7, 1 << 8, 1 << 9,
                     1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15} &
            (int32_t)bits) != 0;
}

static inline Floats16 join_halves(Floats8 a, Floats8 b) {
    return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
}

static inline Floats16 exchange_halves(Floats16 a) {
    return __builtin_shufflevector(a, a, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7);
}

/* Bit mask of the lanes that both halves of a mask have. */
static inline uint32_t in_both_halves(Ints16 mask) {
    uint32_t bits = bits16(mask);
    return bits & bits >> 8;
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

/* The least lanes of four vectors. */
static inline Floats4 least_of_each16(const Floats16 a[4]) {
    Floats4 b[4], c[2];
    for (int i = 0; i < 4; i++) {
        Floats8 half = least8(__builtin_shufflevector(a[i], a[i], 0, 1, 2, 3, 4, 5, 6, 7),
                              __builtin_shufflevector(a[i], a[i], 8, 9, 10, 11, 12, 13, 14, 15));
        b[i] = least4(__builtin_shufflevector(half, half, 0, 1, 2, 3),
                      __builtin_shufflevector(half, half, 4, 5, 6, 7));
    }
    for (int i = 0; i < 2; i++)
        c[i] = least4(__builtin_shufflevector(b[2 * i], b[2 * i + 1], 0, 1, 4, 5),
                      __builtin_shufflevector(b[2 * i], b[2 * i + 1], 2, 3, 6, 7));
    return least4(__builtin_shufflevector(c[0], c[1], 0, 2, 4, 6),
                  __builtin_shufflevector(c[0], c[1], 1, 3, 5, 7));
}

#endif
