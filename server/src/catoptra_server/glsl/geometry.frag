// Provides the range of a surface from the viewpoint, and whose it is.
// Twin: catoptra_server.render.trace.pixel_geometry.PixelGeometry.of.
uniform float mover;                 // 0: the scene; n: the exposure's n-th body
in vec3 place;
out vec2 seen;

void main()
{
    seen = vec2(length(place), mover);
}
