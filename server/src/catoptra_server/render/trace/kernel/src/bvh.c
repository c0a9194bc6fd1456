/* Provides bvh.h: the queries.
 * Float64 twin: reference/triangle_search.py. Owns nothing: writes what its caller passes.
 * Threads: any at once; a hierarchy is only read. */
#include "bvh.h"

#include "textures.h"

#include <math.h>

/* Up to so many rays of a block go on one by one. */
enum { SINGLE_RAYS = 3 };
/* The smallest component of a direction: products of a reciprocal with a coordinate are finite. */
#define LEAST_COMPONENT 1e-20f
/* Distances to the sides of a box are differences, reciprocals and products of floats: off by
 * three roundings each. */
#define BOX_RESERVE 1.000001f
/* Boxes are searched this much beyond the nearest hit: in them may be one at the same distance. */
#define LIMIT_RESERVE 1.00001f
/* The slopes of a beam's sides are moved out by so much. */
#define BEAM_RESERVE 1e-6f
/* Rays that go less far along a beam's axis are traced one by one. */
#define LEAST_COSINE 0.2f

/* The sides on which rays pass an edge are products of coordinates across a beam: a ray's and those
 * at the beam's corners are each off by less than 22 2^-24 times the farthest coordinate across
 * times the farthest of all, and for what is rounded to zero by less than LEAST_LENGTH squared. */
#define EDGE_RESERVE 0x1p-18f
#define LEAST_LENGTH 1e-15f

/* Two axes across a ray, and the one in which it goes farthest. */
static const int AXES[3][3] = {{1, 2, 0}, {0, 2, 1}, {0, 1, 2}};

static const double NOWHERE[3];

/* Rays in the mesh's coordinates have rounded origins: boxes are met this share of the largest
 * coordinate before they begin, which holds the rounding of corners, too. */
#define PLACE_RESERVE 0x1p-22f

typedef struct {
    const BvhNode *nodes;
    const BvhLeaf *leaves;
    const FineLeaf *fine_leaves; /* instead of `leaves`, or NULL */
    const RayBlock *rays;
    const MeshArrays *filter;  /* of facets that rays may pass; or NULL */
    const StartFacets *starts; /* or NULL */
    int sees_backs;            /* whether facets that are none from behind are met all the same */
    const float *begin;        /* (16,) distances up to which no facet is met; NULL: 0 */
    float least_coverage;      /* of blended facets that are met */
    const double *place;       /* of the rays' coordinates in the mesh's; NULL: they are the same */
    const float (*start8)[BLOCK_RAYS]; /* origins in the mesh's coordinates */
    float reserve;             /* of these */
    uint32_t active; /* of an occlusion query: the rays that have met nothing */
    _Alignas(64) float limit[BLOCK_RAYS];
    int32_t triangle[BLOCK_RAYS]; /* the nearest so far */
    float inverse[3][BLOCK_RAYS]; /* of the directions' components */
    /* The ray's own frame: a point is sheared along the axis in which the ray goes farthest, so
     * that the ray is this axis. */
    float shear8[2][BLOCK_RAYS];
    float along8[BLOCK_RAYS]; /* distance per depth along this axis */
    uint32_t lanes_along[3]; /* bit masks of the rays by this axis */
    int has_one_axis;        /* of all active rays */
    int first;               /* active ray */
    float largest;           /* coordinate of the mesh */
    /* The same for fine leaves: starts in the rays' coordinates. Only these read them. */
    float placed[3][BLOCK_RAYS];
    double start8d[3][BLOCK_RAYS], shear8d[2][BLOCK_RAYS], along8d[BLOCK_RAYS];
} Query;

static void place_query(Query *query, const Bvh *bvh, const double place[3]) {
    float largest = bvh->largest;
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++) {
            double start = place[axis] + (double)query->rays->origin[axis][lane];
            query->placed[axis][lane] = (float)start;
            largest = fmaxf(largest, fabsf((float)start));
        }
    query->start8 = (const float(*)[BLOCK_RAYS])query->placed;
    query->reserve = PLACE_RESERVE * largest;
}

/* The axes of a ray's own frame. */
static inline const int *find_axes(const Query *query, int lane) {
    return AXES[query->lanes_along[0] >> lane & 1 ? 0 : query->lanes_along[1] >> lane & 1 ? 1 : 2];
}

static void aim_finely(Query *query) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        const int *axes = find_axes(query, lane);
        double along = 1.0 / (double)query->rays->direction[axes[2]][lane];
        query->along8d[lane] = along;
        for (int i = 0; i < 2; i++)
            query->shear8d[i][lane] =
                (double)query->rays->direction[axes[i]][lane] * along;
        for (int axis = 0; axis < 3; axis++)
            query->start8d[axis][lane] = (double)query->rays->origin[axis][lane];
    }
}

