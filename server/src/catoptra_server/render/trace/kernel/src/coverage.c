#include "coverage.h"

#include "tiles.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Identifiers beside those of the surfaces' triangles. */
enum { BLOCKER = -1 };

/* Parts with more candidates than this are split without a search for a surface that covers them:
 * hardly any is covered, and the search is linear. */
enum { MAX_SEARCHED = 48 };
/* A plane seen at less than two milliradians is left to rays: its distances lose three of float32's
 * seven digits. */
#define MIN_PLANE_SINE 2e-3f
/* Points nearer than this to a plane, relative to the scene, lie on it: corners of walls that stand
 * on a floor. Float32 rounds coordinates to 6e-8. */
#define ON_PLANE 1e-6f

enum { BOX_TRIANGLES = 12 };

/* Triangles, and spheres as triangles of one point; coordinates by component, for vector code. */
struct Candidates {
    int count, capacity;
    float *corner[9];
    float *radius;
    int32_t *id; /* index into the scene's surfaces, or BLOCKER */
};

typedef struct {
    Vec3 normal[4]; /* inward, unit */
    Vec3 edge[4];   /* between neighbouring sides */
    Vec3 axis;
} BeamSides;

typedef struct {
    int surface;
    int32_t triangle;
    Vec3 normal;    /* of the plane, towards the viewpoint */
    float distance; /* of the viewpoint from the plane */
} Cover;

struct Search {
    const FrameState *state;
    Candidates *levels; /* one list for each level of beams, and the frame's */
    uint8_t *outside;
    float on_plane; /* metres */
    int num_filled;
};

static int allocate(Candidates *list, int capacity) {
    /* One block: nine coordinates, radius and identifier of each candidate. */
    float *values = malloc(sizeof(float) * 11 * (size_t)(capacity ? capacity : 1));
    for (int i = 0; i < 9; i++)
        list->corner[i] = values + (size_t)i * (size_t)capacity;
    list->radius = values + 9 * (size_t)capacity;
    list->id = (int32_t *)(values + 10 * (size_t)capacity);
    list->capacity = capacity;
    list->count = 0;
    return values != NULL;
}

static void append(Candidates *list, const Vec3 corners[3], float radius, int32_t id) {
    int at = list->count++;
    for (int corner = 0; corner < 3; corner++) {
        list->corner[3 * corner][at] = corners[corner].x;
        list->corner[3 * corner + 1][at] = corners[corner].y;
        list->corner[3 * corner + 2][at] = corners[corner].z;
    }
    list->radius[at] = radius;
    list->id[at] = id;
}

static Vec3 corner_of(const Candidates *list, int at, int corner) {
    return (Vec3){list->corner[3 * corner][at], list->corner[3 * corner + 1][at],
                  list->corner[3 * corner + 2][at]};
}

static void append_surfaces(Candidates *list, const Scene *scene, Vec3 viewpoint) {
    for (int i = 0; i < scene->surfaces.num_triangles; i++) {
        const float *corners =
            scene->mesh->arrays.corners + 9 * (size_t)scene->surfaces.triangles[i];
        Vec3 relative[3];
        for (int corner = 0; corner < 3; corner++)
            relative[corner] = subtract(vec3(corners + 3 * corner), viewpoint);
        append(list, relative, 0.0f, i);
    }
    for (int i = 0; i < scene->surfaces.num_clusters; i++) {
        const float *cluster = scene->surfaces.clusters + 4 * i;
        Vec3 centre = subtract(vec3(cluster), viewpoint);
        append(list, (Vec3[3]){centre, centre, centre}, cluster[3], BLOCKER);
    }
}

/* An object reaches into a beam only through its box's sides, wherever the viewpoint is. */
static void append_box(Candidates *list, const Pose *pose, const float *box, Vec3 viewpoint) {
    static const uint8_t sides[BOX_TRIANGLES][3] = {
        {0, 1, 3}, {0, 3, 2}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
        {2, 3, 7}, {2, 7, 6}, {0, 2, 6}, {0, 6, 4}, {1, 3, 7}, {1, 7, 5},
    };
    Vec3 corners[8];
    for (int i = 0; i < 8; i++) {
        Vec3 sign = {i & 4 ? 1.0f : -1.0f, i & 2 ? 1.0f : -1.0f, i & 1 ? 1.0f : -1.0f};
        Vec3 local = add(vec3(box), multiply(sign, vec3(box + 3)));
        Vec3 placed = add(rotate(pose->rotation, local), vec3(pose->translation));
        corners[i] = subtract(placed, viewpoint);
    }
    for (int i = 0; i < BOX_TRIANGLES; i++) {
        Vec3 side[3] = {corners[sides[i][0]], corners[sides[i][1]], corners[sides[i][2]]};
        append(list, side, 0.0f, BLOCKER);
    }
}

