// Provides the linear radiance of the sky in the direction of a fragment.
// Twin: catoptra_server.world.panorama.Panorama.radiance.
uniform sampler2D sky;               // octahedral, up in the middle, with a border of one texel
uniform vec4 viewport;               // left, bottom, width, height of the planar image
uniform mat3 scene_from_clip;        // of clip x, y and w
layout(location = 0) out vec4 colour;

void main()
{
    vec2 clip = 2.0 * (gl_FragCoord.xy - viewport.xy) / viewport.zw - 1.0;
    vec3 direction = scene_from_clip * vec3(clip, 1.0);
    direction /= dot(abs(direction), vec3(1.0));
    vec2 outer = (1.0 - abs(direction.yx)) * mix(vec2(1.0), vec2(-1.0), lessThan(direction.xy, vec2(0.0)));
    float size = float(textureSize(sky, 0).x - 2);
    vec2 place = 0.5 * size * (direction.z > 0.0 ? outer : direction.xy) + (0.5 * size + 0.5);
    ivec2 first = clamp(ivec2(floor(place)), ivec2(0), ivec2(int(size)));
    vec2 part = place - vec2(first);
    // Not by the texture unit, whose weights have 8 bits.
    vec3 upper = mix(texelFetch(sky, first, 0).rgb, texelFetch(sky, first + ivec2(1, 0), 0).rgb, part.x);
    vec3 lower = mix(texelFetch(sky, first + ivec2(0, 1), 0).rgb,
                     texelFetch(sky, first + ivec2(1, 1), 0).rgb, part.x);
    colour = vec4(mix(upper, lower, part.y), 1.0);
}
