/* sRGB of linear light in grey levels, not rounded: by a table between whose entries it is linear.
 * Error: at most 0.005 grey levels, where the curve leaves its linear part. */
#ifndef CATOPTRA_ENCODING_H
#define CATOPTRA_ENCODING_H

/* Grey levels, 0 to 255, of linear light, which is clipped to [0, 1]. */
float encode_level(float linear);

/* Fill the table; before any other thread encodes. */
void prepare_encoding(void);

#endif