Candidates *collect_candidates(const FrameState *state) {
    const Frame *frame = state->frame;
    const Surfaces *surfaces = &state->scene->surfaces;
    int is_moving = frame->num_poses > 1 || state->rays->times || state->rays->origins;
    /* Facet numbers come from rays alone: a surface is known by one of its triangles. */
    if (!surfaces->num_surfaces || is_moving || frame->output == OUTPUT_HITS)
        return NULL;
    Candidates *list = calloc(1, sizeof *list);
    int capacity = surfaces->num_triangles + surfaces->num_clusters +
                   BOX_TRIANGLES * frame->num_objects;
    if (!list || !allocate(list, capacity)) {
        free(list);
        return NULL;
    }
    Vec3 viewpoint = vec3(frame->camera->translation);
    append_surfaces(list, state->scene, viewpoint);
    for (int object = 0; object < frame->num_objects; object++)
        append_box(list, frame->object_poses + object, frame->object_boxes + 6 * object, viewpoint);
    return list;
}

void release_candidates(Candidates *candidates) {
    if (candidates)
        free(candidates->corner[0]);
    free(candidates);
}

/* Largest coordinate of a list: the scale of float32's rounding. */
static float find_extent(const Candidates *list) {
    float extent = 0.0f;
    for (int component = 0; component < 9; component++)
        for (int i = 0; i < list->count; i++)
            extent = fmaxf(extent, fabsf(list->corner[component][i]));
    return extent;
}

Search *create_search(const FrameState *state, const Candidates *candidates) {
    Search *search = calloc(1, sizeof *search);
    if (!search)
        return NULL;
    search->state = state;
    search->levels = calloc(BEAM_LEVELS + 1, sizeof(Candidates));
    search->outside = malloc((size_t)candidates->count + 1);
    int is_whole = search->levels && search->outside;
    if (is_whole)
        search->levels[BEAM_LEVELS] = *candidates;
    for (int level = 0; is_whole && level < BEAM_LEVELS; level++)
        is_whole = allocate(&search->levels[level], candidates->count);
    if (!is_whole) {
        release_search(search);
        return NULL;
    }
    search->on_plane = ON_PLANE * find_extent(candidates);
    return search;
}

void release_search(Search *search) {
    if (!search)
        return;
    /* The last list is the frame's. */
    for (int level = 0; search->levels && level < BEAM_LEVELS; level++)
        free(search->levels[level].corner[0]);
    free(search->levels);
    free(search->outside);
    free(search);
}

static Vec3 inward(const float *rotation, Vec3 side, float tangent, float sign, Vec3 axis) {
    Vec3 normal = scale(sign, subtract(side, scale(tangent, axis)));
    return rotate(rotation, scale(1.0f / sqrtf(dot(normal, normal)), normal));
}

static void find_sides(const FrameState *state, const Beam *beam, BeamSides *sides) {
    const float *rotation = state->frame->camera->rotation;
    sides->normal[0] = inward(rotation, beam->a, beam->a_min, 1.0f, beam->axis);
    sides->normal[1] = inward(rotation, beam->a, beam->a_max, -1.0f, beam->axis);
    sides->normal[2] = inward(rotation, beam->b, beam->b_min, 1.0f, beam->axis);
    sides->normal[3] = inward(rotation, beam->b, beam->b_max, -1.0f, beam->axis);
    sides->axis = rotate(rotation, beam->axis);
    for (int i = 0; i < 4; i++) {
        Vec3 edge = cross(sides->normal[i / 2], sides->normal[2 + i % 2]);
        sides->edge[i] = dot(edge, sides->axis) < 0.0f ? scale(-1.0f, edge) : edge;
    }
}

/* Mark the candidates that lie on the outer side of one plane through the viewpoint. */
static void mark_outside(const Candidates *list, Vec3 normal, uint8_t *restrict outside) {
    const float *restrict x0 = list->corner[0], *restrict y0 = list->corner[1];
    const float *restrict z0 = list->corner[2], *restrict x1 = list->corner[3];
    const float *restrict y1 = list->corner[4], *restrict z1 = list->corner[5];
    const float *restrict x2 = list->corner[6], *restrict y2 = list->corner[7];
    const float *restrict z2 = list->corner[8], *restrict radius = list->radius;
    for (int i = 0; i < list->count; i++) {
        float first = normal.x * x0[i] + normal.y * y0[i] + normal.z * z0[i];
        float second = normal.x * x1[i] + normal.y * y1[i] + normal.z * z1[i];
        float third = normal.x * x2[i] + normal.y * y2[i] + normal.z * z2[i];
        float nearer = first > second ? first : second;
        float nearest = nearer > third ? nearer : third;
        outside[i] |= nearest < -radius[i];
    }
}

