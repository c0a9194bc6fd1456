/* Provides catoptra_prepare and the beams of a view: tiles from their rays, larger parts from four
 * smaller ones.
 * No twin: conservative bounds. The view owns tables and beams until catoptra_release_view; the
 * rays stay Python's.
 * Threads: the calling thread alone; a prepared view is only read. */
#include "beams.h"

#include "beam_origins.h"
#include "device.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Beams are widened by this, in tangents: rays are float32, and are rotated in float32. */
#define MARGIN 4e-6f
/* Least cosine between a beam's axis and its rays: wider beams are too coarse to bound anything. */
#define MIN_COSINE 0.3f

static Vec3 normalize(Vec3 a) {
    float length = sqrtf(dot(a, a));
    return length > 0.0f ? scale(1.0f / length, a) : a;
}

static Vec3 reject(Vec3 a, Vec3 axis) { return subtract(a, scale(dot(a, axis), axis)); }

/* Any direction perpendicular to a unit vector. */
static Vec3 perpendicular(Vec3 axis) {
    Vec3 other = axis.x * axis.x < 0.5f ? (Vec3){1, 0, 0} : (Vec3){0, 1, 0};
    return normalize(cross(axis, other));
}

/* Sides of the pyramid: parallel to the part's own sides, where these have directions. */
static void set_sides(Beam *beam) {
    Vec3 across = normalize(reject(beam->across, beam->axis));
    Vec3 down = normalize(reject(beam->down, beam->axis));
    beam->a = cross(beam->axis, across);
    beam->b = cross(beam->axis, down);
    Vec3 skew = cross(beam->a, beam->b);
    if (dot(skew, skew) < 0.05f) {
        beam->a = perpendicular(beam->axis);
        beam->b = cross(beam->axis, beam->a);
    }
}

/* Pyramid with the sides of `beam` around directions; wide if some are far from the axis. */
static void enclose(Beam *beam, const Vec3 *directions, int count) {
    Vec3 sum = {0, 0, 0};
    for (int i = 0; i < count; i++)
        sum = add(sum, directions[i]);
    beam->kind = count ? BEAM_WIDE : BEAM_EMPTY;
    if (dot(sum, sum) == 0.0f)
        return;
    beam->axis = normalize(sum);
    set_sides(beam);
    beam->a_min = beam->b_min = INFINITY;
    beam->a_max = beam->b_max = -INFINITY;
    for (int i = 0; i < count; i++) {
        float along = dot(beam->axis, directions[i]);
        if (along < MIN_COSINE)
            return;
        float a = dot(beam->a, directions[i]) / along, b = dot(beam->b, directions[i]) / along;
        beam->a_min = fminf(beam->a_min, a - MARGIN);
        beam->a_max = fmaxf(beam->a_max, a + MARGIN);
        beam->b_min = fminf(beam->b_min, b - MARGIN);
        beam->b_max = fmaxf(beam->b_max, b + MARGIN);
    }
    beam->kind = BEAM_NARROW;
}

int is_direction_inside(const Beam *beam, Vec3 direction) {
    float along = dot(beam->axis, direction);
    float a = dot(beam->a, direction) / along, b = dot(beam->b, direction) / along;
    return along >= MIN_COSINE && a - MARGIN >= beam->a_min && a + MARGIN <= beam->a_max &&
           b - MARGIN >= beam->b_min && b + MARGIN <= beam->b_max;
}

/* Unit direction of a pyramid's edge: the solution of a.x = a_value, b.x = b_value, axis.x = 1. */
static Vec3 edge_direction(const Beam *beam, float a_value, float b_value) {
    float mixed = dot(beam->a, beam->b), aa = dot(beam->a, beam->a), bb = dot(beam->b, beam->b);
    float determinant = aa * bb - mixed * mixed;
    float s = (a_value * bb - b_value * mixed) / determinant;
    float t = (b_value * aa - a_value * mixed) / determinant;
    return normalize(add(beam->axis, add(scale(s, beam->a), scale(t, beam->b))));
}

int list_beam_edges(const Beam *beam, Vec3 *edges) {
    if (beam->kind != BEAM_NARROW)
        return 0;
    edges[0] = edge_direction(beam, beam->a_min, beam->b_min);
    edges[1] = edge_direction(beam, beam->a_min, beam->b_max);
    edges[2] = edge_direction(beam, beam->a_max, beam->b_min);
    edges[3] = edge_direction(beam, beam->a_max, beam->b_max);
    return 4;
}

