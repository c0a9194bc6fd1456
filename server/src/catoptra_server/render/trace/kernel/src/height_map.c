/* Provides catoptra_build_light_maps: every cell holds the highest casters that reach into it.
 * No twin: conservative bounds. The maps own their cells until catoptra_release_light_maps.
 * Threads: the calling thread, at the first frame with shadows; only read afterwards. */
#include "height_map.h"

#include "device.h"

#include <math.h>
#include <stdlib.h>

/* Heights and cells are known to this, relative to the extent: float32 rounds each to 6e-8, and
 * they are sums of three products; shadow rays begin 4e-6 of the extent beside their points. */
#define TOLERANCE 6e-6f

static void set_axes(LightMap *map, Vec3 towards) {
    map->towards = towards;
    Vec3 other = fabsf(map->towards.x) < 0.7f ? (Vec3){1, 0, 0} : (Vec3){0, 1, 0};
    Vec3 x_axis = cross(map->towards, other);
    map->x_axis = scale(1.0f / sqrtf(dot(x_axis, x_axis)), x_axis);
    map->y_axis = cross(map->towards, map->x_axis);
}

static float find_extent(const MeshArrays *mesh, Vec3 origin) {
    float extent = max_abs(origin);
    for (size_t i = 0; i < 3 * (size_t)mesh->num_triangles; i++)
        extent = fmaxf(extent, max_abs(vec3(mesh->corners + 3 * i)));
    return extent;
}

static void set_cells(LightMap *map, float side) {
    map->cell_side = fmaxf(side / (float)map->side, 1e-6f);
    map->cells_per_metre = 1.0f / map->cell_side;
}

/* The range of a coordinate without its outermost parts, which few corners are in. */
static void narrow(const LightMap *map, const MeshArrays *mesh, int is_y, float *low, float *high) {
    enum { PARTS = 256 };
    int32_t corners[PARTS] = {0}, most = 3 * mesh->num_triangles / 32;
    float first = *low, part = fmaxf((*high - first) / PARTS, 1e-6f);
    for (size_t i = 0; i < 3 * (size_t)mesh->num_triangles; i++) {
        MapPoint point = project(map, vec3(mesh->corners + 3 * i));
        int at = (int)(((is_y ? point.y : point.x) - first) / part);
        corners[at < PARTS ? at : PARTS - 1]++;
    }
    int begin = 0, end = PARTS;
    for (int32_t left_out = 0; (left_out += corners[begin]) <= most;)
        begin++;
    for (int32_t left_out = 0; (left_out += corners[end - 1]) <= most;)
        end--;
    float margin = 0.125f * (float)(end - begin);
    *low = fmaxf(first, first + part * ((float)begin - margin));
    *high = fminf(*high, first + part * ((float)end + margin));
}

/* Across a directional light: the box around the scene, or around most of it where that is less
 * than half as wide: around a room, not around the ground outside its windows. */
static void set_box(LightMap *map, const MeshArrays *mesh) {
    float low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (size_t i = 0; i < 3 * (size_t)mesh->num_triangles; i++) {
        MapPoint point = project(map, vec3(mesh->corners + 3 * i));
        low[0] = fminf(low[0], point.x);
        low[1] = fminf(low[1], point.y);
        high[0] = fmaxf(high[0], point.x);
        high[1] = fmaxf(high[1], point.y);
    }
    float inner_low[2] = {low[0], low[1]}, inner_high[2] = {high[0], high[1]};
    for (int axis = 0; axis < 2; axis++)
        narrow(map, mesh, axis, &inner_low[axis], &inner_high[axis]);
    float side = fmaxf(high[0] - low[0], high[1] - low[1]);
    float inner = fmaxf(inner_high[0] - inner_low[0], inner_high[1] - inner_low[1]);
    int is_narrow = inner < 0.5f * side;
    map->left = (is_narrow ? inner_low : low)[0] - map->tolerance;
    map->top = (is_narrow ? inner_low : low)[1] - map->tolerance;
    set_cells(map, (is_narrow ? inner : side) + 2.0f * map->tolerance);
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
    float highest, lowest;
    int is_steep; /* along the light: its plane has no height */
    int has_holes; /* it hides nothing for certain */
} Caster;

