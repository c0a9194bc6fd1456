/* Provides light_map.h: proofs by the height maps that a light is seen or hidden.
 * No twin: conservative bounds. Heights of objects belong to the frame; the maps to the scene
 * (height_map.c).
 * Threads: raise_objects: the calling thread. Proofs: any. */
#include "light_map.h"

#include "height_map.h"

#include <math.h>
#include <stdlib.h>

/* A part of the image whose footprint covers more cells is left to its points. */
enum { MAX_FOOTPRINT = 64 };
/* Footprints are widened by this much of themselves: the rays between their corners bulge. */
#define BULGE 0.1f
/* Points so near a light that their heights are known to less than this part are left to rays. */
#define MAX_ERROR 0.01f

/* Extent of a part of the image, or of an object, in a map. */
typedef struct {
    MapPoint low, high;
} MapBox;

/* Maps of a light that hold 16 points, by their numbers among the light's. */
static Ints16 find_faces(const Light *light, const float points[3][BLOCK_RAYS]) {
    if (light->kind != LIGHT_POINT)
        return (Ints16){0};
    Floats16 x = load16(points[0]) - light->vector[0], y = load16(points[1]) - light->vector[1];
    Floats16 z = load16(points[2]) - light->vector[2];
    Ints16 is_x = absolute16(x) > absolute16(y);
    Floats16 along = select16(is_x, x, y);
    Ints16 is_z = ~(absolute16(along) > absolute16(z));
    along = select16(is_z, z, along);
    /* 0, 2, 4 by axis, and 1 more below the light. */
    return ((~is_z & ~is_x & 2) | (is_z & 4)) - (along < 0.0f);
}

/* NULL without one. */
static const LightMap *find_map(const FrameState *state, int light, int face) {
    const LightMaps *maps = state->scene->light_maps;
    const LightMap *map = maps ? &maps->maps[FACES * light + face] : NULL;
    return map && map->is_built ? map : NULL;
}

static void enclose(MapBox *box, MapPoint point) {
    box->low = (MapPoint){fminf(box->low.x, point.x), fminf(box->low.y, point.y),
                          fminf(box->low.height, point.height)};
    box->high = (MapPoint){fmaxf(box->high.x, point.x), fmaxf(box->high.y, point.y),
                           fmaxf(box->high.height, point.height)};
}