/* All valid rays of a tile, and the mean differences between its rays along rows and columns. */
static void enclose_tile(const RayTable *rays, int tile, Beam *beam, Vec3 *directions) {
    int samples = rays->samples, count = 0, blocks = samples * samples;
    Vec3 across = {0, 0, 0}, down = {0, 0, 0};
    float middle = 0.5f * (float)(TILE_PX * samples - 1);
    for (int block = 0; block < blocks; block++) {
        const float *base = rays->directions + ((size_t)tile * blocks + block) * 3 * BLOCK_RAYS;
        uint32_t valid = rays->valid[(size_t)tile * blocks + block];
        for (int lane = 0; lane < BLOCK_RAYS; lane++) {
            if (!(valid >> lane & 1))
                continue;
            Vec3 direction = {base[lane], base[BLOCK_RAYS + lane], base[2 * BLOCK_RAYS + lane]};
            int column = block % samples * TILE_PX + lane % TILE_PX;
            int row = block / samples * TILE_PX + lane / TILE_PX;
            across = add(across, scale((float)column - middle, direction));
            down = add(down, scale((float)row - middle, direction));
            directions[count++] = direction;
        }
    }
    beam->across = across;
    beam->down = down;
    enclose(beam, directions, count);
}

static void enclose_children(const BeamLevel *children, int row, int column, Beam *beam,
                             BeamOrigin *origin) {
    const BeamOrigin *origins[4] = {NULL, NULL, NULL, NULL};
    Vec3 edges[16];
    int count = 0, is_wide = 0;
    beam->across = beam->down = (Vec3){0, 0, 0};
    for (int child = 0; child < 4; child++) {
        int child_row = 2 * row + child / 2, child_column = 2 * column + child % 2;
        if (child_row >= children->rows || child_column >= children->columns)
            continue;
        int at = child_row * children->columns + child_column;
        const Beam *part = &children->beams[at];
        is_wide |= part->kind == BEAM_WIDE;
        if (part->kind != BEAM_NARROW)
            continue;
        beam->across = add(beam->across, part->across);
        beam->down = add(beam->down, part->down);
        count += list_beam_edges(part, edges + count);
        origins[child] = children->origins ? children->origins + at : NULL;
    }
    enclose(beam, edges, count);
    if (is_wide)
        beam->kind = BEAM_WIDE;
    if (origin && beam->kind == BEAM_NARROW)
        enclose_part_origins(origins, beam, origin);
}

static int allocate_level(const View *view, int rows, int columns, BeamLevel *level) {
    size_t count = (size_t)rows * (size_t)columns;
    *level = (BeamLevel){rows, columns, calloc(count, sizeof(Beam)), NULL};
    if (view->rays.origins)
        level->origins = calloc(count, sizeof(BeamOrigin));
    return level->beams && (level->origins || !view->rays.origins);
}

static int build_levels(View *view) {
    Vec3 *directions = malloc(sizeof(Vec3) * BLOCK_RAYS * MAX_SAMPLES * MAX_SAMPLES);
    if (!directions)
        return 0;
    int rows = view->tile_rows, columns = view->rays.tile_columns, is_whole = 1;
    for (int level = 0; level < BEAM_LEVELS && is_whole; level++) {
        BeamLevel *parts = &view->levels[level];
        is_whole = allocate_level(view, rows, columns, parts);
        for (int part = 0; is_whole && part < rows * columns; part++) {
            Beam *beam = &parts->beams[part];
            BeamOrigin *origin = parts->origins ? parts->origins + part : NULL;
            if (level)
                enclose_children(parts - 1, part / columns, part % columns, beam, origin);
            else if (view->tile_at[part] >= 0)
                enclose_tile(&view->rays, view->tile_at[part], beam, directions);
            if (!level && origin && beam->kind == BEAM_NARROW)
                enclose_tile_origins(&view->rays, view->tile_at[part], beam, origin);
        }
        rows = (rows + 1) / 2;
        columns = (columns + 1) / 2;
    }
    free(directions);
    return is_whole;
}

/* Largest distance of a ray's origin from the viewpoint; those of invalid rays are at it. */
static float find_max_origin(const RayTable *rays) {
    size_t blocks = (size_t)rays->num_tiles * (size_t)rays->samples * (size_t)rays->samples;
    float squared = 0.0f;
    for (size_t block = 0; rays->origins && block < blocks; block++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++) {
            Vec3 origin = get_lane(
                (const float(*)[BLOCK_RAYS])(rays->origins + block * 3 * BLOCK_RAYS), lane);
            squared = fmaxf(squared, dot(origin, origin));
        }
    return sqrtf(squared);
}

