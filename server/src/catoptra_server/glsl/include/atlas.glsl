// Provides vec2 atlas_position(vec3 direction), and the linear vec3 radiance_seen(direction).
// Twin: catoptra_protocol.optics.cube.face_from_direction; then face_coordinates, scaled.
uniform sampler2D atlas;
uniform vec2 face_centre[FACES];     // texel position of each face's middle; in the order of Face
uniform float texels_per_unit;       // half a face's width in texels
uniform vec2 atlas_texel;            // one over the atlas' width and height

// Turned into the face's own axes the direction is (forward, right, down). The largest forward
// wins, the first of equals. The upward face takes part only where it is drawn.
vec2 atlas_position(vec3 direction)
{
    vec3 local = direction;
    vec2 centre = face_centre[0];
    if (direction.y > local.x) {
        local = vec3(direction.y, -direction.x, direction.z);
        centre = face_centre[1];
    }
    if (-direction.x > local.x) {
        local = vec3(-direction.x, -direction.y, direction.z);
        centre = face_centre[2];
    }
    if (-direction.y > local.x) {
        local = vec3(-direction.y, direction.x, direction.z);
        centre = face_centre[3];
    }
    if (direction.z > local.x) {
        local = vec3(direction.z, direction.y, -direction.x);
        centre = face_centre[4];
    }
#if FACES > 5
    if (-direction.z > local.x) {
        local = vec3(-direction.z, direction.y, direction.x);
        centre = face_centre[5];
    }
#endif
    // Without the upward face a coarse polygon mirror may look past a side face's upper edge; its
    // last row is shown there, as a clamped texture would.
    vec2 st = clamp(local.yz / max(local.x, 1e-30), -1.0, 1.0);
    return (centre + st * texels_per_unit) * atlas_texel;
}

vec3 radiance_seen(vec3 direction)
{
    return textureLod(atlas, atlas_position(direction), 0.0).rgb;
}
