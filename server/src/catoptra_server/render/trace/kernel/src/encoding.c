/* Provides encoding.h: grey levels of linear light by a table.
 * Float64 twin: world/world_description.py:srgb_from_linear. The table is static, filled once.
 * Threads: prepare_encoding: the calling thread, before the pool starts. encode_level: any. */
#include "encoding.h"

#include <math.h>

enum { STEPS = 4096 };

static float levels[STEPS + 2];

void prepare_encoding(void) {
    /* The last entry says that all others are there; two threads write the same values. */
    if (levels[STEPS + 1] != 0.0f)
        return;
    for (int i = 0; i < STEPS + 2; i++) {
        double x = (double)i / STEPS;
        double encoded = x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1.0 / 2.4) - 0.055;
        levels[i] = (float)(255.0 * encoded);
    }
}

float encode_level(float linear) {
    float position = (linear > 0.0f ? linear < 1.0f ? linear : 1.0f : 0.0f) * (float)STEPS;
    int step = (int)position;
    return levels[step] + (position - (float)step) * (levels[step + 1] - levels[step]);
}