static void aim_query(Query *query, const Bvh *bvh, const double *place, const RayBlock *rays) {
    query->nodes = bvh->nodes;
    query->leaves = bvh->leaves;
    query->fine_leaves = bvh->fine_leaves;
    query->filter = bvh->filter;
    query->starts = NULL;
    query->rays = rays;
    query->begin = NULL;
    query->least_coverage = 1.0f;
    if (bvh->fine_leaves && !place)
        place = NOWHERE;
    query->place = place;
    query->start8 = rays->origin;
    query->reserve = 0.0f;
    if (place)
        place_query(query, bvh, place);
    query->largest = bvh->largest;
    query->active = rays->active;
    store16(load16(rays->limit), query->limit);
    store_ints16((Ints16){0} + NO_TRIANGLE, query->triangle);
    Floats16 direction[3], size[3], inverse[3];
    for (int i = 0; i < 3; i++) {
        direction[i] = load16(rays->direction[i]);
        size[i] = absolute16(direction[i]);
        inverse[i] =
            1.0f / select16(size[i] < LEAST_COMPONENT, splat16(LEAST_COMPONENT), direction[i]);
        store16(inverse[i], query->inverse[i]);
    }
    Ints16 is_x = (size[0] >= size[1]) & (size[0] >= size[2]), is_y = ~is_x & (size[1] >= size[2]);
    Floats16 along = select16(is_x, inverse[0], select16(is_y, inverse[1], inverse[2]));
    store16(along, query->along8);
    store16(select16(is_x, direction[1], direction[0]) * along, query->shear8[0]);
    store16(select16(is_x | is_y, direction[2], direction[1]) * along, query->shear8[1]);
    query->lanes_along[0] = bits16(is_x);
    query->lanes_along[1] = bits16(is_y);
    query->lanes_along[2] = bits16(~(is_x | is_y));
    query->first = __builtin_ctz(rays->active);
    query->has_one_axis =
        !(rays->active & ~query->lanes_along[find_axes(query, query->first)[2]]);
    if (bvh->fine_leaves)
        aim_finely(query);
}

double find_coverage(const MeshArrays *mesh, const double *place, const RayBlock *rays, int lane,
                     int32_t triangle, int sees_backs) {
    size_t at = (size_t)triangle;
    if (!(mesh->flags[at] & FACET_FILTERED))
        return INFINITY;
    /* In doubles: holes have sharp edges. Moeller and Trumbore 1997. */
    double from[3], along[3], u_edge[3], v_edge[3], p[3], q[3];
    for (int axis = 0; axis < 3; axis++) {
        double corner[3];
        for (int i = 0; i < 3; i++)
            corner[i] = mesh->fine_corners ? mesh->fine_corners[9 * at + 3 * i + axis]
                                           : (double)mesh->corners[9 * at + 3 * i + axis];
        along[axis] = (double)rays->direction[axis][lane];
        from[axis] = (double)rays->origin[axis][lane] + (place ? place[axis] : 0.0) - corner[0];
        u_edge[axis] = corner[1] - corner[0];
        v_edge[axis] = corner[2] - corner[0];
    }
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        p[i] = along[j] * v_edge[k] - along[k] * v_edge[j];
        q[i] = from[j] * u_edge[k] - from[k] * u_edge[j];
    }
    /* Positive where the ray goes against the normal. */
    double volume = u_edge[0] * p[0] + u_edge[1] * p[1] + u_edge[2] * p[2];
    if (!sees_backs && !(mesh->flags[at] & FACET_TWO_SIDED) && volume < 0.0)
        return -1.0;
    const float *coverage = mesh->coverage + 3 * at;
    if (isinf(coverage[0]) || volume == 0.0)
        return INFINITY;
    double u = (from[0] * p[0] + from[1] * p[1] + from[2] * p[2]) / volume;
    double v = (along[0] * q[0] + along[1] * q[1] + along[2] * q[2]) / volume;
    double opacity = coverage[0] + u * ((double)coverage[1] - coverage[0]) +
                     v * ((double)coverage[2] - coverage[0]);
    const Texture *texture =
        mesh->flags[at] & FACET_TEXTURED ? mesh->textures + mesh->texture[at] : NULL;
    if (texture && texture->channels == 4) {
        const double *uv = corner_uv(mesh, triangle);
        float s = (float)(uv[0] + u * (uv[2] - uv[0]) + v * (uv[4] - uv[0]));
        float t = (float)(uv[1] + u * (uv[3] - uv[1]) + v * (uv[5] - uv[1]));
        TexelSquare square = sample_texels(texture, 0, s, t, 1);
        opacity *= (double)mix_texels(&square)[3];
    }
    return opacity;
}

/* Whether a ray passes a triangle that it meets at a distance. */
static __attribute__((noinline)) int passes(const Query *query, int lane, int32_t triangle,
                                            float distance) {
    const MeshArrays *mesh = query->filter;
    if (query->begin && distance <= query->begin[lane])
        return 1;
    float least = mesh->blended && mesh->blended[triangle] ? query->least_coverage : 1.0f;
    return !(find_coverage(mesh, query->place, query->rays, lane, triangle, query->sees_backs) >=
             least);
}

/* Those of some rays that do not pass a triangle. */
static __attribute__((noinline)) uint32_t keep_stopped(const Query *query, uint32_t lanes,
                                                       int32_t triangle, const Floats16 *distance) {
    _Alignas(64) float distances[BLOCK_RAYS];
    store16(*distance, distances);
    for (uint32_t left = lanes; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        if (passes(query, lane, triangle, distances[lane]))
            lanes &= ~(left & -left);
    }
    return lanes;
}

