/* Provides catoptra_find_surfaces: connected coplanar triangles of one material, by their edges.
 * No twin. Owns nothing: tables are freed before the call returns, results are Python's.
 * Threads: the pool's. Edges are dealt into buckets by their hashes, in the order of threads; each
 * bucket is then sorted by one thread, so that the order is lost. */
#include "device.h"
#include "vectors.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

enum { BUCKETS = 512, TRIANGLES_AT_ONCE = 512 };
/* Of a bucket, in its sort; up to so many edges are sorted by insertion. */
enum { PARTS = 1024, FEW_EDGES = 64 };

/* Two triangles lie in one plane if their unit normals agree to this: 1e-5 rad. */
#define SAME_NORMAL (1.0 - 5e-11)
/* Texture coordinates at one point, by the planes of two triangles. */
#define SAME_UV 1e-9
/* Corners of neighbours result from different sums: within a nanometre both are one vertex. */
#define PLACES_PER_M 1e9

/* A side of a triangle: 3 triangle + k from corner k to the next. Both sides of an edge have one
 * hash. */
typedef struct {
    uint64_t hash;
    int32_t side;
} Edge;

typedef struct {
    const FacetSource *facets;
    Edge *edges;       /* (3 n,) bucket by bucket; NULL while they are counted */
    int32_t *neighbours; /* (3 n,) side beyond each side, then its triangle; -1: the side bounds its
                          * surface */
    int32_t begin[BUCKETS + 1];
    atomic_int filled[BUCKETS];
    atomic_int next;
} EdgeSort;

static void place_corner(const FacetSource *facets, int32_t triangle, int corner, double place[3]) {
    const double *position = facets->corners + 9 * (size_t)triangle + 3 * corner % 9;
    for (int axis = 0; axis < 3; axis++)
        place[axis] = rint(position[axis] * PLACES_PER_M) + 0.0; /* no zero below zero */
}

static uint64_t hash_place(const double place[3]) {
    uint64_t hash = 0, bits;
    for (int axis = 0; axis < 3; axis++) {
        memcpy(&bits, place + axis, sizeof bits);
        hash = (hash ^ bits) * 0x9e3779b97f4a7c15u;
        hash ^= hash >> 29;
    }
    return hash * 0xbf58476d1ce4e5b9u;
}

static void list_edges(const FacetSource *facets, int32_t triangle, Edge edges[3]) {
    uint64_t corners[3];
    for (int corner = 0; corner < 3; corner++) {
        double place[3];
        place_corner(facets, triangle, corner, place);
        corners[corner] = hash_place(place);
    }
    for (int side = 0; side < 3; side++)
        edges[side] = (Edge){corners[side] + corners[(side + 1) % 3], 3 * triangle + side};
}

static int find_bucket(const Edge *edge) { return (int)(edge->hash >> 40) & (BUCKETS - 1); }

static int find_part(const Edge *edge) { return (int)(edge->hash >> 54) & (PARTS - 1); }

/* Count the edges of each bucket, or put them there. */
static void deal_edges(void *argument) {
    EdgeSort *sort = argument;
    int32_t first, count = sort->facets->num_triangles;
    while ((first = atomic_fetch_add(&sort->next, TRIANGLES_AT_ONCE)) < count) {
        Edge edges[3 * TRIANGLES_AT_ONCE];
        int32_t places[BUCKETS] = {0};
        int32_t taken = count - first < TRIANGLES_AT_ONCE ? count - first : TRIANGLES_AT_ONCE;
        for (int32_t i = 0; i < taken; i++)
            list_edges(sort->facets, first + i, edges + 3 * i);
        for (int32_t i = 0; i < 3 * taken; i++)
            places[find_bucket(edges + i)]++;
        for (int bucket = 0; bucket < BUCKETS; bucket++)
            if (places[bucket])
                places[bucket] = atomic_fetch_add(&sort->filled[bucket], places[bucket]);
        for (int32_t i = 0; sort->edges && i < 3 * taken; i++)
            sort->edges[places[find_bucket(edges + i)]++] = edges[i];
    }
}

static int compare_edges(const void *first, const void *second) {
    const Edge *a = first, *b = second;
    return a->hash != b->hash ? (a->hash > b->hash) - (a->hash < b->hash)
                              : (a->side > b->side) - (a->side < b->side);
}

static void sort_few(Edge *edges, int32_t count) {
    for (int32_t i = 1; i < count; i++) {
        Edge edge = edges[i];
        int32_t at = i;
        for (; at > 0 && compare_edges(&edge, edges + at - 1) < 0; at--)
            edges[at] = edges[at - 1];
        edges[at] = edge;
    }
}