static void copy_candidate(const Candidates *from, int at, Candidates *to) {
    int next = to->count++;
    for (int component = 0; component < 9; component++)
        to->corner[component][next] = from->corner[component][at];
    to->radius[next] = from->radius[at];
    to->id[next] = from->id[at];
}

/* Whether the beam lies wholly on the side of a plane that its normal points away from. */
static int is_beam_below(const BeamSides *sides, Vec3 normal) {
    for (int i = 0; i < 4; i++)
        if (dot(normal, sides->edge[i]) >= 0.0f)
            return 0;
    return 1;
}

/* Whether a plane through the viewpoint and one side of a triangle separates it from the beam: with
 * the beam's own sides, all that can separate two pyramids of one apex. */
static int is_beside(const Candidates *list, int at, const BeamSides *sides) {
    for (int side = 0; side < 3; side++) {
        Vec3 normal = cross(corner_of(list, at, side), corner_of(list, at, (side + 1) % 3));
        float height = dot(normal, corner_of(list, at, (side + 2) % 3));
        /* A plane through the viewpoint is seen as a line, which has no sides. */
        if (height != 0.0f && is_beam_below(sides, height < 0.0f ? scale(-1.0f, normal) : normal))
            return 1;
    }
    return 0;
}

/* Candidates of `from` that reach into a beam. */
static void keep_inside(Search *search, const Candidates *from, const BeamSides *sides,
                        Candidates *kept) {
    memset(search->outside, 0, (size_t)from->count);
    for (int side = 0; side < 4; side++)
        mark_outside(from, sides->normal[side], search->outside);
    kept->count = 0;
    for (int i = 0; i < from->count; i++)
        if (!search->outside[i] && (from->radius[i] > 0.0f || !is_beside(from, i, sides)))
            copy_candidate(from, i, kept);
}

/* Distance along the axis to a candidate's triangle, INFINITY if it is not met. */
static float meet(const Candidates *list, int at, Vec3 axis) {
    Vec3 first = corner_of(list, at, 0);
    Vec3 edge_u = subtract(corner_of(list, at, 1), first);
    Vec3 edge_v = subtract(corner_of(list, at, 2), first);
    Vec3 p = cross(axis, edge_v);
    float determinant = dot(edge_u, p);
    if (determinant == 0.0f)
        return INFINITY;
    float inverse = 1.0f / determinant;
    Vec3 q = cross(scale(-1.0f, first), edge_u);
    float u = -dot(first, p) * inverse, v = dot(axis, q) * inverse;
    float distance = dot(edge_v, q) * inverse;
    return u >= 0.0f && v >= 0.0f && u + v <= 1.0f && distance > 0.0f ? distance : INFINITY;
}

/* The surface that the axis meets first; 0 if none, or only at a grazing angle. */
static int find_first_surface(const Search *search, const Candidates *list, Vec3 axis,
                              Cover *cover) {
    const Scene *scene = search->state->scene;
    float nearest = INFINITY;
    int first = -1;
    for (int i = 0; i < list->count; i++) {
        float distance = list->id[i] == BLOCKER ? INFINITY : meet(list, i, axis);
        if (distance < nearest) {
            nearest = distance;
            first = i;
        }
    }
    if (first < 0)
        return 0;
    cover->surface = scene->surfaces.surface[list->id[first]];
    cover->triangle = scene->surfaces.representative[cover->surface];
    Vec3 normal = vec3(scene->mesh->arrays.normals + 3 * (size_t)cover->triangle);
    float sine = dot(normal, axis);
    cover->normal = scale(sine < 0.0f ? 1.0f : -1.0f, normal);
    cover->distance = nearest * fabsf(sine);
    return fabsf(sine) > MIN_PLANE_SINE;
}

/* Whether a side of the beam, or the plane of the edge and the viewpoint, separates both. */
static int is_edge_outside(const BeamSides *sides, Vec3 from, Vec3 to) {
    Vec3 normal = cross(from, to);
    if (is_beam_below(sides, normal) || is_beam_below(sides, scale(-1.0f, normal)))
        return 1;
    for (int side = 0; side < 4; side++)
        if (dot(sides->normal[side], from) < 0.0f && dot(sides->normal[side], to) < 0.0f)
            return 1;
    return 0;
}

