#include "pixels.h"

TilePixels find_pixels(const FrameState *state, int tile) {
    const RayTable *table = state->rays;
    int32_t number = table->tiles[tile];
    int top = number / table->tile_columns * TILE_PX, left = number % table->tile_columns * TILE_PX;
    size_t pixel_bytes = state->frame->output == OUTPUT_LINEAR ? 3 * sizeof(float) : 3;
    size_t row_bytes = (size_t)table->width_px * pixel_bytes;
    int rows = table->height_px - top, columns = table->width_px - left;
    return (TilePixels){
        .first = (char *)state->frame->image + (size_t)top * row_bytes + (size_t)left * pixel_bytes,
        .row_bytes = row_bytes,
        .pixel_bytes = pixel_bytes,
        .rows = rows < TILE_PX ? rows : TILE_PX,
        .columns = columns < TILE_PX ? columns : TILE_PX,
    };
}

/* Mean of a pixel's samples, summed row by row. */
static Vec3 mean_of_pixel(const SampleGrid *grid, int samples, int row, int column) {
    Vec3 sum = {0, 0, 0};
    for (int y = row * samples; y < (row + 1) * samples; y++)
        for (int x = column * samples; x < (column + 1) * samples; x++)
            sum = add(sum, grid->radiance[y][x]);
    return scale(1.0f / (float)(samples * samples), sum);
}

void write_pixels(const FrameState *state, int tile, const SampleGrid *grid) {
    TilePixels pixels = find_pixels(state, tile);
    for (int row = 0; row < pixels.rows; row++)
        for (int column = 0; column < pixels.columns; column++)
            write_mean(state, pixel_at(&pixels, row, column),
                       mean_of_pixel(grid, state->rays->samples, row, column));
}

void store_radiance(const FrameState *state, int block, uint32_t active, const Vec3 *radiance,
                    SampleGrid *grid) {
    int samples = state->rays->samples;
    int top = block / samples * TILE_PX, left = block % samples * TILE_PX;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        Vec3 *sample = &grid->radiance[top + lane / TILE_PX][left + lane % TILE_PX];
        /* A sensor clips, linear light does not. */
        if (!(active >> lane & 1))
            *sample = (Vec3){0, 0, 0};
        else
            *sample = state->frame->output == OUTPUT_SRGB ? clip3(radiance[lane]) : radiance[lane];
    }
}
