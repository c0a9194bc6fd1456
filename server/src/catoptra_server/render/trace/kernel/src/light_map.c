/* Provides light_map.h: proofs by the height maps that a light is seen or hidden.
 * No twin: conservative bounds. Heights of objects belong to the frame; the maps to the scene
 * (height_map.c).
 * Threads: raise_objects: the calling thread. Proofs: any. */
#include "light_map.h"

#include "direct_light.h"
#include "height_map.h"

#include <math.h>
#include <stdlib.h>

/* A part of the image whose footprint covers more cells is left to its points. */
enum { MAX_FOOTPRINT = 64 };
/* Footprints are widened by this much of themselves: the rays between their corners bulge. */
#define BULGE 0.1f
/* Points so near a light that their heights are known to less than this part are left to rays. */
#define MAX_ERROR 0.01f
/* Triangles flatter along a directional light, radians, are left to rays: a hundred roundings. */
#define MIN_SLOPE 1e-5f

/* Extent of a part of the image, or of an object, in a map. */
typedef struct {
    MapPoint low, high;
} MapBox;

/* The map that holds a point; NULL without one. */
static const LightMap *map_at(const FrameState *state, int light, Vec3 point) {
    const LightMaps *maps = state->scene->light_maps;
    if (!maps)
        return NULL;
    const LightMap *map = &maps->maps[FACES * light];
    if (state->scene->lights[light].kind == LIGHT_POINT) {
        Vec3 p = subtract(point, vec3(state->scene->lights[light].vector)), size = absolute(p);
        float parts[3] = {p.x, p.y, p.z};
        int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
        map += 2 * axis + (parts[axis] < 0.0f);
    }
    return map->is_built ? map : NULL;
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

/* The sum of a vector's sizes along the axes: no less than its length. */
static float sum_abs(Vec3 a) { return fabsf(a.x) + fabsf(a.y) + fabsf(a.z); }

/* Whether one plane separates a triangle from the way of light to all of a quadrangle: its own, or
 * one through the light and an edge, by more than a shadow ray may differ in position and
 * direction. */
static int is_triangle_beside(const LightMap *map, const float *triangle, const Vec3 quad[4]) {
    float tolerance = 2.0f * map->tolerance;
    Vec3 corners[3], edges[3], points[4];
    for (int i = 0; i < 3; i++)
        corners[i] = subtract(vec3(triangle + 3 * i), map->origin);
    for (int i = 0; i < 3; i++)
        edges[i] = subtract(corners[(i + 1) % 3], corners[i]);
    for (int i = 0; i < 4; i++)
        points[i] = subtract(quad[i], map->origin);
    Vec3 normal = cross(edges[0], edges[1]);
    float height = map->is_perspective ? -dot(normal, corners[0]) : dot(normal, map->towards);
    float area = sum_abs(edges[0]) * sum_abs(edges[1]), reserve = tolerance * area;
    if (!(fabsf(height) > (map->is_perspective ? reserve : MIN_SLOPE * area)))
        return 0;
    float sign = height < 0.0f ? -1.0f : 1.0f;
    int before = 0;
    for (int i = 0; i < 4; i++)
        before += sign * dot(normal, subtract(points[i], corners[0])) > reserve;
    for (int edge = 0; edge < 3 && before < 4; edge++) {
        Vec3 from = corners[edge], to = corners[(edge + 1) % 3];
        Vec3 inward = map->is_perspective ? cross(to, from) : cross(map->towards, edges[edge]);
        float size = sum_abs(inward), length = sum_abs(edges[edge]);
        int outside = 0;
        for (int i = 0; i < 4; i++) {
            Vec3 at = map->is_perspective ? points[i] : subtract(points[i], from);
            float error = map->is_perspective ? sum_abs(at) * (length + sum_abs(from)) : length;
            outside += sign * dot(inward, at) < -tolerance * (size + error);
        }
        before = outside == 4 ? 4 : before;
    }
    return before == 4;
}

/* Whether a quadrangle sees a light past all casters on a cell's list. */
static int is_cell_beside(const FrameState *state, const LightMap *map, int cell, int32_t surface,
                          const Vec3 quad[4]) {
    const Scene *scene = state->scene;
    const float *corners = (scene->casters ? scene->casters : scene->mesh)->arrays.corners;
    /* Casters have the scene's coordinates. */
    if (!map->casters || has_origin(state))
        return 0;
    for (int32_t at = map->first[cell]; at >= 0; at = map->casters[at].next) {
        int32_t number = map->casters[at].caster;
        int32_t triangle = scene->caster_triangles ? scene->caster_triangles[number] : number;
        if (scene->surfaces.surface[triangle] != surface &&
            !is_triangle_beside(map, corners + 9 * (size_t)number, quad))
            return 0;
    }
    return 1;
}

/* What is known of a box in one cell, or of a quadrangle in it; NULL: of the box. */
static int find_in_cell(const FrameState *state, const LightMap *map, int cell, int32_t surface,
                        const MapBox *box, const Vec3 *quad) {
    const MapCell *entry = &map->cells[cell];
    float low = box->low.height - 2.0f * height_tolerance(map, box->high.height);
    float high = box->high.height + 2.0f * height_tolerance(map, box->high.height);
    if (entry->cover > high)
        return LIGHT_HIDDEN;
    float others = entry->surface == surface ? entry->second : entry->height;
    if (!(others < low) && !(quad && is_cell_beside(state, map, cell, surface, quad)))
        return LIGHT_UNKNOWN;
    int is_behind = state->object_heights &&
                    !(state->object_heights[map->first_cell + (size_t)cell] < low);
    return is_behind ? LIGHT_BEHIND_OBJECTS : LIGHT_SEEN;
}

static int is_precise(const LightMap *map, float height) {
    return height_tolerance(map, height) < MAX_ERROR * fabsf(height) || !map->is_perspective;
}

/* Points on a map, whose places of others mean nothing. */
typedef struct {
    float x[BLOCK_RAYS], y[BLOCK_RAYS], height[BLOCK_RAYS];
    int32_t cell[BLOCK_RAYS], is_known[BLOCK_RAYS]; /* their heights are precise */
} MapPoints;

/* Vector code: one division for 16 points. */
static void place_points(const LightMap *map, const float position[3][BLOCK_RAYS],
                         MapPoints *points, int32_t is_on_face[BLOCK_RAYS]) {
    Vec3 x = map->x_axis, y = map->y_axis, z = map->towards;
    int is_flat = !map->is_perspective;
    for (int i = 0; i < BLOCK_RAYS; i++) {
        Vec3 p = {position[0][i] - map->origin.x, position[1][i] - map->origin.y,
                  position[2][i] - map->origin.z};
        float across = dot(x, p), down = dot(y, p), depth = dot(z, p), inverse = 1.0f / depth;
        is_on_face[i] = is_flat | ((fabsf(across) <= depth) & (fabsf(down) <= depth));
        float height = is_flat ? depth : inverse, factor = is_flat ? 1.0f : inverse;
        points->x[i] = across * factor;
        points->y[i] = down * factor;
        points->height[i] = height;
        points->is_known[i] =
            is_flat | (map->tolerance * height * height < MAX_ERROR * fabsf(height));
        points->cell[i] = cell_of(map, points->y[i], map->top) * map->side +
                          cell_of(map, points->x[i], map->left);
    }
}

/* What a map says of those of the lanes that lie on it, the first of them in any case. */
static uint32_t find_on_map(const FrameState *state, const LightMap *map,
                            const int32_t surface[BLOCK_RAYS],
                            const float position[3][BLOCK_RAYS], uint32_t lanes,
                            LightViews *found) {
    MapPoints points;
    int32_t is_on_face[BLOCK_RAYS];
    uint32_t done = 0;
    place_points(map, position, &points, is_on_face);
    for (uint32_t left = lanes; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        if (!is_on_face[lane] && lane != __builtin_ctz(lanes))
            continue;
        done |= 1u << lane;
        MapPoint at = {points.x[lane], points.y[lane], points.height[lane]};
        MapBox box = {at, at};
        int known = points.is_known[lane]
                        ? find_in_cell(state, map, points.cell[lane], surface[lane], &box, NULL)
                        : LIGHT_UNKNOWN;
        found->hidden |= (uint32_t)(known == LIGHT_HIDDEN) << lane;
        found->unknown |= (uint32_t)(known == LIGHT_UNKNOWN) << lane;
        found->behind_objects |= (uint32_t)(known == LIGHT_BEHIND_OBJECTS) << lane;
    }
    return done;
}

LightViews find_light(const FrameState *state, int light, const HitBlock *hits,
                      const float position[3][BLOCK_RAYS], uint32_t lanes) {
    LightViews found = {0, 0, 0};
    int32_t surface[BLOCK_RAYS];
    for (uint32_t left = lanes; left; left &= left - 1) {
        int lane = __builtin_ctz(left), is_static = hits->object[lane] == OBJECT_STATIC;
        surface[lane] = is_static ? state->scene->surfaces.surface[hits->triangle[lane]] : -2;
    }
    while (lanes) {
        const LightMap *map = map_at(state, light, get_lane(position, __builtin_ctz(lanes)));
        uint32_t done = 1u << __builtin_ctz(lanes);
        if (map)
            done = find_on_map(state, map, surface, position, lanes, &found);
        else
            found.unknown |= done;
        lanes &= ~done;
    }
    return found;
}

/* What all cells of a box agree on. */
static int find_in_box(const FrameState *state, const LightMap *map, int32_t surface,
                       const MapBox *box, const Vec3 quad[4]) {
    int top = cell_of(map, box->low.y, map->top), bottom = cell_of(map, box->high.y, map->top);
    int left = cell_of(map, box->low.x, map->left), right = cell_of(map, box->high.x, map->left);
    if ((bottom - top + 1) * (right - left + 1) > MAX_FOOTPRINT)
        return LIGHT_UNKNOWN;
    int found = find_in_cell(state, map, top * map->side + left, surface, box, quad);
    for (int row = top; row <= bottom && found; row++)
        for (int column = left; column <= right && found; column++)
            if (find_in_cell(state, map, row * map->side + column, surface, box, quad) != found)
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

/* Whether nobody misses a lamp's light on a facet, as near as this inverse depth: a guess, for
 * proofs that rays would not need. */
static int is_dim(const FrameState *state, const Light *light, int32_t triangle, float inverse) {
    const float *ambient = state->scene->ambient_radiance + 3 * (size_t)triangle;
    const float *albedo = state->scene->mesh->arrays.albedo + 3 * (size_t)triangle;
    int is_seen = light->kind != LIGHT_POINT || !leaves_unseen(state);
    for (int i = 0; i < 3 && !is_seen; i++)
        is_seen = albedo[i] * light->intensity[i] * inverse * inverse >
                  unseen_light(state, ambient[i]);
    return !is_seen;
}

static int find_in_quad(const FrameState *state, int light, int32_t triangle,
                        const Vec3 corners[4]) {
    int32_t surface = state->scene->surfaces.surface[triangle];
    Vec3 middle = scale(0.25f, add(add(corners[0], corners[1]), add(corners[2], corners[3])));
    const LightMap *map = map_at(state, light, middle);
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
    Vec3 wide[4];
    for (int i = 0; i < 4; i++)
        wide[i] = add(corners[i], scale(2.0f * BULGE, subtract(corners[i], middle)));
    if (!is_on_map(map, &widened))
        return LIGHT_UNKNOWN;
    int is_listed = !is_dim(state, &state->scene->lights[light], triangle, box.high.height);
    return find_in_box(state, map, surface, &widened, is_listed ? wide : NULL);
}

float find_incidence(const FrameState *state, const Light *light, int32_t triangle) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    Vec3 normal = vec3(mesh->normals + 3 * (size_t)triangle), towards = vec3(light->vector);
    if (light->kind == LIGHT_POINT)
        towards = subtract(towards, plane_point(state, triangle));
    return light->lights_scene ? dot(normal, towards) : 0.0f;
}

LightProof prove_lights(const FrameState *state, int32_t triangle, const Vec3 corners[4]) {
    const LightMaps *maps = state->scene->light_maps;
    LightProof proof = {0, 0};
    int count = maps ? state->scene->num_lights : 0;
    for (int light = 0; light < count && light < 32; light++) {
        /* What is turned away from a light is dark without a proof. */
        if (!(find_incidence(state, &state->scene->lights[light], triangle) > 0.0f))
            continue;
        int found = find_in_quad(state, light, triangle, corners);
        proof.seen |= (uint32_t)(found == LIGHT_SEEN) << light;
        proof.hidden |= (uint32_t)(found == LIGHT_HIDDEN) << light;
    }
    return proof;
}