static int has_outer_edge_inside(const Candidates *list, int at, uint8_t outer_edges,
                                 const BeamSides *sides) {
    for (int edge = 0; edge < 3; edge++)
        if (outer_edges >> edge & 1 && !is_edge_outside(sides, corner_of(list, at, edge),
                                                        corner_of(list, at, (edge + 1) % 3)))
            return 1;
    return 0;
}

static int covers(const Search *search, const Candidates *list, const BeamSides *sides,
                  int surface) {
    const Surfaces *surfaces = &search->state->scene->surfaces;
    for (int i = 0; i < list->count; i++) {
        int id = list->id[i];
        if (id != BLOCKER && surfaces->surface[id] == surface &&
            has_outer_edge_inside(list, i, surfaces->outer_edges[id], sides))
            return 0;
    }
    return 1;
}

static int is_behind(const Search *search, const Candidates *list, int at, const Cover *cover) {
    for (int corner = 0; corner < 3; corner++) {
        float height = dot(cover->normal, corner_of(list, at, corner)) + cover->distance;
        if (height > search->on_plane - list->radius[at])
            return 0;
    }
    return 1;
}

/* Drop what a covering surface hides; 1 if nothing but the surface is left. */
static int drop_hidden(const Search *search, Candidates *list, const Cover *cover) {
    const Surfaces *surfaces = &search->state->scene->surfaces;
    int count = list->count, others = 0;
    list->count = 0;
    for (int i = 0; i < count; i++) {
        int id = list->id[i];
        int is_surface = id != BLOCKER && surfaces->surface[id] == cover->surface;
        if (!is_surface && is_behind(search, list, i, cover))
            continue;
        others += !is_surface;
        copy_candidate(list, i, list);
    }
    return !others;
}

static int has_surfaces(const Candidates *list) {
    for (int i = 0; i < list->count; i++)
        if (list->id[i] != BLOCKER)
            return 1;
    return 0;
}

/* Triangle of the surface that fills a beam, the background, or SURFACE_UNKNOWN. */
static int32_t find_cover(const Search *search, Candidates *list, const BeamSides *sides) {
    Cover cover;
    if (!list->count)
        return SURFACE_BACKGROUND;
    if (list->count > MAX_SEARCHED || !find_first_surface(search, list, sides->axis, &cover) ||
        !covers(search, list, sides, cover.surface))
        return SURFACE_UNKNOWN;
    return drop_hidden(search, list, &cover) ? cover.triangle : SURFACE_UNKNOWN;
}

static void render_beam(Search *search, const View *view, int level, int row, int column,
                        const Candidates *candidates, int32_t triangle);

static void render_quarters(Search *search, const View *view, int level, int row, int column,
                            const Candidates *candidates, int32_t triangle) {
    for (int quarter = 0; quarter < 4; quarter++)
        render_beam(search, view, level - 1, 2 * row + quarter / 2, 2 * column + quarter % 2,
                    candidates, triangle);
}

/* Render a part of the image: filled if `triangle` says with what, else searched if it may have
 * candidates (NULL: it has been given up). */
static void render_beam(Search *search, const View *view, int level, int row, int column,
                        const Candidates *candidates, int32_t triangle) {
    const BeamLevel *parts = &view->levels[level];
    if (row >= parts->rows || column >= parts->columns)
        return;
    const Beam *beam = &parts->beams[row * parts->columns + column];
    if (beam->kind == BEAM_EMPTY)
        return;
    if (triangle == SURFACE_UNKNOWN && candidates && beam->kind == BEAM_NARROW) {
        BeamSides sides;
        Candidates *kept = &search->levels[level];
        find_sides(search->state, beam, &sides);
        keep_inside(search, candidates, &sides, kept);
        triangle = find_cover(search, kept, &sides);
        /* Nothing but small things: no part of it can be proven. */
        candidates = has_surfaces(kept) ? kept : NULL;
    }
    if (level) {
        render_quarters(search, view, level, row, column, candidates, triangle);
        return;
    }
    render_tile(search->state, view->tile_at[row * parts->columns + column], triangle);
    search->num_filled += triangle != SURFACE_UNKNOWN;
}

int render_part(Search *search, const View *view, int part) {
    const BeamLevel *parts = &view->levels[BEAM_LEVELS - 1];
    search->num_filled = 0;
    render_beam(search, view, BEAM_LEVELS - 1, part / parts->columns, part % parts->columns,
                &search->levels[BEAM_LEVELS], SURFACE_UNKNOWN);
    return search->num_filled;
}