/* Sort a bucket: in parts by further bits of hashes, each edge moved to its part's next place. */
static void sort_edges(Edge *edges, int32_t count) {
    int32_t next[PARTS] = {0}, begin[PARTS + 1] = {0};
    for (int32_t i = 0; i < count; i++)
        begin[find_part(edges + i) + 1]++;
    for (int part = 0; part < PARTS; part++) {
        next[part] = begin[part];
        begin[part + 1] += begin[part];
    }
    for (int part = 0; part < PARTS; part++) {
        while (next[part] < begin[part + 1]) {
            Edge edge = edges[next[part]];
            for (int other; (other = find_part(&edge)) != part;) {
                Edge displaced = edges[next[other]];
                edges[next[other]++] = edge;
                edge = displaced;
            }
            edges[next[part]++] = edge;
        }
        Edge *first = edges + begin[part];
        int32_t size = begin[part + 1] - begin[part];
        if (size <= FEW_EDGES)
            sort_few(first, size);
        else
            qsort(first, (size_t)size, sizeof *edges, compare_edges);
    }
}

static int are_equal(const double *a, const double *b, int count) {
    for (int i = 0; i < count; i++)
        if (!(a[i] == b[i]))
            return 0;
    return 1;
}

/* Triangles that pass an edge in opposite directions lie on both sides of it. Copies of one
 * triangle do not, and end there. */
static int pass_oppositely(const FacetSource *facets, int32_t a, int32_t b) {
    double from_a[3], to_a[3], from_b[3], to_b[3];
    place_corner(facets, a / 3, a % 3, from_a);
    place_corner(facets, a / 3, a % 3 + 1, to_a);
    place_corner(facets, b / 3, b % 3, from_b);
    place_corner(facets, b / 3, b % 3 + 1, to_b);
    return are_equal(from_a, to_b, 3) && are_equal(to_a, from_b, 3) && !are_equal(from_a, to_a, 3);
}

/* Whether the texture of one triangle's plane has the coordinates of the other at its corners. */
static int continues_texture(const FacetSource *facets, int32_t a, int32_t b) {
    const double *from = facets->corners + 9 * (size_t)a, *to = facets->corners + 9 * (size_t)b;
    const double *uv = facets->uv + 6 * (size_t)a, *other = facets->uv + 6 * (size_t)b;
    for (int corner = 0; corner < 3; corner++) {
        double weight[2];
        find_weights(from, to + 3 * corner, weight);
        for (int i = 0; i < 2; i++) {
            double there = uv[i] + weight[0] * (uv[2 + i] - uv[i]) +
                           weight[1] * (uv[4 + i] - uv[i]);
            /* False for what is not a number: a triangle without area. */
            if (!(fabs(there - other[2 * corner + i]) < SAME_UV))
                return 0;
        }
    }
    return 1;
}

/* Whether rays meet a triangle at all: others are in no hierarchy, and cover nothing. */
static int is_met(const FacetSource *facets, int32_t triangle) {
    const double *corners = facets->corners + 9 * (size_t)triangle;
    for (int i = 0; i < 9; i++)
        if (!(fabs(corners[i] - facets->centre[i % 3]) < MOST_COORDINATE))
            return 0;
    return 1;
}

/* Whether two triangles are coplanar and of one material. */
static int are_alike(const FacetSource *facets, int32_t a, int32_t b) {
    return dot3(facets->normals + 3 * (size_t)a, facets->normals + 3 * (size_t)b) > SAME_NORMAL &&
           are_equal(facets->albedo + 3 * (size_t)a, facets->albedo + 3 * (size_t)b, 3) &&
           facets->unlit[a] == facets->unlit[b] &&
           /* One surface has one label. */
           facets->object[a] == facets->object[b] && facets->texture[a] == facets->texture[b] &&
           !facets->has_colours[a] && !facets->has_colours[b] &&
           (facets->texture[a] < 0 || continues_texture(facets, a, b)) && is_met(facets, a) &&
           is_met(facets, b);
}

static void join_sides(void *argument) {
    EdgeSort *sort = argument;
    int bucket;
    while ((bucket = atomic_fetch_add(&sort->next, 1)) < BUCKETS) {
        Edge *edges = sort->edges + sort->begin[bucket];
        int32_t count = sort->begin[bucket + 1] - sort->begin[bucket], end;
        sort_edges(edges, count);
        for (int32_t i = 0; i < count; i = end) {
            for (end = i + 1; end < count && edges[end].hash == edges[i].hash;)
                end++;
            /* One edge, two sides: at others it is not said what continues what. */
            for (int32_t at = i; at < end; at++)
                sort->neighbours[edges[at].side] = end - i == 2 ? edges[i + end - 1 - at].side : -1;
        }
    }
}