/* Columns and rows per change of the direction: the inverse of the mean differences between
 * neighbouring rays, in the plane of these differences; zero where no two rays are neighbours. */
static void find_pixel_scale(const RayTable *rays, int tile, float *pixel_scale) {
    int blocks = rays->samples * rays->samples, columns = 0, rows = 0;
    Vec3 across = {0, 0, 0}, down = {0, 0, 0};
    for (int block = 0; block < blocks; block++) {
        size_t at = (size_t)tile * (size_t)blocks + (size_t)block;
        const float(*directions)[BLOCK_RAYS] =
            (const float(*)[BLOCK_RAYS])(rays->directions + at * 3 * BLOCK_RAYS);
        for (int lane = 0; lane < BLOCK_RAYS; lane++) {
            uint32_t valid = (uint32_t)rays->valid[at] >> lane;
            if ((valid & 3) == 3 && lane % TILE_PX < TILE_PX - 1 && ++columns)
                across = add(across, subtract(get_lane(directions, lane + 1),
                                              get_lane(directions, lane)));
            if ((valid & 17) == 17 && lane / TILE_PX < TILE_PX - 1 && ++rows)
                down = add(down, subtract(get_lane(directions, lane + TILE_PX),
                                          get_lane(directions, lane)));
        }
    }
    if (!columns || !rows)
        return;
    across = scale((float)rays->samples / (float)columns, across);
    down = scale((float)rays->samples / (float)rows, down);
    float aa = dot(across, across), bb = dot(down, down), ab = dot(across, down);
    float determinant = aa * bb - ab * ab;
    if (!(determinant > 0.0f))
        return;
    Vec3 column = subtract(scale(bb / determinant, across), scale(ab / determinant, down));
    Vec3 row = subtract(scale(aa / determinant, down), scale(ab / determinant, across));
    memcpy(pixel_scale, &column, sizeof column);
    memcpy(pixel_scale + 3, &row, sizeof row);
}

static int build_pixel_scales(View *view) {
    view->pixel_scales = calloc((size_t)view->rays.num_tiles + 1, 6 * sizeof(float));
    for (int32_t tile = 0; view->pixel_scales && tile < view->rays.num_tiles; tile++)
        find_pixel_scale(&view->rays, tile, view->pixel_scales + 6 * (size_t)tile);
    return view->pixel_scales != NULL;
}

/* What rays without times of their own have. */
static int build_tables(View *view) {
    return build_levels(view) && build_pixel_scales(view) &&
           order_by_row(view->rays.samples, &view->by_row) &&
           order_by_cell(view->rays.samples, &view->by_cell);
}

View *catoptra_prepare(Device *device, const RayTable *rays, char *error) {
    (void)device;
    View *view = calloc(1, sizeof *view);
    if (view) {
        view->rays = *rays;
        view->max_origin_m = find_max_origin(rays);
        view->tile_rows = (rays->height_px + TILE_PX - 1) / TILE_PX;
        size_t tiles = (size_t)view->tile_rows * (size_t)rays->tile_columns;
        view->tile_at = malloc(sizeof(int32_t) * tiles);
        for (size_t tile = 0; view->tile_at && tile < tiles; tile++)
            view->tile_at[tile] = -1;
        for (int32_t i = 0; view->tile_at && i < rays->num_tiles; i++)
            view->tile_at[rays->tiles[i]] = i;
    }
    if (!view || !view->tile_at || (!rays->times && !build_tables(view))) {
        if (view)
            catoptra_release_view(view);
        snprintf(error, ERROR_SIZE, "out of memory");
        return NULL;
    }
    return view;
}

int64_t catoptra_view_bytes(const View *view) {
    int64_t bytes = (int64_t)sizeof(int32_t) * view->tile_rows * view->rays.tile_columns;
    for (int level = 0; level < BEAM_LEVELS; level++) {
        const BeamLevel *parts = &view->levels[level];
        size_t part = (parts->beams ? sizeof(Beam) : 0) + (parts->origins ? sizeof(BeamOrigin) : 0);
        bytes += (int64_t)part * parts->rows * parts->columns;
    }
    if (view->pixel_scales)
        bytes += (int64_t)sizeof(float) * 6 * view->rays.num_tiles;
    return bytes;
}

void catoptra_release_view(View *view) {
    for (int level = 0; level < BEAM_LEVELS; level++) {
        free(view->levels[level].beams);
        free(view->levels[level].origins);
    }
    free(view->by_row.source);
    free(view->by_cell.source);
    free(view->pixel_scales);
    free(view->tile_at);
    free(view);
}
