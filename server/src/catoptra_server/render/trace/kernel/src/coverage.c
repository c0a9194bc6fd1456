/* Provides coverage.h, where the proof is stated: the search for parts of the image that one
 * surface fills, from the coarsest parts to tiles.
 * No twin: every proof is about the exact rays. A search owns its lists, one for each thread, from
 * create_search to release_search.
 * Threads: one search a thread; parts are drawn from a shared counter. */
#include "coverage.h"

#include "blur.h"
#include "body_shade.h"
#include "blur_plan.h"
#include "fog.h"
#include "light_map.h"
#include "light_shaft.h"
#include "occluded_tiles.h"
#include "occlusion.h"
#include "plane_light.h"
#include "tiles.h"

#include <math.h>
#include <stdlib.h>

/* Parts with more candidates than this are split without a search for a surface that covers them:
 * hardly any is covered. */
enum { MAX_SEARCHED = 64 };
/* Parts that may show more than this of the scene are left to rays: their triangles are many and
 * small. */
enum { MAX_LISTED = 1024 };
/* A plane seen at less than two milliradians is left to rays: its distances lose three of float32's
 * seven digits. */
#define MIN_PLANE_SINE 2e-3f
/* Points nearer than this to a plane lie on it: corners of walls that stand on a floor. Relative to
 * the parts of coordinates along the plane's normal, which is how float32 rounds heights: to 2e-7.
 * Relative to the whole scene it would be a millimetre in one of a kilometre, and hide lines. */
#define ON_PLANE 5e-7f

/* Nor is a plane proven whose side of the viewpoint is not certain. */
#define MIN_ROUNDINGS 16.0f

/* Distances that differ by less, relatively, are not told apart. */
#define SAME_DISTANCE 1e-5f

typedef struct {
    int surface;
    int32_t triangle; /* the surface's representative */
    Vec3 normal;      /* of its plane, towards the viewpoint */
    float distance;   /* of the beam's apex from the plane */
    Vec3 scale;       /* magnitudes of the coordinates that the distance results from */
} Cover;

struct Search {
    const FrameState *state;
    const CandidateList *objects; /* boxes of the frame's dynamic objects */
    CandidateList found; /* what may reach into the part whose scene is looked up */
    CandidateList levels[BEAM_LEVELS]; /* what reaches into the current beam of each level */
    uint8_t *marks;
    ShortList short_list; /* of the part whose tiles are being rendered */
    TriangleSet triangles; /* likewise */
    int finest_proven; /* level below which tracing costs less than a proof */
    int num_filled;
    int64_t *blur_rays; /* NULL while the sharp frame is drawn */
    int32_t blockers[MAX_SHAFTS];
};

int can_prove_coverage(const FrameState *state) {
    int32_t output = state->frame->output;
    return !state->frame->has_few_rays && state->scene->surfaces.num_surfaces &&
           state->has_one_pose && output != OUTPUT_HITS && output != OUTPUT_FLOW;
}

Search *create_search(const FrameState *state, int num_boxes) {
    Search *search = calloc(1, sizeof *search);
    if (!search)
        return NULL;
    search->state = state;
    /* The rays of a tile of one sample a pixel take less time than a proof. */
    search->finest_proven = state->rays->samples == 1 ? 1 : 0;
    int capacity = num_boxes + MAX_LISTED;
    search->marks = malloc(whole_blocks(capacity));
    int is_whole = search->marks && candidates_allocate(&search->found, capacity);
    for (int level = 0; level < BEAM_LEVELS; level++)
        is_whole &= candidates_allocate(&search->levels[level], capacity);
    if (is_whole)
        return search;
    release_search(search);
    return NULL;
}

void release_search(Search *search) {
    for (int level = 0; level < BEAM_LEVELS; level++)
        candidates_free(&search->levels[level]);
    candidates_free(&search->found);
    free(search->marks);
    free(search);
}

static float length_of(Vec3 a) { return sqrtf(dot(a, a)); }

/* Whether apex and rays lie on one side of the plane, during all turns of the camera. */
static int is_before_plane(const Cover *cover, const BeamSides *sides, float margin, float turn) {
    Vec3 to_centre = subtract(sides->centre, sides->apex);
    float height = dot(cover->normal, to_centre) + cover->distance;
    return cover->distance > margin + turn * length_of(sides->apex) &&
           height > sides->radius + margin + turn * length_of(sides->centre);
}