/* The triangle as the rays' starts are counted. */
static inline int32_t count_as_start(const StartFacets *starts, int32_t triangle) {
    return starts->numbers ? starts->numbers[triangle] : triangle;
}

/* Note the nearest of a leaf's hits, or of equally near ones that of the lowest number. */
static int note_hits(Query *query, const int32_t triangle[LANES], int lane, uint32_t hits,
                     Floats8 distance) {
    _Alignas(32) float distances[LANES];
    int is_nearer = 0;
    store8(distance, distances);
    do {
        int i = __builtin_ctz(hits);
        hits &= hits - 1;
        float at = distances[i], limit = query->limit[lane];
        if (at > 0.0f && (at < limit || (at == limit && triangle[i] < query->triangle[lane])) &&
            !(query->starts && count_as_start(query->starts, triangle[i]) ==
                                   query->starts->triangle[lane]) &&
            !(query->filter && passes(query, lane, triangle[i], at))) {
            query->limit[lane] = at;
            query->triangle[lane] = triangle[i];
            is_nearer = 1;
        }
    } while (hits);
    return is_nearer;
}

/* The test of rays with triangles, for one ray and eight triangles or for one triangle and sixteen
 * rays: `start`, `shear` and `corner` are coordinates across, across and along the rays' axis.
 * Masks what is met, and gives its depth along the axis. */