static Caster make_caster(const MapPoint corners[3]) {
    Caster caster = {.corners = {corners[0], corners[1], corners[2]}};
    MapPoint a = caster.corners[0], b = caster.corners[1], c = caster.corners[2];
    caster.highest = fmaxf(a.height, fmaxf(b.height, c.height));
    caster.lowest = fminf(a.height, fminf(b.height, c.height));
    float bx = b.x - a.x, by = b.y - a.y, cx = c.x - a.x, cy = c.y - a.y;
    float area = bx * cy - by * cx, longest = fmaxf(bx * bx + by * by, cx * cx + cy * cy);
    /* Below a slope of a thousand a cell's height is known to a tenth of a per cent. */
    caster.is_steep = fabsf(area) <= 1e-3f * longest;
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

/* Whether a cell lies within the caster. */
static int is_cell_inside(const Caster *caster, float x, float y, float half) {
    for (int i = 0; i < 3; i++) {
        MapPoint from = caster->corners[i], to = caster->corners[(i + 1) % 3];
        MapPoint third = caster->corners[(i + 2) % 3];
        float nx = from.y - to.y, ny = to.x - from.x;
        float inner = nx * (third.x - from.x) + ny * (third.y - from.y);
        float sign = inner < 0.0f ? -1.0f : 1.0f;
        float centre = sign * (nx * (x - from.x) + ny * (y - from.y));
        if (!(centre - half * (fabsf(nx) + fabsf(ny)) > 0.0f))
            return 0;
    }
    return 1;
}

/* Heights of a caster in one cell. */
static void cast_on_cell(const LightMap *map, const Caster *caster, float x, float y, float half,
                         int32_t surface, MapCell *cell) {
    if (caster->is_steep) {
        insert(cell, surface, caster->highest);
        return;
    }
    float centre = caster->at_origin + caster->x_slope * x + caster->y_slope * y;
    float rise = half * (fabsf(caster->x_slope) + fabsf(caster->y_slope)) +
                 height_tolerance(map, caster->highest);
    insert(cell, surface, fminf(centre + rise, caster->highest));
    /* A shadow ray begins beside its point, by less than the tolerance. */
    if (!caster->has_holes && centre - rise > cell->cover && is_cell_inside(caster, x, y, half))
        cell->cover = fmaxf(centre - rise, caster->lowest);
}

static void add_caster(LightMap *map, const MapPoint p[3], int has_holes, int32_t surface) {
    Caster caster = make_caster(p);
    caster.has_holes = has_holes;
    float margin = 2.0f * lateral_tolerance(map, caster.highest);
    float half = 0.5f * map->cell_side + margin;
    float left = fminf(p[0].x, fminf(p[1].x, p[2].x)), right = fmaxf(p[0].x, fmaxf(p[1].x, p[2].x));
    float top = fminf(p[0].y, fminf(p[1].y, p[2].y)), bottom = fmaxf(p[0].y, fmaxf(p[1].y, p[2].y));
    int last_row = cell_of(map, bottom + margin, map->top);
    int last_column = cell_of(map, right + margin, map->left);
    int first_column = cell_of(map, left - margin, map->left);
    for (int row = cell_of(map, top - margin, map->top); row <= last_row; row++)
        for (int column = first_column; column <= last_column; column++) {
            float x = map->left + ((float)column + 0.5f) * map->cell_side;
            float y = map->top + ((float)row + 0.5f) * map->cell_side;
            MapCell *cell = &map->cells[row * map->side + column];
            int last = map->side - 1, is_border = !row || !column || row == last || column == last;
            /* What lies outside a box is in its border, wherever it is. */
            if (is_border && !map->is_perspective)
                insert(cell, surface, caster.highest);
            else if (!is_beside_cell(&caster, x, y, half))
                cast_on_cell(map, &caster, x, y, half, surface, cell);
        }
}

/* The part of a polygon on the inner side of a plane through the light (Sutherland and Hodgman
 * 1974); returns its number of corners. */
static int clip_polygon(const Vec3 *from, int count, Vec3 inward, Vec3 *clipped) {
    int kept = 0;
    for (int i = 0; i < count; i++) {
        Vec3 a = from[i], b = from[(i + 1) % count];
        float here = dot(inward, a), next = dot(inward, b);
        if (here >= 0.0f)
            clipped[kept++] = a;
        if ((here >= 0.0f) != (next >= 0.0f))
            clipped[kept++] = add(a, scale(here / (here - next), subtract(b, a)));
    }
    return kept;
}

/* A caster on a face around a point light; 0 if it reaches to the light, where nothing is known. */
static int add_to_face(LightMap *map, const float *corners, int has_holes, int32_t surface) {
    /* Little more than the face, for the rounding of the cut. */
    const float reach = 1.01f * FACE_REACH;
    Vec3 z = scale(reach, map->towards), polygon[8], other[8];
    Vec3 sides[4] = {add(z, map->x_axis), subtract(z, map->x_axis), add(z, map->y_axis),
                     subtract(z, map->y_axis)};
    int count = 3;
    for (int i = 0; i < 3; i++)
        polygon[i] = subtract(vec3(corners + 3 * i), map->origin);
    for (int side = 0; side < 4 && count; side++) {
        Vec3 *from = side % 2 ? other : polygon, *to = side % 2 ? polygon : other;
        count = clip_polygon(from, count, sides[side], to);
    }
    MapPoint points[8];
    for (int i = 0; i < count; i++) {
        float depth = dot(map->towards, polygon[i]);
        if (!(depth > 100.0f * map->tolerance))
            return 0;
        points[i] = project(map, add(polygon[i], map->origin));
    }
    for (int i = 2; i < count; i++)
        add_caster(map, (MapPoint[3]){points[0], points[i - 1], points[i]}, has_holes, surface);
    return 1;
}

static int add_mesh_triangle(LightMap *map, const float *corners, int has_holes, int32_t surface) {
    if (map->is_perspective)
        return add_to_face(map, corners, has_holes, surface);
    MapPoint points[3];
    for (int i = 0; i < 3; i++)
        points[i] = project(map, vec3(corners + 3 * i));
    add_caster(map, points, has_holes, surface);
    return 1;
}

static void fill_map(LightMaps *maps, LightMap *map, const Scene *scene) {
    const MeshArrays *casters =
        scene->casters ? &scene->casters->arrays : &scene->mesh->arrays;
    size_t count = (size_t)map->side * (size_t)map->side;
    map->cells = malloc(sizeof(MapCell) * count);
    int is_whole = map->cells != NULL;
    for (size_t i = 0; is_whole && i < count; i++)
        map->cells[i] = (MapCell){-INFINITY, -INFINITY, -INFINITY, -1};
    for (int32_t i = 0; is_whole && i < casters->num_triangles; i++) {
        int32_t triangle = scene->caster_triangles ? scene->caster_triangles[i] : i;
        int has_holes = casters->coverage && isfinite(casters->coverage[3 * (size_t)i]);
        is_whole = add_mesh_triangle(map, casters->corners + 9 * (size_t)i, has_holes,
                                     scene->surfaces.surface[triangle]);
    }
    map->is_built = is_whole;
    map->first_cell = maps->num_cells;
    maps->num_cells += is_whole ? count : 0;
}

static void build_box(LightMaps *maps, LightMap *map, const Scene *scene, const Light *light) {
    map->side = MAP_SIDE;
    map->tolerance = TOLERANCE * find_extent(&scene->mesh->arrays, (Vec3){0, 0, 0});
    set_axes(map, vec3(light->vector));
    set_box(map, &scene->mesh->arrays);
    fill_map(maps, map, scene);
}

static void build_faces(LightMaps *maps, LightMap *faces, const Scene *scene,
                        const Light *light) {
    float extent = find_extent(&scene->mesh->arrays, vec3(light->vector));
    for (int face = 0; face < FACES; face++) {
        LightMap *map = faces + face;
        float axis[3] = {0, 0, 0};
        axis[face / 2] = face % 2 ? -1.0f : 1.0f;
        map->is_perspective = 1;
        map->side = FACE_SIDE;
        map->origin = vec3(light->vector);
        map->tolerance = TOLERANCE * extent;
        set_axes(map, vec3(axis));
        map->left = map->top = -FACE_REACH;
        set_cells(map, 2.0f * FACE_REACH);
        fill_map(maps, map, scene);
    }
}

void *catoptra_build_light_maps(const Scene *scene) {
    size_t count = FACES * (size_t)scene->num_lights;
    LightMaps *maps = calloc(1, sizeof *maps + count * sizeof(LightMap));
    if (!maps)
        return NULL;
    int num_points = 0;
    for (int i = 0; i < scene->num_lights && scene->mesh->arrays.num_triangles; i++) {
        const Light *light = &scene->lights[i];
        if (light->kind == LIGHT_DIRECTIONAL)
            build_box(maps, &maps->maps[FACES * i], scene, light);
        else if (num_points++ < MAX_MAPPED_POINT_LIGHTS)
            build_faces(maps, &maps->maps[FACES * i], scene, light);
    }
    return maps;
}

void catoptra_release_light_maps(void *light_maps, int32_t num_lights) {
    LightMaps *maps = light_maps;
    for (int32_t map = 0; maps && map < FACES * num_lights; map++)
        free(maps->maps[map].cells);
    free(maps);
}