/* The surface that the axis meets first; 0 if none, or only at a grazing angle. */
static int find_first_surface(const Search *search, const CandidateList *list,
                              const BeamSides *sides, Cover *cover) {
    const Scene *scene = search->state->scene;
    float distances[MAX_SEARCHED + LANES], nearest = INFINITY;
    int first = -1;
    measure_distances(list, sides, distances);
    for (int i = 0; i < list->count; i++)
        /* Of two at one distance the lower number, as rays do. */
        if (list->id[i] >= 0 && (distances[i] < nearest || (first >= 0 && distances[i] == nearest &&
                                                            list->id[i] < list->id[first]))) {
            nearest = distances[i];
            first = i;
        }
    if (first < 0)
        return 0;
    cover->surface = scene->surfaces.surface[list->id[first]];
    cover->triangle = scene->surfaces.representative[cover->surface];
    Vec3 normal = vec3(scene->mesh->arrays.normals + 3 * (size_t)cover->triangle);
    float sine = dot(normal, sides->axis);
    cover->normal = scale(sine < 0.0f ? 1.0f : -1.0f, normal);
    Vec3 corner = corner_from_apex(list, first, 0, sides);
    cover->distance = -dot(cover->normal, corner);
    cover->scale = add(absolute(corner), absolute(vec3(search->state->camera.translation)));
    float rounding = ON_PLANE * dot(absolute(normal), cover->scale);
    float margin = MIN_ROUNDINGS * rounding + search->state->shift;
    return fabsf(sine) > MIN_PLANE_SINE &&
           is_before_plane(cover, sides, margin, search->state->turn);
}

/* Whether a side of the beam, or the plane of the edge and the apex, separates both. */
static int is_edge_outside(const BeamSides *sides, Vec3 from, Vec3 to, float reach) {
    for (int side = 0; side < 4; side++)
        if (dot(sides->normal[side], from) < -reach && dot(sides->normal[side], to) < -reach)
            return 1;
    return is_beam_beside(sides, from, to, reach);
}

static int has_outer_edge_inside(const CandidateList *list, int at, uint8_t outer_edges,
                                 const BeamSides *sides) {
    for (int edge = 0; edge < 3; edge++)
        if (outer_edges >> edge & 1 &&
            !is_edge_outside(sides, corner_from_apex(list, at, edge, sides),
                             corner_from_apex(list, at, (edge + 1) % 3, sides), list->reach[at]))
            return 1;
    return 0;
}

static int covers(const Search *search, const CandidateList *list, const BeamSides *sides,
                  int surface) {
    const Surfaces *surfaces = &search->state->scene->surfaces;
    for (int i = 0; i < list->count; i++) {
        int id = list->id[i];
        if (id >= 0 && surfaces->surface[id] == surface && surfaces->outer_edges[id] &&
            has_outer_edge_inside(list, i, surfaces->outer_edges[id], sides))
            return 0;
    }
    return 1;
}

static int is_below_plane(const CandidateList *list, int at, const Cover *cover,
                          const BeamSides *sides) {
    for (int i = 0; i < 3; i++) {
        Vec3 corner = corner_from_apex(list, at, i, sides);
        float height = dot(cover->normal, corner) + cover->distance;
        Vec3 scale = add(absolute(corner), cover->scale);
        float on_plane = ON_PLANE * dot(absolute(cover->normal), scale);
        if (height > on_plane - list->radius[at])
            return 0;
    }
    return 1;
}

/* Whether the plane of a triangle is farther than the cover's along all rays of the beam. The
 * inverse of a plane's distance is linear in the direction: the beam's edges decide. */
static int is_farther(const CandidateList *list, int at, const Cover *cover,
                      const BeamSides *sides) {
    Vec3 first = corner_from_apex(list, at, 0, sides);
    Vec3 normal = cross(subtract(corner_from_apex(list, at, 1, sides), first),
                        subtract(corner_from_apex(list, at, 2, sides), first));
    float height = dot(normal, first);
    for (int i = 0; i < 4; i++) {
        /* Both inverse distances, times two heights of which the cover's is above zero. */
        float here = dot(normal, sides->edge[i]) * cover->distance;
        float cover_here = -dot(cover->normal, sides->edge[i]) * height;
        float margin = SAME_DISTANCE * fabsf(cover_here);
        if (!(height < 0.0f ? here > cover_here + margin : here < cover_here - margin))
            return 0;
    }
    return height != 0.0f;
}

