/* sRGB of linear light in grey levels, not rounded: by a table between whose entries it is linear.
 * Error: at most 0.005 grey levels, where the curve leaves its linear part. */
#ifndef CATOPTRA_ENCODING_H
#define CATOPTRA_ENCODING_H

#include <stdint.h>

/* Grey levels, 0 to 255, of linear light, which is clipped to [0, 1]. */
float encode_level(float linear);

/* The same of 16 values. */
void encode_levels(const float linear[16], float encoded[16]);

/* Light in eight bits, for fast extremes: grey levels up to white, quarters of an octave beyond. */
uint8_t code_of_light(float linear);

/* The grey level of a code; beyond white the curve goes on. */
float level_of_code(uint8_t code);

/* The light of a code beyond white; 0 up to white. */
float light_of_code(uint8_t code);

/* Fill the tables; before any other thread encodes. */
void prepare_encoding(void);

#endif
