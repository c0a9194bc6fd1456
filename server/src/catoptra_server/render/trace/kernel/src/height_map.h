/* Height maps of a scene's casters, one across each directional light. */
#ifndef CATOPTRA_HEIGHT_MAP_H
#define CATOPTRA_HEIGHT_MAP_H

#include "kernel.h"
#include "vectors.h"

/* 0.8 MB of cells: finer maps prove more, but wait for memory, and take 1.04 to 1.08 of the time. */
enum { MAP_SIDE = 256, MAP_CELLS = MAP_SIDE * MAP_SIDE };

typedef struct {
    float height; /* of the highest surface in the cell */
    float second; /* of all other surfaces */
    int32_t surface;
} MapCell;

typedef struct {
    int is_built;
    Vec3 towards, x_axis, y_axis; /* unit; the first towards the light */
    float left, top, cell_side, cells_per_metre;
    float tolerance; /* metres by which heights and positions may be wrong */
    MapCell *cells;  /* (MAP_SIDE, MAP_SIDE) */
} LightMap;

typedef struct {
    int32_t *surface_of; /* (n,) surface of each triangle; a number of its own for small ones */
    LightMap maps[];     /* one for each light; not built for point lights */
} LightMaps;

/* A point across and along a light. */
typedef struct {
    float x, y, height;
} MapPoint;

static inline MapPoint project(const LightMap *map, Vec3 point) {
    return (MapPoint){dot(map->x_axis, point), dot(map->y_axis, point), dot(map->towards, point)};
}

/* Row or column of a coordinate; those outside the map belong to its border. */
static inline int cell_of(float coordinate, float first, float cells_per_metre) {
    float cell = (coordinate - first) * cells_per_metre;
    return cell > 0.0f ? cell < (float)(MAP_SIDE - 1) ? (int)cell : MAP_SIDE - 1 : 0;
}

#endif