static int is_behind(const CandidateList *list, int at, const Cover *cover,
                     const BeamSides *sides) {
    /* Which of two planes is farther depends on the viewpoint: not while it moves. */
    return is_below_plane(list, at, cover, sides) ||
           (list->reach[at] == 0.0f && is_farther(list, at, cover, sides));
}

/* Drop what a covering surface hides; 1 if nothing but the surface and objects is left. */
static int drop_hidden(const Search *search, CandidateList *list, const Cover *cover,
                       const BeamSides *sides) {
    const Surfaces *surfaces = &search->state->scene->surfaces;
    int count = list->count, others = 0;
    list->count = 0;
    for (int i = 0; i < count; i++) {
        int id = list->id[i];
        int is_surface = id >= 0 && surfaces->surface[id] == cover->surface;
        if (!is_surface && is_behind(list, i, cover, sides))
            continue;
        others += !is_surface && candidate_object(id) == OBJECT_STATIC;
        candidate_copy(list, i, list);
    }
    return !others;
}

static int has_surfaces(const CandidateList *list) {
    for (int i = 0; i < list->count; i++)
        if (list->id[i] >= 0)
            return 1;
    return 0;
}

/* The only dynamic object of a list, OBJECT_NONE or OBJECT_ANY. */
static int32_t find_object(const CandidateList *list) {
    int32_t found = OBJECT_NONE;
    for (int i = 0; i < list->count; i++) {
        int32_t object = candidate_object(list->id[i]);
        if (object == OBJECT_STATIC || object == found)
            continue;
        if (found != OBJECT_NONE)
            return OBJECT_ANY;
        found = object;
    }
    return found;
}

static int has_scene(const CandidateList *list) {
    for (int i = 0; i < list->count; i++)
        if (candidate_object(list->id[i]) == OBJECT_STATIC)
            return 1;
    return 0;
}

/* Of a surface of two sides, and of one that is none from behind, the front is known; one with
 * holes covers nothing. */
static int is_uncertain(const FrameState *state, const BeamSides *sides, int32_t triangle) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    if (!(mesh->flags[triangle] & (FACET_TWO_SIDED | FACET_FILTERED)))
        return 0;
    if (is_filtered(mesh, triangle) && isfinite(mesh->coverage[3 * (size_t)triangle]))
        return 1;
    Vec3 apex = add(vec3(state->camera.translation), sides->apex);
    return dot(vec3(mesh->normals + 3 * (size_t)triangle),
               subtract(plane_point(state, triangle), apex)) >= 0.0f;
}

/* Triangle of the surface that fills a beam, the background, or SURFACE_UNKNOWN; objects apart. */
static int32_t find_cover(const Search *search, CandidateList *list, const BeamSides *sides) {
    Cover cover;
    if (!has_scene(list))
        return SURFACE_BACKGROUND;
    if (list->count > MAX_SEARCHED || !find_first_surface(search, list, sides, &cover) ||
        is_uncertain(search->state, sides, cover.triangle) ||
        !covers(search, list, sides, cover.surface))
        return SURFACE_UNKNOWN;
    return drop_hidden(search, list, &cover, sides) ? cover.triangle : SURFACE_UNKNOWN;
}

/* A part of the image, and what is known of it. */
typedef struct {
    int level, row, column;
    /* What may reach into it: the frame's objects, while the scene has not been looked up; NULL: no
     * proof is tried any more. */
    const CandidateList *candidates;
    TileContent content;
    int is_hidden; /* no part of it shows an open part of its surface */
    uint32_t faint; /* lamps that are left to rays, to which hardly any is cast */
} Part;

/* Of a list's flat surfaces: the planes of the edges that bound them, in a beam. */
enum { MAX_EDGES = 32 };
typedef struct {
    int count;
    int32_t surface[MAX_EDGES];
    Vec3 normal[MAX_EDGES]; /* unit, towards the surface */
} EdgePlanes;

/* Edges meet at less than 30 degrees along a strip; what is shorter than so many spacings has no
 * strips. */
#define MAX_STRIP_COSINE (-0.866f)
#define MIN_STRIP_SPACINGS 4.0f

/* Directions to a triangle's corners. */
static void find_seen(const CandidateList *list, int at, const BeamSides *sides, Vec3 seen[3]) {
    for (int corner = 0; corner < 3; corner++) {
        Vec3 to = corner_from_apex(list, at, corner, sides);
        seen[corner] = scale(1.0f / sqrtf(dot(to, to)), to);
    }
}

/* Whether a triangle is seen narrower than a spacing, and how: strips are told by their edges. */
typedef enum { WIDE, STRIP, SPECK } Shape;

