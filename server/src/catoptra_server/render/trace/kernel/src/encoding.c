/* Provides encoding.h: grey levels of linear light by a table.
 * Float64 twin: world/world_description.py:srgb_from_linear. The table is static, filled once.
 * Threads: prepare_encoding: the calling thread, before the pool starts. encode_level: any. */
#include "encoding.h"

#include "lanes.h"

#include <math.h>

enum { STEPS = 4096, NEWTON_STEPS = 12, CODES = 256, WHITE_CODE = 223, CODES_PER_OCTAVE = 4 };

static float levels[STEPS + 2], code_levels[CODES], code_lights[CODES];

/* x^(1 / 2.4) = q * cbrt(q^2) with q the fourth root of x, at least 0.2: the cube root by
 * Newton's method, since the last bits of a library's `pow` depend on the processor. */
static double encode(double x) {
    double fourth_root = sqrt(sqrt(x)), square = fourth_root * fourth_root, cube_root = 1.0;
    for (int step = 0; step < NEWTON_STEPS; step++)
        cube_root = (2.0 * cube_root + square / (cube_root * cube_root)) / 3.0;
    return x <= 0.0031308 ? 12.92 * x : 1.055 * fourth_root * cube_root - 0.055;
}

void prepare_encoding(void) {
    /* The last entry says that all others are there; two threads write the same values. */
    if (levels[STEPS + 1] != 0.0f)
        return;
    double light = 1.0, step = sqrt(sqrt(2.0));
    for (int code = 0; code < CODES; code++) {
        if (code > WHITE_CODE)
            code_lights[code] = (float)(light *= step);
        code_levels[code] = (float)(255.0 * (code > WHITE_CODE ? encode(light)
                                                               : (double)code / WHITE_CODE));
    }
    for (int i = 0; i < STEPS + 2; i++) {
        levels[i] = (float)(255.0 * encode((double)i / STEPS));
    }
}

uint8_t code_of_light(float linear) {
    if (!(linear > 1.0f))
        return (uint8_t)(encode_level(linear) * ((float)WHITE_CODE / 255.0f) + 0.5f);
    int octave, last = CODES - 1 - WHITE_CODE;
    float mantissa = frexpf(linear, &octave); /* from 1/2 to 1 */
    int step = CODES_PER_OCTAVE * (octave - 1) + (mantissa >= 0.59460356f) +
               (mantissa >= 0.70710678f) + (mantissa >= 0.84089642f);
    return (uint8_t)(WHITE_CODE + (linear < INFINITY && step < last ? step : last));
}

float level_of_code(uint8_t code) { return code_levels[code]; }

float light_of_code(uint8_t code) { return code_lights[code]; }

float encode_level(float linear) {
    float position = (linear > 0.0f ? linear < 1.0f ? linear : 1.0f : 0.0f) * (float)STEPS;
    int step = (int)position;
    return levels[step] + (position - (float)step) * (levels[step + 1] - levels[step]);
}

void encode_levels(const float linear[16], float encoded[16]) {
    Floats16 zero = splat16(0.0f), light = least16(load16(linear), splat16(1.0f));
    Floats16 position = select16(load16(linear) > zero, light, zero) * (float)STEPS;
    Ints16 step = __builtin_convertvector(position, Ints16);
    float low[16], high[16];
    for (int lane = 0; lane < 16; lane++) {
        low[lane] = levels[step[lane]];
        high[lane] = levels[step[lane] + 1];
    }
    Floats16 part = position - __builtin_convertvector(step, Floats16);
    store16(load16(low) + part * (load16(high) - load16(low)), encoded);
}
