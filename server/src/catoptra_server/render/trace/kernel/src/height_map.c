/* Construction of the height maps: every cell holds the highest casters that reach into it. */
#include "height_map.h"

#include "device.h"

#include <math.h>
#include <stdlib.h>

/* Heights and cells are known to this, relative to the extent: float32 rounds each to 6e-8, and
 * they are sums of three products. */
#define TOLERANCE 1e-6f

static int32_t *number_surfaces(const Scene *scene) {
    const Surfaces *surfaces = &scene->surfaces;
    int32_t count = scene->mesh->arrays.num_triangles;
    int32_t *surface_of = malloc(sizeof(int32_t) * (size_t)(count + 1));
    for (int32_t i = 0; surface_of && i < count; i++)
        surface_of[i] = surfaces->num_surfaces + i;
    for (int32_t i = 0; surface_of && i < surfaces->num_triangles; i++)
        surface_of[surfaces->triangles[i]] = surfaces->surface[i];
    return surface_of;
}

static void set_axes(LightMap *map, const Light *light) {
    map->towards = vec3(light->vector);
    Vec3 other = fabsf(map->towards.x) < 0.7f ? (Vec3){1, 0, 0} : (Vec3){0, 1, 0};
    Vec3 x_axis = cross(map->towards, other);
    map->x_axis = scale(1.0f / sqrtf(dot(x_axis, x_axis)), x_axis);
    map->y_axis = cross(map->towards, map->x_axis);
}

static void set_extent(LightMap *map, const MeshArrays *mesh) {
    float low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY}, extent = 0.0f;
    for (size_t i = 0; i < 3 * (size_t)mesh->num_triangles; i++) {
        Vec3 corner = vec3(mesh->corners + 3 * i);
        MapPoint point = project(map, corner);
        low[0] = fminf(low[0], point.x);
        low[1] = fminf(low[1], point.y);
        high[0] = fmaxf(high[0], point.x);
        high[1] = fmaxf(high[1], point.y);
        extent = fmaxf(extent, max_abs(corner));
    }
    map->tolerance = TOLERANCE * extent;
    map->left = low[0] - map->tolerance;
    map->top = low[1] - map->tolerance;
    float side = fmaxf(high[0] - low[0], high[1] - low[1]) + 2.0f * map->tolerance;
    map->cell_side = fmaxf(side / MAP_SIDE, 1e-6f);
    map->cells_per_metre = 1.0f / map->cell_side;
}

static void insert(MapCell *cell, int32_t surface, float height) {
    if (surface == cell->surface) {
        cell->height = fmaxf(cell->height, height);
    } else if (height > cell->height) {
        cell->second = cell->height;
        cell->height = height;
        cell->surface = surface;
    } else {
        cell->second = fmaxf(cell->second, height);
    }
}

/* A caster in a map: its corners, and its plane as height = at_origin + x slope + y slope. */
typedef struct {
    MapPoint corners[3];
    float at_origin, x_slope, y_slope;
    float highest;
    int is_steep; /* along the light: its plane has no height */
} Caster;

static Caster project_caster(const LightMap *map, const float *corners) {
    Caster caster;
    for (int i = 0; i < 3; i++)
        caster.corners[i] = project(map, vec3(corners + 3 * i));
    MapPoint a = caster.corners[0], b = caster.corners[1], c = caster.corners[2];
    caster.highest = fmaxf(a.height, fmaxf(b.height, c.height));
    float bx = b.x - a.x, by = b.y - a.y, cx = c.x - a.x, cy = c.y - a.y;
    float area = bx * cy - by * cx, longest = fmaxf(bx * bx + by * by, cx * cx + cy * cy);
    /* Below a slope of a thousand a cell's height is known to a tenth of a per cent. */
    caster.is_steep = fabsf(area) < 1e-3f * longest;
    if (!caster.is_steep) {
        float bh = b.height - a.height, ch = c.height - a.height;
        caster.x_slope = (bh * cy - ch * by) / area;
        caster.y_slope = (ch * bx - bh * cx) / area;
        caster.at_origin = a.height - caster.x_slope * a.x - caster.y_slope * a.y;
    }
    return caster;
}

