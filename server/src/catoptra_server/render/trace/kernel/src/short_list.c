/* Provides short_list.h: hits with a few triangles, without a search.
 * Float64 twin: reference/triangle_search.py. Owns nothing: lists are on the stack of the tile.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "short_list.h"

#include <math.h>

/* Rounding error of a component of cross product and direction, relative to the product of the
 * lengths, here and in the search together. */
#define PRODUCT_ERROR 1e-6f
/* Volume of corners below which they are a plane through the viewpoint, relative to the product of
 * their distances. */
#define MIN_VOLUME 1e-4f
/* Longest edge of a triangle, of its least distance, below which errors are products of distances
 * and edges: a ray that the search finds inside of its box is at most 1.5 edges from each corner. A
 * corner lies across a ray to 3.4e-7 of its distance, so the side of an edge is known to 1e-6 of
 * distance times edge; half as much again is that of the dual and of its product here. */
#define SMALL 0.5f
/* Largest ratio of the distance of a ray's origin to that of a triangle's plane. */
#define MAX_NEARNESS 0.5f
/* Rounding error of products with origins, relative to those of the lengths: a few times 2^-23. */
#define ORIGIN_ERROR 2e-6f

static float length_of(Vec3 a) { return sqrtf(dot(a, a)); }

static void set_dual(const Vec3 corners[3], ShortTriangle *triangle) {
    float length[3], longest = 0.0f;
    Vec3 edge[3];
    for (int i = 0; i < 3; i++) {
        length[i] = length_of(corners[i]);
        edge[i] = subtract(corners[(i + 1) % 3], corners[i]);
        longest = fmaxf(longest, length_of(edge[i]));
    }
    float nearest = fminf(fminf(length[0], length[1]), length[2]);
    /* Products of the edges of what is seen small lose no digits, nor do those of the search. */
    int is_small = longest < SMALL * nearest;
    float across = is_small ? 2.0f * longest : 0.0f;
    float product = is_small ? length[0] * longest * longest : length[0] * length[1] * length[2];
    Vec3 plane = cross(edge[0], edge[1]);
    float volume = dot(corners[0], is_small ? plane : cross(corners[1], corners[2]));
    /* Its plane holds the viewpoint: any size does, since no distance follows. */
    triangle->is_line = !(fabsf(volume) > MIN_VOLUME * product);
    if (triangle->is_line)
        volume = product;
    /* The plane's own normal is the sum of the duals, with fewer roundings. */
    triangle->sum = scale(1.0f / volume, plane);
    triangle->sum_error = 2.0f * PRODUCT_ERROR * length_of(triangle->sum);
    for (int i = 0; i < 3; i++) {
        int from = (i + 1) % 3, to = (i + 2) % 3;
        Vec3 normal = cross(corners[from], is_small ? edge[from] : corners[to]);
        triangle->dual[i] = scale(1.0f / volume, normal);
        triangle->error[i] = PRODUCT_ERROR * length[from] * (is_small ? across : length[to]) /
                             fabsf(volume);
    }
}

/* Errors of rays that begin within a radius of the corners' origin; 0 if the plane is too near.
 *
 * The inverse distance of an origin o along d is S.d / (1 - S.o), S the sum of the duals; the
 * components, dual.d + inverse dual.o. With |S.o| <= 1/2 the divisor is 1/2 at least: an error of
 * the sum counts four times in the inverse distance, and |S| is known to a few roundings. */
static int allow_origins(float radius, ShortTriangle *triangle) {
    if (!(radius > 0.0f))
        return 1;
    if (triangle->is_line)
        return 0;
    float length = length_of(triangle->sum);
    if (!(length * radius <= MAX_NEARNESS))
        return 0;
    triangle->sum_error = 4.0f * triangle->sum_error + ORIGIN_ERROR * length;
    for (int i = 0; i < 3; i++)
        triangle->error[i] = 2.0f * triangle->error[i] +
                             radius * length_of(triangle->dual[i]) *
                                 (triangle->sum_error + ORIGIN_ERROR * length);
    return 1;
}

/* Whether rays from the corners' origin that meet a triangle do not pass it; -1: some may. What is
 * seen from one side alone is on the same side of all origins, as far as they are allowed. */
static int is_met_from(const FrameState *state, int32_t triangle, const Vec3 corners[3]) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    if (!is_filtered(mesh, triangle))
        return 1;
    if (isfinite(mesh->coverage[3 * (size_t)triangle]) || state->shift > 0.0f)
        return -1;
    float volume = dot(corners[0], cross(corners[1], corners[2]));
    float least =
        MIN_VOLUME * length_of(corners[0]) * length_of(corners[1]) * length_of(corners[2]);
    return fabsf(volume) > least ? volume < 0.0f : -1;
}

