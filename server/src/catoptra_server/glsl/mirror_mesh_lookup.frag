// Provides the places in the atlas that a polygon mirror's samples look up, drawn once.
// Twin: catoptra_server.render.trace.mirror_mesh_rays.polygon_directions.
#include "include/atlas.glsl"
in vec3 direction;
out vec2 place;

void main()
{
    place = atlas_position(direction);
}
