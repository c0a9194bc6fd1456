// Provides vec3 texture_mean(image, coordinates, offset), the mean of a texture over a sample.
// Twin: catoptra_server.world.textures.footprint_texels, sample_levels.

// Polynomials in the cosine of the angle to the camera's axis, scaled to -1 to 1: logarithms of the
// angles between samples along the circles through the axis (x) and across them (y). Twin:
// catoptra_server.render.raster.device.SampleSpacing.at.
const int SPACING_TERMS = 8;
uniform vec2 log_spacing[SPACING_TERMS];
uniform vec3 spacing_axis;           // unit, world axes
uniform vec2 cosine_limits;          // smallest and largest in the image
uniform float has_spacing;           // 0: samples are the fragments themselves
uniform vec2 missing_levels = vec2(0.0, 1.0);   // finer than the texture's first, and 2 to that power

const float MAX_STRETCH = 3.0;

float footprint_of(mat2 steps)
{
    float squares = dot(steps[0], steps[0]) + dot(steps[1], steps[1]);
    float area = abs(determinant(steps));
    float root = sqrt(max(squares - 2.0 * area, 0.0) * (squares + 2.0 * area));
    float longer = sqrt(0.5 * (squares + root));
    return longer > 0.0 ? min(longer, MAX_STRETCH * area / longer) : 0.0;
}

// Angles between samples in a direction.
vec2 spacing_at(float cosine)
{
    float x = (2.0 * cosine - cosine_limits.x - cosine_limits.y) / (cosine_limits.y - cosine_limits.x);
    x = clamp(x, -1.0, 1.0);
    vec2 value = log_spacing[SPACING_TERMS - 1];
    for (int term = SPACING_TERMS - 2; term >= 0; term--)
        value = value * x + log_spacing[term];
    return exp(value);
}

// Texels between the samples of the image, from those between fragments: both see the surface along
// the same plane, which maps angles to texels linearly.
mat2 steps_of_samples(mat2 fragment_steps, vec3 direction, vec3 right, vec3 down)
{
    vec3 across = cross(spacing_axis, direction);
    float sine = length(across);
    // On the axis itself both angles are equal, and any two perpendicular directions do.
    across = sine > 1e-4 ? across / sine : normalize(cross(direction, spacing_axis.yzx));
    vec3 along = cross(across, direction);
    mat2 angles = mat2(dot(along, right), dot(across, right), dot(along, down), dot(across, down));
    vec2 spacing = spacing_at(dot(spacing_axis, direction));
    return fragment_steps * inverse(angles) * mat2(spacing.x, 0.0, 0.0, spacing.y);
}

vec3 texture_mean(sampler2D image, vec2 coordinates, vec3 offset)
{
    vec3 direction = normalize(offset);
    vec2 size = vec2(textureSize(image, 0)) * missing_levels.y;
    mat2 fragment_steps = mat2(dFdx(coordinates) * size, dFdy(coordinates) * size);
    float footprint = footprint_of(fragment_steps);
    if (has_spacing > 0.0)
    {
        mat2 steps = steps_of_samples(fragment_steps, direction, dFdx(direction), dFdy(direction));
        // Where fragments are coarser than samples, they are what must not alias.
        footprint = max(footprint, footprint_of(steps));
    }
    if (!(footprint > 1.0))
        return textureLod(image, coordinates, 0.0).rgb;
    float level = floor(log2(footprint));
    float weight = max(2.0 * footprint * exp2(-level) - 3.0, 0.0);
    return textureLod(image, coordinates, level + weight - missing_levels.x).rgb;
}
