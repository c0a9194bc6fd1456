/* Image effects: a linear image changed stage by stage, and encoded.
 *
 * Python twins: kernel/image.py fills the stages, effects/ has the formulas in float64. Maps are
 * arrays of the image's size, row by row.
 */
#ifndef CATOPTRA_IMAGE_H
#define CATOPTRA_IMAGE_H

#include "kernel.h"

enum {
    STAGE_GAIN = 0,      /* L g;  maps[0] g (h, w) or NULL for numbers[0..2] by colour */
    STAGE_AUTO_GAIN = 1, /* L target / mean luminance;  numbers: target, least and largest gain */
    STAGE_CLIPPED_GAIN = 2, /* min(L, 1) numbers[0..2] */
    STAGE_RESPONSE = 3,  /* maps[0] light shown by L / (1 + L), or NULL for a
                          * shoulder;  numbers: knee, 1 - knee, 1 / white^2 above it */
    STAGE_COVER = 4,     /* L + c (numbers[0] mean luminance - L);  maps[0] c (h, w) */
    STAGE_PATTERN = 5,   /* L g + o;  maps[0] g, maps[1] o (3, h, w) */
    STAGE_QUANTISE = 6,  /* codes;  numbers[0] of white */
    STAGE_SHOT_NOISE = 7,  /* numbers[0] radiance of one electron;  key */
    STAGE_READ_NOISE = 8,  /* numbers[0] standard deviation;  key */
    STAGE_GLARE = 9,     /* see image_glare.c */
    STAGE_BLUR = 10,      /* see image_blur.c */
    STAGE_WARP = 11,     /* maps[0], maps[1] offsets in u and v, maps[2] fraction kept, (h, w) */
    STAGE_MAGNIFY = 12,  /* maps[0] offsets of columns (2, w), maps[1] of rows (2, h): red, blue */
    STAGE_BLOOM = 13,    /* numbers[0] overflowing fraction;  size: rows */
    STAGE_BAYER = 14,
    STAGE_GHOST = 15     /* L maps[0] + maps[1] of the opposite pixel;  numbers: sums of both
                          * columns, rows */
};

typedef struct {
    int32_t kind;
    int32_t size;       /* of a blur's or an overflow's reach, or of a side of a glare's cell, px */
    int32_t num_rows;   /* of a blur's table, or of a glare's sources */
    ChangeLimits limits;
    float least_gain, largest_gain; /* from the stage's light to that of the finished picture */
    float spill[2];     /* gain up to the well; part of what is above that reaches other pixels */
    float numbers[4];
    uint32_t key[4];
    const void *maps[4];
    PixelChange change;       /* result of a stage with limits */
    PixelChange other_change; /* result of a blur by range: change of the image without any blur */
    float *deferred;    /* of a first blur by range: (cells,) zero, for its changes above the
                         * limit, of which the lens behind decides; or NULL */
    double ms;          /* result */
} ImageStage;

typedef struct {
    int32_t width, height;
    const float *light; /* (h, w, 3) linear */
    float *linear;      /* (h, w, 3) result, or NULL */
    uint8_t *rgb;       /* (h, w, 3) result, or NULL */
    const uint8_t *srgb_table; /* (65536,) */
    const float *quantiles;    /* (65536,) of the normal distribution, for noise; or NULL */
    int32_t mirror_pixels;     /* pixels whose centre sees the mirror, for mean luminances */
    int32_t num_stages;
    ImageStage *stages;
    void *scratch;    /* catoptra_image_scratch bytes, aligned to 64 */
    double encode_ms; /* result, with the change of the array's layout */
} ImageJob;

/* Bytes that a job works in. */
CATOPTRA_EXPORT int64_t catoptra_image_scratch(const ImageJob *job);

CATOPTRA_EXPORT void catoptra_change_image(Device *device, ImageJob *job);

#endif