/* Whether a line through two corners separates the third from a cell around (x, y). */
static int is_beside_cell(const Caster *caster, float x, float y, float half) {
    for (int i = 0; i < 3; i++) {
        MapPoint from = caster->corners[i], to = caster->corners[(i + 1) % 3];
        MapPoint third = caster->corners[(i + 2) % 3];
        float nx = from.y - to.y, ny = to.x - from.x;
        float inner = nx * (third.x - from.x) + ny * (third.y - from.y);
        float sign = inner < 0.0f ? -1.0f : 1.0f;
        float centre = sign * (nx * (x - from.x) + ny * (y - from.y));
        if (inner != 0.0f && centre + half * (fabsf(nx) + fabsf(ny)) < 0.0f)
            return 1;
    }
    return 0;
}

static float highest_in_cell(const LightMap *map, const Caster *caster, float x, float y,
                             float half) {
    if (caster->is_steep)
        return caster->highest;
    float height = caster->at_origin + caster->x_slope * x + caster->y_slope * y +
                   half * (fabsf(caster->x_slope) + fabsf(caster->y_slope)) + map->tolerance;
    return fminf(height, caster->highest);
}

static void add_caster(LightMap *map, const float *corners, int32_t surface) {
    Caster caster = project_caster(map, corners);
    const MapPoint *p = caster.corners;
    float margin = map->tolerance, half = 0.5f * map->cell_side + margin;
    float left = fminf(p[0].x, fminf(p[1].x, p[2].x)), right = fmaxf(p[0].x, fmaxf(p[1].x, p[2].x));
    float top = fminf(p[0].y, fminf(p[1].y, p[2].y)), bottom = fmaxf(p[0].y, fmaxf(p[1].y, p[2].y));
    int last_row = cell_of(bottom + margin, map->top, map->cells_per_metre);
    int last_column = cell_of(right + margin, map->left, map->cells_per_metre);
    int first_column = cell_of(left - margin, map->left, map->cells_per_metre);
    for (int row = cell_of(top - margin, map->top, map->cells_per_metre); row <= last_row; row++)
        for (int column = first_column; column <= last_column; column++) {
            float x = map->left + ((float)column + 0.5f) * map->cell_side;
            float y = map->top + ((float)row + 0.5f) * map->cell_side;
            if (!is_beside_cell(&caster, x, y, half))
                insert(&map->cells[row * MAP_SIDE + column], surface,
                       highest_in_cell(map, &caster, x, y, half));
        }
}

static void build_map(LightMap *map, const Scene *scene, const Light *light,
                      const int32_t *surface_of) {
    const MeshArrays *casters =
        scene->casters ? &scene->casters->arrays : &scene->mesh->arrays;
    map->cells = malloc(sizeof(MapCell) * MAP_CELLS);
    if (!map->cells)
        return;
    set_axes(map, light);
    set_extent(map, &scene->mesh->arrays);
    for (int i = 0; i < MAP_CELLS; i++)
        map->cells[i] = (MapCell){-INFINITY, -INFINITY, -1};
    for (int32_t i = 0; i < casters->num_triangles; i++) {
        int32_t triangle = scene->caster_triangles ? scene->caster_triangles[i] : i;
        add_caster(map, casters->corners + 9 * (size_t)i, surface_of[triangle]);
    }
    map->is_built = 1;
}

void *catoptra_build_light_maps(const Scene *scene) {
    size_t count = (size_t)scene->num_lights;
    LightMaps *maps = calloc(1, sizeof *maps + count * sizeof(LightMap));
    if (!maps)
        return NULL;
    maps->surface_of = number_surfaces(scene);
    if (!maps->surface_of) {
        free(maps);
        return NULL;
    }
    for (int light = 0; light < scene->num_lights; light++)
        if (scene->lights[light].kind == LIGHT_DIRECTIONAL && scene->mesh->arrays.num_triangles)
            build_map(&maps->maps[light], scene, &scene->lights[light], maps->surface_of);
    return maps;
}

void catoptra_release_light_maps(void *light_maps, int32_t num_lights) {
    LightMaps *maps = light_maps;
    for (int32_t light = 0; maps && light < num_lights; light++)
        free(maps->maps[light].cells);
    if (maps)
        free(maps->surface_of);
    free(maps);
}
