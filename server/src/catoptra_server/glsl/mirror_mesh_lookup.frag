// Provides the atlas coordinates of the samples of a mirror mesh, rendered once per view.
// Twin: catoptra_server.render.trace.mirror_mesh_rays.mirror_mesh_directions.
#include "include/atlas.glsl"
in vec3 direction;
out vec2 position;

void main()
{
    position = atlas_coordinates(direction);
}