/* In the order of the triangles, whose neighbours are mostly near in memory, each pair twice. */
static void part_unlike(void *argument) {
    EdgeSort *sort = argument;
    int32_t first, sides = 3 * sort->facets->num_triangles;
    while ((first = 3 * atomic_fetch_add(&sort->next, TRIANGLES_AT_ONCE)) < sides) {
        for (int32_t a = first; a < first + 3 * TRIANGLES_AT_ONCE && a < sides; a++) {
            int32_t b = sort->neighbours[a];
            if (b < 0)
                continue;
            int32_t low = a < b ? a : b, high = a < b ? b : a;
            int is_inner = are_alike(sort->facets, low / 3, high / 3) &&
                           pass_oppositely(sort->facets, low, high);
            sort->neighbours[a] = is_inner ? b / 3 : -1;
        }
    }
}

static int32_t find_root(int32_t *parents, int32_t triangle) {
    while (parents[triangle] != triangle)
        triangle = parents[triangle] = parents[parents[triangle]];
    return triangle;
}

/* Number connected triangles, from 0 in the order of their first ones; their number. */
static int32_t number_surfaces(const EdgeSort *sort, int32_t *surface, uint8_t *outer_edges) {
    int32_t count = sort->facets->num_triangles, num_surfaces = 0;
    for (int32_t i = 0; i < count; i++)
        surface[i] = i;
    for (int32_t i = 0; i < count; i++) {
        outer_edges[i] = 0;
        for (int side = 0; side < 3; side++) {
            int32_t neighbour = sort->neighbours[3 * i + side];
            outer_edges[i] |= (uint8_t)((neighbour < 0) << side);
            if (neighbour < i)
                continue;
            int32_t a = find_root(surface, i), b = find_root(surface, neighbour);
            surface[a > b ? a : b] = a < b ? a : b;
        }
    }
    /* No parent comes after its children. */
    for (int32_t i = 0; i < count; i++)
        surface[i] = surface[i] == i ? num_surfaces++ : surface[surface[i]];
    return num_surfaces;
}

static double twice_area(const FacetSource *facets, int32_t triangle) {
    double a[3], b[3];
    edge_vectors(facets->corners + 9 * (size_t)triangle, a, b);
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2];
    double z = a[0] * b[1] - a[1] * b[0];
    return sqrt(x * x + y * y + z * z);
}

/* The largest triangle of each surface: its plane is the best known. */
static void choose_largest(const FacetSource *facets, const int32_t *surface, int32_t *largest) {
    int32_t begun = 0;
    for (int32_t i = 0; i < facets->num_triangles; i++) {
        int32_t *chosen = largest + surface[i];
        if (surface[i] == begun) {
            *chosen = i;
            begun++;
        } else if (twice_area(facets, i) > twice_area(facets, *chosen)) {
            *chosen = i;
        }
    }
}

static void run(EdgeSort *sort, Device *device, void (*job)(void *)) {
    atomic_store(&sort->next, 0);
    workers_run(device->workers, job, sort);
}

int32_t catoptra_find_surfaces(Device *device, const FacetSource *facets, int32_t *surface,
                               uint8_t *outer_edges, int32_t *representative) {
    EdgeSort sort = {.facets = facets};
    size_t sides = 3 * (size_t)facets->num_triangles;
    int32_t num_surfaces = -1;
    run(&sort, device, deal_edges);
    for (int bucket = 0; bucket < BUCKETS; bucket++) {
        sort.begin[bucket + 1] = sort.begin[bucket] + atomic_load(&sort.filled[bucket]);
        atomic_store(&sort.filled[bucket], sort.begin[bucket]);
    }
    sort.edges = malloc(sizeof *sort.edges * (sides + 1));
    sort.neighbours = malloc(sizeof *sort.neighbours * (sides + 1));
    if (sort.edges && sort.neighbours) {
        run(&sort, device, deal_edges);
        run(&sort, device, join_sides);
        run(&sort, device, part_unlike);
        num_surfaces = number_surfaces(&sort, surface, outer_edges);
        choose_largest(facets, surface, representative);
    }
    free(sort.edges);
    free(sort.neighbours);
    return num_surfaces;
}
