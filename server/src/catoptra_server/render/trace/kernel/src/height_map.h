/* Height maps of a scene's casters: one across each directional light, six around a point light.
 *
 * Around a point light the map is projective: the height of a point is the inverse of its depth, in
 * which planes are linear as they are across a directional light. Both kinds share all the rest.
 */
#ifndef CATOPTRA_HEIGHT_MAP_H
#define CATOPTRA_HEIGHT_MAP_H

#include "kernel.h"
#include "vectors.h"

#include <stddef.h>

/* 4 MB of cells. */
enum { MAP_SIDE = 512, FACE_SIDE = 128, FACES = 6 };
/* Faces reach beyond the side of their cube, for parts of the image that lie on two. */
#define FACE_REACH 1.25f
/* Maps of the first point lights only: a megabyte and a half each. */
enum { MAX_MAPPED_POINT_LIGHTS = 16 };

typedef struct {
    float height; /* of the highest surface in the cell */
    float second; /* of all other surfaces */
    float cover;  /* lowest height of a triangle that covers the whole cell */
    int32_t surface;
} MapCell;

typedef struct {
    int is_built, is_perspective;
    int side;
    Vec3 origin;                  /* the position of a point light */
    Vec3 towards, x_axis, y_axis; /* unit; towards a directional light, away from a point light */
    float left, top, cell_side, cells_per_metre;
    float tolerance;    /* metres by which heights and positions may be wrong */
    size_t first_cell;  /* of the map in an array of all maps' cells */
    MapCell *cells;     /* (side, side) */
} LightMap;

typedef struct {
    size_t num_cells; /* of all maps */
    LightMap maps[];  /* FACES for each light, of which a directional light has the first */
} LightMaps;

/* A point across and along a light. */
typedef struct {
    float x, y, height;
} MapPoint;

static inline MapPoint project(const LightMap *map, Vec3 point) {
    Vec3 p = subtract(point, map->origin);
    MapPoint at = {dot(map->x_axis, p), dot(map->y_axis, p), dot(map->towards, p)};
    if (map->is_perspective) {
        float inverse = 1.0f / at.height;
        at = (MapPoint){at.x * inverse, at.y * inverse, inverse};
    }
    return at;
}

/* Errors of the height of a point, and of its place in the map. */
static inline float height_tolerance(const LightMap *map, float height) {
    return map->is_perspective ? map->tolerance * height * height : map->tolerance;
}

static inline float lateral_tolerance(const LightMap *map, float height) {
    return map->is_perspective ? map->tolerance * height : map->tolerance;
}

/* Row or column of a coordinate; those outside the map belong to its border. */
static inline int cell_of(const LightMap *map, float coordinate, float first) {
    float cell = (coordinate - first) * map->cells_per_metre;
    int last = map->side - 1;
    return cell > 0.0f ? cell < (float)last ? (int)cell : last : 0;
}

#endif
