#include "light_map.h"

#include "height_map.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A part of the image whose footprint covers more cells is left to its points. */
enum { MAX_FOOTPRINT = 64 };
/* Footprints are widened by this much of themselves: the rays between their corners bulge. */
#define BULGE 0.1f

static const LightMap *map_of(const FrameState *state, int light) {
    const LightMaps *maps = state->scene->light_maps;
    return maps && maps->maps[light].is_built ? &maps->maps[light] : NULL;
}

static void mark_object(const LightMap *map, Vec3 centre, float radius, uint8_t *marks) {
    MapPoint point = project(map, centre);
    float reach = radius + map->tolerance;
    int last_row = cell_of(point.y + reach, map->top, map->cells_per_metre);
    int last_column = cell_of(point.x + reach, map->left, map->cells_per_metre);
    int first_column = cell_of(point.x - reach, map->left, map->cells_per_metre);
    for (int row = cell_of(point.y - reach, map->top, map->cells_per_metre); row <= last_row; row++)
        memset(marks + row * MAP_SIDE + first_column, 1, (size_t)(last_column - first_column + 1));
}

/* Sphere around a box of an object, over all poses of the object. */
static void mark_poses(const FrameState *state, const LightMap *map, int at, uint8_t *marks) {
    const Frame *frame = state->frame;
    const float *box = frame->boxes + 6 * at;
    int32_t object = frame->box_object[at];
    float radius = sqrtf(dot(vec3(box + 3), vec3(box + 3)));
    for (int step = 0; step < frame->num_poses; step++) {
        const Pose *pose = frame->object_poses + step * frame->num_objects + object;
        Vec3 centre = add(rotate(pose->rotation, vec3(box)), vec3(pose->translation));
        mark_object(map, centre, radius, marks);
    }
}

uint8_t *mark_objects(const FrameState *state, int *failed) {
    const Frame *frame = state->frame;
    if (!frame->has_shadows || !frame->num_objects || !state->scene->light_maps)
        return NULL;
    uint8_t *marks = calloc((size_t)state->scene->num_lights, MAP_CELLS);
    *failed = !marks;
    for (int light = 0; marks && light < state->scene->num_lights; light++)
        for (int box = 0; map_of(state, light) && box < frame->num_boxes; box++)
            mark_poses(state, map_of(state, light), box, marks + (size_t)light * MAP_CELLS);
    return marks;
}

static int is_cell_lit(const FrameState *state, const LightMap *map, int light, int cell,
                       int32_t surface, float height) {
    if (state->object_marks && state->object_marks[(size_t)light * MAP_CELLS + (size_t)cell])
        return 0;
    const MapCell *entry = &map->cells[cell];
    float others = entry->surface == surface ? entry->second : entry->height;
    return others < height - map->tolerance;
}

int is_lit_by_map(const FrameState *state, int light, int32_t triangle, Vec3 point) {
    const LightMap *map = map_of(state, light);
    /* Objects that move during the exposure pass between the cells of their poses. */
    if (!map || (state->frame->num_poses > 1 && state->frame->num_objects))
        return 0;
    const LightMaps *maps = state->scene->light_maps;
    MapPoint at = project(map, point);
    int cell = cell_of(at.y, map->top, map->cells_per_metre) * MAP_SIDE +
               cell_of(at.x, map->left, map->cells_per_metre);
    return is_cell_lit(state, map, light, cell, maps->surface_of[triangle], at.height);
}

static int is_box_lit(const FrameState *state, int light, int32_t surface, const MapPoint *low,
                      const MapPoint *high) {
    const LightMap *map = map_of(state, light);
    int top = cell_of(low->y, map->top, map->cells_per_metre);
    int bottom = cell_of(high->y, map->top, map->cells_per_metre);
    int left = cell_of(low->x, map->left, map->cells_per_metre);
    int right = cell_of(high->x, map->left, map->cells_per_metre);
    if ((bottom - top + 1) * (right - left + 1) > MAX_FOOTPRINT)
        return 0;
    for (int row = top; row <= bottom; row++)
        for (int column = left; column <= right; column++)
            if (!is_cell_lit(state, map, light, row * MAP_SIDE + column, surface, low->height))
                return 0;
    return 1;
}

static int is_quad_lit_by(const FrameState *state, int light, int32_t surface,
                          const Vec3 corners[4]) {
    const LightMap *map = map_of(state, light);
    if (!map)
        return 0;
    MapPoint low = project(map, corners[0]), high = low;
    for (int i = 1; i < 4; i++) {
        MapPoint point = project(map, corners[i]);
        low = (MapPoint){fminf(low.x, point.x), fminf(low.y, point.y),
                         fminf(low.height, point.height)};
        high = (MapPoint){fmaxf(high.x, point.x), fmaxf(high.y, point.y),
                          fmaxf(high.height, point.height)};
    }
    float x = BULGE * (high.x - low.x) + map->tolerance;
    float y = BULGE * (high.y - low.y) + map->tolerance;
    low = (MapPoint){low.x - x, low.y - y, low.height - BULGE * (high.height - low.height)};
    high = (MapPoint){high.x + x, high.y + y, high.height};
    return is_box_lit(state, light, surface, &low, &high);
}

int is_quad_lit(const FrameState *state, int32_t triangle, const Vec3 corners[4]) {
    const LightMaps *maps = state->scene->light_maps;
    if (!maps || state->has_point_lights || state->frame->num_poses > 1)
        return 0;
    Vec3 normal = vec3(state->scene->mesh->arrays.normals + 3 * (size_t)triangle);
    for (int light = 0; light < state->scene->num_lights; light++) {
        const Light *source = &state->scene->lights[light];
        /* A facet turned away is dark with and without occluders. */
        int shines = source->kind == LIGHT_DIRECTIONAL && source->lights_scene &&
                     dot(normal, vec3(source->vector)) > 0.0f;
        if (shines && !is_quad_lit_by(state, light, maps->surface_of[triangle], corners))
            return 0;
    }
    return 1;
}
