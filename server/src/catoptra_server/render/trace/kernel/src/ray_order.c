/* Provides ray_order.h: rays of a tile by rows or by squares of pixels.
 * No twin. The caller frees an order's table: the view has both.
 * Threads: the thread that prepares the view; only read afterwards. */
#include "ray_order.h"

#include <stdlib.h>

/* Number of a sample of a pixel in the table: blocks of 4 x 4 rays, row by row. */
static uint16_t find_ray(int samples, int pixel, int sample) {
    int row = pixel / TILE_PX * samples + sample / samples;
    int column = pixel % TILE_PX * samples + sample % samples;
    int block = row / TILE_PX * samples + column / TILE_PX;
    return (uint16_t)(block * BLOCK_RAYS + row % TILE_PX * TILE_PX + column % TILE_PX);
}

static int allocate(RayOrder *order, int units, int samples) {
    int pixels = TILE_PX * TILE_PX / units;
    *order = (RayOrder){.units = units, .pixels = pixels};
    order->blocks = (pixels * samples * samples + BLOCK_RAYS - 1) / BLOCK_RAYS;
    order->source = malloc(sizeof(uint16_t) * BLOCK_RAYS * (size_t)(units * order->blocks));
    return order->source != NULL;
}

static void list_rays(RayOrder *order, int samples) {
    for (int i = 0; i < order->units * order->blocks * BLOCK_RAYS; i++) {
        int unit = i / (order->blocks * BLOCK_RAYS), ray = i % (order->blocks * BLOCK_RAYS);
        int sample = ray / order->pixels, pixel = order->pixel[unit][ray % order->pixels];
        order->source[i] = sample < samples * samples ? find_ray(samples, pixel, sample) : NO_RAY;
    }
}

int order_by_row(int samples, RayOrder *order) {
    if (!allocate(order, TILE_PX, samples))
        return 0;
    for (int i = 0; i < TILE_PX * TILE_PX; i++)
        order->pixel[i / TILE_PX][i % TILE_PX] = (uint8_t)i;
    list_rays(order, samples);
    return 1;
}

int order_by_cell(int samples, RayOrder *order) {
    int units = samples == 1 ? 1 : MAX_UNITS;
    if (!allocate(order, units, samples))
        return 0;
    for (int i = 0; i < TILE_PX * TILE_PX; i++) {
        int unit = i / order->pixels, pixel = i % order->pixels;
        int row = unit / 2 * 2 + pixel / 2, column = unit % 2 * 2 + pixel % 2;
        order->pixel[unit][pixel] = (uint8_t)(units == 1 ? i : row * TILE_PX + column);
    }
    list_rays(order, samples);
    order->is_table = samples <= 2;
    return 1;
}