#define DEFINE_TEST(S, VECTOR, MASK)                                                               \
    static inline __attribute__((always_inline)) VECTOR subtract_product##S(                       \
        VECTOR a, VECTOR b, VECTOR c, VECTOR d) {                                                  \
        return a * b - c * d;                                                                      \
    }                                                                                              \
    /* Corners as they lie across a ray, which is at 0. */                                         \
    static inline __attribute__((always_inline)) void shear_corners##S(                            \
        const VECTOR start[3], const VECTOR shear[2], const VECTOR corner[3][3],                   \
        VECTOR across[2][3]) {                                                                     \
        for (int i = 0; i < 3; i++) {                                                              \
            VECTOR along = corner[i][2] - start[2];                                                \
            for (int axis = 0; axis < 2; axis++)                                                   \
                across[axis][i] = corner[i][axis] - start[axis] - shear[axis] * along;             \
        }                                                                                          \
    }                                                                                              \
    static inline __attribute__((always_inline)) MASK pass_inside##S(                              \
        const VECTOR start[3], const VECTOR shear[2], const VECTOR corner[3][3]) {                 \
        VECTOR across[2][3], *x = across[0], *y = across[1];                                       \
        shear_corners##S(start, shear, corner, across);                                            \
        /* On which side of each edge the ray passes. A difference of rounded products has the     \
         * sign of the exact one, or is 0: then the ray is inside of both of the edge's            \
         * triangles. */                                                                           \
        VECTOR u = subtract_product##S(x[2], y[1], y[2], x[1]);                                    \
        VECTOR v = subtract_product##S(x[0], y[2], y[0], x[2]);                                    \
        VECTOR w = subtract_product##S(x[1], y[0], y[1], x[0]);                                    \
        /* Not both: the ray lies in the triangle's plane, or the triangle is a point. */          \
        return (least##S(least##S(u, v), w) >= 0) ^ (most##S(most##S(u, v), w) <= 0);              \
    }                                                                                              \
    /* Whether the ray passes the rectangle around the corners: beside a triangle that is a        \
     * millionth of its distance from the ray, the sides of its edges are rounding alone. */       \
    static inline __attribute__((always_inline)) MASK pass_box##S(                                 \
        const VECTOR start[3], const VECTOR shear[2], const VECTOR corner[3][3]) {                 \
        VECTOR across[2][3];                                                                       \
        MASK passes = (MASK){0} == 0;                                                              \
        shear_corners##S(start, shear, corner, across);                                            \
        for (int axis = 0; axis < 2; axis++) {                                                     \
            const VECTOR *x = across[axis];                                                        \
            passes &= (least##S(least##S(x[0], x[1]), x[2]) <= 0) &                                \
                      (most##S(most##S(x[0], x[1]), x[2]) >= 0);                                   \
        }                                                                                          \
        return passes;                                                                             \
    }                                                                                              \
    /* Depth at which the ray meets the plane, by the normal of the edges at corner 0; never       \
     * beyond the corners, however flat the triangle lies. */                                      \
    static inline __attribute__((always_inline)) VECTOR find_depth##S(                             \
        const VECTOR start[3], const VECTOR shear[2], const VECTOR corner[3][3]) {                 \
        VECTOR to[3], first[3], second[3], depths[3];                                              \
        for (int axis = 0; axis < 3; axis++) {                                                     \
            to[axis] = corner[0][axis] - start[axis];                                              \
            first[axis] = corner[1][axis] - corner[0][axis];                                       \
            second[axis] = corner[2][axis] - corner[0][axis];                                      \
            depths[axis] = corner[axis][2] - start[2];                                             \
        }                                                                                          \
        VECTOR x = subtract_product##S(first[1], second[2], first[2], second[1]);                  \
        VECTOR y = subtract_product##S(first[2], second[0], first[0], second[2]);                  \
        VECTOR z = subtract_product##S(first[0], second[1], first[1], second[0]);                  \
        VECTOR depth = (x * to[0] + y * to[1] + z * to[2]) / (x * shear[0] + y * shear[1] + z);    \
        depth = most##S(depth, least##S(least##S(depths[0], depths[1]), depths[2]));               \
        return least##S(depth, most##S(most##S(depths[0], depths[1]), depths[2]));                 \
    }

DEFINE_TEST(8, Floats8, Ints8)
DEFINE_TEST(16, Floats16, Ints16)
DEFINE_TEST(8d, Doubles8, Longs8)
DEFINE_TEST(16d, Doubles16, Longs16)

/* A frustum around all active rays, along the coordinate in which the first goes farthest: where a
 * ray is at a depth along it, its two other coordinates are slope times depth. */
typedef struct {
    const int *axis; /* two across, and the one along */
    float sign;      /* of the rays' way along it */
    float first[3], last[3]; /* least and largest coordinates of the origins */
    float least[2], most[2]; /* slopes */
    float width[2]; /* a narrower box, per depth, is missed by some of the rays */
    float inverse_least[2], inverse_most[2]; /* of slopes that are not 0 */
    float edge_reserve; /* per distance across; infinite unless viewpoint and axis are all rays' */
} Beam;

/* Coordinates of a leaf in those of the rays' starts. */
#define AS_STORED(query, value, axis) (value)
#define FROM_PLACE(query, value, axis) ((value) - (query)->place[axis])

/* Tests with the triangles of a leaf of floats or of doubles; the names of functions on eight and
 * on sixteen of these end with S and ALL. */
#define DEFINE_LEAF(LEAF, AT, S, VECTOR, ALL, VECTORS)                                             \
    /* A ray against all triangles; whether one is nearer than all so far. */                      \
    static inline __attribute__((always_inline)) int test_leaf##S(Query *query, const LEAF *leaf,  \
                                                                  const int axes[3], int lane) {   \
        VECTOR start[3], corner[3][3];                                                             \
        VECTOR shear[2] = {splat##S(query->shear##S[0][lane]), splat##S(query->shear##S[1][lane])};\
        for (int i = 0; i < 3; i++) {                                                              \
            int axis = axes[i];                                                                    \
            start[i] = splat##S(query->start##S[axis][lane]);                                      \
            for (int number = 0; number < 3; number++)                                             \
                corner[number][i] = AT(query, leaf->corner[3 * number + axis], axis);              \
        }                                                                                          \
        uint32_t hits = bits##S(pass_inside##S(start, shear, corner));                             \
        if (!hits || !(hits &= bits##S(pass_box##S(start, shear, corner))))                        \
            return 0;                                                                              \
        VECTOR depth = find_depth##S(start, shear, corner);                                        \
        return note_hits(query, leaf->triangle, lane, hits,                                        \
                         __builtin_convertvector(depth * query->along##S[lane], Floats8));         \
    }                                                                                              \
    /* Rays that go farthest along the same axis against one triangle, which may be known to       \
     * enclose all; those for which it is nearer than all so far. */                               \
    static inline uint32_t test_rays##S(Query *query, const LEAF *leaf, int slot, uint32_t lanes,  \
                                        int encloses) {                                            \
        VECTORS start[3], corner[3][3];                                                            \
        VECTORS shear[2] = {load##ALL(query->shear##S[0]), load##ALL(query->shear##S[1])};         \
        const int *axes = find_axes(query, query->first);                                          \
        for (int i = 0; i < 3; i++) {                                                              \
            int axis = axes[i];                                                                    \
            start[i] = load##ALL(query->start##S[axis]);                                           \
            for (int number = 0; number < 3; number++)                                             \
                corner[number][i] =                                                                \
                    splat##ALL(AT(query, leaf->corner[3 * number + axis][slot], axis));            \
        }                                                                                          \
        Ints16 is_inside = mask16(lanes);                                                          \
        if (!encloses) {                                                                           \
            is_inside &= __builtin_convertvector(pass_inside##ALL(start, shear, corner), Ints16);  \
            if (!bits16(is_inside))                                                                \
                return 0;                                                                          \
            is_inside &= __builtin_convertvector(pass_box##ALL(start, shear, corner), Ints16);     \
        }                                                                                          \
        VECTORS depth = find_depth##ALL(start, shear, corner);                                     \
        Floats16 distance =                                                                        \
            __builtin_convertvector(depth * load##ALL(query->along##S), Floats16);                 \
        Floats16 limit = load16(query->limit);                                                     \
        Ints16 triangle = load_ints16(query->triangle);                                            \
        int32_t number = leaf->triangle[slot];                                                     \
        Ints16 is_nearer = is_inside & (distance > 0.0f) &                                         \
                           ((distance < limit) | ((distance == limit) & (number < triangle)));     \
        if (query->starts)                                                                         \
            is_nearer &= load_ints16(query->starts->triangle) !=                                   \
                         count_as_start(query->starts, number);                                    \
        if (query->filter)                                                                         \
            is_nearer &= mask16(keep_stopped(query, bits16(is_nearer), number, &distance));        \
        store16(select16(is_nearer, distance, limit), query->limit);                               \
        store_ints16((is_nearer & number) | (~is_nearer & triangle), query->triangle);             \
        return bits16(is_nearer);                                                                  \
    }                                                                                              \
    /* Triangles that are not wholly beyond a side of a beam, wherever its rays begin, nor the     \
     * beam beyond an edge; `enclosing`: those that have all rays inside of their edges. The side  \
     * on which a ray passes an edge is linear in its slopes: between those at the corners. */     \
    static uint32_t meet_triangles##S(const Beam *beam, const LEAF *leaf, uint32_t *enclosing) {   \
        /* Across the beam's least slopes, and by the other sign across its most. */               \
        Floats16 sign = join_halves(splat8(1.0f), splat8(-1.0f)), across[2][3], others[3];         \
        Floats16 farthest = splat16(LEAST_LENGTH);                                                 \
        uint32_t met = bits8(load_ints8(leaf->triangle) != NO_TRIANGLE);                           \
        for (int i = 0; i < 2; i++) {                                                              \
            float least = beam->least[i] * beam->sign, most = beam->most[i] * beam->sign;          \
            Floats16 slope = join_halves(splat8(least), splat8(-most));                            \
            Floats16 start = join_halves(splat8(beam->first[i]), splat8(beam->last[i]));           \
            Floats16 begin = join_halves(splat8(least > 0.0f ? beam->last[2] : beam->first[2]),    \
                                         splat8(most > 0.0f ? beam->first[2] : beam->last[2]));    \
            Floats16 *x = across[i];                                                               \
            for (int corner = 0; corner < 3; corner++) {                                           \
                VECTOR coordinate = leaf->corner[3 * corner + beam->axis[i]];                      \
                VECTOR depth = leaf->corner[3 * corner + beam->axis[2]];                           \
                Floats8 at = __builtin_convertvector(coordinate, Floats8);                         \
                Floats8 along = __builtin_convertvector(depth, Floats8);                           \
                x[corner] = (join_halves(at, at) - start) * sign -                                 \
                            slope * (join_halves(along, along) - begin);                           \
                farthest = most16(farthest, absolute16(x[corner]));                                \
                others[corner] = exchange_halves(x[corner]);                                       \
            }                                                                                      \
            met &= in_both_halves(most16(most16(x[0], x[1]), x[2]) >= 0.0f);                       \
        }                                                                                          \
        Floats16 reserve = most16(farthest, exchange_halves(farthest)) * beam->edge_reserve;       \
        uint32_t left = 0, right = 0, all_left = ~0u, all_right = ~0u;                             \
        for (int edge = 0; edge < 3; edge++) {                                                     \
            int from = (edge + 2) % 3, to = (edge + 1) % 3;                                        \
            const Floats16 *x = across[0], *y = across[1];                                         \
            Floats16 same = x[from] * y[to] - y[from] * x[to];                                     \
            Floats16 other = others[from] * x[to] - x[from] * others[to];                          \
            uint32_t is_left = in_both_halves(least16(same, other) > reserve);                     \
            uint32_t is_right = in_both_halves(most16(same, other) < -reserve);                    \
            left |= is_left;                                                                       \
            right |= is_right;                                                                     \
            all_left &= is_left;                                                                   \
            all_right &= is_right;                                                                 \
        }                                                                                          \
        *enclosing = all_left | all_right;                                                         \
        return met & ~(left & right);                                                              \
    }

DEFINE_LEAF(BvhLeaf, AS_STORED, 8, Floats8, 16, Floats16)
DEFINE_LEAF(FineLeaf, FROM_PLACE, 8d, Doubles8, 16d, Doubles16)

static inline __attribute__((always_inline)) int test_leaf(Query *query, int32_t leaf,
                                                           const int axes[3], int lane) {
    return query->fine_leaves ? test_leaf8d(query, query->fine_leaves + leaf, axes, lane)
                              : test_leaf8(query, query->leaves + leaf, axes, lane);
}

static inline void prefetch(const Query *query, int32_t child) {
    const char *at = child >= 0            ? (const char *)(query->nodes + child)
                     : query->fine_leaves ? (const char *)(query->fine_leaves + ~child)
                                          : (const char *)(query->leaves + ~child);
    __builtin_prefetch(at);
    __builtin_prefetch(at + 64);
    __builtin_prefetch(at + 128);
    __builtin_prefetch(at + 192);
}

typedef struct {
    float near;
    int32_t child;
} Visit;

/* Distances at which a ray enters the boxes of a node's children, and whether it does. */
typedef struct {
    Floats8 begin[3], end[3], inverse[3]; /* origins for the near and the far sides */
    int near[3], far[3]; /* sides of the boxes, by the signs of the direction */
} Slabs;

static inline Slabs make_slabs(const Query *query, int lane) {
    Slabs slabs;
    for (int axis = 0; axis < 3; axis++) {
        int is_back = query->inverse[axis][lane] < 0.0f;
        float start = query->start8[axis][lane];
        float reserve = is_back ? -query->reserve : query->reserve;
        slabs.begin[axis] = splat8(start + reserve);
        slabs.end[axis] = splat8(start - reserve);
        slabs.inverse[axis] = splat8(query->inverse[axis][lane]);
        slabs.near[axis] = is_back ? 3 + axis : axis;
        slabs.far[axis] = is_back ? axis : 3 + axis;
    }
    return slabs;
}

static inline Floats8 near_side(const Slabs *slabs, const BvhNode *node, int axis) {
    return (node->bounds[slabs->near[axis]] - slabs->begin[axis]) * slabs->inverse[axis];
}

static inline Floats8 far_side(const Slabs *slabs, const BvhNode *node, int axis) {
    return (node->bounds[slabs->far[axis]] - slabs->end[axis]) * slabs->inverse[axis];
}

static inline uint32_t meet_boxes(const Slabs *slabs, const BvhNode *node, float limit,
                                  Floats8 *near) {
    *near = most8(most8(near_side(slabs, node, 0), near_side(slabs, node, 1)),
                  most8(near_side(slabs, node, 2), (Floats8){0}));
    Floats8 far = least8(least8(far_side(slabs, node, 0), far_side(slabs, node, 1)),
                         far_side(slabs, node, 2));
    return bits8((*near <= far * BOX_RESERVE) & (*near <= limit));
}

/* Put the children of a mask on the stack, the nearest on top; its new height. */
static inline int push_children(const Query *query, const BvhNode *node, uint32_t met, Floats8 near,
                                Visit *stack, int height) {
    _Alignas(32) float nears[LANES];
    store8(near, nears);
    int bottom = height;
    do {
        int slot = __builtin_ctz(met), at = height++;
        met &= met - 1;
        int32_t child = node->child[slot];
        prefetch(query, child);
        for (; at > bottom && stack[at - 1].near < nears[slot]; at--)
            stack[at] = stack[at - 1];
        stack[at] = (Visit){nears[slot], child};
    } while (met);
    return height;
}

/* Search below a child for a ray's nearest hit, or for any; whether there is one. */
static inline __attribute__((always_inline)) int descend_ray(Query *query, int lane, int32_t child,
                                                             int ends_at_first) {
    Visit stack[MAX_STACK];
    int height = 1, has_hit = 0;
    Slabs slabs = make_slabs(query, lane);
    const int *axes = find_axes(query, lane);
    float limit = query->limit[lane] * LIMIT_RESERVE;
    stack[0] = (Visit){0.0f, child};
    while (height) {
        Visit visit = stack[--height];
        if (visit.near > limit)
            continue;
        int32_t at = visit.child;
        while (at >= 0) {
            const BvhNode *node = query->nodes + at;
            Floats8 near;
            uint32_t met = meet_boxes(&slabs, node, limit, &near);
            at = NO_CHILD;
            if (met & (met - 1))
                height = push_children(query, node, met, near, stack, height);
            else if (met)
                at = node->child[__builtin_ctz(met)];
        }
        if (at != NO_CHILD && test_leaf(query, ~at, axes, lane)) {
            has_hit = 1;
            if (ends_at_first)
                break;
            limit = query->limit[lane] * LIMIT_RESERVE;
        }
    }
    return has_hit;
}

static __attribute__((noinline)) int find_nearest(Query *query, int lane, int32_t child) {
    return descend_ray(query, lane, child, 0);
}

static __attribute__((noinline)) int find_any(Query *query, int lane, int32_t child) {
    return descend_ray(query, lane, child, 1);
}

/* Where all active rays begin: one viewpoint, or the box around their origins. */
static void aim_origins(const Query *query, Beam *beam) {
    Ints16 is_active = mask16(query->active);
    for (int i = 0; i < 3; i++) {
        const float *origins = query->start8[beam->axis[i]];
        beam->first[i] = beam->last[i] = origins[query->first];
        if (query->rays->has_origins) {
            Floats16 origin = select16(is_active, load16(origins), splat16(beam->first[i]));
            beam->first[i] = least_of16(origin);
            beam->last[i] = most_of16(origin);
        }
        beam->first[i] -= query->reserve;
        beam->last[i] += query->reserve;
    }
}

/* A beam of at least one ray; 0 if the rays diverge too far. */
static int aim_beam(const Query *query, Beam *beam) {
    const RayBlock *rays = query->rays;
    Ints16 is_active = mask16(query->active);
    beam->axis = find_axes(query, query->first);
    beam->sign = query->inverse[beam->axis[2]][query->first] < 0.0f ? -1.0f : 1.0f;
    Floats16 along = load16(rays->direction[beam->axis[2]]) * beam->sign;
    if (bits16(is_active & (along < LEAST_COSINE)))
        return 0;
    Floats16 inverse = load16(query->inverse[beam->axis[2]]) * beam->sign, slopes[4];
    for (int i = 0; i < 2; i++) {
        Floats16 slope = load16(rays->direction[beam->axis[i]]) * inverse;
        slopes[2 * i] = select16(is_active, slope, splat16(INFINITY));
        slopes[2 * i + 1] = select16(is_active, -slope, splat16(INFINITY));
    }
    /* Least, most, least, most. */
    Floats4 bounds = (least_of_each16(slopes) - BEAM_RESERVE) * (Floats4){1.0f, -1.0f, 1.0f, -1.0f};
    Floats4 inverses = 1.0f / bounds;
    for (int i = 0; i < 2; i++) {
        beam->least[i] = bounds[2 * i];
        beam->most[i] = bounds[2 * i + 1];
        beam->width[i] = 2.0f * (beam->most[i] - beam->least[i]);
        beam->inverse_least[i] = inverses[2 * i];
        beam->inverse_most[i] = inverses[2 * i + 1];
    }
    aim_origins(query, beam);
    float farthest =
        query->largest + fabsf(beam->first[0]) + fabsf(beam->first[1]) + fabsf(beam->first[2]);
    int is_one_frame = !query->rays->has_origins && !query->place && query->has_one_axis;
    beam->edge_reserve = is_one_frame ? EDGE_RESERVE * farthest + LEAST_LENGTH : INFINITY;
    return 1;
}

/* Depth of the farthest active ray's limit. */
static float find_depth(const Query *query, const Beam *beam) {
    Floats16 limit = load16(query->limit);
    if (bits16(limit == INFINITY) & query->active)
        return INFINITY;
    Floats16 end = load16(query->rays->direction[beam->axis[2]]) * beam->sign * limit;
    return most_of16(select16(mask16(query->active), end, (Floats16){0})) * LIMIT_RESERVE;
}

typedef struct {
    float near;
    int32_t child;
    int32_t parent, slot; /* whose box holds the child; no slot if all rays are taken to meet it */
} BeamVisit;

/* The boxes of a node's children that a ray within the beam may meet up to a depth; depths are
 * from the ray's origin. */
static inline uint32_t meet_beam(const Beam *beam, const BvhNode *node, float depth,
                                 Floats8 *near, uint32_t *narrow) {
    int along = beam->axis[2];
    Floats8 far;
    if (beam->sign > 0.0f) {
        *near = node->bounds[along] - beam->last[2];
        far = node->bounds[3 + along] - beam->first[2];
    } else {
        *near = beam->first[2] - node->bounds[3 + along];
        far = beam->last[2] - node->bounds[along];
    }
    *near = most8(*near, (Floats8){0});
    Floats8 size[2];
    for (int i = 0; i < 2; i++) {
        Floats8 least = node->bounds[beam->axis[i]] - beam->last[i];
        Floats8 most = node->bounds[3 + beam->axis[i]] - beam->first[i];
        size[i] = most - least;
        /* A box on the positive side is not reached before the largest slope does. */
        if (beam->most[i] > 0.0f)
            *near = most8(*near, least * beam->inverse_most[i]);
        if (beam->least[i] < 0.0f)
            *near = most8(*near, most * beam->inverse_least[i]);
        /* Rays that all go to one side leave the box on that side for good. */
        if (beam->least[i] > 0.0f)
            far = least8(far, most8(most * beam->inverse_least[i], most * beam->inverse_most[i]));
        if (beam->most[i] < 0.0f)
            far = least8(far, most8(least * beam->inverse_least[i], least * beam->inverse_most[i]));
    }
    *narrow = bits8((size[0] < *near * beam->width[0]) | (size[1] < *near * beam->width[1]));
    return bits8((*near <= far * BOX_RESERVE) & (*near <= depth));
}

/* Rays that meet a box before their limits. */
static uint32_t meet_box(const Query *query, const float bounds[6]) {
    Floats16 near = (Floats16){0}, far = load16(query->limit) * LIMIT_RESERVE;
    for (int axis = 0; axis < 3; axis++) {
        Floats16 origin = load16(query->start8[axis]), inverse = load16(query->inverse[axis]);
        Floats16 first = (bounds[axis] - query->reserve - origin) * inverse;
        Floats16 second = (bounds[3 + axis] + query->reserve - origin) * inverse;
        near = most16(near, least16(first, second));
        far = least16(far, most16(first, second) * BOX_RESERVE);
    }
    return bits16(near <= far) & query->active;
}

static uint32_t meet_child(const Query *query, const BvhNode *node, int slot) {
    float bounds[6];
    for (int side = 0; side < 6; side++)
        bounds[side] = node->bounds[side][slot];
    return meet_box(query, bounds);
}

static int push_parts(const Query *query, int32_t parent, uint32_t met, uint32_t narrow,
                      Floats8 near, BeamVisit *stack, int height) {
    const BvhNode *node = query->nodes + parent;
    _Alignas(32) float nears[LANES];
    store8(near, nears);
    int bottom = height;
    do {
        int slot = __builtin_ctz(met), at = height++;
        met &= met - 1;
        int32_t child = node->child[slot];
        prefetch(query, child);
        for (; at > bottom && stack[at - 1].near < nears[slot]; at--)
            stack[at] = stack[at - 1];
        stack[at] = (BeamVisit){nears[slot], child, parent, narrow >> slot & 1 ? slot : -1};
    } while (met);
    return height;
}

/* Search below a child for the hits of some rays, one by one; whether one has a hit. */
static int descend_rays(Query *query, uint32_t lanes, int32_t child, int ends_at_first) {
    int has_hit = 0;
    for (; lanes; lanes &= lanes - 1) {
        int lane = __builtin_ctz(lanes);
        int is_met =
            ends_at_first ? find_any(query, lane, child) : find_nearest(query, lane, child);
        if (is_met && ends_at_first)
            query->active &= ~(1u << lane);
        has_hit |= is_met;
    }
    return has_hit;
}

static int test_leaf_singly(Query *query, uint32_t lanes, int32_t leaf, int ends_at_first) {
    int has_hit = 0;
    for (; lanes; lanes &= lanes - 1) {
        int lane = __builtin_ctz(lanes);
        int is_met = test_leaf(query, leaf, find_axes(query, lane), lane);
        if (is_met && ends_at_first)
            query->active &= ~(1u << lane);
        has_hit |= is_met;
    }
    return has_hit;
}

static int test_leaf_rays(Query *query, const Beam *beam, uint32_t lanes, int32_t leaf,
                          int ends_at_first) {
    if (!query->has_one_axis || __builtin_popcount(lanes) <= SINGLE_RAYS)
        return test_leaf_singly(query, lanes, leaf, ends_at_first);
    uint32_t met = 0, enclosing;
    const BvhLeaf *plain = query->leaves + leaf;
    const FineLeaf *fine = query->fine_leaves ? query->fine_leaves + leaf : NULL;
    uint32_t slots = fine ? meet_triangles8d(beam, fine, &enclosing)
                          : meet_triangles8(beam, plain, &enclosing);
    for (; slots; slots &= slots - 1) {
        int slot = __builtin_ctz(slots), encloses = enclosing >> slot & 1;
        met |= fine ? test_rays8d(query, fine, slot, lanes, encloses)
                    : test_rays8(query, plain, slot, lanes, encloses);
    }
    if (ends_at_first)
        query->active &= ~met;
    return met != 0;
}

static void descend_beam(Query *query, const Beam *beam, int ends_at_first) {
    BeamVisit stack[MAX_STACK], visit = {0.0f, 0, -1, -1};
    int height = 0;
    float depth = find_depth(query, beam);
    for (;;) {
        uint32_t lanes = visit.slot < 0
                             ? query->active
                             : meet_child(query, query->nodes + visit.parent, visit.slot);
        int has_hit = 0;
        if (lanes && visit.child < 0) {
            has_hit = test_leaf_rays(query, beam, lanes, ~visit.child, ends_at_first);
        } else if (__builtin_popcount(lanes) <= SINGLE_RAYS) {
            has_hit = descend_rays(query, lanes, visit.child, ends_at_first);
        } else {
            const BvhNode *node = query->nodes + visit.child;
            Floats8 near;
            uint32_t narrow;
            uint32_t met = meet_beam(beam, node, depth, &near, &narrow);
            if (met & (met - 1)) {
                height = push_parts(query, visit.child, met, narrow, near, stack, height);
            } else if (met) {
                int slot = __builtin_ctz(met);
                visit = (BeamVisit){0.0f, node->child[slot], visit.child, narrow & met ? slot : -1};
                prefetch(query, visit.child);
                continue;
            }
        }
        if (!height || !query->active)
            return;
        if (has_hit)
            depth = find_depth(query, beam);
        do {
            if (!height)
                return;
            visit = stack[--height];
        } while (visit.near > depth);
    }
}

static void run_query(Query *query, int ends_at_first) {
    Beam beam;
    if (__builtin_popcount(query->active) <= SINGLE_RAYS || !aim_beam(query, &beam))
        descend_rays(query, query->active, 0, ends_at_first);
    else
        descend_beam(query, &beam, ends_at_first);
}

static void find_hits(Query *query, int32_t object, RayBlock *rays, HitBlock *hits) {
    query->sees_backs = 0;
    run_query(query, 0);
    Ints16 triangle = load_ints16(query->triangle), is_met = triangle != NO_TRIANGLE;
    store16(load16(query->limit), rays->limit);
    store_ints16((is_met & triangle) | (~is_met & load_ints16(hits->triangle)), hits->triangle);
    store_ints16((is_met & object) | (~is_met & load_ints16(hits->object)), hits->object);
}

void intersect_bvh(const Bvh *bvh, const double place[3], int32_t object, RayBlock *rays,
                   HitBlock *hits) {
    Query query;
    if (!bvh->num_nodes || !rays->active)
        return;
    aim_query(&query, bvh, place, rays);
    find_hits(&query, object, rays, hits);
}

void intersect_layer(const Bvh *bvh, const double place[3], const float begin[BLOCK_RAYS],
                     float least_coverage, RayBlock *rays, HitBlock *hits) {
    Query query;
    if (!bvh->num_nodes || !rays->active)
        return;
    aim_query(&query, bvh, place, rays);
    query.begin = begin;
    query.least_coverage = least_coverage;
    find_hits(&query, OBJECT_STATIC, rays, hits);
}

uint32_t occlude_bvh(const Bvh *bvh, const double place[3], const RayBlock *rays,
                     const StartFacets *starts) {
    Query query;
    if (!bvh->num_nodes || !rays->active)
        return 0;
    aim_query(&query, bvh, place, rays);
    query.starts = starts;
    query.sees_backs = 1; /* what is seen from one side alone has shadows from both */
    run_query(&query, 1);
    return rays->active & ~query.active;
}

void meet_children(const BvhNode *node, const RayBlock *rays, uint32_t met[LANES]) {
    Query query;
    Bvh bvh = {.nodes = NULL};
    aim_query(&query, &bvh, NULL, rays);
    for (int slot = 0; slot < LANES; slot++)
        met[slot] = meet_child(&query, node, slot);
}