int make_short_list(const FrameState *state, const CandidateList *candidates,
                    const BeamSides *sides, ShortList *list) {
    list->count = 0;
    list->viewpoint = add(vec3(state->camera.translation), sides->centre);
    list->middle = rotate_back(state->camera.rotation, sides->centre);
    list->radius = sides->radius;
    for (int i = 0; i < candidates->count; i++) {
        int32_t id = candidates->id[i];
        if (candidate_object(id) != OBJECT_STATIC)
            continue;
        if (id == CLUSTER || list->count == MAX_SHORT)
            return 0;
        Vec3 *corners = list->corners[list->count];
        for (int corner = 0; corner < 3; corner++)
            corners[corner] = subtract(candidate_corner(candidates, i, corner), sides->centre);
        int is_met = is_met_from(state, id, corners);
        if (is_met < 0)
            return 0;
        if (!is_met)
            continue;
        ShortTriangle *triangle = &list->triangles[list->count++];
        triangle->triangle = id;
        set_dual(corners, triangle);
        if (!allow_origins(list->radius, triangle))
            return 0;
    }
    return 1;
}

int move_short_list(const ShortList *list, const Pose *camera, ShortList *moved) {
    Vec3 middle = rotate(camera->rotation, list->middle);
    moved->viewpoint = add(vec3(camera->translation), middle);
    moved->middle = list->middle;
    moved->radius = list->radius;
    Vec3 offset = subtract(list->viewpoint, moved->viewpoint);
    moved->count = list->count;
    for (int i = 0; i < list->count; i++) {
        Vec3 corners[3];
        for (int corner = 0; corner < 3; corner++)
            corners[corner] = add(list->corners[i][corner], offset);
        moved->triangles[i].triangle = list->triangles[i].triangle;
        set_dual(corners, &moved->triangles[i]);
        if (!allow_origins(list->radius, &moved->triangles[i]))
            return 0;
    }
    return 1;
}

/* Inverse distances along 16 rays: of the nearest hit, and the greatest of anything else. */
typedef struct {
    Floats16 nearest, error; /* 0 without a hit */
    Floats16 rival;          /* upper bound of all others that may be met */
    Ints16 index;
} Nearest;

/* 16 vectors by component. */
typedef struct {
    Floats16 x, y, z;
} Vectors;

static inline __attribute__((always_inline)) Floats16 project(Vec3 onto, Vectors vectors) {
    return onto.x * vectors.x + onto.y * vectors.y + onto.z * vectors.z;
}

static inline __attribute__((always_inline)) void
test_triangle(const ShortTriangle *t, int32_t index, Vectors directions, int has_origins,
              Vectors origins, Nearest *found) {
    Floats16 first = project(t->dual[0], directions), second = project(t->dual[1], directions);
    Floats16 third = project(t->dual[2], directions);
    Floats16 inverse = project(t->sum, directions);
    if (t->is_line) {
        /* Of one sign are those that may meet it, at any distance. */
        Ints16 is_beside =
            ((first > t->error[0]) | (second > t->error[1]) | (third > t->error[2])) &
            ((first < -t->error[0]) | (second < -t->error[1]) | (third < -t->error[2]));
        found->rival = select16(is_beside, found->rival, splat16(INFINITY));
        return;
    }
    if (has_origins) {
        Floats16 u = project(t->dual[0], origins), v = project(t->dual[1], origins);
        Floats16 w = project(t->dual[2], origins);
        inverse = inverse / (1.0f - project(t->sum, origins));
        first += inverse * u;
        second += inverse * v;
        third += inverse * w;
    }
    Ints16 is_inside = (first > t->error[0]) & (second > t->error[1]) & (third > t->error[2]);
    Ints16 is_outside = (first < -t->error[0]) | (second < -t->error[1]) | (third < -t->error[2]);
    Ints16 is_nearest = is_inside & (inverse > found->nearest);
    /* What is not the nearest may still be met in front of it: the nearest so far, this triangle,
     * or one whose edge the ray passes. */
    Floats16 most = select16(is_nearest, found->nearest + found->error, inverse + t->sum_error);
    Ints16 is_rival = (is_nearest | ~is_outside) & (most > found->rival);
    found->rival = select16(is_rival, most, found->rival);
    found->nearest = select16(is_nearest, inverse, found->nearest);
    found->error = select16(is_nearest, splat16(t->sum_error), found->error);
    found->index = (is_nearest & index) | (~is_nearest & found->index);
}

static inline __attribute__((always_inline)) Nearest
find_nearest(const ShortList *list, const RayBlock *rays, int has_origins) {
    Nearest found = {.index = (Ints16){0} - 1};
    Vectors directions = {load16(rays->direction[0]), load16(rays->direction[1]),
                          load16(rays->direction[2])};
    Vectors origins = {load16(rays->origin[0]) - list->viewpoint.x,
                       load16(rays->origin[1]) - list->viewpoint.y,
                       load16(rays->origin[2]) - list->viewpoint.z};
    for (int i = 0; i < list->count; i++)
        test_triangle(&list->triangles[i], i, directions, has_origins, origins, &found);
    return found;
}

int intersect_short_list(const ShortList *list, RayBlock *rays, HitBlock *hits) {
    Nearest found = rays->has_origins ? find_nearest(list, rays, 1) : find_nearest(list, rays, 0);
    Ints16 is_uncertain = (found.rival > 0.0f) & (found.rival >= found.nearest - found.error);
    if (bits16(is_uncertain) & rays->active)
        return 0;
    Floats16 distance = 1.0f / found.nearest;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int32_t index = found.index[lane];
        if (index < 0)
            continue;
        rays->limit[lane] = distance[lane];
        hits->triangle[lane] = list->triangles[index].triangle;
        hits->object[lane] = OBJECT_STATIC;
    }
    return 1;
}