static MapBox empty_box(void) {
    return (MapBox){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
}

/* Whether a side of the pyramid of a point light's face separates all points from it. */
static int is_beside_face(const LightMap *map, const Vec3 *points, int count) {
    Vec3 z = scale(FACE_REACH, map->towards);
    Vec3 sides[4] = {add(z, map->x_axis), subtract(z, map->x_axis), add(z, map->y_axis),
                     subtract(z, map->y_axis)};
    for (int side = 0; side < 4 && map->is_perspective; side++) {
        int inside = 0;
        for (int i = 0; i < count; i++)
            inside += dot(sides[side], subtract(points[i], map->origin)) > -map->tolerance;
        if (!inside)
            return 1;
    }
    return 0;
}

/* Extent of a convex set around points; of all of a point light's face if the set reaches behind
 * the light. */
static MapBox enclose_points(const LightMap *map, const Vec3 *points, int count) {
    MapBox box = empty_box();
    for (int i = 0; i < count; i++) {
        float depth = dot(map->towards, subtract(points[i], map->origin));
        if (map->is_perspective && !(depth > 100.0f * map->tolerance))
            return (MapBox){{-INFINITY, -INFINITY, INFINITY}, {INFINITY, INFINITY, INFINITY}};
        enclose(&box, project(map, points[i]));
    }
    return box;
}

static void find_corners(const Pose *pose, const float *box, Vec3 corners[8]) {
    for (int i = 0; i < 8; i++) {
        Vec3 local = {box[0] + (i & 1 ? box[3] : -box[3]), box[1] + (i & 2 ? box[4] : -box[4]),
                      box[2] + (i & 4 ? box[5] : -box[5])};
        corners[i] = add(rotate(pose->rotation, local), vec3(pose->translation));
    }
}

static void raise_cells(const LightMap *map, const MapBox *box, float *heights) {
    float margin = 2.0f * lateral_tolerance(map, fminf(box->high.height, 1e6f));
    int last_row = cell_of(map, box->high.y + margin, map->top);
    int last_column = cell_of(map, box->high.x + margin, map->left);
    int first_column = cell_of(map, box->low.x - margin, map->left);
    for (int row = cell_of(map, box->low.y - margin, map->top); row <= last_row; row++)
        for (int column = first_column; column <= last_column; column++) {
            float *height = heights + row * map->side + column;
            *height = fmaxf(*height, box->high.height);
        }
}

/* A box of an object, over all its poses: between two of them its corners move in straight
 * lines. */
static void raise_box(const FrameState *state, const LightMap *map, int at, float *heights) {
    const Frame *frame = state->frame;
    const Pose *poses = frame->object_poses + frame->box_object[at];
    int last = frame->num_poses > 1 ? frame->num_poses - 1 : 1;
    for (int step = 0; step < last; step++) {
        int next = step + 1 < frame->num_poses ? step + 1 : step;
        Vec3 corners[16];
        find_corners(poses + step * frame->num_objects, frame->boxes + 6 * at, corners);
        find_corners(poses + next * frame->num_objects, frame->boxes + 6 * at, corners + 8);
        if (is_beside_face(map, corners, 16))
            continue;
        MapBox box = enclose_points(map, corners, 16);
        raise_cells(map, &box, heights + map->first_cell);
    }
}

float *raise_objects(const FrameState *state, int *failed) {
    const Frame *frame = state->frame;
    const LightMaps *maps = state->scene->light_maps;
    if (!frame->has_shadows || !frame->num_objects || !maps)
        return NULL;
    float *heights = malloc(sizeof(float) * (maps->num_cells + 1));
    *failed = !heights;
    for (size_t i = 0; heights && i < maps->num_cells; i++)
        heights[i] = -INFINITY;
    for (int i = 0; heights && i < FACES * state->scene->num_lights; i++)
        for (int box = 0; maps->maps[i].is_built && box < frame->num_boxes; box++)
            raise_box(state, &maps->maps[i], box, heights);
    return heights;
}

/* What is known between two heights, with their tolerances. */
static int find_in_cell(const FrameState *state, const LightMap *map, int cell, int32_t surface,
                        float low, float high) {
    const MapCell *entry = &map->cells[cell];
    if (entry->cover > high)
        return LIGHT_HIDDEN;
    float others = entry->surface == surface ? entry->second : entry->height;
    if (!(others < low))
        return LIGHT_UNKNOWN;
    int is_behind = state->object_heights &&
                    !(state->object_heights[map->first_cell + (size_t)cell] < low);
    return is_behind ? LIGHT_BEHIND_OBJECTS : LIGHT_SEEN;
}

static int is_precise(const LightMap *map, float height) {
    return height_tolerance(map, height) < MAX_ERROR * fabsf(height) || !map->is_perspective;
}

/* Columns or rows of 16 coordinates. */
static Ints16 cells_of(const LightMap *map, Floats16 coordinate, float first) {
    Floats16 cell = (coordinate - first) * map->cells_per_metre;
    Floats16 last = splat16((float)(map->side - 1));
    cell = select16(cell > 0.0f, least16(cell, last), splat16(0.0f));
    return __builtin_convertvector(cell, Ints16);
}

/* Look up some of 16 points in a map; those of which it says nothing stay unknown. */
static void look_up_points(const FrameState *state, const LightMap *map, const HitBlock *hits,
                           const float points[3][BLOCK_RAYS], uint32_t rays, Uncertainty *found) {
    Vec3 o = map->origin, a = map->x_axis, b = map->y_axis, c = map->towards;
    Floats16 px = load16(points[0]) - o.x, py = load16(points[1]) - o.y;
    Floats16 pz = load16(points[2]) - o.z;
    Floats16 x = a.x * px + a.y * py + a.z * pz, y = b.x * px + b.y * py + b.z * pz;
    Floats16 height = c.x * px + c.y * py + c.z * pz, tolerance = splat16(map->tolerance);
    if (map->is_perspective) {
        height = 1.0f / height;
        x *= height;
        y *= height;
        tolerance = map->tolerance * height * height;
        rays &= bits16(tolerance < MAX_ERROR * absolute16(height));
    }
    int32_t cells[BLOCK_RAYS], surfaces[BLOCK_RAYS], above[BLOCK_RAYS];
    float covers[BLOCK_RAYS], heights[BLOCK_RAYS], seconds[BLOCK_RAYS], objects[BLOCK_RAYS];
    const float *object_heights = state->object_heights ? state->object_heights + map->first_cell
                                                        : NULL;
    store_ints16(cells_of(map, y, map->top) * map->side + cells_of(map, x, map->left), cells);
    /* Without a branch: neighbours agree too seldom for one to be foreseen. */
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        const MapCell *cell = &map->cells[cells[lane]];
        covers[lane] = cell->cover;
        heights[lane] = cell->height;
        seconds[lane] = cell->second;
        above[lane] = cell->surface;
        objects[lane] = object_heights ? object_heights[cells[lane]] : -INFINITY;
        surfaces[lane] = rays >> lane & 1 && hits->object[lane] == OBJECT_STATIC
                             ? state->scene->surfaces.surface[hits->triangle[lane]]
                             : -2;
    }
    Floats16 low = height - 2.0f * tolerance, high = height + 2.0f * tolerance;
    uint32_t hidden = bits16(load16(covers) > high) & rays;
    Ints16 is_own = load_ints16(above) == load_ints16(surfaces);
    Floats16 others = select16(is_own, load16(seconds), load16(heights));
    uint32_t seen = bits16(others < low) & rays & ~hidden;
    found->hidden |= hidden;
    found->unknown &= ~(hidden | seen);
    found->behind_objects &= ~(rays & (hidden | bits16(load16(objects) < low)));
}