static Shape find_shape(const Vec3 seen[3], float spacing) {
    float longest = 0.0f, volume = fabsf(dot(seen[0], cross(seen[1], seen[2])));
    for (int corner = 0; corner < 3; corner++) {
        Vec3 side = cross(seen[corner], seen[(corner + 1) % 3]);
        longest = fmaxf(longest, dot(side, side));
    }
    if (volume >= spacing * sqrtf(longest))
        return WIDE;
    return longest > MIN_STRIP_SPACINGS * MIN_STRIP_SPACINGS * spacing * spacing ? STRIP : SPECK;
}

/* Add the edges of a triangle that bound its surface within a beam; 0 if there are too many. */
static int add_edge_planes(const FrameState *state, const CandidateList *list, int at,
                           const BeamSides *sides, EdgePlanes *planes) {
    int32_t id = list->id[at];
    Vec3 seen[3];
    find_seen(list, at, sides, seen);
    float sign = dot(seen[0], cross(seen[1], seen[2])) < 0.0f ? -1.0f : 1.0f;
    for (int edge = 0; edge < 3; edge++) {
        int next = (edge + 1) % 3;
        if (!(state->scene->surfaces.outer_edges[id] >> edge & 1) ||
            is_edge_outside(sides, corner_from_apex(list, at, edge, sides),
                            corner_from_apex(list, at, next, sides), list->reach[at]))
            continue;
        if (planes->count == MAX_EDGES)
            return 0;
        Vec3 normal = cross(seen[edge], seen[next]);
        planes->surface[planes->count] = state->scene->surfaces.surface[id];
        planes->normal[planes->count++] = scale(sign / sqrtf(dot(normal, normal)), normal);
    }
    return 1;
}

/* Whether two edges of a surface run along each other, nearer than a spacing in a beam. */
static int has_strip(const EdgePlanes *planes, const BeamSides *sides, float spacing) {
    for (int i = 0; i < planes->count; i++)
        for (int k = 0; k < i; k++) {
            if (planes->surface[i] != planes->surface[k] ||
                !(dot(planes->normal[i], planes->normal[k]) < MAX_STRIP_COSINE))
                continue;
            float least = INFINITY, most = -INFINITY;
            for (int ray = 0; ray < 4; ray++) {
                float width = dot(add(planes->normal[i], planes->normal[k]), sides->edge[ray]);
                least = fminf(least, width);
                most = fmaxf(most, width);
            }
            if (!(least >= spacing || most <= -spacing))
                return 1;
        }
    return 0;
}

/* Whether something of the static scene may be seen narrower than the distance of two samples along
 * a diagonal. */
static int may_be_thin(const FrameState *state, const CandidateList *kept, const BeamSides *sides) {
    float spacing = 1.5f * sides->tile / (float)(TILE_PX * state->rays->samples);
    EdgePlanes planes = {.count = 0};
    int is_any = 0;
    for (int i = 0; i < kept->count; i++) {
        Vec3 seen[3];
        if (candidate_object(kept->id[i]) != OBJECT_STATIC)
            continue;
        if (kept->id[i] == CLUSTER)
            return 1;
        find_seen(kept, i, sides, seen);
        Shape shape = find_shape(seen, spacing);
        if (shape == SPECK)
            return 1;
        is_any |= shape == STRIP;
    }
    for (int i = 0; is_any && i < kept->count; i++)
        if (candidate_object(kept->id[i]) == OBJECT_STATIC &&
            !add_edge_planes(state, kept, i, sides, &planes))
            return 1;
    return is_any && has_strip(&planes, sides, spacing);
}

/* All that a part may show of the static scene. */
static void list_triangles(Search *search, const CandidateList *kept, const BeamSides *sides,
                           TileContent *content) {
    /* Tiles of a moving frame list what they show during the exposure themselves, in
     * clear air and from one viewpoint. */
    if (search->blur_rays && content->object == OBJECT_NONE && !has_fog(search->state) &&
        !search->state->rays->origins &&
        collect_triangles(search->state, kept, &search->triangles))
        content->triangles = &search->triangles;
    else if (make_short_list(search->state, kept, sides, &search->short_list))
        content->short_list = &search->short_list;
}