Uncertainty find_light(const FrameState *state, int light, const HitBlock *hits,
                       const float points[3][BLOCK_RAYS], uint32_t rays) {
    Uncertainty found = {0, rays, rays};
    Ints16 faces = find_faces(&state->scene->lights[light], points);
    for (uint32_t left = rays, same; left; left &= ~same) {
        int face = faces[__builtin_ctz(left)];
        const LightMap *map = find_map(state, light, face);
        same = bits16(faces == face) & left;
        if (map)
            look_up_points(state, map, hits, points, same, &found);
    }
    return found;
}

/* What all cells of a box agree on. */
static int find_in_box(const FrameState *state, const LightMap *map, int32_t surface,
                       const MapBox *box) {
    int top = cell_of(map, box->low.y, map->top), bottom = cell_of(map, box->high.y, map->top);
    int left = cell_of(map, box->low.x, map->left), right = cell_of(map, box->high.x, map->left);
    float tolerance = 2.0f * height_tolerance(map, box->high.height);
    float low = box->low.height - tolerance, high = box->high.height + tolerance;
    if ((bottom - top + 1) * (right - left + 1) > MAX_FOOTPRINT)
        return LIGHT_UNKNOWN;
    int found = find_in_cell(state, map, top * map->side + left, surface, low, high);
    for (int row = top; row <= bottom && found; row++)
        for (int column = left; column <= right && found; column++)
            if (find_in_cell(state, map, row * map->side + column, surface, low, high) != found)
                found = LIGHT_UNKNOWN;
    return found;
}

/* Whether a part of the image lies on the map, and in front of a point light. */
static int is_on_map(const LightMap *map, const MapBox *box) {
    float reach = FACE_REACH;
    return !map->is_perspective ||
           (box->low.height > 0.0f && box->low.x > -reach && box->low.y > -reach &&
            box->high.x < reach && box->high.y < reach && is_precise(map, box->high.height));
}

static int find_in_quad(const FrameState *state, int light, int32_t surface,
                        const Vec3 corners[4]) {
    Vec3 middle = scale(0.25f, add(add(corners[0], corners[1]), add(corners[2], corners[3])));
    const float point[3][BLOCK_RAYS] = {{middle.x}, {middle.y}, {middle.z}};
    const LightMap *map =
        find_map(state, light, find_faces(&state->scene->lights[light], point)[0]);
    if (!map)
        return LIGHT_UNKNOWN;
    MapBox box = empty_box();
    for (int i = 0; i < 4; i++) {
        /* Behind a point light, heights are negative. */
        MapPoint point = project(map, corners[i]);
        if (!(isfinite(point.x) && isfinite(point.y) && isfinite(point.height)))
            return LIGHT_UNKNOWN;
        enclose(&box, point);
    }
    float margin = lateral_tolerance(map, box.high.height);
    float x = BULGE * (box.high.x - box.low.x) + margin;
    float y = BULGE * (box.high.y - box.low.y) + margin;
    float height = BULGE * (box.high.height - box.low.height);
    MapBox widened = {{box.low.x - x, box.low.y - y, box.low.height - height},
                      {box.high.x + x, box.high.y + y, box.high.height + height}};
    return is_on_map(map, &widened) ? find_in_box(state, map, surface, &widened) : LIGHT_UNKNOWN;
}

float find_incidence(const FrameState *state, const Light *light, int32_t triangle) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    Vec3 normal = vec3(mesh->normals + 3 * (size_t)triangle), towards = vec3(light->vector);
    if (light->kind == LIGHT_POINT)
        towards = subtract(towards, plane_point(state, triangle));
    return light->lights_scene ? dot(normal, towards) : 0.0f;
}

int are_lights_known(const FrameState *state, int32_t triangle, LightProof *proof) {
    uint32_t shining = 0;
    for (int light = 0; light < state->scene->num_lights && light < 32; light++)
        /* What is turned away from a light is dark without a proof. */
        if (find_incidence(state, &state->scene->lights[light], triangle) > 0.0f)
            shining |= 1u << light;
    *proof = (LightProof){shining & state->known.seen, shining & state->known.hidden};
    return !(shining & ~(proof->seen | proof->hidden)) && state->scene->num_lights <= 32;
}

LightProof prove_lights(const FrameState *state, int32_t triangle, const Vec3 corners[4],
                         uint32_t others) {
    LightProof proof;
    if (are_lights_known(state, triangle, &proof) || !state->scene->light_maps)
        return proof;
    for (int light = 0; light < state->scene->num_lights && light < 32; light++) {
        uint32_t bit = 1u << light;
        if ((proof.seen | proof.hidden | others) & bit ||
            !(find_incidence(state, &state->scene->lights[light], triangle) > 0.0f))
            continue;
        int found = find_in_quad(state, light, state->scene->surfaces.surface[triangle], corners);
        proof.seen |= found == LIGHT_SEEN ? bit : 0;
        proof.hidden |= found == LIGHT_HIDDEN ? bit : 0;
    }
    return proof;
}