/* What reaches into a part; 0 if of the static scene it is too much, and nothing is listed. */
static int list_part(Search *search, const BeamSides *sides, const Part *part) {
    CandidateList *kept = &search->levels[part->level], *found = &search->found;
    if (part->candidates != search->objects) {
        keep_inside(part->candidates, sides, search->marks, kept);
        return 1;
    }
    keep_inside(search->objects, sides, search->marks, found);
    int num_objects = found->count;
    int is_whole = add_scene(search->state, sides, num_objects + MAX_LISTED, found);
    if (!is_whole)
        found->count = num_objects;
    keep_inside(found, sides, search->marks, kept);
    return is_whole;
}

/* The corners of the part of a known plane that a beam sees. */
static void find_quad(const FrameState *state, const BeamSides *sides, int32_t triangle,
                      Vec3 corners[4]) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    Vec3 apex = add(vec3(state->camera.translation), sides->apex);
    Vec3 normal = vec3(mesh->normals + 3 * (size_t)triangle);
    float height = dot(normal, subtract(plane_point(state, triangle), apex));
    for (int i = 0; i < 4; i++)
        corners[i] = add(apex, scale(height / dot(normal, sides->edge[i]), sides->edge[i]));
}

static void prove_part(Search *search, const BeamSides *sides, Part *part) {
    CandidateList *kept = &search->levels[part->level];
    int is_whole = list_part(search, sides, part);
    part->content.triangle = is_whole ? find_cover(search, kept, sides) : SURFACE_UNKNOWN;
    part->content.object = find_object(kept);
    if (search->state->frame->shades && search->state->frame->output < OUTPUT_HITS &&
        part->content.triangle >= 0 &&
        part->content.object == OBJECT_NONE) {
        Vec3 corners[4];
        find_quad(search->state, sides, part->content.triangle, corners);
        part->content.is_shaded = may_be_shaded(search->state, corners);
        /* No proof about the facet's light holds beside a body. */
        if (part->content.is_shaded && !has_occlusion(search->state->scene, part->content.triangle))
            part->content.object = OBJECT_ANY;
    }
    /* Nothing but small things: no quarter of it can be proven. */
    int is_hopeless =
        part->level <= search->finest_proven || !is_whole || !has_surfaces(kept);
    part->candidates = is_hopeless ? NULL : kept;
    if (is_hopeless && is_whole && part->content.triangle == SURFACE_UNKNOWN) {
        part->content.may_be_thin = search->state->plan && !search->blur_rays &&
                                    may_be_thin(search->state, kept, sides);
        list_triangles(search, kept, sides, &part->content);
    }
}

static int is_unproven(const Part *part) {
    return part->candidates &&
           (part->content.triangle == SURFACE_UNKNOWN || part->content.object != OBJECT_NONE);
}

static int is_unlit(const Search *search, const Part *part) {
    /* While the viewpoint moves, blocks are proven one by one, at their own instants. */
    int is_moving = search->state->shift > 0.0f || search->state->turn > 0.0f;
    return search->state->frame->has_shadows && part->content.triangle >= 0 &&
           !is_moving &&
           !is_light_proven(search->state, part->content.triangle,
                            (LightProof){part->content.proof.seen | part->faint,
                                         part->content.proof.hidden});
}

static int may_be_open(const Search *search, const Part *part) {
    const FrameState *state = search->state;
    /* Of a moving camera's views the quad is only one. */
    /* The smallest parts find out themselves while they look for factors. */
    /* Baked light is open nowhere. */
    return !state->scene->occlusion.light && state->frame->output < OUTPUT_HITS &&
           part->level > 0 && state->shift == 0.0f &&
           state->turn == 0.0f && part->content.triangle >= 0 && !part->content.is_open &&
           !part->is_hidden && has_occlusion(state->scene, part->content.triangle);
}

static int is_dim(const Search *search, const Part *part) {
    return is_unlit(search, part) || may_be_open(search, part);
}

/* What is known of the lights and of the sky on the part of a known plane that a beam sees. */
static void prove_light(Search *search, const BeamSides *sides, Part *part) {
    const FrameState *state = search->state;
    int32_t triangle = part->content.triangle;
    Vec3 corners[4];
    find_quad(state, sides, triangle, corners);
    if (is_unlit(search, part)) {
        uint32_t known = part->content.proof.seen | part->content.proof.hidden | part->faint;
        part->faint |= find_faint_lamps(state, triangle, corners, known);
        known |= part->faint;
        LightProof proof = prove_lights(state, triangle, corners, known);
        part->content.proof.hidden |= proof.hidden;
        part->content.proof.seen |= proof.seen;
        part->content.proof.seen |= find_free_lights(
            state, triangle, corners, known | proof.seen | proof.hidden, search->blockers);
    }
    if (may_be_open(search, part)) {
        SkyView view = find_sky_view(state->scene, triangle, corners);
        part->content.is_open = view == SKY_OPEN;
        part->is_hidden = view == SKY_HIDDEN;
    }
}

/* Render the tiles of a part of which all is known: without its beams, which memory is slow to
 * deliver. */
static void render_closed(Search *search, const View *view, const Part *part) {
    int side = 1 << part->level, columns = view->levels[0].columns;
    int bottom = (part->row + 1) * side, right = (part->column + 1) * side;
    bottom = bottom < view->tile_rows ? bottom : view->tile_rows;
    right = right < columns ? right : columns;
    int is_filled =
        part->content.triangle != SURFACE_UNKNOWN && part->content.object == OBJECT_NONE;
    int is_occluded = part->content.triangle >= 0 && !part->content.is_open &&
                      has_occlusion(search->state->scene, part->content.triangle);
    for (int row = part->row * side; row < bottom; row++)
        for (int column = part->column * side; column < right; column++) {
            int tile = view->tile_at[row * columns + column];
            if (tile < 0)
                continue;
            if (search->blur_rays) {
                blur_tile(search->state, tile, &part->content, search->blur_rays);
                continue;
            }
            /* Beams are slow to read, too: only those of tiles that need them. */
            TileContent content = part->content;
            if (search->state->plan)
                note_lights(search->state, (size_t)tile, content.proof);
            if (content.may_be_thin) {
                BeamSides sides;
                find_sides(search->state, &view->levels[0], row * columns + column, &sides);
                content.may_be_thin =
                    may_be_thin(search->state, &search->levels[part->level], &sides);
            }
            if (!is_occluded || !fill_occluded_tile(search->state, tile, &content,
                                                    &view->levels[0].beams[row * columns + column]))
                render_tile(search->state, tile, &content);
            search->num_filled += is_filled;
        }
}

/* The second pass of a moving frame draws only those parts that motion changes. */
static int is_wanted(const Search *search, const Part *part) {
    int columns = search->blur_rays ? search->state->view->levels[part->level].columns : 0;
    return !search->blur_rays ||
           search->state->plan->wanted[part->level][part->row * columns + part->column];
}

/* Memory is slow to deliver beams. */
static void fetch_beam(const BeamLevel *parts, int row, int column) {
    if (row < parts->rows && column < parts->columns) {
        const char *beam = (const char *)&parts->beams[row * parts->columns + column];
        __builtin_prefetch(beam);
        __builtin_prefetch(beam + sizeof(Beam) - 1);
    }
}

static void render_beam(Search *search, const View *view, Part part) {
    const BeamLevel *parts = &view->levels[part.level];
    if (part.row >= parts->rows || part.column >= parts->columns)
        return;
    int at = part.row * parts->columns + part.column;
    const Beam *beam = &parts->beams[at];
    if (!is_wanted(search, &part) || beam->kind == BEAM_EMPTY)
        return;
    if (beam->kind == BEAM_NARROW && (is_unproven(&part) || is_dim(search, &part))) {
        BeamSides sides;
        find_sides(search->state, parts, at, &sides);
        if (is_unproven(&part))
            prove_part(search, &sides, &part);
        if (is_dim(search, &part))
            prove_light(search, &sides, &part);
    }
    if (part.level == 0 || !(is_unproven(&part) || is_dim(search, &part))) {
        render_closed(search, view, &part);
        return;
    }
    for (int quarter = 1; quarter < 4; quarter++)
        fetch_beam(&view->levels[part.level - 1], 2 * part.row + quarter / 2,
                   2 * part.column + quarter % 2);
    for (int quarter = 0; quarter < 4; quarter++)
        render_beam(search, view,
                    (Part){part.level - 1, 2 * part.row + quarter / 2,
                           2 * part.column + quarter % 2, part.candidates, part.content,
                           part.is_hidden, part.faint});
}

void aim_search(Search *search, const FrameState *state, const CandidateList *objects,
                int64_t *blur_rays) {
    search->state = state;
    search->objects = objects;
    search->blur_rays = blur_rays;
}

int render_part(Search *search, const View *view, int part) {
    int level = BEAM_LEVELS - 1, columns = view->levels[level].columns;
    search->num_filled = 0;
    render_beam(search, view, (Part){level, part / columns, part % columns, search->objects,
                                     UNKNOWN_CONTENT, 0, 0});
    return search->num_filled;
}
